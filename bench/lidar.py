"""What a scan, a range finder's beam and the clearance cost in worlds of 50 and of 500 obstacles.

    python bench/lidar.py [--json]

"all beams" casts every beam against every obstacle, which is what culling by bearing saves.
"""

import argparse
import json
import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from protocol import frames
from protocol.jit import compiled
from vehicle_sim.sensors.lidar import SECTORS, Lidar, LidarSettings, beam_azimuths, sector_ranges
from vehicle_sim.world import BoxTable, CylinderTable, OriginTable, World, WorldTable
from vehicle_sim.world.geometry import cast_ray

Array = NDArray[np.float64]

OBSTACLES = (50, 500)
POSES = 200
REPEATS = 7
AREA_PER_OBSTACLE_M2 = 60.0
FORWARD = np.array([1.0, 0.0, 0.0])


def field(obstacles: int, rng: np.random.Generator) -> World:
    """Half boxes, half cylinders over a square, equally dense whatever their number."""
    side = math.sqrt(obstacles * AREA_PER_OBSTACLE_M2)

    def place() -> tuple[float, float]:
        north, east = rng.uniform(-0.5 * side, 0.5 * side, 2)
        return float(north), float(east)

    def number(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    boxes = tuple(
        BoxTable(
            name=f"box {i}",
            center=place(),
            size=(number(0.3, 4.0), number(0.3, 4.0)),
            height=number(2.0, 8.0),
            yaw_deg=number(0.0, 360.0),
        )
        for i in range(obstacles // 2)
    )
    cylinders = tuple(
        CylinderTable(name=f"cylinder {i}", center=place(), radius=number(0.1, 1.5), height=number(2.0, 8.0))
        for i in range(obstacles - len(boxes))
    )
    origin = OriginTable(latitude_deg=0.0, longitude_deg=0.0, altitude_m=0.0)
    return World.build(WorldTable(name="field", origin=origin, box=boxes, cylinder=cylinders))


def poses(world: World, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Positions outside of obstacles, attitudes tilted up to 20 degrees."""
    side = math.sqrt(len(world.names) * AREA_PER_OBSTACLE_M2)
    found: list[tuple[Array, Array]] = []
    while len(found) < POSES:
        position = np.array([*rng.uniform(-0.4 * side, 0.4 * side, 2), -3.0])
        if world.clearance(position) > 0.5:
            roll, pitch, yaw = rng.uniform([-0.35, -0.35, -3.1], [0.35, 0.35, 3.1])
            found.append((position, frames.from_euler(roll, pitch, yaw)))
    return found


@compiled
def every_beam(
    boxes: Array, cylinders: Array, position: Array, attitude: Array, cos: Array, sin: Array, max_range: float
) -> Array:
    """The same ranges without culling."""
    nearest = np.full(SECTORS, math.inf)
    for k in range(cos.shape[0]):
        direction = frames.rotate(attitude, np.array([cos[k], sin[k], 0.0]))
        sector = k * SECTORS // cos.shape[0]
        nearest[sector] = min(nearest[sector], cast_ray(boxes, cylinders, position, direction, max_range))
    return nearest


def microseconds(call: Callable[[Array, Array], object], places: list[tuple[Array, Array]]) -> float:
    """Per call, the best of some rounds over all places."""
    best = math.inf
    for _ in range(REPEATS):
        start = time.perf_counter_ns()
        for position, attitude in places:
            call(position, attitude)
        best = min(best, (time.perf_counter_ns() - start) / 1e3 / len(places))
    return best


def scan_costs(world: World, places: list[tuple[Array, Array]], settings: LidarSettings) -> dict[str, float]:
    lidar = Lidar(settings, np.random.default_rng(1))
    azimuths = beam_azimuths(settings.beams_per_sector)
    beams, cos, sin = len(azimuths), np.cos(azimuths), np.sin(azimuths)

    def culled(position: Array, attitude: Array) -> Array:
        return sector_ranges(world.boxes, world.cylinders, position, attitude, cos, sin, settings.max_range_m)

    def plain(position: Array, attitude: Array) -> Array:
        return every_beam(world.boxes, world.cylinders, position, attitude, cos, sin, settings.max_range_m)

    few = places[:20]
    for place in few:
        if not np.allclose(culled(*place), plain(*place), rtol=1e-12):
            raise AssertionError("culling changed a range")
    return {
        f"scan, {beams} beams, with noise": microseconds(lambda p, q: lidar.scan(world, p, q), places),
        f"ranges, {beams} beams, culled": microseconds(culled, places),
        f"ranges, {beams} beams, all beams": microseconds(plain, few),
    }


def measure(obstacles: int) -> dict[str, float]:
    rng = np.random.default_rng(obstacles)
    world = field(obstacles, rng)
    places = poses(world, rng)
    figures: dict[str, float] = {}
    for per_sector in (1, 5):
        figures |= scan_costs(world, places, LidarSettings(beams_per_sector=per_sector))
    lidar = Lidar(LidarSettings(), np.random.default_rng(1))
    figures["one beam, with noise"] = microseconds(lambda p, q: lidar.beam(world, p, FORWARD, q), places)
    figures["clearance"] = microseconds(lambda p, q: world.clearance(p), places)
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description="cost of LiDAR scans and distances, microseconds")
    parser.add_argument("--json", action="store_true", help="one object instead of the table")
    as_json = parser.parse_args().json
    columns = {obstacles: measure(obstacles) for obstacles in OBSTACLES}
    if as_json:
        rows = {str(obstacles): figures for obstacles, figures in columns.items()}
        print(json.dumps({"bench": "lidar", "unit": "us", "obstacles": rows}))
        return
    print(f"{'us a call':<32}" + "".join(f"{obstacles:>8} obstacles" for obstacles in OBSTACLES))
    for key in columns[OBSTACLES[0]]:
        print(f"{key:<32}" + "".join(f"{columns[obstacles][key]:>18.1f}" for obstacles in OBSTACLES))


if __name__ == "__main__":
    main()
