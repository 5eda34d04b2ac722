"""Tracks of what is as wide as a car: it is known to move, and what stands is not, though its visible part changes."""

import numpy as np
import pytest

from companion.config_avoidance import AvoidanceTracks
from companion.perception.tracks import Tracker
from protocol.arrays import Array
from protocol.frames import from_euler
from tests.companion.perception.test_tracks import PERIOD_NS, ring
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import CylinderTable, OriginTable, WallTable, World, WorldTable

LEVEL = from_euler(0.0, 0.0, 0.0)
ORIGIN = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
SCANS = 45


def disc(north: float, east: float) -> World:
    cylinder = CylinderTable(name="car", center=(north, east), radius=1.4, height=4.0)
    return World.build(WorldTable(name="road", origin=ORIGIN, cylinder=(cylinder,)))


def wall(length: float) -> World:
    table = WallTable(name="wall", start=(10.0, 3.0), end=(10.0 + length, 3.0), thickness=0.2, height=4.0)
    return World.build(WorldTable(name="road", origin=ORIGIN, wall=(table,)))


def seen(worlds: list[World], places: list[Array]) -> Tracker:
    """Scans of the worlds from the places, one after the other."""
    lidar, tracker = Lidar(LidarSettings(noise_m=0.02), np.random.default_rng(1)), Tracker(AvoidanceTracks())
    for k, (world, place) in enumerate(zip(worlds, places, strict=True)):
        tracker.add(ring(lidar, world, (place, LEVEL), k * PERIOD_NS), place, LEVEL, -0.3)
        if tracker.moving.size:
            break
    return tracker


@pytest.mark.parametrize("speed", [-6.0, -2.0, 2.0, 6.0])
def test_a_car_that_crosses_is_known_to_move_before_it_is_in_the_way(speed: float) -> None:
    dt, here = PERIOD_NS * 1e-9, np.array([0.0, 0.0, -2.0])
    tracker = seen([disc(9.0, -1.5 * speed + k * dt * speed) for k in range(20)], [here] * 20)
    assert tracker.moving.size == 1
    velocity = tracker.moving["mean"][0, 2:]
    assert np.sign(velocity[1]) == np.sign(speed) and abs(velocity[1]) > 0.5 * abs(speed) > abs(velocity[0])


@pytest.mark.parametrize("world", [disc(10.0, 3.0), wall(2.0), wall(4.5)], ids=["car", "wall of 2 m", "wall of 4.5 m"])
def test_what_stands_does_not_move_as_the_vehicle_passes_it(world: World) -> None:
    """At 8 m/s; of each its near end, its side and its far end are seen in turn."""
    places = [np.array([8.0 * k * PERIOD_NS * 1e-9, 0.0, -2.0]) for k in range(SCANS)]
    tracker = seen([world] * SCANS, places)
    assert places[-1][0] > 20.0 and tracker.moving.size == 0
