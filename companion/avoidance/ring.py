"""A ring of ranges -> points in the world."""

import math

import numpy as np

from companion.state import Scan
from protocol.compiled import compiled
from protocol.frames import Array, rotate


def obstacle_points(scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float) -> Array:
    """Returns (n, 3) NED of a scan taken at that pose, in the order of bearing, without those of the ground.

    `ground_down` is the NED height below which a return is the ground: a tilted ring looks down.
    """
    bearings, ranges = scan.bearings_frd[scan.hit], scan.ranges_m[scan.hit]
    points = _place(bearings, ranges, position_ned, attitude_ned_frd)
    return points[points[:, 2] < ground_down]


@compiled
def _place(bearings: Array, ranges: Array, position_ned: Array, attitude_ned_frd: Array) -> Array:
    points = np.empty((bearings.size, 3))
    for i in range(bearings.size):
        beam = np.array([ranges[i] * math.cos(bearings[i]), ranges[i] * math.sin(bearings[i]), 0.0])
        points[i] = position_ned + rotate(attitude_ned_frd, beam)
    return points
