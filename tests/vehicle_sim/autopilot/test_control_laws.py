"""The vehicle's own control laws: signs, symmetry, convergence, and who gives way when rotors saturate."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.frames import rotate, to_rotation_vector
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, tilted
from vehicle_sim.airframe import parameters
from vehicle_sim.autopilot.control_laws import COMMAND, Command, Level, attitude_law, mix, position_law
from vehicle_sim.physics.integrator import work_array
from vehicle_sim.physics.motion import FEEDBACK
from vehicle_sim.physics.rigid_body import RATES, ROTORS, STATES
from vehicle_sim.tick import EXACT, advance

BODY = AIRFRAME.body
MOST = BODY.rotor_max_thrust_n
WEIGHT = AIRFRAME.takeoff_mass_kg * GRAVITY
PARAMETERS = parameters(AIRFRAME)


def flying(attitude: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0), height: float = 500.0) -> Array:
    state = np.zeros(STATES)
    state[2] = -height
    state[6:10] = attitude
    state[ROTORS] = math.sqrt(WEIGHT / 4.0 / AIRFRAME.rotors.thrust_constant_ns2)
    return state


def command(level: Level, **fields: object) -> Command:
    record = np.zeros(1, COMMAND)
    record["level"] = level
    record["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
    record["thrust_n"] = WEIGHT
    record["speed_limits"] = (5.0, 1.5, 1.5)
    for name, value in fields.items():
        record[name] = value
    return record


def fly(state: Array, order: Command, seconds: float) -> NDArray[np.float64]:
    """All states, one a tick."""
    feedback, room = np.zeros(1, FEEDBACK), work_array()
    states = []
    for _ in range(round(seconds / 0.004)):
        advance(state, order, PARAMETERS, feedback, room, EXACT)
        states.append(state.copy())
    return np.array(states)


def wrench(thrusts: Array) -> tuple[float, Array]:
    """What four rotor thrusts give together, by the cross product of arm and force."""
    arm = BODY.arm_length_m
    places = np.array([[arm, 0, 0], [0, arm, 0], [-arm, 0, 0], [0, -arm, 0]])
    torque = sum(np.cross(place, [0.0, 0.0, -thrust]) for place, thrust in zip(places, thrusts, strict=True))
    torque = torque + np.array([0.0, 0.0, BODY.torque_per_thrust_m]) * (thrusts @ np.array([1, -1, 1, -1]))
    return float(thrusts.sum()), torque


def mixed(thrust: float, torque: tuple[float, float, float] | Array) -> Array:
    out = np.zeros(4)
    mix(thrust, np.array(torque, dtype=np.float64), PARAMETERS, out)
    assert (out >= -1e-12).all()
    assert (out <= MOST + 1e-12).all()
    return out


def test_mixer_gives_what_was_asked_while_rotors_can() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        thrust, torque = rng.uniform(10.0, 22.0), rng.uniform(-1.0, 1.0, 3) * (0.4, 0.4, 0.05)
        given, turned = wrench(mixed(thrust, torque))
        assert given == pytest.approx(thrust)
        assert turned == pytest.approx(torque)


def test_yaw_gives_way_to_thrust_roll_and_pitch() -> None:
    rng = np.random.default_rng(2)
    for _ in range(200):
        thrust, sign = rng.uniform(8.0, 24.0), rng.choice((-1.0, 1.0))
        torque = np.append(rng.uniform(-0.4, 0.4, 2), 5.0 * sign)
        given, turned = wrench(mixed(thrust, torque))
        assert given == pytest.approx(thrust)
        assert turned[:2] == pytest.approx(torque[:2])
        assert 0.0 < turned[2] * sign < 5.0


def test_thrust_gives_way_to_roll_and_pitch_at_the_top() -> None:
    given, turned = wrench(mixed(4.0 * MOST, (0.8, -0.5, 0.0)))
    assert turned[:2] == pytest.approx((0.8, -0.5))
    assert given == pytest.approx(4.0 * (MOST - 0.4 / BODY.arm_length_m))


def test_roll_and_pitch_are_cut_together_at_the_bottom() -> None:
    given, turned = wrench(mixed(2.0, (0.8, -0.5, 0.0)))
    assert given == pytest.approx(2.0)
    assert turned[0] == pytest.approx(2.0 * BODY.arm_length_m * 0.5)
    assert turned[1] / turned[0] == pytest.approx(-0.5 / 0.8)


def test_no_thrust_no_torque() -> None:
    assert mixed(0.0, (1.0, -1.0, 1.0)) == pytest.approx(np.zeros(4))
    assert mixed(-5.0, (1.0, -1.0, 1.0)) == pytest.approx(np.zeros(4))


def test_any_demand_stays_within_the_rotors_limits() -> None:
    rng = np.random.default_rng(3)
    for _ in range(1000):
        mixed(rng.uniform(-10.0, 50.0), rng.normal(0.0, 2.0, 3))


@pytest.mark.parametrize(("axis", "east", "north"), [((1, 0, 0), 1, 0), ((0, 1, 0), 0, -1)])
def test_positive_roll_goes_right_and_positive_pitch_goes_back(
    axis: tuple[float, float, float], east: int, north: int
) -> None:
    end = fly(flying(), command(Level.ATTITUDE, attitude_ned_frd=tilted(0.1, axis)), 1.0)[-1]
    assert np.sign(np.where(np.abs(end[3:5]) < 0.02, 0.0, end[3:5])).tolist() == [north, east]
    assert end[6:10] == pytest.approx(tilted(0.1, axis), abs=0.01)


def test_either_sign_of_the_quaternion_is_the_same_command() -> None:
    goal = np.array(tilted(1.0, (0.3, -1.0, 2.0)))
    start = tilted(2.0, (1.0, 1.0, 0.2))
    one = fly(flying(start), command(Level.ATTITUDE, attitude_ned_frd=goal), 1.0)
    other = fly(flying(start), command(Level.ATTITUDE, attitude_ned_frd=-goal), 1.0)
    assert np.array_equal(one, other)
    mirrored = fly(flying(tuple(-x for x in start)), command(Level.ATTITUDE, attitude_ned_frd=goal), 1.0)
    assert np.array_equal(one[:, 10:], mirrored[:, 10:])


def test_attitude_converges_from_any_attitude_and_spin() -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        start, goal = rng.normal(size=(2, 4))
        goal /= np.linalg.norm(goal)
        state = flying(tuple(start / np.linalg.norm(start)))
        state[RATES] = rng.normal(0.0, 2.0, 3)
        end = fly(state, command(Level.ATTITUDE, attitude_ned_frd=goal, thrust_n=16.0), 5.0)[-1]
        assert abs(end[6:10] @ goal) > math.cos(0.5 * math.radians(1.0))


def test_attitude_error_takes_the_short_way() -> None:
    order = command(Level.ATTITUDE, attitude_ned_frd=tilted(math.radians(350.0), (0, 0, 1)))
    attitude_law(flying(), order, PARAMETERS)
    gain = AIRFRAME.inner_loop.attitude_gain_1_s[2]
    assert order["rates_frd"][0] == pytest.approx((0.0, 0.0, -gain * math.radians(10.0)))


def test_rates_are_reached_and_limited() -> None:
    wanted = (0.5, -0.4, 0.3)
    end = fly(flying(), command(Level.RATES, rates_frd=wanted), 1.0)[-1]
    assert end[RATES] == pytest.approx(wanted, abs=0.01)
    fast = fly(flying(), command(Level.RATES, rates_frd=(99.0, 0.0, 0.0), thrust_n=20.0), 1.0)[-1]
    assert fast[10] == pytest.approx(math.radians(AIRFRAME.inner_loop.rate_limit_deg_s[0]), rel=0.03)


def test_rate_step_is_first_order_with_the_gain() -> None:
    """Without the rotors' lag the closed loop would be 1 / (1 + s / gain); with it, it is a little late."""
    history = fly(flying(), command(Level.RATES, rates_frd=(0.2, 0.0, 0.0)), 0.5)[:, 10]
    reached = 0.004 * (1 + int(np.argmax(history > 0.2 * (1.0 - math.exp(-1.0)))))
    ideal = 1.0 / AIRFRAME.inner_loop.rate_gain_1_s[0]
    assert ideal < reached < ideal + 2.0 * AIRFRAME.rotors.time_constant_down_s


