"""The phase margin with a delay, and the pace that keeps it."""

import math

import numpy as np
import pytest
import scipy.linalg

from companion.config import Settings
from companion.control import margin
from companion.control.margin import FLOOR, LEAST_PACE, Design, feedback, pace_for, phase_margin, plant
from companion.control.parameters import controller_parameters, design_of
from companion.runtime.files import load_body
from companion.state import Output

STEP_S = 0.001


def design(output: Output) -> Design:
    return design_of(controller_parameters(Settings(), load_body("paper_quad"), output)[0])


DESIGNS = [design(output) for output in Output]


@pytest.mark.parametrize("each", DESIGNS)
def test_the_floor_is_kept_with_every_delay(each: Design) -> None:
    floor = min(FLOOR, phase_margin(each, 0.0))
    assert floor > math.radians(28.0)
    for delay in np.linspace(0.004, 0.4, 34).tolist():
        for left in (0.0, 0.1 * delay):
            pace, margin = pace_for(each, delay, left)
            assert margin == pytest.approx(phase_margin(each, delay, left, pace))
            assert LEAST_PACE <= pace <= 1.0
            if pace > LEAST_PACE:
                assert phase_margin(each, delay, left, pace) >= floor - 1e-9
            if pace < 1.0:  # and no slower than it must be
                assert phase_margin(each, delay, left, pace + 0.0201) < floor


@pytest.mark.parametrize("each", DESIGNS)
def test_without_a_delay_it_is_the_design_itself(each: Design) -> None:
    assert pace_for(each, 0.0, 0.0) == (1.0, None)


@pytest.mark.parametrize("each", DESIGNS)
def test_a_longer_delay_is_flown_slower(each: Design) -> None:
    """Least so where the vehicle keeps its attitude by itself."""
    paces = [pace_for(each, delay, 0.0).share for delay in (0.05, 0.1, 0.2, 0.4)]
    assert paces == sorted(paces, reverse=True)
    assert paces[-1] < 0.5 if each.angle_feedback == 0.0 else 0.9 < paces[-1] < 1.0


def grows(each: Design, delay: float, left: float) -> bool:
    """Whether the loop, predicted over `delay` and with so much more of it, runs away from a position of 1 m."""
    A, B = plant(each)
    K = feedback(each, 1.0)
    once = np.block([[A * STEP_S, B[:, None] * STEP_S], [np.zeros((1, 6))]])
    whole, term = np.eye(6), np.eye(6)
    for n in range(1, 8):
        term = term @ once / n
        whole = whole + term
    Ad, Bd = whole[:5, :5], whole[:5, 5]
    ahead, behind = round(delay / STEP_S), round(left / STEP_S)
    powers = [np.linalg.matrix_power(Ad, n) for n in range(ahead, -1, -1)]
    of_state, of_sent = K @ powers[0], np.array([K @ each @ Bd for each in powers[1:]])
    x, sizes, steps = np.array([1.0, 0.0, 0.0, 0.0, 0.0]), [], round(20.0 / STEP_S)
    sent = np.zeros(steps + ahead + behind)
    for now in range(ahead + behind, len(sent)):
        sent[now] = -(of_state @ x + of_sent @ sent[now - ahead : now])
        x = Ad @ x + Bd * sent[now - ahead - behind]
        sizes.append(abs(x[0]))
    return bool(max(sizes[-2000:]) > max(sizes[:2000]))


@pytest.mark.parametrize(
    ("output", "delay"), [(Output.RATES, 0.0), (Output.RATES, 0.04), (Output.ATTITUDE, 0.0), (Output.ATTITUDE, 0.2)]
)
def test_the_margin_is_what_a_simulated_loop_bears(output: Output, delay: float) -> None:
    """The delay beyond the prediction at which the computed margin ends is where the loop begins to run away."""
    each = design(output)
    low, high = 0.0, 0.4
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if phase_margin(each, delay, middle) > 0.0 else (low, middle)
    assert not grows(each, delay, 0.85 * low)
    assert grows(each, delay, 1.15 * low)


@pytest.mark.parametrize("each", DESIGNS)
@pytest.mark.parametrize("seconds", [0.0, 0.004, 0.1, 0.5])
def test_the_exponential_is_scipy_s(each: Design, seconds: float) -> None:
    """It has one of its own, since the import of scipy costs a companion's start more than all else."""
    free, push = plant(each)
    for matrix in (free, free - np.outer(push, feedback(each, 1.0))):
        assert margin._exponential(matrix, seconds) == pytest.approx(scipy.linalg.expm(matrix * seconds), abs=1e-9)
