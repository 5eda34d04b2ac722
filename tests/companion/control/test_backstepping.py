"""Backstepping against Table 3 of the paper, its own Lyapunov argument and the analytic error equation."""

import control
import numpy as np
import pytest

from companion.control import backstepping
from companion.control.backstepping import lyapunov
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array

# Reading of the paper's Table 3, the column "checked": rise 10-90 % (s), settling 2 % (s), overshoot (%).
TABLE_3 = {1.0: (1.519, 4.216, 4.321), 2.5: (1.628, 2.723, 0.0246), 5.0: (1.836, 3.331, 0.0)}
ZERO = np.zeros(3)
STEP_S = 5e-4


def acceleration_command(
    position: Array, velocity: Array, target: Array, rate: Array, acceleration: Array, c1: Array, c2: Array
) -> tuple[Array, Array, Array]:
    """The law's acceleration and its errors e1, e2; all (3,)."""
    e1, e2 = backstepping.errors(position, velocity, target, rate, c1)
    error = TrackingError(e1, rate - velocity, e2, ZERO)
    return backstepping.acceleration_command(error, acceleration, np.array([c1, c2])), e1, e2


def step_response(c: float, duration: float = 12.0) -> tuple[Array, Array]:
    """The ideal double integrator under the law, from rest at 0 to the reference (1, 1, 1)."""
    c1, c2 = np.full(3, c), np.ones(3)
    target = np.ones(3)
    position, velocity = np.zeros(3), np.zeros(3)
    path = [0.0]
    for _ in range(round(duration / STEP_S)):
        # the midpoint rule is exact to second order
        a, _, _ = acceleration_command(position, velocity, target, ZERO, ZERO, c1, c2)
        mid_p, mid_v = position + 0.5 * STEP_S * velocity, velocity + 0.5 * STEP_S * a
        a, _, _ = acceleration_command(mid_p, mid_v, target, ZERO, ZERO, c1, c2)
        position, velocity = position + STEP_S * mid_v, velocity + STEP_S * a
        path.append(position[0])
    return STEP_S * np.arange(len(path), dtype=np.float64), np.array(path, np.float64)


@pytest.mark.parametrize("c", TABLE_3)
def test_table_3(c: float) -> None:
    time, path = step_response(c)
    assert path[-1] == pytest.approx(1.0, abs=1e-4)
    info = control.step_info(path, time, final_output=1.0)
    rise, settling, overshoot = TABLE_3[c]
    assert info["RiseTime"] == pytest.approx(rise, rel=0.01)
    assert info["SettlingTime"] == pytest.approx(settling, rel=0.01)
    assert info["Overshoot"] == pytest.approx(overshoot, rel=0.01, abs=0.002)


@pytest.mark.parametrize("c", TABLE_3)
def test_error_follows_its_analytic_equation(c: float) -> None:
    """e'' + (c1 + c2) e' + (1 + c1 c2) e = 0, python-control as the oracle."""
    time, path = step_response(c, 5.0)
    k = 1.0 + c
    _, expected = control.step_response(control.tf([k], [1.0, c + 1.0, k]), time)
    assert np.allclose(path, expected, atol=1e-5)


def test_lyapunov_function_falls_as_promised() -> None:
    """dV/dt along the law's own motion, by finite differences, equals -c1 e1^2 - c2 e2^2 on each axis."""
    rng = np.random.default_rng(1)
    h = 1e-6
    for _ in range(100):
        p, v, pd, vd, ad = rng.normal(size=(5, 3))
        c1, c2 = rng.uniform(0.5, 5.0, size=(2, 3))
        a, e1, e2 = acceleration_command(p, v, pd, vd, ad, c1, c2)
        before, promised = lyapunov(e1, e2, c1, c2)
        _, e1, e2 = acceleration_command(p + h * v, v + h * a, pd + h * vd, vd + h * ad, ad, c1, c2)
        after, _ = lyapunov(e1, e2, c1, c2)
        assert np.allclose((after - before) / h, promised, atol=1e-3)
        assert np.all(promised <= 0.0)


def test_feed_forward_of_the_acceleration_leaves_no_error() -> None:
    """Without it the steady error at constant acceleration is a / (1 + c1 c2); with it, none."""
    c1, c2 = np.full(3, 2.5), np.ones(3)
    acceleration = np.array([1.0, -2.0, 0.5])
    for fed, expected in ((acceleration, np.zeros(3)), (ZERO, acceleration / (1.0 + 2.5))):
        position, velocity = np.zeros(3), np.zeros(3)
        for i in range(24000):
            t = i * STEP_S
            reference = 0.5 * acceleration * t * t
            a, e1, _ = acceleration_command(position, velocity, reference, acceleration * t, fed, c1, c2)
            position, velocity = position + STEP_S * velocity + 0.5 * STEP_S**2 * a, velocity + STEP_S * a
        assert np.allclose(e1, expected, atol=2e-3)
