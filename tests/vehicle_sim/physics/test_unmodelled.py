"""What a vehicle file may state beyond the companion's model, against closed solutions, and a body's precession."""

import math

import numpy as np
import pytest

from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, ForeignPilot, airframe_with
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.physics.battery import battery_state
from vehicle_sim.physics.integrator import step, work_array
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import RATES, ROTORS, STATES, derivative

BODY, MASS = AIRFRAME.body, AIRFRAME.takeoff_mass_kg
HOVER = math.sqrt(MASS * GRAVITY / (4.0 * AIRFRAME.rotors.thrust_constant_ns2))
FRONT, RIGHT, BACK, LEFT = range(13, 17)


def at(height: float, speed: float = 0.0) -> Array:
    state = np.zeros(STATES)
    state[2], state[6], state[ROTORS] = -height, 1.0, speed
    return state


def rate_of(state: Array, airframe: Airframe) -> Array:
    out = np.zeros(STATES)
    derivative(state, state[ROTORS], parameters(airframe), out)
    return out


def flown(state: Array, airframe: Airframe, seconds: float) -> Array:
    end, room, record = state.copy(), work_array(), parameters(airframe)
    for _ in range(round(seconds * 1e3)):
        step(end, state[ROTORS], record, 1e-3, room)
    return end


def test_a_fall_ends_where_linear_and_quadratic_drag_carry_the_weight() -> None:
    airframe = airframe_with("unmodelled.quadratic_drag_kg_m=[0.02, 0.02, 0.05]")
    end = flown(at(9000.0), airframe, 40.0)
    c, k = BODY.drag_kg_s[2], 0.05
    speed = (-c + math.sqrt(c * c + 4.0 * k * MASS * GRAVITY)) / (2.0 * k)
    assert end[5] == pytest.approx(speed, rel=1e-6)


def test_quadratic_drag_alone_slows_down_as_one_over_time() -> None:
    airframe = airframe_with("unmodelled.quadratic_drag_kg_m=[0.1, 0.0, 0.0]", "body.drag_kg_s=[0.0, 0.0, 0.0]")
    start = at(1000.0, HOVER)
    start[3] = 10.0
    end = flown(start, airframe, 3.0)
    assert end[3] == pytest.approx(10.0 / (1.0 + 0.1 * 10.0 * 3.0 / MASS), rel=1e-6)
    start[3] = -10.0
    assert flown(start, airframe, 3.0)[3] == pytest.approx(-end[3], rel=1e-9)


@pytest.mark.parametrize(("ahead", "right"), [(0.02, 0.0), (0.0, 0.02), (-0.01, 0.03)])
def test_a_centre_of_mass_aside_is_balanced_by_the_rotors_moments_about_it(ahead: float, right: float) -> None:
    airframe = airframe_with(f"unmodelled.centre_of_mass_m=[{ahead}, {right}]")
    arm, quarter = BODY.arm_length_m, 0.25 * MASS * GRAVITY
    pitch, roll = 2.0 * quarter * ahead / arm, -2.0 * quarter * right / arm
    thrusts = np.array((quarter + pitch, quarter - roll, quarter - pitch, quarter + roll))
    places = np.array(((arm, 0.0), (0.0, arm), (-arm, 0.0), (0.0, -arm)))
    assert thrusts @ (places - (ahead, right)) == pytest.approx((0.0, 0.0), abs=1e-12), "no moment"
    state = at(100.0)
    state[ROTORS] = np.sqrt(thrusts / AIRFRAME.rotors.thrust_constant_ns2)
    rates = rate_of(state, airframe)
    assert rates[10:12] == pytest.approx((0.0, 0.0), abs=1e-9) and rates[5] == pytest.approx(0.0, abs=1e-9)


def test_a_weak_rotor_gives_its_share_of_thrust_and_torque() -> None:
    airframe = airframe_with("rotors.thrust_share=[1.0, 1.0, 1.0, 0.8]")
    rates, lost = rate_of(at(100.0, HOVER), airframe), 0.2 * 0.25 * MASS * GRAVITY
    assert rates[5] == pytest.approx(lost / MASS, rel=1e-6)
    assert rates[10] == pytest.approx(-lost * BODY.arm_length_m / BODY.inertia_kgm2[0], rel=1e-6)
    assert rates[12] == pytest.approx(lost * BODY.torque_per_thrust_m / BODY.inertia_kgm2[2], rel=1e-6)


