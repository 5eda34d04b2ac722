"""Backstepping position control: equations (11)-(25) of the paper, as corrected, and its adaptive form.

With e1 = p_d - p, the virtual rate v_d + c1 e1 and e2 = v - v_d - c1 e1, the Lyapunov function V = (e1^2 + e2^2) / 2
has V' = -c1 e1^2 - c2 e2^2 for

    acceleration = a_d + e1 + c1 (v_d - v) - c2 e2

on each axis. (The paper prints (23)-(25) with + c2 e2, which is unstable; see its derivation (17)-(22).) After a step
the error follows e'' + (c1 + c2) e' + (1 + c1 c2) e = 0.

**Adaptive.** An unknown constant acceleration d adds e2 d to V'. With an estimate D that is subtracted from the command
and moves by D' = gamma e2, the function V + (d - D)^2 / (2 gamma) has the derivative -c1 e1^2 - c2 e2^2 again, because
(d - D) e2 - (d - D) D' / gamma = 0. The errors go to zero for every d (LaSalle). D is an integral of e2, so it stops
while a limit is reached and is kept within bounds (projection, which can only lower that derivative).
"""

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.jit import compiled


def gains(control: Control) -> tuple[tuple[float, float, float], ...]:
    """The rows c1 (1/s) and c2 (1/s) of `acceleration_command`."""
    return control.position.c1, control.position.c2


@compiled
def errors(
    position: Array, velocity: Array, reference_position: Array, reference_velocity: Array, c1: Array
) -> tuple[Array, Array]:
    """The errors e1 (3,) in m and e2 (3,) in m/s of (11)-(16), NED."""
    e1 = reference_position - position
    return e1, velocity - reference_velocity - c1 * e1


@compiled
def acceleration_command(error: TrackingError, reference_acceleration: Array, gains: Array) -> Array:
    """Acceleration (3,) in m/s2, NED, gravity not included; `gains` (2 or more, 3) are the rows c1 and c2."""
    command: Array = reference_acceleration + error.position + gains[0] * error.velocity - gains[1] * error.virtual
    return command


@compiled
def lyapunov(e1: Array, e2: Array, c1: Array, c2: Array) -> tuple[Array, Array]:
    """V (19), and V' (22) for a vehicle whose acceleration is the commanded one; (3,) each."""
    return 0.5 * (e1 * e1 + e2 * e2), -c1 * e1 * e1 - c2 * e2 * e2


@compiled
def integrated(integral: Array, error: Array, gain: Array, dt: float, bound: float) -> Array:
    """The integral (3,) of gain times error after `dt` (s), each axis within +-bound; D (m/s2) for e2 and gamma."""
    return np.minimum(np.maximum(integral + dt * gain * error, -bound), bound)
