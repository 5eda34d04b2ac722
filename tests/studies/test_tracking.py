"""Table 4: the law in c, the ideal loop beside an integration of it, and a flight beside both."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from studies import tracking


def test_the_paper_s_z_is_the_law_and_its_x_has_no_constant() -> None:
    a, b, residual = tracking.law_of_c(tracking.PRINTED["z"])
    assert (a, b) == pytest.approx((0.0746, 0.3129), abs=1e-4)
    assert residual < 1e-4
    for c, value in zip(tracking.CONSTANTS, tracking.PRINTED["x"], strict=True):
        assert value * (1.0 + c) == pytest.approx(2.0 * tracking.PRINTED["x"][0], rel=0.035)


def test_the_fit_finds_the_law_and_the_residual_what_is_not_of_it() -> None:
    exact = [0.1 + 0.4 / (1.0 + c) for c in tracking.CONSTANTS]
    assert tracking.law_of_c(exact) == pytest.approx((0.1, 0.4, 0.0), abs=1e-12)
    bent = [exact[0], exact[1] + 0.01, exact[2]]
    assert 0.001 < tracking.law_of_c(bent)[2] < 0.01


@pytest.mark.parametrize("fed_forward", tracking.FED_FORWARD)
@pytest.mark.parametrize("c", tracking.CONSTANTS)
def test_the_circle_s_error_is_that_of_the_integrated_law(c: float, fed_forward: str) -> None:
    """x'' = fed acceleration + e + c (fed velocity - x') - e2 on x_d = R cos(w t), integrated until it is steady."""
    radius, w = tracking.RADIUS, tracking.PACE
    feeds_velocity, feeds_acceleration = fed_forward != "none", fed_forward == "acceleration"

    def rates(t: float, state: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[float]:
        x, v = state
        e = radius * np.cos(w * t) - x
        fed_velocity = -radius * w * np.sin(w * t) if feeds_velocity else 0.0
        fed_acceleration = -radius * w * w * np.cos(w * t) if feeds_acceleration else 0.0
        e2 = v - fed_velocity - c * e
        return [v, fed_acceleration + e + c * (fed_velocity - v) - e2]

    times = np.linspace(0.0, 20.0 * np.pi, 20001)
    path = solve_ivp(rates, (0.0, times[-1]), [radius, 0.0], t_eval=times, rtol=1e-9, atol=1e-11).y[0]
    steady = times > 16.0 * np.pi
    mae = np.abs(radius * np.cos(w * times) - path)[steady].mean()
    assert tracking.circle_mae(c, fed_forward) == pytest.approx(mae, rel=1e-3, abs=1e-6)


def test_the_flown_circle_is_the_ideal_one_within_a_tenth() -> None:
    tracked = tracking.fly("circle", 2.5, "velocity")
    mae = np.abs(tracking.at_pace(tracked, tracking.RADIUS * tracking.PACE)).mean(axis=0)
    ideal = tracking.circle_mae(2.5, "velocity")
    assert mae[:2] == pytest.approx([ideal, ideal], rel=0.1)
    assert mae[2] < 0.01
