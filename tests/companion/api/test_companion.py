"""Flights by a program, each with two processes beside it."""

import asyncio
import logging
import re
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from companion import Companion, Delivery, FlightError, Mission, Outcome, Phase, State, Waypoint
from companion.logs.replay import replay
from companion.logs.verdict import verdict_of
from companion.mission.orders import Order
from protocol.flightlog import FlightLogError, LogReader
from protocol.flightlog.chunks import CHUNK_MARK
from tests.companion.view.made_logs import make
from tests.flights.processes import PATIENT, ROOT, simulator_for

LOCKSTEP = ("--pace", "lockstep", "--output", "rates", *PATIENT)
ANY_PORT = "udpin:127.0.0.1:0"


class Port(logging.Handler):
    """The port at which a flight waits for its vehicle."""

    def __init__(self) -> None:
        super().__init__()
        self.found: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def emit(self, record: logging.LogRecord) -> None:
        if "waiting at" in record.getMessage():
            self.found.set_result(int(record.getMessage().rpartition(":")[2]))


async def beside_a_vehicle(flight: Awaitable[None], world: str) -> None:
    """The flight, with a simulator that joins it."""
    logger, port = logging.getLogger("companion.api"), Port()
    logger.addHandler(port)
    logger.setLevel(logging.DEBUG)
    try:
        flying = asyncio.ensure_future(flight)
        ends: list[asyncio.Future[Any]] = [flying, port.found]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        if not flying.done():
            with simulator_for(port.found.result(), "lockstep", world):
                await flying
        await flying
    finally:
        logger.removeHandler(port)


def fly(flight: Awaitable[None], world: str = "empty") -> None:
    async def run() -> None:
        await beside_a_vehicle(flight, world)

    asyncio.run(run())


