"""What a step of the mission may take."""

import numpy as np
import pytest

from companion.config import Settings
from companion.mission.step_time import StepTime, way_s

MORE_S = Settings().supervision.step_timeout
LIMITS = Settings().trajectory
"""Up at 1.5 m/s, down at 1 m/s."""


@pytest.mark.parametrize(
    ("way", "seconds"),
    [
        ((24.0, -32.0, 0.0), 10.0),
        ((0.0, 0.0, -30.0), 20.0),
        ((0.0, 0.0, 30.0), 30.0),
        ((24.0, 32.0, -9.0), 10.0),
        ((24.0, 32.0, 30.0), 30.0),
        ((0.0, 0.0, 0.0), 0.0),
    ],
    ids=["across", "up", "down", "climbs on the way", "sinks for longer", "there"],
)
def test_a_way_takes_as_long_as_the_slower_of_both_across_and_up_or_down(
    way: tuple[float, float, float], seconds: float
) -> None:
    assert way_s(np.array(way), 4.0, LIMITS) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("hold_s", "track_s", "explored", "allowed"),
    [
        (20.0, None, 0.0, 20.0 + 30.0),
        (20.0, None, 39.0, 20.0 + 30.0),
        (20.0, None, 80.0, 20.0 + 60.0),
        (20.0, 25.0, 0.0, 75.0 + 30.0),
    ],
    ids=["hold", "less than the way", "long search", "figure"],
)
def test_holds_count_once_and_what_is_flown_three_times(
    hold_s: float, track_s: float | None, explored: float, allowed: float
) -> None:
    """What can't keep its speed is flown slower."""
    time = StepTime(Settings())
    time.way = np.array((40.0, 0.0, -3.0))
    assert time.allowed(hold_s, track_s, 4.0, explored) == pytest.approx(MORE_S + allowed)


def test_it_is_overdue_after_that_without_the_pauses() -> None:
    time = StepTime(Settings())
    time.begin(1_000_000_000)
    time.pause(3_000_000_000)
    time.resume(10_000_000_000)
    assert time.overdue(5.0, 12_000_000_000) == 0.0
    assert time.overdue(5.0, 15_000_000_000) == pytest.approx(2.0)
