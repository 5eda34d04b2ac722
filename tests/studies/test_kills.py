"""Killed processes: who gets which signal when, and how a flight becomes a row of the table."""

import signal
from pathlib import Path

import msgspec
import pytest

from studies.faults import kills
from studies.faults.kills import (
    COMPANION,
    PLANNER,
    PROCESSES,
    PROMISES,
    RECORDER,
    SIGNALS,
    STAYED,
    VEHICLE,
    Blow,
    Kill,
    Row,
    Sent,
)
from studies.faults.proxy import Console
from studies.report import Report, markdown

ROW = Row(PLANNER, "SIGKILL", 1, "abc", 5.0, "landed", "landed: no map", "hold", 0.5, None, 0.0, 0, 30.0)


@pytest.mark.parametrize(("name", "number"), [("SIGKILL", signal.SIGKILL), ("SIGTERM", signal.SIGTERM)])
def test_the_signal_is_sent_once_the_moment_has_come(name: str, number: signal.Signals) -> None:
    between = Sent(5.0)
    blow, vehicle = (
        Blow(Kill(VEHICLE, name, 1, ""), between),
        Console("timeit", "-n", "1", "import signal; signal.pause()"),
    )
    blow(vehicle, vehicle)
    assert vehicle.process.poll() is None
    between.began_ns = 1
    blow(vehicle, vehicle)
    blow(vehicle, vehicle)
    assert vehicle.end() is None and vehicle.process.returncode == -number


def test_who_is_stopped_goes_on_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, now = list[tuple[int, int]](), [0]
    monkeypatch.setattr("os.kill", lambda pid, number: sent.append((now[0], number)))
    monkeypatch.setattr("time.monotonic_ns", lambda: now[0])
    between, vehicle = Sent(5.0), Console("timeit", "-n", "1", "pass")
    vehicle.end()
    blow = Blow(Kill(VEHICLE, "SIGSTOP 3 s", 1, ""), between)
    between.began_ns = 1
    for now[0] in range(0, 5_000_000_000, 500_000_000):
        blow(vehicle, vehicle)
    assert sent == [(0, signal.SIGSTOP), (3_000_000_000, signal.SIGCONT)]


def test_each_process_and_signal_has_a_promise() -> None:
    assert set(PROMISES) == {(process, name) for process in PROCESSES for name in SIGNALS}


@pytest.mark.parametrize(
    ("process", "outcome", "kept"),
    [
        (PLANNER, "landed", True),
        (PLANNER, "delivered", True),
        (COMPANION, STAYED, True),
        (PLANNER, "contact", False),
        (PLANNER, "not ended", False),
        (RECORDER, "landed", False),
        (VEHICLE, "gone", True),
        (VEHICLE, "landed", False),
    ],
)
def test_a_promise_is_kept_by_what_the_vehicle_came_to(process: str, outcome: str, kept: bool) -> None:
    assert msgspec.structs.replace(ROW, process=process, outcome=outcome).kept is kept


@pytest.mark.parametrize("wrong", [{"log": "cut"}, {"missing_s": 0.21}, {"differences": 1}, {"differences": None}])
def test_a_log_opens_lacks_nothing_and_replays(wrong: dict[str, object]) -> None:
    assert ROW.logged and not msgspec.structs.replace(ROW, **wrong).logged


def test_the_page_says_what_was_not_as_promised(tmp_path: Path) -> None:
    report = Report("kills", "Kills", tmp_path)
    kills.tell(report, [ROW, msgspec.structs.replace(ROW, seed=2, outcome="contact", missing_s=0.3)])
    text = markdown(report.section(), "faults")
    assert "| planner | SIGKILL | holds, lands after 5 s | 2 | 1 of 2 (9-91 %) | 1 contact, 1 landed | 2 hold |" in text
    assert "| planner | SIGKILL | 2 | 5 | contact | landed: no map | opens | 0.3 | 0 |" in text
    assert [check.ok for check in report.section().checks] == [False, False, False]
