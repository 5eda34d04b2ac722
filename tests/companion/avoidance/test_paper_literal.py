"""The paper's rule as printed: which edges, how far outside, when; the same in all four directions and in a mirror."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.avoidance.methods import goal_rule
from companion.avoidance.paper_literal import LiteralPaperRule, outside_nearer_edge, past_edge_towards
from companion.config_avoidance import Avoidance
from companion.state import AvoidanceDecision
from protocol.arrays import Array

SETTINGS = Avoidance(method="paper-literal")
ROOM = SETTINGS.vehicle_radius + SETTINGS.safe_distance
HERE = np.array([0.0, 0.0, -3.0])
GOAL = np.array([20.0, 0.0, -3.0])
SPEED = 4.0
PLACES = st.lists(st.tuples(st.floats(0.5, 19.0), st.floats(-5.0, 5.0)), min_size=1, max_size=12)


def box(south: float, north: float, west: float, east: float) -> Array:
    """Returns at the corners of an obstacle."""
    return np.array([[n, e, -3.0] for n in (south, north) for e in (west, east)])


def decide(points: Array, here: Array = HERE, goal: Array = GOAL) -> AvoidanceDecision:
    return LiteralPaperRule(SETTINGS).decide(points, here, np.zeros(3), goal, SPEED)


def quarter_turned(vectors: Array) -> Array:
    """North becomes east."""
    return np.stack([-vectors[..., 1], vectors[..., 0], vectors[..., 2]], axis=-1)


def mirrored(vectors: Array) -> Array:
    return np.multiply(vectors, (1.0, -1.0, 1.0))


def test_the_settings_choose_it() -> None:
    assert isinstance(goal_rule(SETTINGS), LiteralPaperRule)


def test_three_metres_outside_the_nearer_edge_and_past_the_obstacle() -> None:
    """A box from 8 to 10 m ahead: to the left of its left edge at -1, or to the right of its right edge at +1."""
    assert np.allclose(decide(box(8.0, 10.0, -1.0, 2.0)).target_ned, [13.0, -4.0, -3.0])
    assert np.allclose(decide(box(8.0, 10.0, -2.0, 1.0)).target_ned, [13.0, 4.0, -3.0])


def test_a_wall_on_the_right_alone_is_passed_on_the_left() -> None:
    decision = decide(box(8.0, 10.0, 0.5, 9.0))
    assert decision.blocked
    assert decision.target_ned[1] == pytest.approx(0.5 - 3.0)


def test_a_tie_belongs_to_the_least_edge_alone() -> None:
    """Both branches of the print hold there."""
    assert decide(box(8.0, 10.0, -1.0, 1.0)).target_ned[1] == pytest.approx(-4.0)
    assert outside_nearer_edge(0.0, -1.0, 1.0, 3.0) == -4.0


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(0.0, 20.0))
def test_the_place_is_outside_and_the_other_side_is_farther(position: float, least: float, width: float) -> None:
    most = least + width
    place = outside_nearer_edge(position, least, most, 3.0)
    (other,) = {least - 3.0, most + 3.0} - {place}
    assert abs(place - position) <= abs(other - position) + 1e-9


def test_along_the_course_it_is_the_edge_towards_the_goal() -> None:
    """As (31) prints it before the obstacle's middle; beside the far end it still leads on, and never past the goal."""
    for position in (0.0, 9.9):
        assert past_edge_towards(20.0, position, 8.0, 10.0, 3.0) == 13.0
        assert past_edge_towards(11.0, position, 8.0, 10.0, 3.0) == 11.0
    assert past_edge_towards(-20.0, 0.0, -10.0, -8.0, 3.0) == -13.0
    assert past_edge_towards(-11.0, 0.0, -10.0, -8.0, 3.0) == -11.0


def test_one_box_stands_around_all_returns() -> None:
    """That is the print, and why there is another method to fly with: the gap of 8 m is not seen."""
    points = np.vstack([box(8.0, 9.0, -6.0, -4.0), box(8.0, 9.0, 4.0, 7.0)])
    assert decide(points).target_ned[1] == pytest.approx(-9.0)


def test_what_is_beside_behind_or_past_the_goal_changes_nothing() -> None:
    for points in (
        box(8.0, 10.0, ROOM + 0.01, 5.0),
        box(-5.0, -ROOM - 0.01, -1.0, 1.0),
        box(20.0 + ROOM + 0.01, 25.0, -1.0, 1.0),
        np.empty((0, 3)),
    ):
        decision = decide(points)
        assert np.array_equal(decision.target_ned, GOAL) and not decision.blocked
        assert decision.speed_limit == SPEED
    assert decide(box(8.0, 10.0, ROOM - 0.01, 5.0)).blocked


def test_the_obstacle_counts_until_it_is_passed() -> None:
    """On the way past, beside it: still its side; behind it by the room that is kept: the goal."""
    points = box(8.0, 10.0, -1.0, 2.0)
    beside = decide(points, here=np.array([9.9, -3.5, -3.0]))
    assert np.allclose(beside.target_ned, [13.0, -4.0, -3.0])
    assert not decide(points, here=np.array([10.0 + ROOM + 0.01, -3.5, -3.0])).blocked


def test_the_setpoint_is_not_past_the_goal() -> None:
    assert decide(box(16.0, 19.0, -1.0, 2.0)).target_ned[0] == pytest.approx(20.0)


def test_clearance_is_that_of_the_hull() -> None:
    assert decide(box(3.0, 4.0, 4.0, 5.0)).clearance == pytest.approx(5.0 - SETTINGS.vehicle_radius)
    assert decide(np.empty((0, 3))).clearance == math.inf


@given(PLACES)
def test_the_same_in_all_four_directions(places: list[tuple[float, float]]) -> None:
    """Ties aside, where the least edge is another one after a turn."""
    points = np.array([(north, east, -3.0) for north, east in places])
    if abs(points[:, 1].min() + points[:, 1].max()) < 1e-6:
        return
    expected, target = decide(points), decide(points).target_ned
    goal = GOAL
    for _ in range(3):
        points, goal, target = quarter_turned(points), quarter_turned(goal), quarter_turned(target)
        turned = decide(points, goal=goal)
        assert np.allclose(turned.target_ned, target)
        assert turned.blocked == expected.blocked


@given(PLACES)
def test_the_same_in_a_mirror(places: list[tuple[float, float]]) -> None:
    points = np.array([(north, east, -3.0) for north, east in places])
    if abs(points[:, 1].min() + points[:, 1].max()) < 1e-6:
        return
    assert np.allclose(decide(mirrored(points)).target_ned, mirrored(decide(points).target_ned))


@given(PLACES, st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0), st.floats(-20.0, 0.0)))
def test_the_same_anywhere(places: list[tuple[float, float]], shift: tuple[float, float, float]) -> None:
    points, offset = np.array([(north, east, -3.0) for north, east in places]), np.array(shift)
    gaps = [points[:, 1].min() + points[:, 1].max(), *(np.abs(points[:, 1]) - ROOM)]
    if min(abs(gap) for gap in gaps) < 1e-6:
        return  # an edge of a rule: rounding decides
    there = decide(points + offset, here=HERE + offset, goal=GOAL + offset)
    assert np.allclose(there.target_ned, decide(points).target_ned + offset)
