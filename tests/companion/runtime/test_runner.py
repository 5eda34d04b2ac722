"""The loop itself in lockstep, with the simulated vehicle at the other end of a queue."""

import os
import signal
import struct
import time
from collections import deque
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest

from companion.autopilot import Autopilot
from companion.events import operation_of
from companion.logs.replay import replay
from companion.outcomes import Outcome
from companion.records import OPERATION, RECORD_TYPES
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.planning import InProcessPlanner, Planning
from companion.runtime.router import Router, Station
from companion.runtime.runner import Runner, lockstep_time
from companion.runtime.side_links import SideLinks
from companion.state import Output
from companion.supervision.operations import LogFault, LogRecovered
from companion.supervision.states import State
from protocol import toml_files
from protocol.clock import RealClock
from protocol.flightlog import Direction, FlightLog, LogReader
from protocol.flightlog.reader import datagrams
from protocol.framing import Framer
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.messages import Encoder, decoder_of, dialect
from protocol.transport import Memory, TransportError
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

HOVER_FILE = toml_files.ROOT / "tests" / "data" / "hover.toml"
HOVER = load_mission(str(HOVER_FILE))[0]
SETTINGS = load_settings(None, ["avoidance.method=none"])
STATUSTEXT = dialect.MAVLINK_MSG_ID_STATUSTEXT


class Queue:
    """A transport to a vehicle that goes on as soon as it is listened to; `strange` comes before all that it says."""

    preserves_datagrams = True
    peer = "memory:vehicle"

    def __init__(self, *strange: bytes) -> None:
        frame = Airframe.load(toml_files.find("vehicles", HOVER.vehicle), ())
        self.vehicle = Vehicle(frame, World.load(toml_files.find("worlds", HOVER.world), ()), seed=1, lockstep=True)
        self._waiting = deque(strange)

    def receive(self, timeout_s: float) -> bytes | None:
        while not self._waiting:
            self._waiting += self.vehicle.advance()
        return self._waiting.popleft()

    def send(self, data: bytes) -> None:
        self.vehicle.receive(data)

    def lock(self) -> None: ...

    def close(self) -> None: ...


class Faulty:
    """A flight log whose faults are as told: from a time (s) on, and until another one."""

    def __init__(self, log: FlightLog, *faults: tuple[float, float]) -> None:
        self._log = log
        self._faults = faults
        self._now_s = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._log, name)

    def datagram(self, time_ns: int, *rest: Any) -> None:
        self._now_s = time_ns * 1e-9
        self._log.datagram(time_ns, *rest)

    @property
    def fault(self) -> str | None:
        for start, stop in self._faults:
            if start <= self._now_s < stop:
                return f"it has not moved for {self._now_s - start:.1f} s"
        return None


def opened(folder: Path, *, console: bool = False) -> FlightLog:
    flight = {"mission": HOVER.name, "output": "rates", "pace": "lockstep", "overrides": "[]"}
    kinds = {"mission": "missions", "vehicle": "vehicles", "world": "worlds"}
    names = {"mission": str(HOVER_FILE), "vehicle": HOVER.vehicle, "world": HOVER.world}
    files = {f"{kind}.toml": toml_files.find(kinds[kind], names[kind]).read_bytes() for kind in kinds}
    return FlightLog.open(
        folder,
        metadata={"flight": {**flight, "whole_datagrams": "True"}},
        attachments={**files, "settings.json": msgspec.json.encode(SETTINGS)},
        types=RECORD_TYPES,
        on_full="wait",
        console=console,
    )


def runner_of(transport: Queue, log: FlightLog | Faulty, *, console: bool = False) -> Runner:
    autopilot = Autopilot(SETTINGS, load_body(HOVER.vehicle), HOVER, Output.RATES)
    planning = Planning(InProcessPlanner(SETTINGS.avoidance), SETTINGS.avoidance.answer_delay)
    return Runner(autopilot, transport, cast(FlightLog, log), None, planning, console=console)


