"""From an acceleration command to a thrust vector that the vehicle can give: the altitude comes first."""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import to_body, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY


@compiled
def drag_compensation(velocity_ned: Array, attitude_ned_frd: Array, drag: Array, mass: float) -> Array:
    """Acceleration (m/s2, NED) that makes up for linear drag (kg/s, body axes) at a velocity through still air."""
    x, y, z = to_body(attitude_ned_frd, velocity_ned)
    force = to_world(attitude_ned_frd, (drag[0] * x, drag[1] * y, drag[2] * z))
    return np.array([force[0] / mass, force[1] / mass, force[2] / mass])


@compiled
def thrust_vector(
    acceleration_ned: Array, mass: float, lowest: float, highest: float, tilt_limit: float
) -> tuple[Array, bool]:
    """Thrust (N, NED) for an acceleration (m/s2), and whether a limit bit.

    The vertical part is kept between `lowest` and `highest` (N); what the limit on the whole and on the tilt (rad)
    leave is given to the horizontal part, whose direction is kept.
    """
    north = mass * acceleration_ned[0]
    east = mass * acceleration_ned[1]
    wanted_up = mass * (GRAVITY - acceleration_ned[2])
    up = min(max(wanted_up, lowest), highest)
    horizontal = math.sqrt(north * north + east * east)
    allowed = min(up * math.tan(tilt_limit), math.sqrt(highest * highest - up * up))
    scale = 1.0
    if horizontal > allowed:
        scale = allowed / horizontal
    return np.array([scale * north, scale * east, -up]), up != wanted_up or scale != 1.0


@compiled
def collective(thrust_ned: Array, attitude_ned_frd: Array) -> float:
    """Thrust (N) along the body's axis that comes nearest to `thrust_ned` at the present attitude."""
    return -to_body(attitude_ned_frd, thrust_ned)[2]
