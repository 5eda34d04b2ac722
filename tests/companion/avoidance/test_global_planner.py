"""Out of a trap that is larger than the map's window."""

import itertools
import math

import numpy as np
import pytest

from companion.avoidance.global_planner import GlobalPlanner
from companion.avoidance.planner import PlanningPipeline, PlanRequest
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.perception.local_map import LocalMap
from companion.perception.map_view import MapView
from companion.state import Scan
from protocol.arrays import Array
from studies.worlds import make_site, make_wall
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import World

PERIOD_NS, SPEED = 66_000_000, 4.0
BEARINGS, LEVEL = np.radians(np.arange(0.0, 360.0, 5.0)), np.array([1.0, 0.0, 0.0, 0.0])
WINDOW = 0.25, 96
"""Side of a cell (m) and cells: 12 m to each side."""
DEEP, HALF = 22.0, 8.0
"""m"""
GOAL = np.array([DEEP + 8.0, 0.0, -3.0])


def trap() -> World:
    """Open to the south alone, where the vehicle comes from."""
    ends = [(1.0, -HALF), (DEEP, -HALF), (DEEP, HALF), (1.0, HALF)]
    return make_site("trap", 0, {"wall": [make_wall(a, b) for a, b in itertools.pairwise(ends)]}).world()


def along(path: Array, here: Array, way: float) -> Array:
    """The place (3,) after so much (m) of a path (k, 2)."""
    at = here[:2]
    for vertex in path[1:]:
        leg = math.dist(vertex, at)
        if leg > way:
            return np.array([*(at + (vertex - at) * way / leg), here[2]])
        at, way = vertex, way - leg
    return np.array([*at, here[2]])


def flown(settings: Avoidance, most: float) -> float:
    """m flown by a point along its paths until it is at the goal; `most` if it is not by then."""
    world, lidar = trap(), Lidar(LidarSettings(max_range_m=8.0), np.random.default_rng(1))
    pipeline, here, way, k = PlanningPipeline(settings), np.array([0.0, 0.0, -3.0]), 0.0, 0
    while way < most and math.dist(here, GOAL) > 1.0:
        distances, furthest = lidar.scan(world, here, LEVEL), lidar.settings.max_range_m
        ranges = np.minimum(0.01 * distances, furthest)
        scan = Scan(k * PERIOD_NS, k * PERIOD_NS // 1000, BEARINGS, ranges, ranges < furthest, np.ones(72, bool))
        request = PlanRequest(k + 1, scan.time_ns, scan, (here, LEVEL), -0.5, here, np.zeros(3), GOAL, SPEED)
        here = along(pipeline.answer(request).path.vertices, here, SPEED * PERIOD_NS * 1e-9)
        way, k = way + SPEED * PERIOD_NS * 1e-9, k + 1
    return way


@pytest.mark.parametrize("beyond_window", [True, False])
def test_it_leads_out_of_a_trap_that_is_larger_than_the_window(beyond_window: bool) -> None:
    """In, out, and around; the window alone shows an open way again each time."""
    cell, cells = WINDOW
    settings = Avoidance(map=AvoidanceMap(cell=cell, cells=cells, memory_cells=512, beyond_window=beyond_window))
    once = 2.0 * DEEP + HALF + math.hypot(HALF, DEEP) + 8.0
    assert (flown(settings, 2.0 * once) < 1.7 * once) is beyond_window


def test_the_planner_is_left_alone_until_the_vehicle_had_to_go_back() -> None:
    """By 6 m, a quarter of half of the window: then it is led to a place on the way, 18 m ahead. A new goal is taken
    as it is."""
    settings, goal, looks = Avoidance(), np.array([60.0, 0.0, -3.0]), 0
    remembered, planner = LocalMap(settings), GlobalPlanner(settings)

    def look() -> MapView:
        nonlocal looks
        looks += 1
        return remembered.look_far(0)

    def asked(north: float, goal: Array) -> Array:
        return planner.local_goal(np.array([north, 0.0, -3.0]), goal, look)

    for north in (0.0, 10.0, 4.1):
        assert asked(north, goal) is goal and looks == 0
    local_goal = asked(3.9, goal)
    assert looks == 1 and local_goal == pytest.approx([3.9 + 18.0, 0.0, -3.0], abs=0.4)
    assert asked(3.0, goal) is local_goal and looks == 1, "the way is looked for once a second"
    other = goal + np.array([0.0, 5.0, 0.0])
    assert asked(3.0, other) is other and looks == 1