def test_a_stall_of_the_recorder_before_the_start_delays_it_and_no_more(tmp_path: Path) -> None:
    """Each fault is handed over once, however its words change, and so is its end; the log of it replays."""
    with opened(tmp_path / "log") as log:
        runner = runner_of(Queue(), Faulty(log, (0.0, 4.0), (12.0, 13.0)))
        runner.run()
        assert runner.failure is None and runner._autopilot.supervisor.fault is None
    reader = LogReader(tmp_path / "log" / "flight.mcap")
    events = [operation_of(OPERATION, each.time_ns, each.data) for each in reader.records((OPERATION.topic,))]
    times = [event.time_ns for event in events]
    assert events == [
        LogFault(times[0], "it has not moved for 0.1 s"),
        LogRecovered(times[1]),
        LogFault(times[2], "it has not moved for 0.0 s"),
        LogRecovered(times[3]),
    ]
    trace = reader.array("/companion/trace")
    first = trace["time_ns"][trace["state"] == State.FLY.value][0]
    assert 4e9 <= times[1] < 4.2e9 < first < 10e9 < times[2]
    result = replay(reader.path)
    assert result.differences == [] and result.datagrams > 1000


class Kill(Queue):
    """A transport that kills the log's recorder at 6 s, and goes on when that is noticed."""

    log: FlightLog

    def receive(self, timeout_s: float) -> bytes | None:
        if self.vehicle.time_ns == 6_000_000_000 and self.log.fault is None:
            os.kill(self.log.recorder_pid, signal.SIGKILL)
            deadline = time.monotonic() + 20.0
            while self.log.fault is None and time.monotonic() < deadline:
                pass
        return super().receive(timeout_s)


def test_without_a_recorder_the_flight_is_told_all_the_same(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    transport = Kill()
    with opened(tmp_path / "log", console=True) as transport.log:
        runner = runner_of(transport, transport.log, console=True)
        runner.run()
    flown_s = transport.vehicle.time_ns * 1e-9
    assert transport.vehicle.summary().outcome == "landed" and runner.flown_s == pytest.approx(flown_s, abs=0.01)
    said = capfd.readouterr().err.splitlines()
    for text in ("armed, taking off", "the flight log fails: ", "landed and disarmed"):
        assert len([line for line in said if text in line]) == 1, (text, said)


class HangUp(Queue):
    """A transport during whose flight the terminal hangs up, and says so twice, as the kernel and a shell do."""

    def receive(self, timeout_s: float) -> bytes | None:
        if self.vehicle.time_ns in (4_000_000_000, 4_500_000_000):
            signal.raise_signal(signal.SIGHUP)
        return super().receive(timeout_s)


@pytest.mark.parametrize("ignored", [False, True])
def test_a_terminal_that_hangs_up_lands_and_one_that_is_not_listened_to_does_not(ignored: bool, tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else lambda number, frame: None)
    try:
        with opened(tmp_path / "log") as log:
            runner = runner_of(HangUp(), log)
            runner.run()
    finally:
        signal.signal(signal.SIGHUP, before)
    assert runner.failure is None
    supervisor = runner._autopilot.supervisor
    called_off = supervisor.verdict is not None and supervisor.verdict.outcome is Outcome.CALLED_OFF
    assert called_off is not ignored and supervisor.flew


def test_a_time_that_can_not_be_is_none(tmp_path: Path) -> None:
    """It is answered as anybody's question, the clock stays, and the flight is flown."""
    encoder = Encoder(1, 1)
    times = [
        encoder.encode_fields(dialect.MAVLink_timesync_message, 0, time_ns)
        for time_ns in (-1, -(2**63), 2**63 - 1, 2**32 * 10**9, 2**61 + 1)
    ]
    strange = encoder.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, 0, 4, 3), *times
    assert [lockstep_time(each) for each in times] == [None] * 5
    assert lockstep_time(encoder.encode_fields(dialect.MAVLink_timesync_message, 0, 2**61)) == 2**61
    with opened(tmp_path / "log") as log:
        runner = runner_of(Queue(*strange), log)
        runner.run()
    assert runner.failure is None and runner._autopilot.supervisor.fault is None and runner.flown_s < 60.0


