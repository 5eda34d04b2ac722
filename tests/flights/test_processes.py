"""The two processes over UDP: the demo, its repeatability, and what happens when one of them is killed."""

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

from companion.autopilot import Autopilot
from companion.config import Settings
from companion.events import Datagram, PlanReady, Tick, operation_of
from companion.logs.recorded import open_flight
from companion.logs.replay import replay
from companion.mission.plan import Mission
from companion.records import OPERATION, PLANNED, TICK, TRACE
from companion.runtime.files import load_body
from companion.runtime.planning import InProcessPlanner
from companion.state import Reason
from companion.supervision.operations import PlannerFault, PlannerReady, PlannerStarting
from companion.supervision.states import State
from protocol import toml_files
from protocol.flightlog import DATAGRAM, Direction, LogReader, datagrams, digest
from protocol.framing import Framer
from protocol.transport import Udp
from tests.flights.processes import HOP, PATIENT, Process, Relay, pair, run, simulator_for, waiting_companion
from tests.flights.shared import once

EVERY_STEP = "log.trace_rate=250"
FLOWN = ("errand", "--seed", "3", "--set", EVERY_STEP)
KILLS = 2
"""bench/log.py kills fifty."""
KILL_PACES = ("2", "lockstep")
STEPS_IN_A_FIFTH_OF_A_SECOND = 100
"""At pace 2."""
TICKS_TO_NOTICE = 10
"""The supervisor looks at each fifth tick."""
UNHURRIED = "1"
"""A pace at which a busy machine may stand still for a second: that is when the vehicle's own failsafe comes."""


def demo_command(logs: Path, *arguments: str) -> tuple[str, ...]:
    return "companion", "demo", "--no-report", "--log", str(logs), "--json", *arguments


def demo(logs: Path, *arguments: str) -> dict[str, Any]:
    done = run(*demo_command(logs, *arguments))
    assert done.returncode == 0, done.stderr
    verdict: dict[str, Any] = json.loads(done.stdout)
    return verdict


def test_demo_in_lockstep_repeats_to_the_byte(flown: dict[str, Any], tmp_path: Path) -> None:
    """Two runs of one seed, in different folders, at other ports; the second one by `python -m`."""
    command = [sys.executable, "-m", *demo_command(tmp_path, *FLOWN)]
    second = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    assert digest(flown["log"]) == digest(second["log"])
    hashes = [run("companion", "digest", str(verdict["log"])).stdout for verdict in (flown, second)]
    assert hashes[0] == hashes[1] and len(hashes[0].split()) == 4
    assert_delivered(second)


def test_demo_in_lockstep_delivers(flown: dict[str, Any]) -> None:
    assert_delivered(flown)


def assert_delivered(*verdicts: dict[str, Any]) -> None:
    for verdict in verdicts:
        assert verdict["outcome"] == "delivered" and verdict["delivered"] is True
        assert verdict["contacts"] == 0 and verdict["messages_lost"] == 0
        assert verdict["least_clearance_m"] >= 0.5
        assert verdict["duration_s"] > 0 and verdict["real_time_factor"] > 0


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One whole demo."""

    def make(folder: Path) -> None:
        verdict = demo(folder, *FLOWN)
        (folder / "verdict.json").write_text(json.dumps(verdict))

    folder = once(tmp_path_factory, "lockstep_demo", make)
    verdict: dict[str, Any] = json.loads((folder / "verdict.json").read_text())
    return verdict


def test_log_holds_everything(flown: dict[str, Any]) -> None:
    log = LogReader(flown["log"])
    assert log.complete and log.problem is None
    assert set(log.attachments) == {"mission.toml", "vehicle.toml", "world.toml", "settings.json"}
    assert log.metadata["flight"]["seed"] == "3" and log.metadata["flight"]["pymavlink"]
    assert log.metadata["result"]["delivered"] == "True"
    topics = set(log.topics)
    assert {"/courier/datagrams", "/companion/trace", "/companion/ticks", "/log"} <= topics
    for name in ("ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "OBSTACLE_DISTANCE", "HEARTBEAT", "HIL_STATE_QUATERNION"):
        assert f"/mavlink/1/1/{name}" in topics
    assert "/mavlink/1/191/SET_ATTITUDE_TARGET" in topics


def test_trace_agrees_with_the_ground_truth_in_the_log(flown: dict[str, Any]) -> None:
    """The companion's state against HIL_STATE_QUATERNION, which no stage of it reads, to what the estimator errs by."""
    log = LogReader(flown["log"])
    trace, truth = log.array(TRACE.topic), log.array("/mavlink/1/1/HIL_STATE_QUATERNION")
    rows = np.searchsorted(trace["time_ns"], truth["time_ns"])
    inside = (rows > 0) & (rows < len(trace))
    velocity = truth["vx"][inside] * 0.01
    assert np.abs(velocity - trace["velocity_ned"][rows[inside], 0]).max() < 0.12
    quaternion = truth["attitude_quaternion"][inside]
    inner = np.abs((quaternion * trace["attitude_ned_frd"][rows[inside]]).sum(axis=1))
    assert inner.min() > 0.9998


