"""The trail: how long the way back is, where it turns, and how slowly it was flown."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Trajectory
from companion.mission.stall import Trail
from companion.mission.step_time import way_s
from protocol.arrays import Array

HOME = np.array([0.0, 0.0, -3.0])
LIMITS = Trajectory(climb_speed=1.0, descent_speed=0.5)


def empty(back: float = 1.0) -> Trail:
    """The way `back` is flown at so many m/s."""
    return Trail(back, LIMITS)


def along(
    *corners: tuple[float, float], step: float = 0.2, asked: float = 4.0, flown: float = 4.0, back: float = 1.0
) -> Trail:
    """A trail from home straight through these places (north, east), at 3 m, `asked` for and `flown` at so many m/s."""
    trail = empty(back)
    here, length = HOME, 0.0
    for north, east in corners:
        there = np.array([north, east, -3.0])
        count = max(round(math.dist(here.tolist(), there.tolist()) / step), 1)
        for share in np.linspace(0.0, 1.0, count + 1):
            place = here + share * (there - here)
            trail.add(place, asked, round((length + math.dist(here.tolist(), place.tolist())) / flown * 1e9))
        length += math.dist(here.tolist(), there.tolist())
        here = there
    return trail


def end(north: float, east: float) -> Array:
    return np.array([north, east, -3.0])


def test_a_straight_way_back_has_no_corners() -> None:
    trail = along((100.0, 0.0))
    assert trail.corners(end(100.0, 0.0), HOME) == []
    assert trail.back_s(end(100.0, 0.0), HOME) == pytest.approx(100.0)


def test_round_a_corner_the_way_back_turns_there() -> None:
    trail = along((50.0, 0.0), (50.0, 40.0))
    corners = trail.corners(end(50.0, 40.0), HOME)
    assert 1 <= len(corners) <= 2
    assert all(math.dist(corner.tolist(), (50.0, 0.0, -3.0)) < 6.0 for corner in corners)
    assert trail.back_s(end(50.0, 40.0), HOME) == pytest.approx(90.0, abs=5.0)


def test_loops_are_no_part_of_the_way_back() -> None:
    square = along((30.0, 0.0), (30.0, 30.0), (0.0, 30.0), (0.0, 0.0))
    assert square.back_s(HOME, HOME) < 1.0 and square.corners(HOME, HOME) == []


def test_without_a_trail_home_is_straight_away() -> None:
    assert empty().corners(end(30.0, 40.0), HOME) == []
    assert empty().back_s(end(30.0, 40.0), HOME) == pytest.approx(50.0)


def test_the_way_back_is_as_slow_as_the_way_flown() -> None:
    """Each second of a long way counts, a second of setting off hardly does; who waits is not slow, and who is quicker
    than asked for neither."""
    assert along((100.0, 0.0), back=4.0).slowness == pytest.approx(1.0)
    assert along((1000.0, 0.0), flown=2.0, back=4.0).slowness == pytest.approx(2.0, abs=0.05)
    assert along((2.0, 0.0), flown=1.0, back=4.0).slowness < 1.3
    assert along((100.0, 0.0), flown=8.0, back=4.0).slowness == 1.0


@pytest.mark.parametrize(
    ("asked", "flown", "back", "slowness"),
    [(8.0, 5.0, 4.0, 1.0), (8.0, 3.0, 4.0, 4.0 / 3.0), (2.0, 2.0, 4.0, 1.0), (2.0, 1.0, 4.0, 2.0)],
    ids=["faster", "too fast for the place", "slower", "slower than slow"],
)
def test_a_way_that_was_asked_to_be_faster_or_slower_than_the_way_back_tells_of_that(
    asked: float, flown: float, back: float, slowness: float
) -> None:
    trail = along((2000.0, 0.0), asked=asked, flown=flown, back=back)
    assert trail.slowness == pytest.approx(slowness, abs=0.02)


@pytest.mark.parametrize(("climbing", "slowness"), [(1.0, 1.0), (0.5, 2.0)])
def test_a_climb_takes_its_time_and_makes_the_way_back_no_slower(climbing: float, slowness: float) -> None:
    """The way back counts it by itself. It is asked for at 1 m/s."""
    trail = empty(4.0)
    for metres in range(4001):
        trail.add(np.array([0.0, 0.0, -3.0 - 0.5 * metres]), 4.0, round(0.5 * metres / climbing * 1e9))
    assert trail.slowness == pytest.approx(slowness, abs=0.01)


def test_neither_waiting_nor_what_others_fly_makes_the_way_back_slow() -> None:
    trail = along((100.0, 0.0), back=4.0)
    trail.add(end(101.0, 0.0), 4.0, 900_000_000_000)
    assert trail.slowness < 1.1
    trail.add(end(161.0, 0.0), 4.0, 2_000_000_000_000)
    assert trail.slowness < 1.1


@given(st.lists(st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0)), min_size=1, max_size=6))
def test_the_way_back_keeps_to_the_trail(corners: list[tuple[float, float]]) -> None:
    """Each place of the trail is within a metre of the polygon that is flown back, in its order."""
    trail, here = along(*corners, step=1.0), end(*corners[-1])
    way = [here, *trail.corners(here, HOME), HOME]
    for place in trail.back():
        assert min(distance(place, one, other) for one, other in pairwise(way)) <= 1.0 + 1e-9


def distance(place: Array, start: Array, stop: Array) -> float:
    way = stop - start
    share = float(np.clip((place - start) @ way / max(float(way @ way), 1e-12), 0.0, 1.0))
    return float(np.linalg.norm(place - start - share * way))


def test_no_loop_is_left_in_a_trail_through_space() -> None:
    rng, trail, here, pace = np.random.default_rng(1), empty(), HOME, np.zeros(3)
    for _ in range(2000):
        pace = 0.95 * pace + rng.normal(0.0, 0.3, 3)
        here = here + pace
        trail.add(here, 5.0, 0)
    places = np.array(trail.back())
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 10.0 * np.eye(len(places))
    assert len(places) > 100 and apart.min() >= 5.0
    way = np.array([here, *places, HOME])
    assert trail.back_s(here, HOME) == pytest.approx(sum(way_s(leg, 1.0, LIMITS) for leg in np.diff(way, axis=0)))


def test_back_down_a_shaft_it_sinks_and_does_not_climb() -> None:
    trail = empty()
    for height in np.arange(3.0, 33.1, 0.5):
        trail.add(np.array([0.0, 0.0, -height]), 1.0, 0)
    top = np.array([0.0, 0.0, -33.0])
    assert trail.back_s(top, HOME) == pytest.approx(60.0)
    assert empty().back_s(HOME, top) == pytest.approx(30.0)
