"""Sliding mode position control over the LQR's attitude loop, the combination of the paper's reference [4].

On the surface s = e' + slope e the error decays by e' = -slope e. The reaching law s' = -gain sat(s / boundary) brings
the motion there. It saturates over a boundary layer instead of switching, which would make the attitude chatter:

    acceleration = a_d + slope e' + gain sat(s / boundary)

With V = s^2 / 2 outside the layer, V' = -gain |s| + s d < 0 for every disturbance |d| < gain.
"""

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.jit import compiled


def gains(control: Control) -> tuple[tuple[float, float, float], ...]:
    """The rows slope (1/s), gain (m/s2) and boundary (m/s) of `acceleration_command`."""
    table = control.sliding_mode
    return table.slope, table.gain, (table.boundary, table.boundary, table.boundary)


@compiled
def acceleration_command(error: TrackingError, reference_acceleration: Array, gains: Array) -> Array:
    """Acceleration (3,) in m/s2, NED; `gains` (3, 3) are the rows slope, gain, boundary."""
    slope, gain, boundary = gains[0], gains[1], gains[2]
    surface = error.velocity + slope * error.position
    reaching = gain * np.minimum(np.maximum(surface / boundary, -1.0), 1.0)
    command: Array = reference_acceleration + slope * error.velocity + reaching
    return command
