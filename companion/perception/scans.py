"""Scans: returns as points in the world, and scans assembled from sensors that cover one sector each."""

import math

import numpy as np

from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import to_world
from protocol.jit import compiled

WIDE_SECTOR = math.radians(15.01)
"""rad: in a wider sector the place of a return is too uncertain to tell that it moves, or that it should have. Those of
15 degrees, 24 around the vehicle, are not wider, however they are rounded."""


def sector_width(scan: Scan) -> float:
    """rad of a sector; 5 degrees of a scan of one beam."""
    bearings = scan.bearings_frd
    return abs(float(bearings[1] - bearings[0])) if bearings.size > 1 else math.radians(5.0)


def obstacle_points(
    scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float, slope: float = 0.0
) -> Array:
    """Returns (n, 3) NED (m) of a scan taken at that pose, in the order of bearing, without those of the ground.

    `ground_down` is the NED height (m) below which a return is the ground, since a tilted scan looks down; the ground
    may rise away from the vehicle with that `slope`.
    """
    bearings, ranges = scan.bearings_frd[scan.hit], scan.ranges_m[scan.hit]
    points = world_points(bearings, ranges, position_ned, attitude_ned_frd)
    return points[points[:, 2] < ground_down - slope * ranges]


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
