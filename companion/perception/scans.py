"""A ring of ranges -> points in the world; and a ring from sensors that look to one side each."""

import math

import numpy as np

from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import to_world
from protocol.jit import compiled


def obstacle_points(scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float) -> Array:
    """Returns (n, 3) NED of a scan taken at that pose, in the order of bearing, without those of the ground.

    `ground_down` is the NED height below which a return is the ground: a tilted ring looks down.
    """
    bearings, ranges = scan.bearings_frd[scan.hit], scan.ranges_m[scan.hit]
    points = place(bearings, ranges, position_ned, attitude_ned_frd)
    return points[points[:, 2] < ground_down]


class SectorRing:
    """Eighths that come one by one, of one ring after the other."""

    def __init__(self, sectors: int) -> None:
        self._bearings: Array = np.arange(sectors, dtype=np.float64) * (2.0 * math.pi / sectors)
        self._begin()

    def _begin(self) -> None:
        count = self._bearings.size
        self._ranges, self._hit, self._known = np.zeros(count), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._heard = np.zeros(count, np.bool_)
        self._boot_time_ms = 0

    def add(self, sector: int, range_m: float, hit: bool, known: bool, boot_time_ms: int, now_ns: int) -> Scan | None:
        """The ring, once it is whole or, where sectors are missing, once the next one begins."""
        ring = None
        if self._heard[sector]:
            ring = self._ring(now_ns)
        self._heard[sector] = True
        self._ranges[sector], self._hit[sector], self._known[sector] = range_m, hit and known, known
        self._boot_time_ms = boot_time_ms
        return self._ring(now_ns) if self._heard.all() else ring

    def _ring(self, now_ns: int) -> Scan:
        ring = Scan(now_ns, self._boot_time_ms * 1000, self._bearings, self._ranges, self._hit, self._known)
        self._begin()
        return ring


@compiled
def place(bearings: Array, ranges: Array, position_ned: Array, attitude_ned_frd: Array) -> Array:
    """(n, 3) NED of returns with bearings (n,) and ranges (n,)."""
    points = np.empty((bearings.size, 3))
    for i in range(bearings.size):
        beam = ranges[i] * math.cos(bearings[i]), ranges[i] * math.sin(bearings[i]), 0.0
        turned = to_world(attitude_ned_frd, beam)
        for axis in range(3):
            points[i, axis] = position_ned[axis] + turned[axis]
    return points
