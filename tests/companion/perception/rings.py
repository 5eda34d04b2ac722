"""What tests of the map show to it: rings from one place."""

import numpy as np

from companion.config_avoidance import AvoidanceMap
from companion.perception.map_view import MapView
from companion.perception.rolling_map import RollingMap
from companion.state import Scan
from protocol.arrays import Array, BoolArray
from protocol.frames import from_euler

SETTINGS = AvoidanceMap(cell=0.2, cells=256, layer=1.5, memory_s=40.0)
HULL = 0.36
HERE = np.array([0.05, -0.03, -3.0])
LEVEL = from_euler(0.0, 0.0, 0.0)
GROUND = -0.5
BEARINGS: Array = np.radians(5.0 * np.arange(72))


def scan_of(ranges: Array, hit: BoolArray | None = None, time_ns: int = 0, known: BoolArray | None = None) -> Scan:
    everything = np.ones(72, bool)
    return Scan(
        time_ns, 0, BEARINGS, ranges, everything if hit is None else hit, everything if known is None else known
    )


def see_a_post(rolling: RollingMap, sector: int) -> None:
    """From `HERE`, 3 m away, four times, and nothing else."""
    ranges, hit = np.full(72, 15.0), np.zeros(72, bool)
    ranges[sector], hit[sector] = 3.0, True
    for _ in range(4):
        rolling.add(scan_of(ranges, hit), HERE, LEVEL, GROUND)


def state_at(view: MapView, north: float, east: float) -> int:
    return view.state_at(np.array([north, east]))
