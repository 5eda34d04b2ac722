"""Motion against closed forms and conservation laws."""

import math

import numpy as np
import pytest

from protocol.arrays import Array
from protocol.frames import rotate
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, tilted
from vehicle_sim.airframe import parameters
from vehicle_sim.physics.integrator import step, work_array
from vehicle_sim.physics.rigid_body import ATTITUDE, POSITION, RATES, ROTORS, STATES, VELOCITY, Parameters, derivative

BODY = AIRFRAME.body
HOVER_SPEED = math.sqrt(AIRFRAME.takeoff_mass_kg * GRAVITY / 4.0 / AIRFRAME.rotors.thrust_constant_ns2)
FRONT, RIGHT, BACK, LEFT = range(13, 17)


def at_height(height: float, rotor_speed: float = 0.0) -> Array:
    state = np.zeros(STATES)
    state[2] = -height
    state[6] = 1.0
    state[ROTORS] = rotor_speed
    return state


INERTIA = np.array([0.012, 0.017, 0.021])
"""Three different ones, so that no term of Euler's equation vanishes."""


def without_air() -> Parameters:
    record = parameters(AIRFRAME)
    record["drag_kg_s"] = 0.0
    record["inertia_kgm2"] = INERTIA
    return record


def run(state: Array, p: Parameters, seconds: float, *, commands: Array | None = None, dt: float = 1e-3) -> Array:
    """The state after some time; rotors are told to keep their speed unless told otherwise."""
    end, room = state.copy(), work_array()
    told = state[ROTORS].copy() if commands is None else commands
    for _ in range(round(seconds / dt)):
        step(end, told, p, dt, room)
    return end


def angular_momentum_ned(state: Array, p: Parameters) -> Array:
    spin = p["rotor_inertia_kgm2"][0] * (state[RIGHT] + state[LEFT] - state[FRONT] - state[BACK])
    body = INERTIA * state[RATES] + np.array([0.0, 0.0, spin])
    return np.asarray(rotate(state[ATTITUDE], body))


def test_free_fall_without_air_is_a_parabola() -> None:
    start = at_height(100.0)
    start[VELOCITY] = (1.0, -2.0, -3.0)
    end = run(start, without_air(), 1.5)
    assert end[POSITION] == pytest.approx((1.5, -3.0, -100.0 - 4.5 + 0.5 * GRAVITY * 1.5**2), abs=1e-9)
    assert end[VELOCITY] == pytest.approx((1.0, -2.0, -3.0 + GRAVITY * 1.5), abs=1e-9)


def test_hover_trim_is_an_equilibrium() -> None:
    start = at_height(10.0, HOVER_SPEED)
    assert run(start, parameters(AIRFRAME), 10.0) == pytest.approx(start, abs=1e-9)


def test_released_parcel_changes_the_trim_by_its_weight() -> None:
    light = parameters(AIRFRAME)
    light["mass_kg"] = BODY.mass_kg
    rate = np.zeros(STATES)
    start = at_height(10.0, HOVER_SPEED)
    derivative(start, start[ROTORS], light, rate)
    assert rate[5] == pytest.approx(-GRAVITY * BODY.parcel_mass_kg / BODY.mass_kg)


@pytest.mark.parametrize("axis", range(3))
def test_drag_slows_each_body_axis_with_its_own_time_constant(axis: int) -> None:
    """Velocity along one body axis, in an attitude that is not level, decays as exp(-k t / m) with no force beside."""
    p = parameters(AIRFRAME)
    start = at_height(1000.0)
    start[ATTITUDE] = tilted(0.7, (1.0, 2.0, -0.5))
    direction = rotate(start[ATTITUDE], np.eye(3)[axis])
    start[VELOCITY] = 8.0 * direction
    falling = at_height(1000.0)
    falling[ATTITUDE] = start[ATTITUDE]
    slowed = run(start, p, 2.0)[VELOCITY] - run(falling, p, 2.0)[VELOCITY]  # linear: the fall is taken away
    k = AIRFRAME.body.drag_kg_s[axis]
    assert slowed == pytest.approx(8.0 * direction * math.exp(-2.0 * k / AIRFRAME.takeoff_mass_kg), abs=1e-9)


