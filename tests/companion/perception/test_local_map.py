"""Tracks and map together: what moves leaves no obstacle behind where it came from."""

import math

import numpy as np
import pytest

from companion.config_avoidance import Avoidance
from companion.perception.local_map import LocalMap
from companion.perception.map_view import OCCUPIED, to_certain
from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import from_euler
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import BoxTable, CylinderTable, OriginTable, World, WorldTable

HERE = np.array([0.0, 0.0, -2.0])
LEVEL = from_euler(0.0, 0.0, 0.0)
BEARINGS: Array = np.radians(5.0 * np.arange(72))
PERIOD_S = 1.0 / 15.0
POST = (-4.0, 0.0)


def scene(*cylinders: CylinderTable, boxes: tuple[BoxTable, ...] = ()) -> World:
    origin = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
    return World.build(WorldTable(name="scene", origin=origin, cylinder=cylinders, box=boxes))


class Surroundings:
    """What the simulator's LiDAR sees: somebody who moves and a post from one place, or any world from anywhere."""

    def __init__(self) -> None:
        self.map = LocalMap(Avoidance())
        self._lidar = Lidar(LidarSettings(), np.random.default_rng(1))
        self._time = 0.0
        self.returns = 0

    def see(self, walker: tuple[float, float]) -> None:
        places = ("walker", walker), ("post", POST)
        world = scene(*(CylinderTable(name=name, center=at, radius=0.3, height=4.0) for name, at in places))
        self.look_at(world, HERE, LEVEL)

    def look_at(self, world: World, here: Array, attitude: Array) -> None:
        ranges = self._lidar.scan(world, here, attitude).astype(float)
        now_ns = round(self._time * 1e9)
        hit, known = ranges <= 1500.0, ranges != 65535.0
        self.returns += int(hit.sum())
        scan = Scan(now_ns, now_ns, BEARINGS, np.minimum(ranges, 1500.0) * 0.01, hit, known)
        self.map.add(scan, (here, attitude), -0.3, now_ns)
        self.view = self.map.look(now_ns)
        self._time += PERIOD_S

    def occupied_near(self, place: tuple[float, float], reach: float) -> int:
        """Occupied cells up to so far (m) from a place."""
        away = self.view.obstacle_centres() - np.array(place)
        return int((np.hypot(away[:, 0], away[:, 1]) < reach).sum())


@pytest.mark.parametrize(("stands_s", "speed"), [(3.0, 1.5), (3.0, 6.0), (0.2, 6.0)])
def test_where_somebody_stood_and_went_nothing_is_left_once_it_is_known(stands_s: float, speed: float) -> None:
    seen = Surroundings()
    for _ in range(math.ceil(stands_s / PERIOD_S)):
        seen.see((5.0, -2.0))
    assert seen.view.moving is None
    assert seen.occupied_near((5.0, -2.0), 0.6) > 0 and seen.occupied_near(POST, 0.6) > 0
    east = -2.0
    while seen.view.moving is None:
        east += speed * PERIOD_S
        assert east < 1.0
        seen.see((5.0, east))
    for share in np.linspace(0.0, 1.0, 9).tolist():
        assert seen.occupied_near((5.0, -2.0 + share * (east + 2.0)), 0.6) == 0
    assert seen.occupied_near(POST, 0.6) > 0, "what stands stays"
    assert int((seen.view.states == OCCUPIED).sum()) == seen.occupied_near(POST, 0.6)


@pytest.mark.parametrize("height", [1.5, 1.7, 2.0, 2.4])
def test_what_a_tilted_scan_rises_over_does_not_move(height: float) -> None:
    """Ahead it is low: as the vehicle comes nearer it passes over the tops of cars and hedges, and meets others behind
    them."""
    boxes = [
        BoxTable(name=f"car {k}", center=(12.0 + 3.7 * k, side * (3.0 + 0.9 * (k % 4))), size=(1.8, 1.6), height=height)
        for k in range(12)
        for side in (-1, 1)
    ]
    world, seen, tilted = scene(boxes=tuple(boxes)), Surroundings(), from_euler(0.0, math.radians(-7.0), 0.0)
    for step in range(90):
        seen.look_at(world, np.array([0.4 * step, 0.0, -3.1]), tilted)
        assert seen.view.moving is None, step
    assert seen.returns > 200


