"""LQR attitude control: equations (7)-(10) of the paper, with the reference gain that it lacks.

The state is (phi, phi', theta, theta', psi, psi'), the inputs are the thrust differences U2, U3 (N) at the arm's
length and the torque U4 (N m), so B holds l/Ixx, l/Iyy, 1/Izz. The law is u = K (x_ref - x): its gain from reference
to angle is 1 for every weight (the paper feeds the reference in without K, and then misses it by 1 - 1/sqrt(q)).

**Torque or rates.** A, B, Q, R fall apart into the three axes, so each row of K is (k1, k2) and

    u = k1 (angle_ref - angle) - k2 rate = k2 ((k1 / k2) (angle_ref - angle) - rate).

The right side is a rate loop of gain k2 under a rate command of (k1 / k2) times the angle's error: sent to a vehicle
whose own rate loop has that gain, it is the same closed loop, s^2 + b k2 s + b k1 with b the axis's entry of B; the
faster the vehicle's rate loop, the nearer the angle comes to a first-order lag of k1 / k2.
"""

from collections.abc import Sequence

import numpy as np

from protocol.body import Body
from protocol.compiled import compiled
from protocol.frames import Array, conjugate, multiply, to_rotation_vector


def attitude_model(body: Body) -> tuple[Array, Array]:
    """A (6, 6) and B (6, 3) of (7): the linear plant about hover."""
    A = np.zeros((6, 6))
    B = np.zeros((6, 3))
    for axis, entry in enumerate(
        (
            body.arm_length_m / body.inertia_kgm2[0],
            body.arm_length_m / body.inertia_kgm2[1],
            1.0 / body.inertia_kgm2[2],
        )
    ):
        A[2 * axis, 2 * axis + 1] = 1.0
        B[2 * axis + 1, axis] = entry
    return A, B


def attitude_gain(
    body: Body, angle_weight: Sequence[float], rate_weight: Sequence[float], input_weight: Sequence[float]
) -> Array:
    """K (3, 6) of the weights' diagonals, three of each: Q = diag(angle, rate, angle, ...), R = diag(input)."""
    import control  # takes seconds to import

    A, B = attitude_model(body)
    K, _, _ = control.lqr(A, B, np.diag(np.column_stack([angle_weight, rate_weight]).ravel()), np.diag(input_weight))
    return np.asarray(K, dtype=np.float64)


def rate_gain(K: Array) -> Array:
    """k1 / k2 (1/s), (3,): the rate command for an angle's error."""
    return np.array([K[axis, 2 * axis] / K[axis, 2 * axis + 1] for axis in range(3)])


def to_torque(body: Body) -> Array:
    """(3,) N m for one unit of U2, U3, U4."""
    return np.array([body.arm_length_m, body.arm_length_m, 1.0])


@compiled
def attitude_error(attitude_ned_frd: Array, command_ned_frd: Array) -> Array:
    """The shortest rotation (rad, body axes) from the attitude to the command; the same for q and -q."""
    return to_rotation_vector(multiply(conjugate(attitude_ned_frd), command_ned_frd))


@compiled
def inputs(error: Array, rate_error: Array, K: Array) -> Array:
    """U2, U3 (N), U4 (N m) = K (x_ref - x), from the errors (3,) of angle (rad) and rate (rad/s)."""
    u = np.zeros(3)
    for i in range(3):
        for axis in range(3):
            u[i] += K[i, 2 * axis] * error[axis] + K[i, 2 * axis + 1] * rate_error[axis]
    return u


@compiled
def rates_command(error: Array, reference_rates: Array, gain: Array, limit: Array) -> Array:
    """Body rates (rad/s) = reference + (k1 / k2) error, each axis within +-limit."""
    return np.minimum(np.maximum(reference_rates + gain * error, -limit), limit)
