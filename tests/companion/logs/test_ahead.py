"""Replays whose planner's answers come from a process that runs ahead."""

import math
import os
import signal
import subprocess
import sys
import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.avoidance.planner import PlanningPipeline, PlanRequest, PlanResult
from companion.logs import ahead
from companion.logs.ahead import Ahead, DivergedError
from companion.logs.replay import replay
from companion.records import ASKED, PLANNED
from companion.runtime.planning import pack_request
from companion.state import Scan
from protocol.flightlog import LogReader, Record
from tests.companion.logs.changed_logs import Flyer, rewritten

ALONE = """
import sys
from pathlib import Path
from companion.logs import ahead, replay

ahead._WORTH_IT = 0
taken = []
take = ahead.Ahead.take
ahead.Ahead.take = lambda *arguments: taken.append(take(*arguments)) or taken[-1]
result = replay.replay(Path(sys.argv[1]))
print(len(result.differences), result.datagrams, len(taken), None in taken)
"""


class Watched:
    """What was taken, and whether the flight asked something else."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.taken: list[PlanResult | None] = []
        self.diverged = 0
        take = Ahead.take
        monkeypatch.setattr(ahead, "_WORTH_IT", 0)
        monkeypatch.setattr(Ahead, "take", lambda its, patience_s: self.take(take, its, patience_s))

    def take(
        self, take: Callable[[Ahead, float], PlanResult | None], its: Ahead, patience_s: float
    ) -> PlanResult | None:
        try:
            answer = take(its, patience_s)
        except DivergedError:
            self.diverged += 1
            raise
        self.taken.append(answer)
        return answer


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(monkeypatch)


def count(log: LogReader, topic: str) -> int:
    return sum(1 for _ in log.records((topic,)))


def test_the_log_says_what_was_asked(fly: Flyer) -> None:
    log = LogReader(fly())
    asked, planned = (count(log, topic) for topic in (ASKED.topic, PLANNED.topic))
    assert asked >= planned > 100
    numbers = log.array(ASKED.topic)["number"]
    assert (numbers == np.arange(1, asked + 1)).all()


def test_in_a_copy_of_the_process(fly: Flyer) -> None:
    path = fly()
    done = subprocess.run([sys.executable, "-c", ALONE, str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    result = replay(path)
    assert done.stdout.split() == ["0", str(result.datagrams), str(count(LogReader(path), PLANNED.topic)), "False"]


def test_what_was_taken_last_holds_when_all_is_ready(fly: Flyer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its arrays lie where the process that runs ahead writes, which has gone as far as it may."""
    kept: list[PlanResult] = []
    take, answered, here = Ahead.take, PlanningPipeline.answer, os.getpid()

    def marked(its: PlanningPipeline, question: PlanRequest) -> PlanResult:
        answer = answered(its, question)
        if os.getpid() != here:  # a copy of this process; a vehicle that stands sees the same again and again
            answer.space.to_unseen[:] = question.number
        return answer

    def watched(its: Ahead, patience_s: float) -> PlanResult | None:
        answer = take(its, patience_s)
        assert answer is not None
        kept.append(answer)
        deadline = time.monotonic() + 20.0
        while its._free.get_value() and time.monotonic() < deadline:
            os.sched_yield()
        for held in kept[-2:]:
            assert (held.space.to_unseen == held.number).all(), f"{held.number} when {answer.number} was taken"
        if len(kept) == 20:
            raise DivergedError
        return answer

    monkeypatch.setattr("threading.active_count", lambda: 1)
    monkeypatch.setattr(ahead, "_WORTH_IT", 0)
    monkeypatch.setattr(PlanningPipeline, "answer", marked)
    monkeypatch.setattr(Ahead, "take", watched)
    assert replay(fly()).differences == [] and len(kept) == 20


def test_in_a_new_process(fly: Flyer, watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("threading.active_count", lambda: 2)
    path = fly()
    assert replay(path).differences == [] and not watched.diverged
    assert len(watched.taken) == count(LogReader(path), PLANNED.topic)


def test_what_was_not_asked_is_answered_here(fly: Flyer, watched: Watched, tmp_path: Path) -> None:
    """A log in which a question reads otherwise than the flight asks it."""

    def change(record: Record) -> list[Record]:
        if record.topic != ASKED.topic:
            return [record]
        row = np.frombuffer(record.data, ASKED.dtype).copy()
        row["speed"] += row["number"] == 60
        return [record._replace(data=row.tobytes())]

    path = rewritten(fly(), tmp_path / "changed.mcap", change)
    result = replay(path)
    assert result.differences == [] and result.datagrams == replay(fly()).datagrams
    assert watched.diverged == 1


def test_what_the_log_of_a_question_does_not_hold_is_answered_here(
    fly: Flyer, watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A vehicle at another height than the route's, where what is in the way depends on the height."""
    ask = Ahead.ask

    def at_another_height(its: Ahead, question: PlanRequest) -> None:
        ask(its, msgspec.structs.replace(question, in_the_way=(math.inf, 0.4)) if question.number == 40 else question)

    monkeypatch.setattr(Ahead, "ask", at_another_height)
    assert replay(fly()).differences == []
    assert watched.diverged == 1


def test_a_question_comes_out_of_its_record_as_it_was() -> None:
    known = np.ones(72, np.bool_)
    scan = Scan(5, 4, np.radians(5.0 * np.arange(72)), np.full(72, 15.0), ~known, known)
    here, level = np.array([1.0, 2.0, -3.0]), np.array([1.0, 0.0, 0.0, 0.0])
    asked = PlanRequest(7, 6, scan, (here, level), -0.5, here, np.zeros(3), here + 9.0, 4.0, margin=0.16)
    read = ahead._request(ASKED.unpack(pack_request(asked)), OrderedDict({(5, 4): scan}))
    assert read is not None and read.margin == 0.16
    assert ahead._identity(read) == ahead._identity(asked)


def test_a_process_that_ends_is_done_without(fly: Flyer, watched: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    ask = Ahead.ask

    def fatal(its: Ahead, question: PlanRequest) -> None:
        if question.number == 40:
            assert its.pid is not None
            os.kill(its.pid, signal.SIGKILL)
        ask(its, question)

    monkeypatch.setattr(Ahead, "ask", fatal)
    assert replay(fly()).differences == []
    assert watched.diverged == 1
