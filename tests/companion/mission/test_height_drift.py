"""What is taken for a drift of the vehicle's height, and what for something that stands on the ground."""

import pytest

from companion.mission.height_drift import HeightDrift
from companion.state import Ground

START = 2.0
"""m, NED"""
MOST, TICK_S = 1.5, 0.1


class Flown:
    """Seconds over ground that is nearer, or lies lower, by so much than that of the start."""

    def __init__(self) -> None:
        self.drift, self.said, self._now_ns = HeightDrift(MOST), list[str](), 0

    def over(self, nearer: float | None, seconds: float) -> float:
        for _ in range(round(seconds / TICK_S)):
            ground = None if nearer is None else Ground(START - nearer, START - nearer)
            said = self.drift.follow(ground, START, self._now_ns)
            self.said += [] if said is None else [said.text]
            self._now_ns += round(TICK_S * 1e9)
        return self.drift.rise

    def drifts(self, start: float, end: float, rate: float = 0.3) -> float:
        steps = round(abs(end - start) / (rate * TICK_S))
        for step in range(steps):
            self.over(start + (end - start) * (step + 1) / steps, TICK_S)
        return self.over(end, 3.0)


def test_a_drift_is_followed_but_for_what_there_is_room_for() -> None:
    flown = Flown()
    assert flown.drifts(0.0, 0.19) == 0.0 and not flown.said
    assert flown.drifts(0.19, 1.1) == pytest.approx(0.9)
    assert flown.said == ["the ground below is 0.7 m nearer than the vehicle's height says: flying higher while it is"]
    assert flown.drifts(1.1, 0.3) == pytest.approx(0.1)
    assert flown.drifts(0.3, -1.0) == 0.0, "ground that is farther away than it should be is in nobody's way"
    assert len(flown.said) == 1


def test_it_is_followed_no_faster_than_estimates_drift() -> None:
    flown = Flown()
    assert flown.over(0.39, 0.2) == pytest.approx(0.05), "from the second time on"
    assert flown.over(0.39, 3.0) == pytest.approx(0.19)
    assert flown.over(0.0, 0.2) == pytest.approx(0.09)


@pytest.mark.parametrize("height", [0.5, 1.2, 3.0, -0.5])
def test_what_begins_with_a_step_is_none_however_long_it_lasts(height: float) -> None:
    flown = Flown()
    flown.drifts(0.0, 0.6)
    assert flown.over(0.6 + height, 60.0) == pytest.approx(0.4)
    assert flown.drifts(0.6, 0.8) == pytest.approx(0.6), "and then it goes on"


def test_more_than_a_drift_can_be_changes_nothing() -> None:
    flown = Flown()
    assert flown.drifts(0.0, 3.0) == pytest.approx(MOST - 0.2, abs=0.05)


def test_what_has_come_about_unseen_counts_once_it_is_seen() -> None:
    flown = Flown()
    assert flown.over(None, 1.0) == 0.0
    assert flown.over(0.8, 3.0) == pytest.approx(0.6), "0.4 m, and 0.5 m for each second"
    assert flown.over(1.5, 3.0) == pytest.approx(0.6)