def test_terminal_velocity() -> None:
    end = run(at_height(5000.0), parameters(AIRFRAME), 60.0)
    assert end[5] == pytest.approx(AIRFRAME.takeoff_mass_kg * GRAVITY / AIRFRAME.body.drag_kg_s[2], rel=1e-6)


@pytest.mark.parametrize(
    ("start", "end", "tau"),
    [(200.0, 400.0, AIRFRAME.rotors.time_constant_up_s), (400.0, 200.0, AIRFRAME.rotors.time_constant_down_s)],
)
def test_rotor_lag_is_of_first_order(start: float, end: float, tau: float) -> None:
    after = run(at_height(100.0, start), parameters(AIRFRAME), tau, commands=np.full(4, end))
    assert after[ROTORS] == pytest.approx(start + (end - start) * (1.0 - math.exp(-1.0)), rel=1e-6)


def test_rotor_speed_saturates_at_full_thrust() -> None:
    end = run(at_height(100.0), parameters(AIRFRAME), 1.0, commands=np.array([9e9, 9e9, -9e9, 0.0]))
    full = math.sqrt(BODY.rotor_max_thrust_n / AIRFRAME.rotors.thrust_constant_ns2)
    assert end[ROTORS] == pytest.approx((full, full, 0.0, 0.0), abs=1e-9)


def test_integrator_is_of_fourth_order() -> None:
    start = at_height(100.0, 350.0)
    start[RATES] = (3.0, -2.0, 4.0)
    start[VELOCITY] = (5.0, 1.0, -2.0)
    start[RIGHT] += 10.0
    p = parameters(AIRFRAME)
    exact = run(start, p, 0.32, dt=2.5e-4)
    coarse, fine = (float(np.linalg.norm(run(start, p, 0.32, dt=dt) - exact)) for dt in (0.016, 0.008))
    assert 13.0 < coarse / fine < 20.0


def test_torque_free_rotation_conserves_energy_and_angular_momentum() -> None:
    p = without_air()
    start = at_height(1000.0)
    start[RATES] = (5.0, 0.3, -4.0)
    end = run(start, p, 5.0)
    assert end[RATES] != pytest.approx(start[RATES], abs=0.5)  # it does tumble
    assert INERTIA @ end[RATES] ** 2 == pytest.approx(INERTIA @ start[RATES] ** 2, rel=1e-9)
    assert angular_momentum_ned(end, p) == pytest.approx(angular_momentum_ned(start, p), rel=1e-8)


def test_gyroscopic_torque_does_no_work() -> None:
    """Two rotors of one direction turn, made to give no thrust and no drag: only their angular momentum acts."""
    p = without_air()
    p["thrust_constant_ns2"] = 1e-30
    p["rotor_max_speed"] = 1e9
    start = at_height(1000.0)
    start[RATES] = (2.0, 1.0, 0.5)
    still = run(start, p, 2.0)
    start[[RIGHT, LEFT]] = 450.0
    end = run(start, p, 2.0)
    assert end[RATES] != pytest.approx(still[RATES], abs=0.1)
    assert INERTIA @ end[RATES] ** 2 == pytest.approx(INERTIA @ start[RATES] ** 2, rel=1e-9)
    assert angular_momentum_ned(end, p) == pytest.approx(angular_momentum_ned(start, p), rel=1e-8)


