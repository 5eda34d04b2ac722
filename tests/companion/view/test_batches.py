"""The records of a log in batches: in times of their own where the log's clock leaps."""

from pathlib import Path

import pytest

from companion.logs.writer import Writer
from companion.view.batches import Leap, batches
from protocol.flightlog import LogReader, record_type

FAST, SLOW, LATE = (record_type(f"/{name}", "x/A", [("x", "float32")]) for name in ("fast", "slow", "late"))
S = 1_000_000_000
HOUR = 3600


def told(path: Path, order: list[tuple[str, float]]) -> tuple[dict[str, list[float]], list[Leap]]:
    """The times (s) by topic, and the leaps, of records in the order of a file."""
    kinds = {kind.topic[1:]: kind for kind in (FAST, SLOW, LATE)}
    with Writer(path, 10**18, {}) as writer:
        for number, (name, seconds) in enumerate(order):
            writer.record(kinds[name], round(seconds * S), number, bytes(4))
    leaps: list[Leap] = []
    found = {topic[1:]: (times / S).tolist() for topic, _, times, _ in batches(LogReader(path), leaps)}
    return found, leaps


@pytest.mark.parametrize("by", [HOUR, -HOUR, 1e8, -60.0])
def test_a_leap_is_left_out_of_all_topics(tmp_path: Path, by: float) -> None:
    """Also of one that is there first behind it."""
    order = [("slow", 0.0), *(("fast", float(at)) for at in range(10))]
    behind = [("late", by + 9.5), ("fast", by + 10.0), ("slow", by + 11.0), ("fast", by + 12.0)]
    found, leaps = told(tmp_path / "a.mcap", [*order, *behind])
    assert leaps == [Leap(9 * S, round((by + 0.5) * S))]
    assert found == {"slow": [0.0, 10.5], "fast": [*map(float, range(10)), 9.5, 11.5], "late": [9.0]}


def test_a_log_that_is_set_twice_has_two_leaps(tmp_path: Path) -> None:
    order = [("fast", at) for at in (0.0, 1.0, 5000.0, 5001.0, 2.0, 3.0)]
    found, leaps = told(tmp_path / "a.mcap", order)
    assert leaps == [Leap(S, 4999 * S), Leap(2 * S, -4999 * S)]
    assert found["fast"] == [0.0, 1.0, 1.0, 2.0, 2.0, 3.0]


def test_topics_one_after_the_other_are_no_leap(tmp_path: Path) -> None:
    """Whole, or in pieces; and one that is seldom heard."""
    whole = [(name, float(at)) for name in ("fast", "slow", "late") for at in range(0, 4000, 20)]
    found, leaps = told(tmp_path / "a.mcap", whole)
    assert leaps == [] and all(times == [float(at) for at in range(0, 4000, 20)] for times in found.values())
    pieces = [(name, at + 0.0) for start in (0, 50) for name in ("fast", "slow") for at in range(start, start + 50)]
    found, leaps = told(tmp_path / "b.mcap", pieces)
    assert leaps == [] and found["slow"] == [float(at) for at in range(100)]
    seldom = [("slow", 0.0), *(("fast", float(at)) for at in range(0, 4000, 100)), ("slow", 4000.0), ("late", 0.0)]
    found, leaps = told(tmp_path / "c.mcap", seldom)
    assert leaps == [] and found["slow"] == [0.0, 4000.0] and found["late"] == [0.0]
