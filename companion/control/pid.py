"""Plain PID position control, to compare with: no model of the motion but the mass.

acceleration = kp e + ki integral(e) + kd e'
"""

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def acceleration_command(error: Array, error_rate: Array, integral: Array, kp: Array, ki: Array, kd: Array) -> Array:
    """Acceleration (3,) in m/s2 from errors reference minus measured (m, m/s) and the integral of the first (m s)."""
    return kp * error + ki * integral + kd * error_rate
