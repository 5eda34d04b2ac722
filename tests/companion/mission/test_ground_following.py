"""Heights above the ground that rises and falls, and what becomes of them when it is not seen."""

import math

import numpy as np
import pytest

from companion.config import Settings
from companion.config_avoidance import Avoidance
from companion.curves import Route
from companion.mission.ground_following import GroundFollowing
from companion.mission.plan import Phase, Step
from companion.state import Ground

ROUTE = Step(Phase.ROUTE, np.array((40.0, 0.0, -1.0)), avoids=True)
"""3 m above a start at 2 m, NED."""


def begun(slope: float = 0.2) -> GroundFollowing:
    following = GroundFollowing(Settings(avoidance=Avoidance(ground_slope=slope)))
    following.begin(2.0)
    return following


def test_heights_go_up_as_the_ground_ahead_and_returns_count_from_the_ground_here() -> None:
    following = begun()
    changed, said = following.follow(Ground(0.5, 0.0), ROUTE, -2.0, 0)
    target = following.shifted(ROUTE).target_ned
    assert changed and said is None and target is not None
    np.testing.assert_allclose(target, (40.0, 0.0, -3.0))
    assert following.lowest_return == pytest.approx(0.0)
    np.testing.assert_allclose(following.planned(target), (40.0, 0.0, -1.0))


def test_nothing_is_lifted_beyond_the_fence_nor_pressed_below_what_was_planned() -> None:
    following = begun()
    following.begin(2.0, highest=-2.5)
    following.follow(Ground(0.0, 0.0), ROUTE, -2.0, 0)
    higher = Step(Phase.ROUTE, np.array((40.0, 0.0, -4.0)), avoids=True)
    lifted = [following.shifted(step).target_ned for step in (ROUTE, higher)]
    assert [target[2] for target in lifted if target is not None] == [-2.5, -4.0]


def test_ground_below_the_start_is_followed_down() -> None:
    following = begun()
    assert following.follow(Ground(6.0, 6.0), ROUTE, 1.0, 0) == (True, None)
    target = following.shifted(ROUTE).target_ned
    assert target is not None and target[2] == pytest.approx(3.0)


def test_a_little_more_or_less_changes_nothing() -> None:
    following = begun()
    assert following.follow(Ground(1.95, 1.95), ROUTE, -1.0, 0) == (False, None)


@pytest.mark.parametrize("phase", [Phase.TAKEOFF, Phase.TRACK, Phase.RETURN])
def test_take_off_and_tracks_count_from_the_start(phase: Phase) -> None:
    """The curve home, too: it would end as far below its home as the ground lies lower where it begins."""
    curve = None if phase is Phase.TAKEOFF else Route(np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), 4.0)
    following, step = begun(), Step(phase, np.array((0.0, 0.0, -1.0)), curve=curve)
    assert following.follow(Ground(0.0, 0.0), step, -1.0, 0) == (False, None)
    following.follow(Ground(0.0, 0.0), ROUTE, -1.0, 0)
    assert following.shifted(step) is step


def test_who_is_too_low_waits_until_it_has_climbed() -> None:
    following = begun()
    assert following.follow(Ground(2.0, 0.0), ROUTE, -0.9, 0) == (True, None) and following.too_low
    assert following.follow(Ground(2.0, 0.0), ROUTE, -1.1, 0) == (True, None) and not following.too_low
    low = Step(Phase.ROUTE, np.array((40.0, 0.0, 1.0)), avoids=True)  # a route of 1 m: 0.6 m will do
    following.follow(Ground(2.0, 2.0), low, 1.3, 0)
    assert not following.too_low


def test_without_sight_of_the_ground_heights_stay_and_all_returns_count() -> None:
    following = begun()
    following.follow(Ground(0.0, 0.0), ROUTE, -3.0, 0)
    changed, said = following.follow(None, ROUTE, -3.0, 0)
    assert not changed and said is not None and "not seen" in said.text
    assert following.lowest_return == math.inf
    target = following.shifted(ROUTE).target_ned
    assert target is not None and target[2] == pytest.approx(-3.0)
    assert following.follow(None, ROUTE, -3.0, 0) == (False, None), "said once"
    _, said = following.follow(Ground(0.0, 0.0), ROUTE, -3.0, 0)
    assert said is not None and "seen again" in said.text and following.lowest_return == pytest.approx(-0.5)


def test_where_no_ground_is_followed_heights_count_from_the_start() -> None:
    following = begun(slope=0.0)
    assert following.follow(None, ROUTE, -1.0, 0) == (False, None)
    assert following.follow(Ground(-5.0, -5.0), ROUTE, -1.0, 10**9) == (False, None)
    assert following.shifted(ROUTE) is ROUTE and following.lowest_return == pytest.approx(1.5)


def test_but_for_the_drift_of_the_vehicle_s_height() -> None:
    following = begun(slope=0.0)
    for second in range(5):
        following.follow(Ground(1.7, 1.7), ROUTE, -1.0, second * 10**9)
    assert following.lowest_return == pytest.approx(1.4)
    for second in range(5, 10):
        following.follow(Ground(1.4, 1.4), ROUTE, -1.0, second * 10**9)
    assert following.lowest_return == pytest.approx(1.1)
    target = following.shifted(ROUTE).target_ned
    assert target is not None and target[2] == pytest.approx(-1.4)
