"""The rigid body, (4) and (6) from hover: where they agree and where they part."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from protocol import toml_files
from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY
from studies.open_loop import Motion, coupling, equation_4, equation_6, parted, rigid_body, thrusts
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.physics.rigid_body import ATTITUDE, RATES, ROTORS, STATES, derivative

FRAME = Airframe.load(toml_files.find("vehicles", "paper_quad"))
WEIGHT = FRAME.body.mass_kg * GRAVITY
Model = Callable[[Airframe, Array, float], Motion]
MODELS: tuple[Model, ...] = (rigid_body, equation_4, equation_6)


def test_mixed_thrusts_are_the_inputs_again() -> None:
    front, right, back, left = thrusts(FRAME, np.array([12.0, 0.3, -0.2, 0.01]))
    assert front + right + back + left == pytest.approx(12.0)
    assert left - right == pytest.approx(0.3) and front - back == pytest.approx(-0.2)
    assert FRAME.body.torque_per_thrust_m * (front + back - right - left) == pytest.approx(0.01)


@pytest.mark.parametrize("model", MODELS)
def test_a_step_of_thrust_lifts_by_newtons_law(model: Model) -> None:
    motion = model(FRAME, np.array([1.1 * WEIGHT, 0.0, 0.0, 0.0]), 1.0)
    assert motion.position[-1] == pytest.approx([0.0, 0.0, -0.5 * 0.1 * GRAVITY], abs=1e-9)
    assert motion.time[-1] == pytest.approx(1.0) and not motion.angles.any()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("axis", range(3))
def test_one_torque_turns_one_angle_evenly(model: Model, axis: int) -> None:
    inputs = np.array([WEIGHT, 0.0, 0.0, 0.0])
    inputs[1 + axis] = 0.02
    arm = FRAME.body.arm_length_m if axis < 2 else 1.0
    angle = 0.5 * arm * 0.02 / FRAME.body.inertia_kgm2[axis]
    assert model(FRAME, inputs, 1.0).angles[-1, axis] == pytest.approx(angle, rel=1e-5)


def test_roll_to_the_right_moves_east_and_pitch_up_moves_south() -> None:
    for model in MODELS:
        assert model(FRAME, np.array([WEIGHT, 0.05, 0.0, 0.0]), 0.5).velocity[-1, 1] > 0.1
        assert model(FRAME, np.array([WEIGHT, 0.0, 0.05, 0.0]), 0.5).velocity[-1, 0] < -0.1


def test_the_linear_model_parts_where_sine_and_cosine_say() -> None:
    inputs = np.array([WEIGHT, 0.05, 0.0, 0.0])
    truth = rigid_body(FRAME, inputs, 2.0)
    attitude, across, down = parted(equation_6(FRAME, inputs, 2.0), truth)
    assert attitude is None and across is not None and down is not None
    tilt = truth.tilt[across]
    assert tilt / math.sin(tilt) == pytest.approx(1.1, abs=0.002)
    assert math.cos(truth.tilt[down]) == pytest.approx(0.9, abs=0.002)
    assert parted(equation_4(FRAME, inputs, 2.0), truth) == (None, None, None)


def test_coupling_does_no_work_but_as_printed_it_does() -> None:
    rng = np.random.default_rng(1)
    for rates in rng.normal(size=(20, 3)):
        assert abs(rates @ coupling(FRAME, 0.01, rates)) < 1e-15
    rates = np.array([1.0, 2.0, 0.5])
    assert abs(rates @ coupling(FRAME, 0.01, rates, printed=True)) > 0.01


def test_coupling_is_that_of_the_rigid_body() -> None:
    """From its compiled derivative, rotors turning unevenly."""
    vehicle = parameters(FRAME)
    vehicle["drag_kg_s"] = 0.0
    state, rate = np.zeros(STATES), np.zeros(STATES)
    state[2], state[ATTITUDE], state[RATES] = -100.0, (1.0, 0.0, 0.0, 0.0), (1.0, -2.0, 0.7)
    state[ROTORS] = (300.0, 350.0, 300.0, 350.0)
    derivative(state, state[ROTORS], vehicle, rate)
    inertia = np.array(FRAME.body.inertia_kgm2)
    yaw = FRAME.body.torque_per_thrust_m * FRAME.rotors.thrust_constant_ns2 * 2.0 * (300.0**2 - 350.0**2)
    spin = FRAME.rotors.inertia_kgm2 * 100.0
    assert rate[RATES] * inertia == pytest.approx(np.add(coupling(FRAME, spin, state[RATES]), (0.0, 0.0, yaw)))
