"""Questions and answers: the same in this process and in another, at their time, and what happens when they end."""

import dataclasses
import itertools
import math
import os
import pickle
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.avoidance.planner import PlanRequest, PlanResult, result_bytes
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.mission.plan import Phase
from companion.records import PLANNED
from companion.runtime.planning import (
    _MOST_UNANSWERED,
    _MOST_WAITING,
    InProcessPlanner,
    PlannerProcess,
    Planning,
    pack_result,
)
from companion.state import Scan
from companion.supervision.states import State
from protocol.frames import from_euler
from studies.joined import Joined, mission_of

SETTINGS = Avoidance(method="astar", map=AvoidanceMap(cells=160, cell=0.25))
BEARINGS = np.radians(np.arange(0.0, 360.0, 5.0))
PERIOD_NS = 66_000_000
PATIENCE_S = 60.0


def questions(count: int = 8) -> list[PlanRequest]:
    """On the way north at 3 m/s, towards a thing ahead, with chance ranges around."""
    rng = np.random.default_rng(5)
    asked = []
    for k in range(count):
        ranges = rng.uniform(6.0, 15.0, 72)
        here = np.array([0.2 * k, 0.0, -3.0])
        ranges[[71, 0, 1]] = max(5.0 - 0.2 * k, 1.0)
        scan = Scan(k * PERIOD_NS, k * PERIOD_NS // 1000, BEARINGS, ranges, ranges < 12.0, np.ones(72, bool))
        pose = (here, np.array([1.0, 0.0, 0.0, 0.0]))
        goal = np.array([30.0, 0.0, -3.0])
        asked.append(PlanRequest(k + 1, k * PERIOD_NS, scan, pose, -0.5, here, np.array([3.0, 0.0, 0.0]), goal, 3.0))
    return asked


@pytest.fixture
def elsewhere() -> Iterator[PlannerProcess]:
    thinker = PlannerProcess(SETTINGS)
    for question in questions():
        thinker.ask(question)  # which is not kept
    assert not thinker.ready and thinker.take(PATIENCE_S) is None and thinker.ready
    assert thinker.take(0.0) is None
    yield thinker
    thinker.close()


def told(answer: PlanResult | None) -> tuple[object, ...]:
    """All that it says, arrays to the bit."""
    assert answer is not None
    space, path = answer.space, answer.path
    arrays = (space.to_occupied, space.to_unseen, space.points, path.vertices, path.speeds)
    plain = (space.seen_ns, space.corner, space.cell, space.tight, path.bearing, path.tight)
    rest = (answer.number, answer.asked_ns, answer.clearance, answer.blocked)
    return (*plain, *rest, *((each.shape, each.dtype.str, each.tobytes()) for each in arrays))


def test_another_process_answers_the_same_also_all_that_waited(elsewhere: PlannerProcess) -> None:
    """What it was asked while it stood, more than a pipe holds, is answered in order, to the bit."""
    assert elsewhere.pid is not None
    here, asked = InProcessPlanner(SETTINGS), questions(_MOST_UNANSWERED + 20)
    os.kill(elsewhere.pid, signal.SIGSTOP)
    try:
        for question in asked:
            here.ask(question)
            elsewhere.ask(question)
    finally:
        os.kill(elsewhere.pid, signal.SIGCONT)
    for question in asked:
        mine, theirs = here.take(0.0), elsewhere.take(20.0)
        assert mine is not None and mine.number == question.number and len(mine.path.vertices) > 1
        assert told(mine) == told(theirs)
    assert elsewhere.take(0.0) is None and elsewhere.fault is None
    holds_what_was_taken_last(elsewhere)


def holds_what_was_taken_last(elsewhere: PlannerProcess) -> None:
    """The loop that flies looks at an answer's arrays where they lie, until it has taken another one up, also while as
    many are open as may be."""
    asked = questions(_MOST_UNANSWERED + 2)
    for question in asked[:2]:
        elsewhere.ask(question)
    held = [elsewhere.take(20.0) for _ in range(2)]
    before = [told(answer) for answer in held]
    for question in asked[2:]:
        elsewhere.ask(question)
    assert [told(elsewhere.take(20.0))[6] for _ in asked[2:]] == [question.number for question in asked[2:]]
    assert [told(answer) for answer in held] == before and elsewhere.fault is None


@pytest.mark.parametrize(("cells", "cell"), [(384, 0.125), (384, 0.05), (96, 0.3)])
def test_an_answer_is_never_larger_than_it_may_be(cells: int, cell: float) -> None:
    """It would be read in pieces then, and the loop that flies would wait."""
    settings = msgspec.structs.replace(SETTINGS, map=AvoidanceMap(cells=cells, cell=cell))
    here, sizes = InProcessPlanner(settings), []
    for question in questions():
        here.ask(question)
        answer = here.take(0.0)
        assert answer is not None
        buffers: list[pickle.PickleBuffer] = []
        pickle.dumps(answer, protocol=5, buffer_callback=buffers.append)
        sizes.append(sum(memoryview(buffer).nbytes + 64 for buffer in buffers))
    assert 0.5 * result_bytes(settings) < max(sizes) <= result_bytes(settings)


@pytest.mark.parametrize("below, is_there", [(0.8, False), (1.0, True)])
def test_what_is_not_in_the_way_is_not_in_the_answer(below: float, is_there: bool) -> None:
    """Seen by a vehicle that leans by 10 degrees: what is 5 m ahead is met 0.9 m below it."""
    question, here, ahead = questions(1)[0], InProcessPlanner(SETTINGS), np.isin(np.arange(72), (71, 0, 1))
    pose = question.pose[0], from_euler(0.0, math.radians(-10.0), 0.0)
    scan = dataclasses.replace(question.scan, hit=ahead)
    for _ in range(4):
        here.ask(msgspec.structs.replace(question, scan=scan, pose=pose, in_the_way=(math.inf, below)))
        answer = here.take(0.0)
    assert answer is not None and answer.blocked is is_there


def test_a_planner_that_is_killed_is_a_fault_and_no_exception(elsewhere: PlannerProcess) -> None:
    first, second, *_ = questions()
    elsewhere.ask(first)
    assert elsewhere.take(20.0) is not None
    pid = elsewhere.pid
    assert pid is not None
    os.kill(pid, signal.SIGKILL)
    elsewhere.ask(second)
    assert elsewhere.take(20.0) is None
    elsewhere.ask(second)
    assert elsewhere.take(0.0) is None
    elsewhere.close()
    assert elsewhere.fault is not None and "-9" in elsewhere.fault


def test_a_planner_that_ends_before_it_is_ready_is_a_fault_and_no_exception() -> None:
    planner = PlannerProcess(SETTINGS)
    assert planner.pid is not None
    os.kill(planner.pid, signal.SIGKILL)
    assert planner.take(PATIENCE_S) is None and not planner.ready
    planner.ask(questions()[0])
    planner.close()
    assert planner.fault is not None and "-9" in planner.fault


def test_a_planner_that_hangs_never_holds_the_loop_up(elsewhere: PlannerProcess) -> None:
    """Stopped, it takes nothing: questions are put into the pipe as long as it is sure to have room, others wait, then
    it is given up; a `send` that waited would wait for ever."""
    assert elsewhere.pid is not None
    os.kill(elsewhere.pid, signal.SIGSTOP)
    try:
        for question in questions(_MOST_UNANSWERED + _MOST_WAITING + 1):
            elsewhere.ask(question)
            assert elsewhere.take(0.0) is None
            assert elsewhere.fault is None or question.number == _MOST_UNANSWERED + _MOST_WAITING + 1
        assert elsewhere.fault is not None and "100 requests unanswered" in elsewhere.fault
    finally:
        os.kill(elsewhere.pid, signal.SIGCONT)


@pytest.mark.parametrize("hangs", [False, True])
def test_the_planner_ends_with_its_companion(tmp_path: Path, *, hangs: bool) -> None:
    """Killed, so that it can't say anything to anybody; also while the planner compiles, or hangs."""
    program = tmp_path / "program.py"
    program.write_text(
        "import signal, sys; from companion.config import Avoidance; from companion.runtime import planning\n"
        f"planning.rehearse = lambda settings: print('ready', flush=True) or ({hangs} and signal.pause())\n"
        "if __name__ == '__main__':\n"
        "    planner = planning.PlannerProcess(Avoidance(method='vfh'))\n"
        "    print(planner.pid, flush=True); sys.stdin.read()\n"
    )
    command = [sys.executable, str(program)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as companion:
        assert companion.stdout is not None
        planner = os.pidfd_open(int(companion.stdout.readline()))
        assert companion.stdout.readline() == "ready\n"
        companion.kill()
    ended, _, _ = select.select([planner], [], [], PATIENCE_S)
    os.close(planner)
    assert ended


def test_no_interrupt_reaches_a_planner_that_imports_and_none_that_is_left_holds_its_program_back() -> None:
    """multiprocessing ends its processes at the exit by SIGTERM, which this one ignores, and waits for them. The first
    process that a program starts is the hard one: multiprocessing lets interrupts in again as it starts its tracker."""
    text = (
        "import os, signal; from companion.config import Avoidance\n"
        "from companion.runtime.planning import PlannerProcess\n"
        "if __name__ == '__main__':\n"
        "    planner = PlannerProcess(Avoidance(method='vfh')); os.kill(planner.pid, signal.SIGINT)\n"
        "    planner.take(60.0); os.kill(planner.pid, signal.SIGINT)\n"
        "    print(planner.fault, signal.pthread_sigmask(signal.SIG_BLOCK, ()))\n"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "None set()", "")


def test_answers_count_their_delay_after_the_question() -> None:
    planning = Planning(InProcessPlanner(SETTINGS), 0.02)
    first, second, *_ = questions()
    planning.ask(first)
    assert planning.due(first.asked_ns + 19_999_999) is None
    planning.ask(second)
    answer = planning.due(first.asked_ns + 20_000_000)
    assert answer is not None and answer.number == 1
    assert planning.due(second.asked_ns + 19_999_999) is None
    answer = planning.due(second.asked_ns + 30_000_000)
    assert answer is not None and answer.number == 2
    assert planning.due(10**12) is None


def test_the_record_says_number_and_way() -> None:
    here = InProcessPlanner(SETTINGS)
    here.ask(questions()[0])
    answer = here.take(0.0)
    assert answer is not None
    record = PLANNED.unpack(pack_result(answer))
    corners = record["corners"]
    assert record["number"] == 1 and corners == len(answer.path.vertices)
    assert np.reshape(record["way_ned"], (-1, 2))[:corners] == pytest.approx(answer.path.vertices, abs=1e-5)
    assert record["speeds"][:corners] == pytest.approx(answer.path.speeds, abs=1e-5)
    assert not np.any(record["way_ned"][2 * corners :])


class Failing(InProcessPlanner):
    """Answers up to a number, and then never again."""

    def __init__(self, last: int) -> None:
        super().__init__(SETTINGS)
        self._left = itertools.count(last, -1)

    def take(self, patience_s: float) -> PlanResult | None:
        return super().take(patience_s) if next(self._left) > 0 else None


def test_without_answers_the_vehicle_stops_and_lands_by_itself() -> None:
    """The planner's process dies on the way: the guard brakes, the companion holds, the vehicle lands unhurt."""
    joined = Joined(
        mission_of("courier"),
        overrides=('avoidance.method="astar"', "avoidance.map.cells=160", "avoidance.map.cell=0.25"),
    )
    joined.fly_with(Failing(130))
    joined.fly(until=lambda flight: flight.autopilot.supervisor.state is State.HOLD, limit_s=60.0)
    assert joined.autopilot.navigator.phase is Phase.ROUTE
    joined.fly(limit_s=3.0)
    assert np.linalg.norm(joined.vehicle.motion.velocity_ned) < 0.3
    joined.fly(limit_s=60.0)
    summary = joined.vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and not joined.autopilot.navigator.released
    assert any("no map" in said for said in joined.said)
