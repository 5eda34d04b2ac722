"""Free distance along a straight line, and the speed from which the vehicle stops within it."""

import math

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def free_distance(points_ned: Array, position_ned: Array, direction: Array, half_width: float) -> float:
    """Distance (m) from a position along a direction before a disc of radius `half_width` (m) meets a point.

    `points_ned` (n, 3) and `position_ned` (3,) m, NED; `direction` (3,): a horizontal unit vector. inf if the disc
    meets no point. A point inside the disc counts if it lies ahead.
    """
    nearest = math.inf
    for i in range(points_ned.shape[0]):
        north = points_ned[i, 0] - position_ned[0]
        east = points_ned[i, 1] - position_ned[1]
        along = north * direction[0] + east * direction[1]
        across = north * direction[1] - east * direction[0]
        if along > 0.0 and abs(across) < half_width:
            nearest = min(nearest, max(along - math.sqrt(half_width * half_width - across * across), 0.0))
    return nearest


@compiled
def stopping_speed(distance: float, acceleration: float, delay: float) -> float:
    """The v (m/s) of v^2 / (2 a) + v delay = distance, with a the `acceleration` (m/s2), `delay` in s, m."""
    if distance <= 0.0:
        return 0.0
    reaction = acceleration * delay
    return math.sqrt(reaction * reaction + 2.0 * acceleration * distance) - reaction