def test_a_slow_rotor_takes_its_share_of_time() -> None:
    airframe = airframe_with("rotors.lag_share=[1.0, 2.0, 1.0, 1.0]")
    state, out = at(100.0, 300.0), np.zeros(STATES)
    derivative(state, np.full(4, 400.0), parameters(airframe), out)
    assert out[RIGHT] == pytest.approx(0.5 * out[LEFT]) and out[FRONT] == out[BACK] == out[LEFT] > 0.0


@pytest.mark.parametrize("height", [0.2, 0.5, 3.0])
def test_the_ground_carries_as_cheeseman_and_bennett_say(height: float) -> None:
    airframe = airframe_with("unmodelled.propeller_radius_m=0.127", "ground.foot_height_m=0.05")
    up = GRAVITY - rate_of(at(height, HOVER), airframe)[5]
    assert up == pytest.approx(GRAVITY / (1.0 - (0.127 / (4.0 * height)) ** 2), rel=1e-6)


def test_over_the_ground_rotors_turn_the_vehicle_as_much_more_as_they_lift_it() -> None:
    """The ground effect makes more thrust of each rotor, at the same drag of its blades."""
    airframe = airframe_with("unmodelled.propeller_radius_m=0.127", "ground.foot_height_m=0.05")
    low, high = at(0.2, HOVER), at(3000.0, HOVER)
    for state in (low, high):
        state[ROTORS] += (20.0, -10.0, -30.0, 5.0)
    near, far = rate_of(low, airframe), rate_of(high, airframe)
    more = (GRAVITY - near[5]) / (GRAVITY - far[5])
    assert more > 1.02
    assert near[10:12] == pytest.approx(more * far[10:12])
    assert near[12] == pytest.approx(far[12])


def test_hover_s_current_behind_a_resistance() -> None:
    """Kirchhoff's law and the power of hover."""
    airframe = airframe_with("battery.internal_resistance_ohm=0.02")
    state, feedback = at(10.0, HOVER), np.zeros(1, FEEDBACK)
    found = battery_state(airframe, Motion.of(0, state, feedback))
    battery = airframe.battery
    shaft_w = BODY.torque_per_thrust_m * MASS * GRAVITY * HOVER
    assert found.volts * found.amperes == pytest.approx(shaft_w / battery.efficiency + battery.idle_w, rel=1e-6)
    assert found.volts == pytest.approx(battery.full_v - 0.02 * found.amperes, rel=1e-6)


def test_full_thrust_falls_with_the_square_of_the_voltage() -> None:
    full = float(parameters(AIRFRAME)["rotor_max_speed"][0])
    pilot = ForeignPilot(airframe=airframe_with("battery.drives_speed=true", "battery.charge=0.4"))
    pilot.fly(1.2)
    pilot.vehicle.flight.arm()
    pilot.vehicle.flight.take_off(2.5)
    pilot.fly(5.0)
    pilot.go_offboard()
    pilot.fly(0.4, lambda: pilot.attitude(thrust=1.0))
    share = pilot.vehicle.state[FRONT] / full
    volts = battery_state(pilot.vehicle.airframe, pilot.vehicle.motion).volts
    assert share == pytest.approx(volts / AIRFRAME.battery.full_v, abs=1e-3) and share < 0.95


def test_a_symmetric_body_precesses_at_its_own_rate() -> None:
    """Torque-free: the transverse rates turn with (Iz - Ix) / Ix wz about the body's axis."""
    airframe = airframe_with("body.inertia_kgm2=[0.012, 0.012, 0.021]", "body.drag_kg_s=[0.0, 0.0, 0.0]")
    start = at(1000.0)
    start[RATES] = (0.6, 0.0, 5.0)
    angle = (0.021 - 0.012) / 0.012 * 5.0 * 2.0
    end = flown(start, airframe, 2.0)
    assert end[RATES] == pytest.approx((0.6 * math.cos(angle), 0.6 * math.sin(angle), 5.0), abs=1e-6)


def test_the_momentum_is_what_the_weight_gives_and_the_shafts_energy_is_drag_times_speed() -> None:
    """A tick of hover: no momentum gained; energy taken is torque times speed times time."""
    pilot = ForeignPilot()
    vehicle = pilot.vehicle
    pilot.take_off()
    pilot.fly(10.0)
    before = vehicle.motion
    pilot.fly(2.0)
    after = vehicle.motion
    assert after.velocity_ned == pytest.approx(before.velocity_ned, abs=0.02)
    power = BODY.torque_per_thrust_m * AIRFRAME.rotors.thrust_constant_ns2 * sum(s**3 for s in after.rotor_speeds)
    assert (after.shaft_energy_j - before.shaft_energy_j) / 2.0 == pytest.approx(power, rel=2e-3)
