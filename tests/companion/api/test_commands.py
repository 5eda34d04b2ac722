"""Commands of a program that meet each other, or the end of its block; the flight's process is none."""

import asyncio
import os
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import pytest

from companion import Companion, FlightError, Mission, Phase, State, Waypoint
from companion.api.companion import lines
from companion.outcomes import recorded
from companion.records import LOGGED, OPERATION, OperationKind
from protocol.flightlog import TEXT

NOWHERE = (0.0, 0.0, 0.0)


class Process:
    """In place of a flight's process: its own pipes, and it ends once its input does."""

    def __init__(self) -> None:
        self.stdin, self.stderr, self.left = self, self, asyncio.Event()
        self.given: list[bytes] = []

    def write(self, data: bytes) -> None:
        self.given.append(data)

    def close(self) -> None:
        self.left.set()

    async def wait(self) -> int:
        await self.left.wait()
        return 0

    async def read(self, _: int) -> bytes:
        await self.left.wait()
        return b""


class Speaking(Process):
    """Says something first."""

    def __init__(self, *said: bytes) -> None:
        super().__init__()
        self.said = list(said)

    async def read(self, most: int) -> bytes:
        return self.said.pop(0) if self.said else await super().read(most)


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[Process]:
    """The processes that were started."""
    found: list[Process] = []

    async def start(*_: Any, **__: Any) -> Process:
        await asyncio.sleep(0.01)
        found.append(Process())
        return found[-1]

    monkeypatch.setattr(asyncio, "create_subprocess_exec", start)
    return found


def at(phase: Phase, step: int) -> State:
    return State(0.0, phase, step, NOWHERE, NOWHERE, (1.0, 0.0, 0.0, 0.0), NOWHERE, 1.0)


def run(flight: Callable[[Companion], Awaitable[None]]) -> None:
    async def whole() -> None:
        async with asyncio.timeout(10.0):
            await flight(Companion.connect("udpin:127.0.0.1:0"))

    asyncio.run(whole())


def test_two_commands_at_once_begin_one_flight(started: list[Process]) -> None:
    async def flight(vehicle: Companion) -> None:
        async with vehicle:
            first, second = (asyncio.create_task(vehicle.take_off(height)) for height in (3.0, 4.0))
            with pytest.raises(FlightError, match="not in the air"):
                await second
            first.cancel()

    run(flight)
    (process,) = started
    assert process.left.is_set() and process.given == []


def test_a_flight_that_begins_while_its_block_is_left_is_ended(started: list[Process]) -> None:
    async def flight(vehicle: Companion) -> None:
        async with vehicle:
            flying = asyncio.create_task(vehicle.take_off(3.0))
            await asyncio.sleep(0)
        with pytest.raises(FlightError):
            await flying
        with pytest.raises(FlightError, match="not in the air"):
            await vehicle.take_off(3.0)

    run(flight)
    (process,) = started
    assert process.left.is_set()


def test_no_flight_begins_after_its_block(started: list[Process]) -> None:
    async def flight(vehicle: Companion) -> None:
        async with vehicle:
            pass
        with pytest.raises(FlightError, match="block was left"):
            await vehicle.take_off(3.0)

    run(flight)
    assert started == []


def test_on_the_ground_no_place_is_flown_to(started: list[Process]) -> None:
    """The vehicle took off by itself, and flew there."""

    async def flight(vehicle: Companion) -> None:
        async with vehicle:
            with pytest.raises(FlightError, match="not in the air: take_off"):
                await vehicle.go_to(1.0, 0.0, 3.0)

    run(flight)
    assert started == []


class Log:
    """In place of a flight's log: a program commands a vehicle that waits in the air."""

    def __init__(self, vehicle: Companion) -> None:
        self.process, self.telemetry, self._time_ns = Process(), vehicle._telemetry, 0
        vehicle._process = cast(asyncio.subprocess.Process, self.process)
        vehicle._flight = asyncio.create_task(asyncio.sleep(0))
        self.telemetry.state = at(Phase.WAIT, 1)

    def order(self, said: str, kind: OperationKind = OperationKind.ORDER) -> None:
        """The next order was read, and this said to it."""
        self._time_ns += 1
        self.telemetry._take(OPERATION.topic, self._time_ns, lambda _: {"kind": kind, "text": ""}, b"")
        self.says(said)

    def says(self, text: str) -> None:
        self.telemetry._take(TEXT.topic, self._time_ns, lambda _: {"message": text}, b"")
        self.telemetry._tell()

    def waits(self, later_ns: int = 1, phase: Phase = Phase.WAIT) -> None:
        """The vehicle waits, or is in another phase, so long after the last order."""
        state = at(phase, 3)
        fields = {each: getattr(state, each) for each in State.__slots__} | {"clearance": 1.0}
        self.telemetry._take(LOGGED.topic, self._time_ns + later_ns, lambda _: fields, b"")
        self.telemetry._tell()