@pytest.mark.parametrize(
    ("faster", "rates", "moves"),
    [
        ([LEFT], (1, 0, -1), (0, 1)),  # right side down, to the right
        ([RIGHT], (-1, 0, -1), (0, -1)),
        ([FRONT], (0, 1, 1), (-1, 0)),  # nose up, backwards
        ([BACK], (0, -1, 1), (1, 0)),
        ([FRONT, BACK], (0, 0, 1), (0, 0)),  # nose to the right
        ([LEFT, RIGHT], (0, 0, -1), (0, 0)),
    ],
)
def test_directions_in_which_a_faster_rotor_turns_and_moves_the_vehicle(
    faster: list[int], rates: tuple[int, int, int], moves: tuple[int, int]
) -> None:
    start = at_height(100.0, HOVER_SPEED)
    start[faster] *= 1.02
    end = run(start, parameters(AIRFRAME), 0.15)
    assert tuple(np.sign(np.where(np.abs(end[RATES]) < 1e-3, 0.0, end[RATES]))) == rates
    assert tuple(np.sign(np.where(np.abs(end[3:5]) < 1e-4, 0.0, end[3:5]))) == moves


def test_full_torque_is_that_of_full_actuator_controls() -> None:
    """VehicleParameters.full_torque_nm: one rotor full against its opposite at rest, one pair against the other."""
    p, rate = parameters(AIRFRAME), np.zeros(STATES)
    full = float(p["rotor_max_speed"][0])
    for axis, rotors in enumerate(([LEFT], [FRONT], [FRONT, BACK])):
        state = at_height(10.0)
        state[rotors] = full
        derivative(state, state[ROTORS], p, rate)
        assert rate[10 + axis] * BODY.inertia_kgm2[axis] == pytest.approx(BODY.full_torque_nm[axis])


def test_rest_on_the_ground_is_an_equilibrium() -> None:
    start = at_height(AIRFRAME.rest_height_m)
    assert run(start, parameters(AIRFRAME), 20.0) == pytest.approx(start, abs=1e-9)


def test_a_drop_on_one_foot_ends_at_rest() -> None:
    start = at_height(0.3)
    start[ATTITUDE] = tilted(0.2, (1.0, 0.4, 0.0))
    end = run(start, parameters(AIRFRAME), 4.0)
    assert end[2] == pytest.approx(-AIRFRAME.rest_height_m, abs=1e-4)
    assert np.abs(end[3:6]).max() < 1e-4
    assert end[7:9] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_friction_stops_a_slide_within_the_distance_of_coulombs_law() -> None:
    start = at_height(AIRFRAME.rest_height_m)
    start[3] = 1.0
    end = run(start, parameters(AIRFRAME), 3.0)
    assert end[0] == pytest.approx(1.0 / (2.0 * AIRFRAME.ground.friction * GRAVITY), rel=0.15)
    assert abs(end[3]) < 1e-3


@pytest.mark.parametrize("lift", [0.0, 0.5])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, -0.8)])
def test_on_the_ground_it_stands_still_until_a_force_exceeds_the_dry_friction(
    lift: float, direction: tuple[float, float]
) -> None:
    """`lift`: the share of the weight that the rotors, say, take off the feet."""
    p, mass = without_air(), AIRFRAME.takeoff_mass_kg
    start, grip = at_height(AIRFRAME.rest_height_m), AIRFRAME.ground.friction * (1.0 - lift) * mass * GRAVITY
    along = np.array([*direction, 0.0])
    for share, speed in ((0.5, 0.0), (0.95, 0.0), (1.2, 0.2 * grip / mass * 3.0)):
        p["force_ned"] = share * grip * along - (0.0, 0.0, lift * mass * GRAVITY)
        end = run(start, p, 3.0)
        assert end[VELOCITY] == pytest.approx(speed * along, abs=1e-4 if share < 1.0 else 0.05)
        assert share > 1.0 or math.hypot(*end[:2]) < 0.02, "it leans, and stays"


def test_ground_never_pulls() -> None:
    """Pulled out of the ground fast, the dampers must not hold it back."""
    start = at_height(AIRFRAME.rest_height_m)
    start[5] = -1.0
    rate = np.zeros(STATES)
    derivative(start, start[ROTORS], without_air(), rate)
    assert rate[5] == pytest.approx(GRAVITY)
