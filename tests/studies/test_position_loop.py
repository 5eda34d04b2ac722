"""Table 3 of the paper, and the stability of the cascade beside what can be worked out by hand."""

import msgspec
import numpy as np
import pytest

from companion.control import lqr
from protocol import toml_files
from studies import position_loop
from studies.position_loop import (
    CHECKED,
    CONSTANTS,
    diverges,
    figures,
    growth,
    ideal,
    stable_from,
    step_north,
    without_drag,
)
from vehicle_sim.airframe import Airframe

FRAME = Airframe.load(toml_files.find("vehicles", "paper_quad"))


@pytest.mark.parametrize("c", CONSTANTS)
def test_ideal_is_the_checked_column(c: float) -> None:
    ours, checked = figures(*ideal(c)), CHECKED[c]
    assert ours.rise == pytest.approx(checked.rise, rel=0.01)
    assert ours.settling == pytest.approx(checked.settling, rel=0.01)
    assert ours.overshoot == pytest.approx(checked.overshoot, rel=0.01, abs=1e-6)
    assert ours.error < 1e-6


def test_figures_of_a_first_order_lag() -> None:
    time = np.linspace(0.0, 12.0, 12001)
    ours = figures(time, 1.0 - np.exp(-time))
    assert ours.rise == pytest.approx(np.log(9.0), abs=2e-3)
    assert ours.settling == pytest.approx(np.log(50.0), abs=2e-3)
    assert ours.overshoot == 0.0 and ours.error == pytest.approx(np.exp(-12.0), rel=1e-6)


@pytest.mark.parametrize("c", [0.5, 1.0, 2.5, 5.0])
@pytest.mark.parametrize("weight", [0.5, 1.0, 2.0, 3.0, 5.0, 100.0])
def test_stability_is_that_of_routh(c: float, weight: float) -> None:
    """Without motor lag and sampling: s^4 + A s^3 + B s^2 + B C s + B D with A = b k2, B = b k1, C = D = 1 + c."""
    b = FRAME.body.arm_length_m / FRAME.body.inertia_kgm2[0]
    k1 = np.sqrt(weight)
    A, B, C = b * np.sqrt(1.0 + 2.0 * k1 / b), b * k1, 1.0 + c
    stable = A > C and A * B * C > B * C**2 + A**2 * C
    rate = growth(FRAME.body, c, weight, drag=False, lag_s=1e-4, period_s=1e-5)
    assert (rate < 0.0) == stable
    assert rate == pytest.approx(np.roots([1.0, A, B, B * C, B * C]).real.max(), abs=2e-3)


def test_a_quick_attitude_loop_leaves_the_ideal_position_loop() -> None:
    rate = growth(FRAME.body, 1.0, 1e8, drag=True, lag_s=1e-5, period_s=1e-6)
    assert rate == pytest.approx(-1.0, abs=0.01)  # s^2 + 2 s + 2


@pytest.mark.parametrize("drag", [False, True])
def test_nothing_grows_from_the_weight_that_is_said(drag: bool) -> None:
    for c in CONSTANTS:
        weight = stable_from(FRAME.body, c, drag=drag)
        assert growth(FRAME.body, c, 0.95 * weight, drag=drag) > 0.0 > growth(FRAME.body, c, 1.05 * weight, drag=drag)


def test_the_papers_weight_diverges_in_flight_and_ten_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(position_loop, "HOLD_S", 15.0)
    frame = without_drag(FRAME)
    assert frame.body.drag_kg_s == (0.0, 0.0, 0.0)
    assert msgspec.structs.replace(frame.body, drag_kg_s=FRAME.body.drag_kg_s) == FRAME.body
    time, path = step_north(frame, 5.0, 1.0)
    assert diverges(time, path) and np.abs(path - 1.0).max() > 3.0
    time, path = step_north(frame, 5.0, 10.0)
    assert not diverges(time, path) and abs(path[-1] - 1.0) < 1e-3


def test_growth_has_the_gains_of_the_companion() -> None:
    """Its u = k1 angle + k2 rate is the LQR's row of pitch."""
    K = lqr.attitude_gain(FRAME.body, (400.0,) * 3, (1.0,) * 3, (1.0,) * 3)
    b = FRAME.body.arm_length_m / FRAME.body.inertia_kgm2[1]
    assert K[1, 2] == pytest.approx(20.0) and K[1, 3] == pytest.approx(np.sqrt(1.0 + 40.0 / b))
