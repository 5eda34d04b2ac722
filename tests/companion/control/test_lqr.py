"""LQR attitude control against Table 2 of the paper, python-control and the algebra in the module's docstring."""

from typing import Any

import control
import numpy as np
import pytest

from companion.control import lqr
from companion.runtime.files import load_body
from protocol.arrays import Array
from protocol.frames import from_rotation_vector, multiply

BODY = load_body("paper_quad")
ONE = (1.0, 1.0, 1.0)
ROLL, PITCH, YAW = range(3)

# Reading of the paper's Table 2, the column "checked": rise 10-90 % (s), settling 2 % (s), final error (rad).
TABLE_2 = {
    (ROLL, 1.0): (2.309, 4.125, 0.00007),
    (ROLL, 5.0): (1.091, 1.956, -0.553),
    (ROLL, 10.0): (0.801, 1.439, -0.684),
    (YAW, 1.0): (2.196, 3.932, 0.00005),
    (YAW, 5.0): (0.982, 1.769, -0.553),
    (YAW, 10.0): (0.695, 1.256, -0.684),
}


def closed_loop(K: Array, axis: int, entry: float, feed: float) -> Any:
    """One axis with b = `entry` under u = feed r - k1 angle - k2 rate."""
    k1, k2 = K[axis, 2 * axis], K[axis, 2 * axis + 1]
    return control.ss([[0, 1], [-entry * k1, -entry * k2]], [[0], [entry * feed]], [[1, 0]], [[0]])


def feedback(error: Array, rate_error: Array, gain: Array) -> Array:
    """Feedback of all axes, without an error of angular acceleration."""
    return np.array([lqr.feedback(error[axis], rate_error[axis], 0.0, gain[axis]) for axis in range(3)])


@pytest.mark.parametrize(("axis", "weight"), TABLE_2)
def test_table_2_as_published(axis: int, weight: float) -> None:
    """u = r - K x; roll and pitch on a plant without the arm's length under a gain designed with it."""
    K = lqr.attitude_gain(BODY, (weight,) * 3, ONE, ONE)
    entry = 1.0 / BODY.inertia_kgm2[axis]
    time = np.linspace(0.0, 10.0, 20001)
    _, angle = control.step_response(closed_loop(K, axis, entry, 1.0), time)
    info = control.step_info(angle, time, final_output=1.0 / np.sqrt(weight))
    rise, settling, error = TABLE_2[axis, weight]
    assert info["RiseTime"] == pytest.approx(rise, rel=0.01)
    assert info["SettlingTime"] == pytest.approx(settling, rel=0.01)
    assert abs(angle[-1] - 1.0) == pytest.approx(abs(error), rel=0.01, abs=1e-5)


@pytest.mark.parametrize(("weight", "rise", "settling"), [(1.0, 2.199, 3.97), (5.0, 0.991, 1.80), (10.0, 0.707, 1.29)])
def test_roll_with_the_arm_in_the_plant(weight: float, rise: float, settling: float) -> None:
    K = lqr.attitude_gain(BODY, (weight,) * 3, ONE, ONE)
    entry = BODY.arm_length_m / BODY.inertia_kgm2[ROLL]
    info = control.step_info(closed_loop(K, ROLL, entry, 1.0), T=np.linspace(0.0, 10.0, 20001))
    assert info["RiseTime"] == pytest.approx(rise, rel=0.01)
    assert info["SettlingTime"] == pytest.approx(settling, rel=0.01)


@pytest.mark.parametrize("weight", [1.0, 5.0, 10.0, 400.0])
def test_reference_gain_reaches_the_setpoint(weight: float) -> None:
    """u = K (x_ref - x) has unit gain for every weight: what the paper calls a disadvantage of the LQR is not one."""
    K = lqr.attitude_gain(BODY, (weight,) * 3, ONE, ONE)
    for axis in range(3):
        entry = lqr.attitude_model(BODY)[1][2 * axis + 1, axis]
        assert control.dcgain(closed_loop(K, axis, entry, K[axis, 2 * axis])) == pytest.approx(1.0)


def test_gain_solves_the_riccati_equation() -> None:
    A, B = lqr.attitude_model(BODY)
    K = lqr.attitude_gain(BODY, (400.0, 400.0, 50.0), ONE, ONE)
    k1 = np.sqrt([400.0, 400.0, 50.0])  # per axis, by hand: k1 = sqrt(q), k2 = sqrt(r + 2 k1 / b)
    b = np.array([B[1, 0], B[3, 1], B[5, 2]])
    assert np.allclose([K[i, 2 * i] for i in range(3)], k1)
    assert np.allclose([K[i, 2 * i + 1] for i in range(3)], np.sqrt(1.0 + 2.0 * k1 / b))
    assert np.all(np.linalg.eigvals(A - B @ K).real < 0)
    off_axis = K.copy()
    for axis in range(3):
        off_axis[axis, 2 * axis : 2 * axis + 2] = 0.0
    assert np.allclose(off_axis, 0.0, atol=1e-9)


