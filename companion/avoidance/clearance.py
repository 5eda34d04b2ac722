"""Clearance around the vehicle: distances to what is occupied and to what was not seen free, and the length of a path
that keeps clear of both."""

import math
from typing import NamedTuple

import numpy as np

from companion.perception.distance_field import Floats, between
from protocol.arrays import Array
from protocol.jit import compiled

MIN_SPEED = 0.3
"""m/s; a slower velocity has no direction that can be relied on."""
_BEYOND_MAP = 100.0
"""m; farther than the edge of any map."""

Place = tuple[float, float]
"""North and east (m), or a vector of that plane: no array, which compiled code would take from the heap."""


class ClearanceMap(NamedTuple):
    """Two distance fields over the same cells. Exists in compiled code only: it costs 2 us to pass one from Python."""

    to_occupied: Floats
    """(n, m) m from each cell's centre to the nearest occupied one's."""
    to_unseen: Floats
    """(n, m) m from each cell's centre to that of the nearest cell not seen free."""
    cell: float
    """m, the side of a cell."""


class KeepOut(NamedTuple):
    """Distances that must be kept (m)."""

    occupied: float
    unseen: float


@compiled
def clearance_at(clearances: ClearanceMap, north: float, east: float) -> tuple[float, float]:
    """Distances (m) to occupied and to unseen at a place that counts from the map's corner (m); 0, 0 outside."""
    row, column = north / clearances.cell - 0.5, east / clearances.cell - 0.5
    return between(clearances.to_occupied, row, column), between(clearances.to_unseen, row, column)


@compiled
def free_length(clearances: ClearanceMap, path: Array, keep_out: KeepOut) -> float:
    """Length (m) of the path until it enters a keep-out; inf if it never does.

    `path` (k, 2): vertices of a polyline, counted from the map's corner (m). A path that starts within a keep-out is
    free as long as it does not come nearer.
    """
    at_occupied, at_unseen = clearance_at(clearances, path[0, 0], path[0, 1])
    occupied, unseen = min(keep_out.occupied, at_occupied), min(keep_out.unseen, at_unseen)
    passed = 0.0
    for k in range(path.shape[0] - 1):
        dn, de = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
        length = math.hypot(dn, de)
        along = 0.0
        while along < length:
            share = along / length
            a, b = clearance_at(clearances, path[k, 0] + share * dn, path[k, 1] + share * de)
            if a < occupied or b < unseen or (a == 0.0 and b == 0.0):
                return passed + along
            along += max(min(a - occupied, b - unseen), 0.5 * clearances.cell)
        passed += length
    return math.inf


@compiled
def free_ahead(
    clearances: ClearanceMap, corner: Place, position: Array, velocity: Array, path: Array, keep_out: KeepOut
) -> float:
    """The shorter of two free lengths (m): along the path, and straight on with the velocity.

    `corner`: of the map (m, NED); `position` and `velocity` (2,) or more, m and m/s NED; `path` (k, 2) m, NED: the
    vertices that follow the position.
    """
    vertices = np.empty((path.shape[0] + 1, 2))
    vertices[0], vertices[1:] = position[:2], path
    vertices[:, 0] -= corner[0]
    vertices[:, 1] -= corner[1]
    free = free_length(clearances, vertices, keep_out)
    speed = math.hypot(velocity[0], velocity[1])
    if speed > MIN_SPEED:
        onward = np.empty((2, 2))
        onward[0] = vertices[0]
        onward[1, 0] = vertices[0, 0] + _BEYOND_MAP / speed * velocity[0]
        onward[1, 1] = vertices[0, 1] + _BEYOND_MAP / speed * velocity[1]
        free = min(free, free_length(clearances, onward, keep_out))
    return free
