"""Cost of each stage from a scan to the reference, in flight through a forest (density 1/25, trees of 0.6 m).

    python bench/avoidance.py [--json]

The scans are the simulator's along a straight flight of 40 m at 5 m/s, tilted as the vehicle would be. The guard's
filter runs at each control step, all else at each scan. Percentiles over all scans; the load of the machine shows in
the 99th.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from companion.avoidance.astar import AStar
from companion.avoidance.guard import Guard
from companion.avoidance.shortcut import shorten, vertex_speeds
from companion.avoidance.vfh import Vfh
from companion.config_avoidance import Avoidance
from companion.perception.free_space import free_space
from companion.perception.rolling_map import RollingMap
from companion.perception.tracks import Tracker
from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import from_euler
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import CylinderTable, OriginTable, World, WorldTable

SETTINGS = Avoidance(method="astar")
GOAL = np.array([40.0, 0.0, -3.0])
SPEED = 5.0
SCANS = 120
ROUNDS = 3
T = TypeVar("T")


class Stopwatch:
    """Times (us) by stage."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {}

    def call(self, stage: str, function: Callable[..., T], *arguments: Any) -> T:
        start = time.perf_counter_ns()
        result = function(*arguments)
        self.times.setdefault(stage, []).append((time.perf_counter_ns() - start) / 1e3)
        return result


def forest(seed: int) -> World:
    """30 x 60 m, with a lane of 1.5 m for the straight flight."""
    rng = np.random.default_rng(seed)
    count = int(rng.poisson(30.0 * 60.0 / 25.0))
    places = np.column_stack([rng.uniform(-10.0, 50.0, count), rng.uniform(-15.0, 15.0, count)])
    places = places[np.abs(places[:, 1]) > 0.75 + 0.3]
    trees = tuple(
        CylinderTable(name=f"tree {k}", center=(float(n), float(e)), radius=0.3, height=12.0)
        for k, (n, e) in enumerate(places)
    )
    origin = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
    return World.build(WorldTable(name="forest", origin=origin, cylinder=trees))


def scans_of(world: World) -> list[tuple[Scan, Array, Array]]:
    """Scans with their poses."""
    lidar = Lidar(LidarSettings(), np.random.default_rng(1))
    bearings: Array = np.radians(5.0 * np.arange(72))
    found = []
    for k in range(SCANS):
        position = np.array([SPEED * k / 15.0, 0.0, -3.0])
        attitude = from_euler(0.03 * math.sin(0.7 * k), -0.12, 0.1 * math.sin(0.3 * k))
        distances = lidar.scan(world, position, attitude).astype(np.float64)
        ranges = np.minimum(distances, 1500.0) * 0.01
        scan = Scan(k * 66_666_667, 0, bearings, ranges, distances <= 1500.0, distances != 65535.0)
        found.append((scan, position, attitude))
    return found


def fly(scans: list[tuple[Scan, Array, Array]], watch: Stopwatch) -> None:
    """All stages once along the flight."""
    rolling_map = RollingMap(SETTINGS.map, SETTINGS.vehicle_radius)
    search, vfh = AStar(SETTINGS.plan, SETTINGS.map.cells), Vfh(SETTINGS.vfh)
    guard_settings = SETTINGS.guard
    guard, tracker = Guard(guard_settings), Tracker(SETTINGS.tracks)
    velocity, command = np.array([SPEED, 0.0, 0.0]), np.array([1.0, 0.5, 0.0])
    for scan, position, attitude in scans:
        began = time.perf_counter_ns()
        moving = watch.call("tracks", tracker.add, scan, position, attitude, -0.5)
        watch.call("map: add a scan", rolling_map.add, scan, position, attitude, -0.5, moving)
        view = watch.call("map: view with distances", rolling_map.view, scan.time_ns)
        costmap = watch.call("astar: costmap", search.costmap, view)
        path = watch.call("astar: search", search.plan, view, costmap, position, GOAL)
        if path is not None:
            vertices = watch.call("astar: shortening", shorten, path, view, costmap, SETTINGS.plan.inflation)
            watch.call("astar: vertex speeds", vertex_speeds, vertices, np.full(len(vertices), 0.5), SPEED, 4.0, 3.5)
        guard.look(watch.call("guard: free space", free_space, view, position, scan.time_ns, guard_settings))
        watch.call("guard: speed limit", guard.limit, position, velocity, GOAL[None, :2], SPEED)
        watch.times.setdefault("scan to reference", []).append((time.perf_counter_ns() - began) / 1e3)
        watch.call("vfh", vfh.choose, view, position, velocity, GOAL)
        for _ in range(16):
            watch.call("guard: filter", guard.filter, position, velocity, command, scan.time_ns)


def measure() -> dict[str, dict[str, float]]:
    """Median and 99th percentile (us) by stage."""
    scans = scans_of(forest(1))
    fly(scans, Stopwatch())
    watch = Stopwatch()
    for _ in range(ROUNDS):
        fly(scans, watch)
    return {
        stage: {"p50": round(float(np.percentile(times, 50)), 1), "p99": round(float(np.percentile(times, 99)), 1)}
        for stage, times in watch.times.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="cost of the stages of avoidance, microseconds")
    parser.add_argument("--json", action="store_true", help="one object instead of the table")
    as_json = parser.parse_args().json
    figures = measure()
    if as_json:
        print(json.dumps({"bench": "avoidance", "unit": "us", "stages": figures}))
        return
    print(f"{'us':<28}{'p50':>10}{'p99':>10}")
    for stage, row in figures.items():
        print(f"{stage:<28}{row['p50']:>10.1f}{row['p99']:>10.1f}")


if __name__ == "__main__":
    main()
