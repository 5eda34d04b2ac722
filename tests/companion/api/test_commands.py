"""Commands of a program that meet each other, or the end of its block; the flight's process is none."""

import asyncio
import os
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, cast

import pytest

from companion import Companion, FlightError, Mission, Phase, State, Waypoint
from companion.api.telemetry import Telemetry

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

    def __aiter__(self) -> "Process":
        return self

    async def __anext__(self) -> bytes:
        await self.left.wait()
        raise StopAsyncIteration


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


def test_a_refusal_is_of_the_order_that_was_refused() -> None:
    async def flight(vehicle: Companion) -> None:
        vehicle._process = cast(asyncio.subprocess.Process, Process())
        telemetry: Telemetry = vehicle._telemetry
        telemetry.state = at(Phase.WAIT, 1)
        vehicle._flight = asyncio.create_task(asyncio.sleep(0))
        going = asyncio.create_task(vehicle.go_to(1.0, 0.0, 3.0))
        await asyncio.sleep(0)
        far = asyncio.create_task(vehicle.go_to(1e4, 0.0, 3.0))
        await asyncio.sleep(0)
        telemetry.refused = "order refused: beyond"
        telemetry._tell()
        with pytest.raises(FlightError, match="beyond"):
            await far
        assert not going.done()
        telemetry.state = at(Phase.WAIT, 3)
        telemetry._tell()
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

    class Said(Process):
        def __init__(self) -> None:
            super().__init__()
            self.lines = [b"companion: log at " + said + b"/flight.mcap\n"]

        async def __anext__(self) -> bytes:
            return self.lines.pop() if self.lines else await super().__anext__()

    async def flight(vehicle: Companion) -> None:
        process, opened = cast(asyncio.subprocess.Process, Said()), asyncio.Event()
        vehicle._logs, folder = logs, tempfile.TemporaryDirectory()
        attending = asyncio.create_task(vehicle._attend(process, opened, folder))
        await opened.wait()
        assert vehicle.log == log
        attending.cancel()

    run(flight)
