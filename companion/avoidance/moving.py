"""Moving obstacles in a costmap: they cost where they will be when the vehicle could be there.

The vehicle reaches a cell after the straight distance over its speed, which lies between the present and the highest
one. Between these two times the obstacle moves on straight, and less and less is known of where it is. So a path gives
way to one that comes ahead on, and passes behind one that crosses.
"""

import math

import numpy as np

from companion.perception.distance_field import Floats
from protocol.arrays import Array
from protocol.jit import compiled

_COST = 12.0
"""Cost of a cell at the middle of where a moving obstacle will be; falls to 0 at the edge of its room."""
_HORIZON_S = 4.0
"""s that a moving obstacle is expected to go straight on."""
_MARGIN_M = 0.5
"""m of room beyond the keep-out."""
_DRIFT = 0.3
"""m/s by which its velocity may be another."""
_LEAST_SPEED = 1.0
"""m/s of the vehicle, at least."""


@compiled
def add_moving(
    costmap: Floats,
    points: Array,
    here: tuple[float, float],
    speeds: tuple[float, float],
    corner: tuple[int, int],
    cell: float,
) -> None:
    """Add the costs of moving obstacles, `points` (k, 5) or more columns of `perception.free_space`, to a costmap.

    `here`: the vehicle's place (m, NED); `speeds`: its present and its highest speed (m/s); `corner`: world index of
    `costmap[0, 0]`.
    """
    rows, columns = costmap.shape
    slow, fast = max(min(speeds), _LEAST_SPEED), max(max(speeds), _LEAST_SPEED)
    for k in range(points.shape[0]):
        north, east, vn, ve = points[k, 0], points[k, 1], points[k, 2], points[k, 3]
        square = max(vn * vn + ve * ve, 1e-9)
        widest = points[k, 4] + _MARGIN_M + _DRIFT * _HORIZON_S
        top = math.floor((min(north, north + _HORIZON_S * vn) - widest) / cell) - corner[0]
        bottom = math.ceil((max(north, north + _HORIZON_S * vn) + widest) / cell) - corner[0]
        left = math.floor((min(east, east + _HORIZON_S * ve) - widest) / cell) - corner[1]
        right = math.ceil((max(east, east + _HORIZON_S * ve) + widest) / cell) - corner[1]
        for i in range(max(top, 0), min(bottom, rows)):
            for j in range(max(left, 0), min(right, columns)):
                at_n, at_e = (corner[0] + i + 0.5) * cell, (corner[1] + j + 0.5) * cell
                way = math.hypot(at_n - here[0], at_e - here[1])
                if way > fast * _HORIZON_S:
                    continue
                abeam = ((at_n - north) * vn + (at_e - east) * ve) / square
                t = min(max(abeam, way / fast), min(way / slow, _HORIZON_S))
                away = math.hypot(north + t * vn - at_n, east + t * ve - at_e)
                room = points[k, 4] + _MARGIN_M + _DRIFT * t
                if away < room:
                    costmap[i, j] += np.float32(_COST * (1.0 - away / room))
