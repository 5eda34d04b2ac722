"""Tracks and map together: what moves leaves no obstacle behind where it came from."""

import math

import numpy as np
import pytest

from companion.config_avoidance import Avoidance
from companion.perception.local_map import LocalMap
from companion.perception.map_view import OCCUPIED
from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import from_euler
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import CylinderTable, OriginTable, World, WorldTable

HERE = np.array([0.0, 0.0, -2.0])
LEVEL = from_euler(0.0, 0.0, 0.0)
BEARINGS: Array = np.radians(5.0 * np.arange(72))
PERIOD_S = 1.0 / 15.0
POST = (-4.0, 0.0)


class Surroundings:
    """Somebody who moves and a post, seen from one place by the simulator's LiDAR."""

    def __init__(self) -> None:
        self.map = LocalMap(Avoidance())
        self._lidar = Lidar(LidarSettings(), np.random.default_rng(1))
        self._time = 0.0

    def see(self, walker: tuple[float, float]) -> None:
        cylinders = tuple(
            CylinderTable(name=name, center=place, radius=0.3, height=4.0)
            for name, place in (("walker", walker), ("post", POST))
        )
        origin = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
        world = World.build(WorldTable(name="scene", origin=origin, cylinder=cylinders))
        ranges = self._lidar.scan(world, HERE, LEVEL).astype(float)
        now_ns = round(self._time * 1e9)
        hit, known = ranges <= 1500.0, ranges != 65535.0
        scan = Scan(now_ns, now_ns, BEARINGS, np.minimum(ranges, 1500.0) * 0.01, hit, known)
        self.map.add(scan, (HERE, LEVEL), -0.3, now_ns)
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
