"""Plain PID position control, for comparison: no model of the motion but the mass.

acceleration = kp e + ki integral(e) + kd e'
"""

from companion.config import Control
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.jit import compiled


def gains(control: Control) -> tuple[tuple[float, float, float], ...]:
    """The rows kp (1/s2), ki (1/s3) and kd (1/s) of `acceleration_command`."""
    return control.pid.proportional, control.pid.integral, control.pid.derivative


@compiled
def acceleration_command(error: TrackingError, reference_acceleration: Array, gains: Array) -> Array:
    """Acceleration (3,) in m/s2, NED; `gains` (3, 3) are the rows kp, ki, kd. The reference's acceleration is not
    used."""
    command: Array = gains[0] * error.position + gains[1] * error.integral + gains[2] * error.velocity
    return command
