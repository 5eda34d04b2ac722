"""Sliding mode position control over the LQR's attitude loop, the combination of the paper's reference [4].

On the surface s = e' + slope e the error dies away by e' = -slope e; the reaching law s' = -gain sat(s / boundary)
brings it there, saturated over a boundary layer instead of switched, or the attitude would chatter:

    acceleration = a_d + slope e' + gain sat(s / boundary)

With V = s^2 / 2 outside the layer, V' = -gain |s| + s d < 0 for every disturbance |d| < gain.
"""

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def acceleration_command(
    error: Array, error_rate: Array, reference_acceleration: Array, slope: Array, gain: Array, boundary: float
) -> Array:
    """Acceleration (3,) in m/s2 from errors reference minus measured (m, m/s)."""
    surface = error_rate + slope * error
    return reference_acceleration + slope * error_rate + gain * np.minimum(np.maximum(surface / boundary, -1.0), 1.0)
