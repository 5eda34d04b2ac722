"""From an acceleration command to a thrust vector within the vehicle's limits; the altitude has priority."""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import to_body, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_LEAST_COSINE = 0.1


@compiled
def drag_compensation(velocity_ned: Array, attitude_ned_frd: Array, drag: Array, mass: float) -> Array:
    """Acceleration (3,) in m/s2, NED, that compensates linear drag (3,) in kg/s along the body's axes, at a velocity
    (3,) in m/s, NED, through still air; `mass` in kg."""
    x, y, z = to_body(attitude_ned_frd, velocity_ned)
    force = to_world(attitude_ned_frd, (drag[0] * x, drag[1] * y, drag[2] * z))
    return np.array([force[0] / mass, force[1] / mass, force[2] / mass])


@compiled
def thrust_vector(
    acceleration_ned: Array, mass: float, lowest: float, highest: float, tilt_limit: float
) -> tuple[Array, bool]:
    """Thrust (3,) in N, NED, for an acceleration (3,) in m/s2, NED, and whether a limit was reached.

    The vertical part is kept between `lowest` and `highest` (N). The horizontal part keeps its direction and gets what
    the limits on the whole thrust and on the tilt (rad) leave. Without a limit on the tilt (pi) the thrust keeps its
    direction, whichever that is.
    """
    if tilt_limit >= math.pi:
        return _any_direction(acceleration_ned, mass, lowest, highest)
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
def _any_direction(acceleration_ned: Array, mass: float, lowest: float, highest: float) -> tuple[Array, bool]:
    """The thrust (3,) in N, NED, of a vehicle that may be inverted, and whether a limit on its size was reached."""
    wanted = mass * acceleration_ned
    wanted[2] -= mass * GRAVITY
    size = math.sqrt(wanted[0] * wanted[0] + wanted[1] * wanted[1] + wanted[2] * wanted[2])
    if size < 1e-6 * mass:
        return np.array([0.0, 0.0, -lowest]), True
    kept = min(max(size, lowest), highest)
    return wanted * (kept / size), kept != size


@compiled
def collective(thrust_ned: Array, attitude_ned_frd: Array) -> float:
    """Thrust (N) along the body's -z axis that comes nearest to `thrust_ned` (3,) in N at an attitude (4,)."""
    return -to_body(attitude_ned_frd, thrust_ned)[2]


@compiled
def on_the_wire(collective_n: float, attitude_ned_frd: Array, boosted: bool) -> float:
    """What to ask the vehicle for (N), so that it gives a thrust at an attitude (4,).

    A vehicle with angle boost divides the thrust that it is asked for by the cosine of its tilt, but by no less than
    `_LEAST_COSINE` (ArduPilot's AC_AttitudeControl_Multi::get_throttle_boosted).
    """
    if not boosted:
        return collective_n
    x, y = attitude_ned_frd[1], attitude_ned_frd[2]
    cosine: float = max(1.0 - 2.0 * (x * x + y * y), _LEAST_COSINE)
    return collective_n * cosine
