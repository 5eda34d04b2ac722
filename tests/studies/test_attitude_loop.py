"""Table 2 of the paper, recomputed and flown."""

import math

import pytest

from protocol import toml_files
from studies.attitude_loop import AXES, CHECKED, SMALL, WEIGHTS, WITH_ARM, figures, flown, linear
from vehicle_sim.airframe import Airframe

FRAME = Airframe.load(toml_files.find("vehicles", "paper_quad"))


@pytest.mark.parametrize("weight", WEIGHTS)
@pytest.mark.parametrize("axis", range(3))
def test_as_published_is_the_checked_column(axis: int, weight: float) -> None:
    ours = figures(*linear(FRAME.body, axis, weight, published=True), 1.0 / math.sqrt(weight))
    checked = CHECKED[AXES[axis], weight]
    assert ours.rise == pytest.approx(checked.rise, rel=0.01)
    assert ours.settling == pytest.approx(checked.settling, rel=0.01)
    assert abs(ours.error) == pytest.approx(abs(checked.error), rel=0.01, abs=1e-5)


@pytest.mark.parametrize("weight", WEIGHTS)
def test_with_the_reference_gain(weight: float) -> None:
    for axis in range(3):
        ours = figures(*linear(FRAME.body, axis, weight, published=False), 1.0)
        yaw = CHECKED["psi", weight]
        rise, settling = WITH_ARM[weight] if axis < 2 else (yaw.rise, yaw.settling)
        assert ours.rise == pytest.approx(rise, rel=0.01)
        assert ours.settling == pytest.approx(settling, rel=0.01)
        assert abs(ours.error) < 1e-4


@pytest.mark.parametrize("axis", range(3))
def test_flown_step_is_that_of_the_linear_plant_but_for_the_motors(axis: int) -> None:
    ideal = figures(*linear(FRAME.body, axis, 10.0, published=False), 1.0)
    time, angle = flown(FRAME, axis, 10.0, SMALL)
    flight = figures(time, angle, 1.0)
    assert flight.rise == pytest.approx(ideal.rise, rel=0.05)
    assert flight.settling == pytest.approx(ideal.settling, rel=0.05)
    assert angle.max() < 1.005 and abs(flight.error) < 1e-6


def test_a_whole_step_of_yaw_takes_longer_than_the_rotors_torque_allows_a_small_one() -> None:
    small, whole = (figures(*flown(FRAME, 2, 10.0, step), 1.0) for step in (SMALL, 1.0))
    assert whole.settling > 1.03 * small.settling