def test_torque_turns_as_fast_as_the_inertia_lets_it() -> None:
    torque = np.array([0.02, -0.01, 0.004])
    states = fly(flying(), command(Level.TORQUE, torque_frd=torque), 0.4)
    acceleration = (states[-1, RATES] - states[-26, RATES]) / 0.1
    assert acceleration == pytest.approx(torque / np.array(BODY.inertia_kgm2), rel=0.05)


def test_stopped_stops_the_rotors() -> None:
    end = fly(flying(), command(Level.STOPPED), 1.0)[-1]
    assert end[ROTORS] == pytest.approx(np.zeros(4), abs=1e-9)


def test_position_is_reached_with_the_yaw_and_within_the_limits() -> None:
    goal, yaw = np.array([20.0, -12.0, -505.0]), 2.0
    order = command(Level.POSITION, position_ned=goal, yaw=yaw)
    states = fly(flying(), order, 20.0)
    assert states[-1, 0:3] == pytest.approx(goal, abs=1e-3)
    assert to_rotation_vector(states[-1, 6:10]) == pytest.approx((0.0, 0.0, yaw), abs=1e-3)
    assert np.hypot(states[:, 3], states[:, 4]).max() < 5.1
    assert np.abs(states[:, 5]).max() < 1.6


def test_position_law_thrusts_along_the_wanted_acceleration() -> None:
    rng = np.random.default_rng(5)
    for _ in range(100):
        state = flying()
        state[3:6] = rng.normal(0.0, 0.3, 3)
        order = command(Level.POSITION, position_ned=state[0:3], yaw=rng.uniform(-3.0, 3.0))
        position_law(state, order, PARAMETERS)
        force = rotate(order["attitude_ned_frd"][0], np.array([0.0, 0.0, -order["thrust_n"][0]]))
        wanted = -AIRFRAME.auto.velocity_gain_1_s * state[3:6] - np.array([0.0, 0.0, GRAVITY])
        assert force / AIRFRAME.takeoff_mass_kg == pytest.approx(wanted, abs=1e-9)
        assert np.linalg.norm(order["attitude_ned_frd"][0]) == pytest.approx(1.0)


