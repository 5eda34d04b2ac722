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
    missing,
    outcome,
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
    ("process", "came_to", "kept"),
    [
        (PLANNER, "landed", True),
        (PLANNER, "delivered", True),
        (COMPANION, STAYED, True),
        (PLANNER, "contact", False),
        (PLANNER, "not ended", False),
        (PLANNER, "no signal", False),
        (RECORDER, "landed", False),
        (VEHICLE, "gone", True),
        (VEHICLE, "landed", False),
    ],
)
def test_a_promise_is_kept_by_what_the_vehicle_came_to(process: str, came_to: str, kept: bool) -> None:
    assert msgspec.structs.replace(ROW, process=process, outcome=came_to).kept is kept


@pytest.mark.parametrize("wrong", [{"log": "cut"}, {"missing_s": 0.21}, {"differences": 1}, {"differences": None}])
def test_a_log_opens_lacks_nothing_and_replays(wrong: dict[str, object]) -> None:
    assert ROW.logged and not msgspec.structs.replace(ROW, **wrong).logged


def test_a_log_whose_recorder_was_killed_is_cut_off_and_no_other() -> None:
    cut = msgspec.structs.replace(ROW, process=RECORDER, log="cut off at byte 7")
    assert cut.logged and not msgspec.structs.replace(cut, signal="SIGTERM").logged


@pytest.mark.parametrize(
    ("process", "ended", "words", "expected"),
    [
        (COMPANION, {"outcome": "landed", "contacts": 0, "flight_time_s": 9.0}, None, "landed"),
        (RECORDER, {"outcome": "landed", "contacts": 0, "flight_time_s": 9.0}, "delivered", "delivered"),
        (COMPANION, {"outcome": "stopped", "contacts": 0, "flight_time_s": 0.0}, None, STAYED),
        (COMPANION, {"outcome": "crashed", "contacts": 1, "flight_time_s": 9.0}, None, "contact"),
        (COMPANION, None, "delivered", "not ended"),
        (VEHICLE, None, "telemetry lost", "gone"),
        (VEHICLE, {"outcome": "stopped", "contacts": 0, "flight_time_s": 9.0}, None, "gone"),
        (VEHICLE, {"outcome": "landed", "contacts": 0, "flight_time_s": 9.0}, "lost", "landed"),
    ],
)
def test_what_the_vehicle_came_to(
    process: str, ended: dict[str, object] | None, words: str | None, expected: str
) -> None:
    assert outcome(Kill(process, "SIGKILL", 1, ""), ended, words) == expected


def test_a_vehicle_that_stands_still_before_its_take_off_stays_on_the_ground() -> None:
    never_flew: dict[str, object] = {"outcome": "stopped", "contacts": 0, "flight_time_s": 0.0}
    assert outcome(Kill(VEHICLE, "SIGSTOP 3 s", 1, ""), never_flew, "telemetry lost") == STAYED
    assert outcome(Kill(VEHICLE, "SIGTERM", 1, ""), never_flew, "telemetry lost") == "gone"


def test_what_a_log_lacks_counts_from_the_first_that_is_missing_to_the_signal() -> None:
    sent = [(1_000_000_000, b"a"), (1_500_000_000, b"b"), (1_800_000_000, b"c"), (2_500_000_000, b"d")]
    assert missing(sent, {b"a", b"c"}, 2_000_000_000) == pytest.approx(0.5)
    assert missing(sent, {b"a", b"b", b"c"}, 2_000_000_000) == 0.0, "what came after the signal is nobody's"


def test_the_page_says_what_was_not_as_promised(tmp_path: Path) -> None:
    report = Report("kills", "Kills", tmp_path)
    kills.tell(report, [ROW, msgspec.structs.replace(ROW, seed=2, outcome="contact", missing_s=0.3)])
    text = markdown(report.section(), "faults")
    assert "| planner | SIGKILL | holds, lands after 5 s | 2 | 1 of 2 (9-91 %) | 1 contact, 1 landed | 2 hold |" in text
    assert "| planner | SIGKILL | 2 | 5 | contact | landed: no map | opens | 0.3 | 0 |" in text
    assert [check.ok for check in report.section().checks] == [False, False, False]
