"""Backstepping position control: equations (11)-(25) of the paper, as corrected, and its adaptive form.

With e1 = p_d - p, the virtual rate v_d + c1 e1 and e2 = v - v_d - c1 e1, the Lyapunov function V = (e1^2 + e2^2) / 2
has V' = -c1 e1^2 - c2 e2^2 for

    acceleration = a_d + e1 + c1 (v_d - v) - c2 e2

on each axis. (The paper prints (23)-(25) with + c2 e2, which is unstable; see its derivation (17)-(22).) For a step
the error obeys e'' + (c1 + c2) e' + (1 + c1 c2) e = 0.

**Adaptive.** A constant acceleration d that nobody knows adds e2 d to V'. With an estimate D that is taken off the
command and moves by D' = gamma e2, the function V + (d - D)^2 / (2 gamma) has the derivative -c1 e1^2 - c2 e2^2 again,
for (d - D) e2 - (d - D) D' / gamma = 0: the errors go to zero whatever d is (LaSalle). D is an integral of e2, so it
stops while a limit bites and is kept within bounds (projection, which only lowers that derivative).
"""

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def acceleration_command(
    position: Array,
    velocity: Array,
    reference_position: Array,
    reference_velocity: Array,
    reference_acceleration: Array,
    c1: Array,
    c2: Array,
) -> tuple[Array, Array, Array]:
    """Acceleration (m/s2) and the errors e1 (m), e2 (m/s); all (3,), one row an axis, gravity not included."""
    e1 = reference_position - position
    e2 = velocity - reference_velocity - c1 * e1
    return reference_acceleration + e1 + c1 * (reference_velocity - velocity) - c2 * e2, e1, e2


@compiled
def lyapunov(e1: Array, e2: Array, c1: Array, c2: Array) -> tuple[Array, Array]:
    """V (19) and the V' (22) that the law gives where its acceleration is obeyed; (3,) each."""
    return 0.5 * (e1 * e1 + e2 * e2), -c1 * e1 * e1 - c2 * e2 * e2


@compiled
def adapted(estimate: Array, e2: Array, gamma: Array, dt: float, bound: float) -> Array:
    """The estimate D (3,) in m/s2 after `dt` (s), each axis within +-bound."""
    return np.minimum(np.maximum(estimate + dt * gamma * e2, -bound), bound)
