"""Geometric tracking control on SE(3): T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor
UAV on SE(3)", IEEE CDC 2010.

This is their position law, with gains divided by the mass, and their attitude error. Rates and angular acceleration of
the reference are fed forward by `control.flatness`, as for the other laws.
"""

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.frames import conjugate, multiply
from protocol.jit import compiled


def gains(control: Control) -> tuple[tuple[float, float, float], ...]:
    """The rows of position (1/s2) and velocity (1/s) gains of `acceleration_command`."""
    return control.se3.position_gain, control.se3.velocity_gain


@compiled
def acceleration_command(error: TrackingError, reference_acceleration: Array, gains: Array) -> Array:
    """Acceleration (3,) in m/s2, NED; `gains` (2 or more, 3) are the rows of position and velocity gains."""
    command: Array = reference_acceleration + gains[0] * error.position + gains[1] * error.velocity
    return command


@compiled
def attitude_error(attitude_ned_frd: Array, command_ned_frd: Array) -> Array:
    """-e_R = (R' Rd - Rd' R) / 2 as a vector (3,) in body axes: sin(angle) along the axis of the shortest rotation to
    the command. The same for q and -q.

    It shrinks again beyond 90 degrees, which is the law's known weakness.
    """
    q = multiply(conjugate(attitude_ned_frd), command_ned_frd)
    error: Array = 2.0 * q[0] * np.array([q[1], q[2], q[3]])
    return error