def test_the_example_delivers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Around the street lamp; and the flight is flown again with its orders."""
    script = ROOT / "examples" / "deliver.py"
    assert len(script.read_text().splitlines()) <= 30
    deliver: Callable[..., Awaitable[None]] = runpy.run_path(str(script))["deliver"]
    monkeypatch.chdir(tmp_path)
    small_map = ("--set", "avoidance.map.cells=160", "--set", "avoidance.map.cell=0.25")
    fly(deliver(ANY_PORT, *LOCKSTEP, *small_map), "neighbourhood")
    printed = capsys.readouterr().out
    assert "parcel released" in printed and printed.splitlines()[-1].endswith("outcome: delivered")
    (log,) = tmp_path.glob("logs/*_script/flight.mcap")
    again = replay(log)
    assert again.differences == [] and again.datagrams > 1000


def test_the_example_says_why_no_flight_began(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "examples" / "deliver.py"), "udpin:nowhere:14540"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (ended.returncode, len(ended.stderr.splitlines())) == (1, 1)
    assert ended.stderr.startswith("companion: udpin:nowhere:14540: ")


def test_who_is_cancelled_leaves_the_vehicle_holding_and_who_leaves_lands_it(tmp_path: Path) -> None:
    states: list[State] = []

    async def flight() -> None:
        options = (*LOCKSTEP, "--set", "avoidance.method=none", "--set", "geofence.radius=100.0")
        async with Companion.connect(ANY_PORT, *options, logs=tmp_path) as vehicle:
            with pytest.raises(FlightError, match="not in the air"):
                await vehicle.land()
            await vehicle.take_off(1.5)
            with pytest.raises(FlightError, match="go_to flies it to another height"):
                await vehicle.take_off(2.0)
            assert vehicle.state is not None and vehicle.state.position_ned[2] == pytest.approx(-1.5, abs=0.2)
            first, second = await asyncio.gather(
                vehicle.go_to(1.0, 0.0, -3.0), vehicle.go_to(1.0, 0.0, 2.0), return_exceptions=True
            )
            assert isinstance(first, FlightError) and "height" in str(first) and second is None
            going = asyncio.create_task(vehicle.go_to(30.0, 0.0, 2.0))
            await asyncio.sleep(0)
            await vehicle.hold()
            with pytest.raises(FlightError, match="another order came"):
                await going
            with pytest.raises(FlightError, match="beyond"):
                await vehicle.go_to(120.0, 0.0, 2.0)
            going = asyncio.create_task(vehicle.go_to(90.0, 0.0, 2.0))
            async for state in vehicle.states():
                states.append(state)
                if state.position_ned[0] > 4.0:
                    going.cancel()
                if state.phase is Phase.WAIT and state.position_ned[0] > 4.0 and abs(state.velocity_ned[0]) < 0.1:
                    break
            assert going.cancelled()
            async for message in vehicle.messages("HEARTBEAT"):
                assert message["mavlink_version"] == 3
                break
            raise InterruptedError

    with pytest.raises(InterruptedError):
        fly(flight())
    assert states[-1].position_ned[0] < 70.0, "it did not fly on"
    assert [state.time_s for state in states] == sorted(state.time_s for state in states)
    (log,) = tmp_path.glob("*/flight.mcap")
    verdict = verdict_of(log, LogReader(log).metadata)
    assert verdict is not None and verdict.outcome is Outcome.CALLED_OFF
    assert LogReader(log).metadata["result"]["landed"] == "True"


@pytest.mark.parametrize("waits", [True, False])
def test_who_is_cancelled_while_the_flight_gets_ready_can_still_call_it_off(tmp_path: Path, waits: bool) -> None:
    async def flight() -> None:
        async with Companion.connect(ANY_PORT, logs=tmp_path) as vehicle:
            flying = asyncio.create_task(vehicle.fly(Mission("hop", waypoints=[Waypoint(1.0, 0.0, 3.0)], waits=waits)))
            async with asyncio.timeout(60.0):
                while vehicle._process is None:
                    await asyncio.sleep(0)
            flying.cancel()
            with pytest.raises(asyncio.CancelledError):
                await flying
            assert vehicle.log is None
            if not waits:  # it was called off already
                assert [state async for state in vehicle.states()] == []
        assert vehicle.verdict is not None and vehicle.verdict.outcome is Outcome.CALLED_OFF

    asyncio.run(flight())


def test_a_flight_that_can_not_begin_says_why(tmp_path: Path) -> None:
    async def flight(*options: str) -> None:
        async with Companion.connect(ANY_PORT, *options, logs=tmp_path) as vehicle:
            await vehicle.fly(Mission("hop", waits=True))

    with pytest.raises(FlightError, match=r"avoidance\.method|magic"):
        asyncio.run(flight("--avoid", "magic"))


@pytest.mark.parametrize("name", ["../../x y", "a/b"])
def test_a_mission_s_name_leads_nowhere(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is none that a mission may have, and no path."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "a" / "b"))
    (tmp_path / "a" / "b").mkdir(parents=True)

    async def flight() -> None:
        async with Companion.connect(ANY_PORT, logs=tmp_path / "logs") as vehicle:
            await vehicle.fly(Mission(name, waits=True))

    with pytest.raises(FlightError, match="`name`"):
        asyncio.run(flight())
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("damaged", [False, True])
def test_a_log_that_grows_no_more_is_an_error_and_no_wait_for_ever(
    damaged: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its recorder was killed, or its disk is full or broken: the vehicle may be where it was sent long ago."""
    monkeypatch.setattr("companion.api.telemetry._SILENT_S", 0.1)
    log = make(tmp_path)
    data = bytearray(log.read_bytes())
    if damaged:
        chunk = data.index(CHUNK_MARK) + 64
        data[chunk : chunk + 64] = bytes(64)
    log.write_bytes(data if damaged else data[: len(data) // 3])

    async def flight() -> None:
        vehicle, over = Companion.connect(ANY_PORT), asyncio.get_running_loop().create_future()
        following = asyncio.create_task(vehicle._telemetry.follow(log, over))
        with pytest.raises(FlightError, match="nothing is heard of the flight"):
            await vehicle._done(1, waits=True)
        over.set_result(None)
        if not damaged:
            await following
        else:
            with pytest.raises(FlightLogError):
                await following

    asyncio.run(flight())


@pytest.mark.parametrize("complete", [True, False])
def test_a_complete_log_is_not_silent_nor_one_without_a_state(
    complete: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The flight's report may be written yet; or the vehicle is waited for."""
    monkeypatch.setattr("companion.api.telemetry._SILENT_S", 0.1)
    log = make(tmp_path, 2.0) if complete else make(tmp_path, traced=0.0)
    if not complete:
        log.write_bytes(log.read_bytes()[: log.stat().st_size // 3])

    async def flight() -> None:
        telemetry, over = Companion.connect(ANY_PORT)._telemetry, asyncio.get_running_loop().create_future()
        following = asyncio.create_task(telemetry.follow(log, over))
        for _ in range(10):
            await telemetry.news()
            assert not telemetry.silent
        assert (telemetry.state is not None) is complete
        over.set_result(None)
        await following

    asyncio.run(flight())


def test_the_page_shows_the_example_and_the_orders_as_they_are() -> None:
    page = (ROOT / "docs" / "api.md").read_text()
    assert f"```python\n{(ROOT / 'examples' / 'deliver.py').read_text()}```" in page
    orders = [msgspec.json.decode(line, type=Order) for line in page.splitlines() if line.startswith('    {"do"')]
    assert {order.do for order in orders} == set(get_args(get_type_hints(Order)["do"]))
    (mission,) = re.findall(r"^    (Mission\(.*\))$", page, re.MULTILINE)
    assert eval(mission, {"Mission": Mission, "Waypoint": Waypoint, "Delivery": Delivery}).parcels


def test_importing_the_package_loads_nothing_else() -> None:
    code = "import sys, companion; print([name for name in sys.modules if name.split('.')[0] in ('numpy', 'asyncio')])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
