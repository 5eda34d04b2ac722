"""The speed from which the vehicle can still stop before what it sees."""

import math

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def free_distance(points_ned: Array, position_ned: Array, direction: Array, half_width: float) -> float:
    """Distance (m) that can be flown from the position along the horizontal unit vector `direction` (3,) before a
    disc of radius `half_width` meets a point of (n, 3); inf if none is met. A point inside the disc counts when it
    lies ahead.
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
    """v of v^2 / (2 a) + v delay = distance (m/s)."""
    if distance <= 0.0:
        return 0.0
    reaction = acceleration * delay
    return math.sqrt(reaction * reaction + 2.0 * acceleration * distance) - reaction