async def on_its_way(vehicle: Companion) -> tuple[Log, asyncio.Task[None]]:
    """A vehicle that has taken an order, and the command that waits for its end."""
    log = Log(vehicle)
    going = asyncio.create_task(vehicle.go_to(26.0, 0.0, 3.0))
    await asyncio.sleep(0)
    log.order("route, step 3 of 5")
    return log, going


def test_a_refusal_is_of_the_order_that_was_refused() -> None:
    """Whichever of two at once it is; the other one is flown."""

    async def flight(vehicle: Companion) -> None:
        log = Log(vehicle)
        for refused_first in (True, False):
            both = [asyncio.create_task(vehicle.go_to(north, 0.0, 3.0)) for north in (1.0, 1e4)]
            await asyncio.sleep(0)
            for refused in (refused_first, not refused_first):
                log.order("order refused: beyond" if refused else "route, step 3 of 5")
                log.says("scan: something is near")
            refused_one, flown = both if refused_first else reversed(both)
            with pytest.raises(FlightError, match="beyond"):
                await refused_one
            assert not flown.done()
            log.waits()
            await flown

    run(flight)


def test_an_order_that_another_one_overtakes_is_not_done() -> None:
    """The vehicle waits, but not where the first one sent it."""

    async def flight(vehicle: Companion) -> None:
        log, going = await on_its_way(vehicle)
        holding = asyncio.create_task(vehicle.hold())
        await asyncio.sleep(0)
        assert not going.done()
        log.order("wait, step 4 of 5")
        log.waits()
        with pytest.raises(FlightError, match="another order came"):
            await going
        await holding

    run(flight)


def test_an_order_that_was_done_stays_so_when_another_one_comes_at_once() -> None:
    async def flight(vehicle: Companion) -> None:
        log, going = await on_its_way(vehicle)
        log.waits()
        log.order("descend, step 5 of 9")
        await going

    run(flight)


def test_an_order_is_done_once_the_vehicle_waits_and_not_before() -> None:
    """Whatever else is done and said meanwhile, also by a vehicle that uses the same words."""

    async def flight(vehicle: Companion) -> None:
        log, going = await on_its_way(vehicle)
        log.waits(phase=Phase.ROUTE)
        log.says("order refused: by the vehicle, of somebody else")
        log.order("the planner does not answer", OperationKind.PLANNER_FAULT)
        log.waits(phase=Phase.ROUTE)
        await asyncio.sleep(0.01)
        assert not going.done()
        log.waits()
        await going

    run(flight)


def test_a_landing_is_done_with_the_flight() -> None:
    async def flight(vehicle: Companion) -> None:
        log = Log(vehicle)
        landing = asyncio.create_task(vehicle.land())
        await asyncio.sleep(0)
        log.order("landing")
        log.waits()
        await asyncio.sleep(0.01)
        assert not landing.done()
        vehicle.verdict = recorded({"outcome": "delivered", "landed": "True"})
        log.telemetry.end()
        assert await landing is vehicle.verdict
        with pytest.raises(FlightError, match="the vehicle is not in the air"):
            await vehicle.take_off(3.0)

    run(flight)


def test_a_landing_of_which_nothing_is_known_is_not_done() -> None:
    async def flight(vehicle: Companion) -> None:
        log = Log(vehicle)
        landing = asyncio.create_task(vehicle.land())
        await asyncio.sleep(0)
        vehicle._words.append("companion: killed")
        log.telemetry.end()
        with pytest.raises(FlightError, match="companion: killed"):
            await landing

    run(flight)


def test_a_state_of_before_an_order_is_none_of_after_it() -> None:
    """The log has the last one of a phase when the next begins."""

    async def flight(vehicle: Companion) -> None:
        log, going = await on_its_way(vehicle)
        log.waits(later_ns=0)
        await asyncio.sleep(0.01)
        assert not going.done()
        log.waits()
        await going

    run(flight)