def test_rate_command_is_the_same_loop_factored() -> None:
    """K x_ref-error equals k2 times (rate command - rate), for random errors and rates."""
    K = lqr.attitude_gain(BODY, (400.0, 300.0, 50.0), (1.0, 2.0, 3.0), ONE)
    k2 = np.array([K[axis, 2 * axis + 1] for axis in range(3)])
    rng = np.random.default_rng(1)
    for _ in range(50):
        error, rates, reference = rng.normal(size=(3, 3))
        command = reference + feedback(error, reference - rates, lqr.rate_gain(K))
        inputs = feedback(error, reference - rates, lqr.axis_gain(K))
        assert np.allclose(inputs, k2 * (command - rates))


def test_error_is_the_rotation_to_the_command_and_blind_to_the_sign() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        attitude = rng.normal(size=4)
        attitude /= np.linalg.norm(attitude)
        rotation = rng.normal(size=3)
        rotation *= rng.uniform(0.0, 3.1) / np.linalg.norm(rotation)
        command = multiply(attitude, from_rotation_vector(rotation))
        for a, c in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
            assert np.allclose(lqr.attitude_error(a * attitude, c * command), rotation, atol=1e-9)


def test_every_attitude_converges() -> None:
    """The torque law on the rigid body (no lag) from random attitudes and rates, up to upside down."""
    gain = lqr.axis_gain(lqr.attitude_gain(BODY, (400.0, 400.0, 50.0), ONE, ONE))
    inertia, scale = np.array(BODY.inertia_kgm2), lqr.to_torque(BODY)
    rng = np.random.default_rng(3)
    command = np.array([1.0, 0.0, 0.0, 0.0])
    step = 0.002
    for _ in range(10):
        q = rng.normal(size=4)
        q /= np.linalg.norm(q)
        rates = rng.normal(size=3) * 2.0
        for _ in range(2500):
            torque = scale * feedback(lqr.attitude_error(q, command), -rates, gain)
            rates = rates + step * (torque - np.cross(rates, inertia * rates)) / inertia
            q = multiply(q, from_rotation_vector(step * rates))
        assert np.linalg.norm(lqr.attitude_error(q, command)) < 1e-3
        assert np.linalg.norm(rates) < 1e-3


def test_weights_by_bandwidth_and_damping() -> None:
    """The LQR of the rule's weights has the poles that the rule was asked for, on each axis."""
    bandwidth, damping = (12.0, 9.0, 4.0), 0.9
    K = lqr.attitude_gain(BODY, *lqr.weights_for(BODY, bandwidth, damping), ONE)
    A, B = lqr.attitude_model(BODY)
    for axis, w in enumerate(bandwidth):
        rows = slice(2 * axis, 2 * axis + 2)
        closed = A[rows, rows] - B[rows, axis : axis + 1] @ K[axis : axis + 1, rows]
        assert np.poly(closed) == pytest.approx([1.0, 2.0 * damping * w, w * w], rel=1e-6)


def test_sampled_gain_goes_over_into_the_continuous_one() -> None:
    """As lag and period go to zero; the angular acceleration then says nothing."""
    entries = [lqr.attitude_model(BODY)[1][2 * axis + 1, axis] for axis in range(3)]
    weights = ((400.0, 400.0, 50.0), ONE, ONE)
    continuous = lqr.axis_gain(lqr.attitude_gain(BODY, *weights))
    sampled = lqr.sampled_gain(None, entries, 1e-3, 1e-4, *weights)
    assert sampled[:, :2] == pytest.approx(continuous[:, :2], rel=0.05)
    assert np.abs(sampled[:, 2]).max() < 0.01


@pytest.mark.parametrize("rate_loop", [None, (20.0, 20.0, 10.0)])
def test_sampled_gain_is_stable_on_the_lagging_plant(rate_loop: tuple[float, float, float] | None) -> None:
    entries = [lqr.attitude_model(BODY)[1][2 * axis + 1, axis] for axis in range(3)]
    gain = lqr.sampled_gain(rate_loop, entries, 0.03, 0.004, (400.0, 400.0, 50.0), ONE, ONE)
    for axis in range(3):
        k = 0.0 if rate_loop is None else rate_loop[axis]
        b = entries[axis] if rate_loop is None else k
        A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -k / 0.03, -1.0 / 0.03]])
        plant = control.c2d(control.ss(A, [[0.0], [0.0], [b / 0.03]], np.eye(3), np.zeros((3, 1))), 0.004)
        assert np.abs(np.linalg.eigvals(plant.A - plant.B @ gain[axis : axis + 1])).max() < 1.0
