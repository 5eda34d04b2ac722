"""Moving obstacles in the costmap and in the path: they cost where they will be when the vehicle could be there."""

import dataclasses
import math

import numpy as np
import pytest

from companion.avoidance.moving import add_moving
from companion.avoidance.path import Path
from companion.avoidance.planner import Planner
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.perception.distance_field import Floats, distance_to
from companion.perception.map_view import FREE, OCCUPIED, MapView
from protocol.arrays import Array

CELL, CELLS = 0.25, 256
CORNER = (-CELLS // 2, -CELLS // 2)
ROOM = 0.8
HERE, GOAL = np.array([0.0, 0.0, -3.0]), np.array([28.0, 0.0, -3.0])


def mover(north: float, east: float, vn: float, ve: float) -> Array:
    return np.array([[north, east, vn, ve, ROOM]])


def costs(points: Array, present: float, highest: float) -> Floats:
    costmap = np.zeros((CELLS, CELLS), np.float32)
    add_moving(costmap, points, (0.0, 0.0), (present, highest), CORNER, CELL)
    return costmap


def place(costmap: Floats, north: float, east: float) -> float:
    return float(costmap[math.floor(north / CELL) - CORNER[0], math.floor(east / CELL) - CORNER[1]])


def path(*points: Array, speed: float = 6.0) -> Path:
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    view = MapView(states, distance_to(states == OCCUPIED, CELL), CORNER, CELL)
    if points:
        view = dataclasses.replace(view, moving=np.concatenate(points))
    planner = Planner(Avoidance(method="astar", map=AvoidanceMap(cell=CELL, cells=CELLS)))
    return planner.path(view, HERE, np.array([speed, 0.0, 0.0]), GOAL, speed)


def east_at(flown: Path, north: float) -> float:
    return float(np.interp(north, flown.vertices[:, 0], flown.vertices[:, 1]))


@pytest.mark.parametrize("turn", np.radians([0.0, 90.0, 180.0, 270.0]))
def test_a_mover_costs_where_both_would_meet(turn: float) -> None:
    """Ahead on at 4 m/s from 20 m, the vehicle at 6 m/s: they meet after 2 s, 12 m away."""
    cos, sin = math.cos(turn), math.sin(turn)
    costmap = costs(mover(20.0 * cos, 20.0 * sin, -4.0 * cos, -4.0 * sin), 6.0, 6.0)
    met = np.array([place(costmap, along * cos + 0.01, along * sin + 0.01) for along in np.arange(1.0, 25.0, 0.5)])
    assert np.arange(1.0, 25.0, 0.5)[met.argmax()] == pytest.approx(12.0, abs=0.5)
    assert met[0] == 0.0 and met[-1] == 0.0


def test_the_slower_the_vehicle_may_be_the_longer_is_the_stretch() -> None:
    """At 2 m/s they would meet 6.7 m away; at an unknown speed between both, anywhere between."""
    point = mover(20.0, 0.0, -4.0, 0.0)
    both = costs(point, 2.0, 6.0)
    assert all(place(both, north, 0.0) > 8.0 for north in (7.0, 9.0, 11.5))
    assert place(costs(point, 2.0, 2.0), 11.5, 0.0) == 0.0 == place(costs(point, 6.0, 6.0), 7.0, 0.0)


def test_where_a_mover_has_left_there_is_no_cost() -> None:
    """Across the way at 2 m/s, 12 m ahead and now 4 m to the left: it is on the way when the vehicle is."""
    costmap = costs(mover(12.0, -4.0, 0.0, 2.0), 6.0, 6.0)
    assert place(costmap, 12.0, 0.0) > 8.0 and place(costmap, 12.0, -4.0) == 0.0 and place(costmap, 12.0, 4.0) == 0.0


def test_at_the_edge_of_the_map_no_index_wraps() -> None:
    half = CELL * CELLS / 2
    costmap = costs(mover(half - 1.0, half - 1.0, 3.0, 3.0), 6.0, 12.0)
    assert not costmap[:128].any() and not costmap[:, :128].any()
    assert not costs(mover(2.0 * half, 0.0, 1.0, 0.0), 6.0, 6.0).any()


def test_the_path_gives_way_and_returns() -> None:
    """Ahead on, a little to the left: the path passes it on the right with room, and the mirror image."""
    assert abs(east_at(path(), 12.0)) < 0.2
    for side in (1.0, -1.0):
        given = side * east_at(path(mover(20.0, -0.3 * side, -4.0, 0.0)), 12.0)
        assert ROOM < given < 4.0


def test_the_path_passes_behind_who_crosses() -> None:
    """It is 0.4 m beyond the straight way when the vehicle comes there."""
    for side in (1.0, -1.0):
        flown = path(mover(12.0, -3.6 * side, 0.0, 2.0 * side))
        assert -4.0 < side * east_at(flown, 12.0) < -0.4
