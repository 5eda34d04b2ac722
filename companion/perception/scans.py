"""Scans: returns as points in the world, and scans assembled from sensors that cover one sector each."""

import math

import numpy as np

from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import to_world
from protocol.jit import compiled


def obstacle_points(scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float) -> Array:
    """Returns (n, 3) NED (m) of a scan taken at that pose, in the order of bearing, without those of the ground.

    `ground_down` is the NED height (m) below which a return is the ground: a tilted scan looks down.
    """
    bearings, ranges = scan.bearings_frd[scan.hit], scan.ranges_m[scan.hit]
    points = world_points(bearings, ranges, position_ned, attitude_ned_frd)
    return points[points[:, 2] < ground_down]


class SectorScanAssembler:
    """Assembles scans from reports of single sectors, as DISTANCE_SENSOR messages bring them."""

    def __init__(self, sectors: int) -> None:
        self._bearings: Array = np.arange(sectors, dtype=np.float64) * (2.0 * math.pi / sectors)
        self._begin()

    def _begin(self) -> None:
        count = self._bearings.size
        self._ranges, self._hit, self._known = np.zeros(count), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._received = np.zeros(count, np.bool_)
        self._boot_time_ms = 0

    def add(self, sector: int, range_m: float, hit: bool, known: bool, boot_time_ms: int, now_ns: int) -> Scan | None:
        """The scan once it is complete or, where sectors are missing, once the next scan begins."""
        scan = None
        if self._received[sector]:
            scan = self._finished(now_ns)
        self._received[sector] = True
        self._ranges[sector], self._hit[sector], self._known[sector] = range_m, hit and known, known
        self._boot_time_ms = boot_time_ms
        return self._finished(now_ns) if self._received.all() else scan

    def _finished(self, now_ns: int) -> Scan:
        scan = Scan(now_ns, self._boot_time_ms * 1000, self._bearings, self._ranges, self._hit, self._known)
        self._begin()
        return scan


@compiled
def world_points(bearings: Array, ranges: Array, position_ned: Array, attitude_ned_frd: Array) -> Array:
    """(n, 3) NED (m) of returns with bearings (n,) rad and ranges (n,) m, seen from one pose (3,), (4,)."""
    points = np.empty((bearings.size, 3))
    for i in range(bearings.size):
        beam = ranges[i] * math.cos(bearings[i]), ranges[i] * math.sin(bearings[i]), 0.0
        turned = to_world(attitude_ned_frd, beam)
        for axis in range(3):
            points[i, axis] = position_ned[axis] + turned[axis]
    return points
