"""Geometric tracking control on SE(3): T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor
UAV on SE(3)", IEEE CDC 2010.

Their position law (with gains by mass) and attitude error; rates and angular acceleration of the reference are fed
forward by `control.flatness`, as for the other laws.
"""

import numpy as np

from protocol.arrays import Array
from protocol.frames import conjugate, multiply
from protocol.jit import compiled


@compiled
def acceleration_command(
    error: Array, error_rate: Array, reference_acceleration: Array, position_gain: Array, velocity_gain: Array
) -> Array:
    """Acceleration (3,) in m/s2 from errors reference minus measured (m, m/s)."""
    return reference_acceleration + position_gain * error + velocity_gain * error_rate


@compiled
def attitude_error(attitude_ned_frd: Array, command_ned_frd: Array) -> Array:
    """-e_R = (R' Rd - Rd' R) / 2 as a vector: sin(angle) along the axis of the shortest rotation to the command.

    Beyond 90 degrees it shrinks again, which is the law's known weakness; the same for q and -q.
    """
    q = multiply(conjugate(attitude_ned_frd), command_ned_frd)
    error: Array = 2.0 * q[0] * np.array([q[1], q[2], q[3]])
    return error
