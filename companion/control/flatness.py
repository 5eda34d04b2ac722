"""The attitude that points the thrust where it is wanted, with any yaw: exact, no small angles."""

import math

import numpy as np

from protocol.compiled import compiled
from protocol.frames import Array, from_matrix


@compiled
def attitude_command(thrust_ned: Array, yaw: float) -> Array:
    """Quaternion whose -z body axis is along `thrust_ned` (not zero) and whose x axis heads to `yaw` (rad).

    At 90 degrees of tilt across the heading the yaw is undefined; the limits on tilt keep away from it.
    """
    down = -thrust_ned / math.sqrt(np.sum(thrust_ned * thrust_ned))
    # y = down x heading, heading = (cos, sin, 0)
    y = np.array([-down[2] * math.sin(yaw), down[2] * math.cos(yaw), down[0] * math.sin(yaw) - down[1] * math.cos(yaw)])
    y = y / math.sqrt(np.sum(y * y))
    r = np.empty((3, 3))
    r[0, 0] = y[1] * down[2] - y[2] * down[1]
    r[1, 0] = y[2] * down[0] - y[0] * down[2]
    r[2, 0] = y[0] * down[1] - y[1] * down[0]
    r[:, 1] = y
    r[:, 2] = down
    return from_matrix(r)