class Broken(Faulty):
    """A log that takes no text and no record from a time on."""

    def text(self, *arguments: Any) -> None:
        if self._now_s >= self._faults[0][0]:
            raise struct.error("argument out of range")
        self._log.text(*arguments)

    def record(self, *arguments: Any) -> None:
        if self._now_s >= self._faults[0][0]:
            raise struct.error("argument out of range")
        self._log.record(*arguments)


def test_rings_from_before_the_start_are_old(tmp_path: Path) -> None:
    """The scanner's driver runs already while the companion compiles: those rings would pass for new ones."""
    sensor, driver = Memory.pair()
    for _ in range(100):
        driver.send(bytes(180))
    settings = load_settings(None, ["avoidance.method=none", "supervision.find_timeout=0.2"])
    autopilot = Autopilot(settings, load_body(HOVER.vehicle), HOVER, Output.RATES)
    planning = Planning(InProcessPlanner(settings.avoidance), None)
    beside = SideLinks(sensor=sensor)
    with opened(tmp_path / "log") as log:
        runner = Runner(autopilot, Memory.pair()[0], log, RealClock(), planning, beside=beside)
        runner.run()
    assert autopilot.ended and runner.failure is None
    assert Direction.SENSOR not in {direction for _, direction, _, _ in datagrams(tmp_path / "log" / "flight.mcap")}


def test_whatever_the_log_does_the_loop_ends_with_a_word(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with opened(tmp_path / "log") as log:
        runner = runner_of(Queue(), Broken(log, (6.0, 99.0)), console=True)
        runner.run()
    assert runner.failure == "the companion's loop failed: error('argument out of range')"
    said = capfd.readouterr().err
    assert "Traceback" in said and f"{runner.failure}; setpoints have stopped" in said


class Unplugged(Queue):
    """A link that is gone once so many datagrams have come; with a key the vehicle signs."""

    left = 50

    def __init__(self, keeper: Keeper | None) -> None:
        super().__init__()
        self._keeper = keeper

    def receive(self, timeout_s: float) -> bytes | None:
        self.left -= 1
        if self.left < 0:
            raise TransportError("unplugged")
        data = super().receive(timeout_s)
        return data if data is None or self._keeper is None else self._keeper.signing.sign(data, self._keeper.now())

    def send(self, data: bytes) -> None:
        if self.left < 0:
            raise TransportError("unplugged")
        super().send(data)


@pytest.mark.parametrize("key", [None, bytes(range(32))])
def test_ground_stations_are_told_that_the_link_to_the_vehicle_is_gone(tmp_path: Path, key: bytes | None) -> None:
    """They saw the vehicle fall silent, and no more."""
    vehicles, ours = (None, None) if key is None else (Keeper(key), Keeper(key))
    link, (near, far) = GuardedLink(Unplugged(vehicles), ours), Memory.pair()
    autopilot = Autopilot(SETTINGS, load_body(HOVER.vehicle), HOVER, Output.RATES)
    planning = Planning(InProcessPlanner(SETTINGS.avoidance), SETTINGS.avoidance.answer_delay)
    beside = SideLinks(Router([Station("s0", near)], link=link))
    with opened(tmp_path) as log:
        runner = Runner(autopilot, link, log, None, planning, beside=beside)
        runner.run()
    assert runner.failure == "the link is gone: unplugged"
    heard = list[bytes]()
    while (data := far.receive(0.0)) is not None:
        heard.append(data)
    frames = [frame for frame in Framer().datagram(b"".join(heard)) if frame.message_id == STATUSTEXT]
    (last,) = [frame for frame in frames if decoder_of(STATUSTEXT)(frame).text == runner.failure]
    assert (last.system, last.component, last.signed) == (1, 191, key is not None)
