"""What a step of the mission may take."""

import pytest

from companion.config import Settings
from companion.mission.step_time import StepTime

MORE_S = Settings().supervision.step_timeout


@pytest.mark.parametrize(
    ("hold_s", "track_s", "length", "climb", "allowed"),
    [
        (20.0, 0.0, 0.0, 0.0, 20.0),
        (0.0, 0.0, 40.0, 0.0, 30.0),
        (0.0, 25.0, 0.0, 0.0, 75.0),
        (0.0, 25.0, 40.0, 0.0, 105.0),
        (0.0, 0.0, 0.0, 3.0, 6.0),
        (0.0, 0.0, 40.0, 3.0, 30.0),
    ],
    ids=["hold", "way", "figure", "way to a figure", "climb", "way while it climbs"],
)
def test_holds_count_once_and_what_is_flown_three_times(
    hold_s: float, track_s: float, length: float, climb: float, allowed: float
) -> None:
    """What can't keep its speed is flown slower."""
    time = StepTime(Settings())
    assert time.allowed(hold_s, track_s, length, 4.0, climb) == pytest.approx(MORE_S + allowed)


def test_it_is_overdue_after_that_without_the_pauses() -> None:
    time = StepTime(Settings())
    time.begin(1_000_000_000)
    time.pause(3_000_000_000)
    time.resume(10_000_000_000)
    assert time.overdue(5.0, 12_000_000_000) == 0.0
    assert time.overdue(5.0, 15_000_000_000) == pytest.approx(2.0)