def pushed(push_m_s2: float, seconds: float, after: float, thrust_to_weight: float) -> tuple[Array, Command]:
    """Heights (m, one a tick) above the one to hold of a vehicle that a force per kg pushes down for some seconds, and
    for some after them; and the command then."""
    heavy = parameters(AIRFRAME)
    heavy["mass_kg"] = mass = 4.0 * MOST / (thrust_to_weight * GRAVITY)
    state, order = flying(), command(Level.POSITION, position_ned=(0.0, 0.0, -500.0), integrates=True)
    state[ROTORS] = math.sqrt(mass * GRAVITY / 4.0 / AIRFRAME.rotors.thrust_constant_ns2)
    feedback, room = np.zeros(1, FEEDBACK), work_array()
    heights = []
    for push, ticks in ((push_m_s2, round(seconds / 0.004)), (0.0, round(after / 0.004))):
        heavy["force_ned"] = (0.0, 0.0, push * mass)
        for _ in range(ticks):
            advance(state, order, heavy, feedback, room, EXACT)
            heights.append(-500.0 - state[2])
    return np.array(heights), order


@pytest.mark.parametrize("push", [1.5, -2.0])
def test_the_vertical_integral_is_what_pushes_the_vehicle_up_or_down(push: float) -> None:
    heights, order = pushed(push, 15.0, 0.0, 2.1)
    assert np.abs(heights).max() > 0.1 and abs(heights[-1]) < 0.01
    assert order["integral"][0][2] == pytest.approx(-push, rel=0.01)


@pytest.mark.parametrize(
    ("push", "thrust_to_weight"),
    [(2.2, 1.2), (-5.0, 2.1)],
    ids=["more than the rotors hold", "more than the limit of its acceleration"],
)
def test_the_vertical_integral_waits_where_no_more_can_be_done(push: float, thrust_to_weight: float) -> None:
    """Once the force is gone the vehicle comes back, and not far beyond."""
    heights, _ = pushed(push, 1.5, 12.0, thrust_to_weight)
    off = -np.sign(push) * heights
    assert off.min() > -0.15 and off.max() > 0.5 and abs(heights[-1]) < 0.05