def test_every_datagram_is_whole_frames(flown: dict[str, Any]) -> None:
    framer = Framer()
    count = dict.fromkeys(Direction, 0)
    for _, direction, address, data in datagrams(flown["log"]):
        assert sum(len(frame.raw) for frame in framer.datagram(data)) == len(data)
        assert address.startswith("127.0.0.1:")
        count[direction] += 1
    assert abs(count[Direction.IN] - count[Direction.OUT]) < 10 and count[Direction.IN] > 5_000


def test_the_log_is_the_flight(flown: dict[str, Any]) -> None:
    """Its events, fed to a new autopilot, lead to the same bytes as were sent."""
    log = LogReader(flown["log"])
    tables = tomllib.loads(log.attachments["mission.toml"].decode())
    autopilot = Autopilot(
        msgspec.json.decode(log.attachments["settings.json"], type=Settings),
        load_body("paper_quad"),
        toml_files.convert(tables, Mission, "mission.toml"),
        open_flight(log.path).output,
    )
    thinker = InProcessPlanner(autopilot.settings.avoidance)
    sent, repeated = b"", b""
    for record in log.records(("/courier/datagrams", TICK.topic, OPERATION.topic, PLANNED.topic)):
        if record.topic == TICK.topic:
            reaction = autopilot.handle(Tick(record.time_ns, TICK.unpack(record.data)["late_ns"]))
            repeated += reaction.datagram
            if reaction.plan_request is not None:
                thinker.ask(reaction.plan_request)
        elif record.topic == PLANNED.topic:
            answer = thinker.take(0.0)
            assert answer is not None and answer.number == PLANNED.unpack(record.data)["number"]
            repeated += autopilot.handle(PlanReady(record.time_ns, answer)).datagram
        elif record.topic == OPERATION.topic:
            raise AssertionError("nobody asked for anything")
        else:
            values = DATAGRAM.unpack(record.data)
            if values["direction"] == Direction.OUT:
                sent += values["data"]
            else:
                repeated += autopilot.handle(Datagram(record.time_ns, values["data"])).datagram
    assert len(sent) > 100_000 and repeated == sent


def test_demo_in_real_time(tmp_path: Path) -> None:
    """Deadlines are absolute: no drift between the clocks of the two, and it lands like in lockstep. A ground station
    is shown the vehicle meanwhile."""
    station = Udp("127.0.0.1", 0, bind=True)
    verdict = demo(tmp_path, HOP, "--gcs", f"udpout:127.0.0.1:{station.port}", *PATIENT)
    shown = Framer().datagram(station.receive(0.0) or b"")
    station.close()
    assert {(frame.system, frame.component) for frame in shown} == {(1, 1)}
    assert verdict["outcome"] == "flown"
    log = LogReader(verdict["log"])
    assert log.complete
    attitude = log.array("/mavlink/1/1/ATTITUDE_QUATERNION")
    offset_s = (attitude["time_ns"].astype(np.int64) - attitude["time_boot_ms"].astype(np.int64) * 1_000_000) * 1e-9
    # Messages are late at times, and many are late on a busy machine; of each half, the one that was least so.
    half = len(attitude) // 2
    passed_s = (attitude["time_ns"][-1] - attitude["time_ns"][0]) * 1e-9
    assert abs(offset_s[half:].min() - offset_s[:half].min()) < 0.01 * passed_s


class Killed(NamedTuple):
    """What is left of a flight whose companion was killed."""

    sent: list[bytes]
    report: dict[str, Any]
    log: Path


def killed_companion(folder: Path, pace: str, steps: int) -> Killed:
    """Kill the companion when it has sent so many datagrams since its take-off."""
    # The planner's process takes its time to start, and ends with the companion in any case: see test_planning.py.
    with (
        waiting_companion(folder, pace, "courier", "--set", "avoidance.method=paper") as (companion, port),
        Relay(port) as relay,
        simulator_for(relay.port, pace) as simulator,
    ):
        companion.wait_for("armed, taking off")
        relay.wait_for(steps)
        companion.kill()
        assert simulator.end() == 0
        (log,) = folder.glob("*/flight.mcap")
        return Killed(relay.sent, simulator.report(), log)


def children(parent: Process) -> list[int]:
    """Its processes."""
    pid = parent.process.pid
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_companion_killed_at_random_moments(tmp_path: Path) -> None:
    """The vehicle holds, then lands; the log opens and has all that was sent up to 0.2 s
    before the kill."""
    steps = np.random.default_rng(1).integers(0, 2000, KILLS).tolist()
    folders = [tmp_path / str(index) for index in range(KILLS)]
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(killed_companion, folders, itertools.cycle(KILL_PACES), steps))
    assert all(report["flight_time_s"] > 0.0 for _, report, _ in results)
    for sent, report, path in results:
        assert report["outcome"] == "landed" and report["contacts"] == 0
        assert LogReader(path).problem is None
        logged = {data for _, direction, _, data in datagrams(path) if direction is Direction.OUT}
        lost = [data not in logged for data in sent]
        assert len(sent) > 100 and not any(lost[:-STEPS_IN_A_FIFTH_OF_A_SECOND])


