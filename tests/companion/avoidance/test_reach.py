"""What a fast vehicle can't reach without braking costs more."""

import numpy as np
import pytest

from companion.avoidance.planner import Planner
from companion.avoidance.reach import add_turns
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.perception.distance_field import Floats, distance_to
from companion.perception.map_view import FREE, OCCUPIED, MapView
from protocol.arrays import Array

CELL, CELLS = 0.2, 200
CORNER = (-100, -100)
ACCELERATION, BRAKING, LAG_S = 6.0, 4.5, 0.15
PLACES = (np.arange(CELLS) - 99.5) * CELL
"""m of the cells' centres, north or east."""


def added(velocity: tuple[float, float]) -> Floats:
    costmap = np.ones((CELLS, CELLS), np.float32)
    add_turns(costmap, (0.0, 0.0), velocity, (ACCELERATION, BRAKING, LAG_S), CORNER, CELL)
    return costmap - 1.0


def test_what_is_in_reach_of_the_lateral_acceleration_costs_nothing() -> None:
    speed = 9.0
    costs = added((speed, 0.0))
    along, across = np.meshgrid(PLACES - LAG_S * speed, np.abs(PLACES), indexing="ij")
    stopping = np.hypot(along, across) < 0.5 * speed**2 / BRAKING
    in_time = 0.5 * ACCELERATION * (np.maximum(along, 0.0) / speed) ** 2
    assert not costs[(across < in_time - CELL) & (along > CELL)].any()
    assert (costs[stopping & (across > in_time + 2.0 * CELL)] > 0.0).all()
    assert not costs[np.hypot(along, across) > 0.5 * speed**2 / BRAKING + CELL].any()
    np.testing.assert_array_equal(costs, costs[:, ::-1])


def test_the_cost_is_by_how_much_slower_the_vehicle_must_be() -> None:
    """3 m aside take a second, in which 9 m are flown: where 4.5 m are left, half the speed does."""
    costs = added((9.0, 0.0))
    row, column = int((4.5 + LAG_S * 9.0) / CELL) + 100, int(3.0 / CELL) + 100
    assert costs[row, column] == pytest.approx(0.5, abs=0.1)
    assert costs[80, 100] == pytest.approx(1.5), "behind"


def test_a_slow_vehicle_turns_as_it_likes_and_the_window_may_end_anywhere() -> None:
    assert not added((2.9, 0.0)).any()
    costmap = np.ones((20, 20), np.float32)
    add_turns(costmap, (0.0, 0.0), (0.0, 9.0), (ACCELERATION, BRAKING, LAG_S), (-5, -5), CELL)
    np.testing.assert_array_equal(costmap, 1.0 + added((0.0, 9.0))[95:115, 95:115])


def test_the_costs_turn_and_are_mirrored_with_the_velocity() -> None:
    costs = added((7.0, 3.0))
    for turned, velocity in (
        (costs[:, ::-1], (7.0, -3.0)),
        (costs[::-1], (-7.0, 3.0)),
        (costs.T, (3.0, 7.0)),
        (costs[::-1, ::-1], (-7.0, -3.0)),
    ):
        np.testing.assert_allclose(added(velocity), turned, atol=1e-5)


def first_side(speed: float, velocity: Array) -> float:
    """East (m) at which the path passes a trunk 7 m ahead, a little to the left of the straight way."""
    states = np.full((384, 384), FREE, np.uint8)
    states[246:250, 188:192] = OCCUPIED
    view = MapView(states, distance_to(states == OCCUPIED, 0.125), (-192, -192), 0.125)
    planner = Planner(Avoidance(method="astar", map=AvoidanceMap(cell=0.125, cells=384)))
    path = planner.path(view, np.array([0.0, 0.0, -3.0]), velocity, np.array([20.0, 0.0, -3.0]), speed)
    return float(np.interp(7.0, path.vertices[:, 0], path.vertices[:, 1]))


def test_of_two_ways_around_the_one_in_reach_is_flown() -> None:
    """To the right is the shorter way; who flies to the left at 8 m/s goes on to the left."""
    leftward = np.array([8.0, -2.5, 0.0])
    assert first_side(10.0, np.array([8.0, 0.0, 0.0])) > 0.5
    assert first_side(10.0, leftward) < -0.5
    assert first_side(6.0, leftward) > 0.5, "slower flights are planned without"