def test_who_is_cancelled_as_the_flight_ends_is_cancelled() -> None:
    async def flight(vehicle: Companion) -> None:
        vehicle._process = cast(asyncio.subprocess.Process, Process())
        vehicle._telemetry.state = at(Phase.WAIT, 1)
        holding = asyncio.create_task(vehicle.hold())
        await asyncio.sleep(0)
        vehicle._telemetry.end()
        holding.cancel()
        with pytest.raises(asyncio.CancelledError):
            await holding

    run(flight)


def test_a_mission_that_is_too_long_for_an_order_is_not_sent() -> None:
    async def flight(vehicle: Companion) -> None:
        process = Process()
        vehicle._process = cast(asyncio.subprocess.Process, process)
        vehicle._telemetry.state = at(Phase.WAIT, 1)
        vehicle._flight = asyncio.create_task(asyncio.sleep(0))
        places = [Waypoint(float(number), 2.5, 5.0) for number in range(4000)]
        with pytest.raises(FlightError, match="at most 262144"):
            await vehicle.fly(Mission("long", waypoints=places, waits=True))
        assert process.given == []

    run(flight)


@pytest.mark.parametrize("said", [b"/tmp/\\udcff/2026_script", "/tmp/jürgen/2026_script".encode("latin-1")])
def test_the_log_is_found_in_a_folder_of_any_name(tmp_path: Path, said: bytes) -> None:
    """Such bytes are said escaped, or in the locale's own letters."""
    logs = tmp_path / os.fsdecode(b"l\xff")
    log = logs / "2026_script" / "flight.mcap"
    log.parent.mkdir(parents=True)
    log.write_bytes(b"")

    async def flight(vehicle: Companion) -> None:
        process = cast(asyncio.subprocess.Process, Speaking(b"companion: log at " + said + b"/flight.mcap\n"))
        opened, vehicle._logs, folder = asyncio.Event(), logs, tempfile.TemporaryDirectory()
        attending = asyncio.create_task(vehicle._attend(process, opened, folder))
        await opened.wait()
        assert vehicle.log == log
        attending.cancel()

    run(flight)


def test_long_lines_are_cut_and_those_in_pieces_are_whole() -> None:
    """A plug-in prints what it likes."""
    pieces = [
        b"y" + b"x" * 49_999,
        b"x" * 50_000,
        b"x" * 50_000 + b"\ncompa",
        b"nion: log",
        b" at a\n\nb\xff\nthe",
        b" end",
    ]

    async def read() -> list[str]:
        process = Speaking(*pieces)
        process.close()
        return [line async for line in lines(cast(asyncio.StreamReader, process))]

    assert asyncio.run(read()) == ["y" + "x" * 65_535, "companion: log at a", "", "b\ufffd", "the end"]


def test_the_logs_folder_may_be_a_string(tmp_path: Path) -> None:
    log = tmp_path / "2026_script" / "flight.mcap"
    log.parent.mkdir()
    log.write_bytes(b"")
    assert Companion.connect("udpin:127.0.0.1:0", logs=str(tmp_path))._log_at(log) == log


def test_when_nobody_can_listen_the_vehicle_lands_before_that_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the process says while it lands is read: with its pipe full it would stand still."""

    def fail(*_: object) -> Path:
        raise OSError("no disk")

    landed = asyncio.Event()

    class Landing(Speaking):
        async def wait(self) -> int:
            await landed.wait()
            return 0

    async def flight(vehicle: Companion) -> None:
        process, opened = Landing(b"companion: log at /a/b\n", b"landing\n", b"x" * (1 << 18)), asyncio.Event()
        monkeypatch.setattr(vehicle, "_log_at", fail)
        folder, vehicle._process = tempfile.TemporaryDirectory(), cast(asyncio.subprocess.Process, process)
        vehicle._flight = asyncio.create_task(vehicle._attend(vehicle._process, opened, folder))
        await process.left.wait()
        while process.said:
            await asyncio.sleep(0)
        assert not vehicle._telemetry.ended and not vehicle._flight.done()
        landed.set()
        with pytest.raises(OSError, match="no disk"):
            async with vehicle:
                pass
        assert vehicle._telemetry.ended

    run(flight)