def test_beside_a_fence_the_obstacles_of_wide_sectors_stay_as_large() -> None:
    """A scanner of 8 sectors, and a fence somewhere in the window."""
    bearings, hit = np.radians(45.0 * np.arange(8)), np.arange(8) == 0
    ranges, found = np.where(hit, 5.0, 12.0), []
    for fence in (None, (0.0, 0.0, -math.inf, math.inf, -math.inf, math.inf, 20.0)):
        local_map = LocalMap(Avoidance())
        for now_ns in range(1_000_000_000, 1_400_000_000, 66_000_000):
            scan = Scan(now_ns, now_ns // 1000, bearings, ranges, hit, np.ones(8, np.bool_))
            local_map.add(scan, (HERE, LEVEL), -0.3, now_ns)
        view = local_map.look(now_ns, fence)
        found.append([view.distance_at(np.array([north, 0.0])) for north in (2.5, 3.0, 3.5, 4.0)])
    assert found[0] == found[1]


@pytest.mark.parametrize("tight", [False, True])
def test_with_a_margin_all_that_is_seen_is_larger_and_as_far_away_as_before(tight: bool) -> None:
    """A post ahead, and somebody who crosses behind the vehicle."""
    seen, margin = Surroundings(), 0.15
    for k in range(20):
        seen.see((5.0, -2.0 + 0.1 * k))
    here, now_ns = np.array([-2.6, 0.2, -2.0]), 2_000_000_000
    found = []
    for larger in (0.0, margin):
        seen.map.margin = larger
        view = seen.map.look(now_ns)
        space = seen.map.free_space(here, now_ns, tight=tight)
        certain, far = to_certain(view, 1.0), seen.map.look_far(now_ns)
        found.append((view.to_occupied.copy(), certain.copy(), space, seen.map.clearance(here), far.to_occupied))
    (plain, certain, space, clearance, far_plain), (less, sooner, narrower, as_seen, far_less) = found
    both = (plain, less), (space.to_occupied, narrower.to_occupied), (far_plain, far_less)
    for without, larger_by in both:
        assert np.abs(larger_by - np.maximum(without - margin, 0.0)).max() < 1e-6
    assert (narrower.to_unseen == space.to_unseen).all(), "what was seen free stays free"
    near = certain < 1.0
    assert near.any() and np.abs(sooner[near] - (certain[near] - margin)).max() < 1e-6
    assert as_seen == pytest.approx(clearance, abs=1e-6) and 0.4 < clearance < 1.2
    kept, wider = space.points[:, 4], narrower.points[:, 4]
    guard = Avoidance().guard
    of_return = guard.keep_out_tight if tight else guard.keep_out
    assert of_return in kept and wider.max() == pytest.approx(of_return + margin)
    assert len(space.movers) == 1 and narrower.movers[0, 4] == pytest.approx(space.movers[0, 4] + margin)


def test_far_from_all_there_is_no_clearance_with_a_margin_either() -> None:
    seen = Surroundings()
    seen.see((5.0, -2.0))
    seen.map.margin = 0.15
    seen.map.look(0)
    assert seen.map.clearance(np.array([0.0, 6.0, -2.0])) == math.inf


@pytest.mark.parametrize("count", [8, 72])
def test_clearance_is_to_what_is_seen_however_wide_its_sectors_are(count: int) -> None:
    bearings: Array = np.radians(360.0 / count * np.arange(count))
    here = np.array([0.0, 0.0, -2.0])
    for distance, clearance in ((2.0, 2.0 - Avoidance().vehicle_radius), (12.0, math.inf)):
        local_map, hit = LocalMap(Avoidance()), np.full(count, distance < 10.0)
        for now_ns in range(1_000_000_000, 1_700_000_000, 66_000_000):
            scan = Scan(now_ns, now_ns // 1000, bearings, np.full(count, distance), hit, np.ones(count, np.bool_))
            local_map.add(scan, (here, LEVEL), -0.3, now_ns)
        local_map.look(now_ns)
        assert local_map.clearance(here) == pytest.approx(clearance, abs=0.25)