@pytest.mark.parametrize("pace", ["1", "lockstep"])
def test_simulator_killed(tmp_path: Path, pace: str) -> None:
    """The companion ends by itself as soon as the silence is long enough, and leaves a whole log."""
    with pair(tmp_path, pace) as (simulator, companion):
        companion.wait_for("armed, taking off")
        simulator.kill()
        assert companion.end() == 1
    assert any("silent" in line for line in companion.lines)
    (path,) = tmp_path.glob("*/flight.mcap")
    log = LogReader(path)
    assert log.complete
    heard_ns = max(time_ns for time_ns, direction, _, _ in datagrams(path) if direction is Direction.IN)
    silence_s = (log.array(TICK.topic)["time_ns"].astype(np.int64) - heard_ns) * 1e-9
    timeout_s = msgspec.json.decode(log.attachments["settings.json"], type=Settings).supervision.silence_timeout
    assert 0 < (silence_s > timeout_s).sum() <= TICKS_TO_NOTICE


def test_recorder_killed_and_garbage(tmp_path: Path) -> None:
    """Strangers send noise to the companion's port before and during the flight, and its recorder is killed. It flies
    on and says so; what was written is read."""
    rng = np.random.default_rng(1)
    with (
        waiting_companion(tmp_path, UNHURRIED, HOP, "--set", "avoidance.method=none") as (companion, port),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):

        def disturb() -> None:
            stranger.sendto(rng.bytes(int(rng.integers(1, 300))), ("127.0.0.1", port))

        for _ in range(100):
            disturb()
        with simulator_for(port, UNHURRIED) as simulator:
            companion.wait_for("armed, taking off")
            (path,) = tmp_path.glob("*/flight.mcap")
            (recorder,) = children(companion)
            os.kill(recorder, signal.SIGKILL)
            while not companion.ended_within(0.005):
                disturb()
            assert companion.end() == 0, companion.lines
            simulator.end()
            assert simulator.report()["outcome"] == "landed"
    (fault,) = (k for k, line in enumerate(companion.lines) if "the flight log fails" in line)
    for text in ("landed and disarmed", "height"):
        assert any(text in line for line in companion.lines[fault:]), companion.lines
    log = LogReader(path)
    assert not log.complete
    last_s = max(record.time_ns for record in log.records()) * 1e-9
    assert companion.report()["duration_s"] > last_s + 5.0, "the flight's, not the log's"
    assert sum(1 for _ in log.records()) > 100


def planner_of(companion: Process) -> int:
    """The process's number."""
    (planner,) = (pid for pid in children(companion) if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes())
    return planner


def test_planner_late_and_killed_before_the_start(tmp_path: Path) -> None:
    """The companion waits for a planner that does not answer yet, and flies nothing with one that is gone."""
    with waiting_companion(tmp_path, UNHURRIED, "errand") as (companion, port):
        planner = planner_of(companion)
        os.kill(planner, signal.SIGSTOP)
        with simulator_for(port, UNHURRIED) as simulator:
            companion.wait_for("waiting: the planner is not ready")
            os.kill(planner, signal.SIGKILL)
            assert companion.end() == 1
            assert companion.report()["outcome"] == (
                "not started: the planner's process has ended by itself (exit code -9)"
            )
            simulator.kill()


def test_planner_killed(tmp_path: Path) -> None:
    """On the way: it is said to everybody, the vehicle brakes, holds and lands unhurt, and the log replays."""
    with pair(tmp_path, UNHURRIED, "errand") as (simulator, companion):
        companion.wait_for("route, step")
        os.kill(planner_of(companion), signal.SIGKILL)
        assert companion.end() == 1
        simulator.end()
    said = "no map any more: the planner's process has ended by itself (exit code -9)"
    assert any(said in line for line in companion.lines), companion.lines
    report = simulator.report()
    assert report["outcome"] == "landed" and report["contacts"] == 0 and not report["released"]
    (path,) = tmp_path.glob("*/flight.mcap")
    log = LogReader(path)
    starting, ready, fault = (
        operation_of(OPERATION, each.time_ns, each.data) for each in log.records((OPERATION.topic,))
    )
    text = "the planner's process has ended by itself (exit code -9)"
    assert [starting, ready] == [PlannerStarting(starting.time_ns), PlannerReady(ready.time_ns)]
    assert fault == PlannerFault(fault.time_ns, text)
    sent = log.topics["/mavlink/1/191/STATUSTEXT"]
    assert any("no map any more" in sent.unpack(each.data)["text"] for each in log.records((sent.topic,)))
    trace = log.array(TRACE.topic)
    assert (trace["guard_reason"] == Reason.STALE).any() and State.HOLD.value in trace["state"]
    result = replay(path)
    assert result.differences == [] and result.datagrams > 1000
