"""LQR attitude control: equations (7)-(10) of the paper, with the reference gain that it lacks.

The state is (phi, phi', theta, theta', psi, psi'), the inputs are the thrust differences U2, U3 (N) at the arm's
length and the torque U4 (N m), so B holds l/Ixx, l/Iyy, 1/Izz. The law is u = K (x_ref - x). Its gain from reference
to angle is 1 for every weight (the paper feeds the reference in without K, which leaves an error of 1 - 1/sqrt(q)).

**Torque or rates.** A, B, Q, R separate into the three axes, so each row of K is (k1, k2) and

    u = k1 (angle_ref - angle) - k2 rate = k2 ((k1 / k2) (angle_ref - angle) - rate).

The right side is a rate loop of gain k2 under a rate command of (k1 / k2) times the angle's error. Sent to a vehicle
whose own rate loop has that gain, the command gives the same closed loop, s^2 + b k2 s + b k1 with b the axis's entry
of B. The faster the vehicle's rate loop, the nearer the angle comes to a first-order lag with the rate k1 / k2.
"""

from collections.abc import Sequence

import numpy as np

from protocol.arrays import Array
from protocol.disk_cache import cached_on_disk
from protocol.frames import conjugate, multiply, to_rotation_vector
from protocol.jit import compiled
from protocol.vehicle_parameters import VehicleParameters


def attitude_model(body: VehicleParameters) -> tuple[Array, Array]:
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


@cached_on_disk("control", "scipy", "numpy")
def attitude_gain(
    body: VehicleParameters, angle_weight: Sequence[float], rate_weight: Sequence[float], input_weight: Sequence[float]
) -> Array:
    """K (3, 6) for the diagonals of the weights (3 each): Q = diag(angle, rate, angle, ...), R = diag(input)."""
    import control  # takes seconds to import

    A, B = attitude_model(body)
    K, _, _ = control.lqr(A, B, np.diag(np.column_stack([angle_weight, rate_weight]).ravel()), np.diag(input_weight))
    return np.asarray(K, dtype=np.float64)


def weights_for(body: VehicleParameters, bandwidth: Sequence[float], damping: float) -> tuple[list[float], list[float]]:
    """Angle and rate weights (three each, R = 1) whose LQR has the closed loop s^2 + 2 damping w s + w^2 on each axis.

    With b the axis's entry of B the LQR gives k1 = sqrt(q_angle) and k2 = sqrt(q_rate + 2 k1 / b), and the closed loop
    is s^2 + b k2 s + b k1; so q_angle = (w^2 / b)^2 and q_rate = (4 damping^2 - 2) (w / b)^2. `bandwidth` in rad/s;
    `damping` is at least sqrt(1/2); no weights give less.
    """
    _, B = attitude_model(body)
    entries = [B[2 * axis + 1, axis] for axis in range(3)]
    angle = [(w * w / b) ** 2 for w, b in zip(bandwidth, entries, strict=True)]
    rate = [(4.0 * damping * damping - 2.0) * (w / b) ** 2 for w, b in zip(bandwidth, entries, strict=True)]
    return angle, rate


def axis_gain(K: Array) -> Array:
    """(3, 3), one row for each axis: gains from its errors of angle, rate and angular acceleration (0 here) to its
    input of (7)."""
    return np.array([[K[axis, 2 * axis], K[axis, 2 * axis + 1], 0.0] for axis in range(3)])


def rate_gain(K: Array) -> Array:
    """(3, 3) as `axis_gain`, for a rate command: k1 / k2 (1/s) for the angle's error, 0 for the others."""
    return np.array([[K[axis, 2 * axis] / K[axis, 2 * axis + 1], 0.0, 0.0] for axis in range(3)])


@cached_on_disk("control", "scipy", "numpy")
def sampled_gain(
    rate_loop: Sequence[float] | None,
    entries: Sequence[float],
    lag_s: float,
    period_s: float,
    angle_weight: Sequence[float],
    rate_weight: Sequence[float],
    input_weight: Sequence[float],
) -> Array:
    """(3, 3) as `axis_gain`: the discrete-time LQR of each axis with the rotors' lag in the plant,

        angle' = rate, rate' = acceleration, lag acceleration' = b u - acceleration   (u an input of (7)), or
        lag acceleration' = k (u - rate) - acceleration   (u a rate command, k the gain of the vehicle's `rate_loop`),

    under a zero-order hold of `period_s` and the same weights per second. The delays of telemetry and link are not
    included, since the state is predicted over them (`control.prediction`).
    """
    import control  # takes seconds to import

    gains = np.zeros((3, 3))
    for axis in range(3):
        k = 0.0 if rate_loop is None else rate_loop[axis]
        b = entries[axis] if rate_loop is None else k
        A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -k / lag_s, -1.0 / lag_s]])
        plant = control.c2d(control.ss(A, [[0.0], [0.0], [b / lag_s]], np.eye(3), np.zeros((3, 1))), period_s)
        Q = np.diag([angle_weight[axis], rate_weight[axis], 0.0])
        K, _, _ = control.dlqr(plant.A, plant.B, Q, [[input_weight[axis]]])
        gains[axis] = K[0]
    return gains


def to_torque(body: VehicleParameters) -> Array:
    """(3,) torque (N m) for one unit of U2, U3, U4."""
    return np.array([body.arm_length_m, body.arm_length_m, 1.0])


@compiled
def attitude_error(attitude_ned_frd: Array, command_ned_frd: Array) -> Array:
    """(3,) the shortest rotation (rad, body axes) from the attitude (4,) to the command (4,); the same for q and -q."""
    return to_rotation_vector(multiply(conjugate(attitude_ned_frd), command_ned_frd))


@compiled
def feedback(angle_error: float, rate_error: float, acceleration_error: float, gain: Array) -> float:
    """The product of an axis's row (3,) of a gain with its errors of angle (rad), rate (rad/s) and angular acceleration
    (rad/s2): U2, U3 (N) or U4 (N m) with `axis_gain`, a rate (rad/s) with `rate_gain`."""
    return float(gain[0] * angle_error + gain[1] * rate_error + gain[2] * acceleration_error)
