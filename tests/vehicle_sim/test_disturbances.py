"""Wind and force of a world, and what they do to the vehicle, against closed forms."""

import math

import msgspec
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, HOLD, LAND, RETURN, UNSET, ForeignPilot, airframe_with, world_with
from vehicle_sim.airframe import parameters
from vehicle_sim.physics.integrator import step, work_array
from vehicle_sim.physics.rigid_body import POSITION, RATES, ROTORS, STATES, VELOCITY
from vehicle_sim.world import World, WorldTable


def test_a_hovering_body_reaches_the_winds_velocity_exponentially() -> None:
    """Level, at the thrust that hovers: velocity goes to the wind's as 1 - exp(-k t / m) on each axis."""
    p = parameters(AIRFRAME)
    wind = np.array([6.0, -4.0, 1.0])
    p["wind_ned"] = wind
    state, room = np.zeros(STATES), work_array()
    state[2], state[6] = -5000.0, 1.0
    state[ROTORS] = math.sqrt(AIRFRAME.takeoff_mass_kg * GRAVITY / 4.0 / AIRFRAME.rotors.thrust_constant_ns2)
    told = state[ROTORS].copy()
    k = np.array(AIRFRAME.body.drag_kg_s) / AIRFRAME.takeoff_mass_kg
    for seconds in (1.0, 99.0):
        before = state[VELOCITY].copy()
        for _ in range(round(seconds * 1000.0)):
            step(state, told, p, 1e-3, room)
        assert state[VELOCITY] == pytest.approx(wind + (before - wind) * np.exp(-k * seconds), abs=1e-9)
    assert state[VELOCITY] == pytest.approx(wind, abs=1e-9)


def test_a_constant_force_accelerates_a_falling_body_exactly() -> None:
    p = parameters(AIRFRAME)
    p["drag_kg_s"] = 0.0
    force = np.array([5.0, -2.0, 1.0])
    p["force_ned"] = force
    state, room = np.zeros(STATES), work_array()
    state[2], state[6], state[RATES] = -100.0, 1.0, (2.0, 1.0, -0.5)  # whatever way it turns
    for _ in range(1500):
        step(state, np.zeros(4), p, 1e-3, room)
    acceleration = force / AIRFRAME.takeoff_mass_kg + (0.0, 0.0, GRAVITY)
    assert state[VELOCITY] == pytest.approx(acceleration * 1.5, abs=1e-9)
    assert state[POSITION] - (0.0, 0.0, -100.0) == pytest.approx(0.5 * acceleration * 1.5**2, abs=1e-9)


def test_force_of_a_world_pushes_from_take_off_to_landing() -> None:
    """In hold the vehicle leans against it and comes back to its place; on the ground it stands still."""
    push = 3.0
    pilot = ForeignPilot(world_with(f"disturbance.force_ned=[0.0, {push}, 0.0]"))
    pilot.fly(1.0)
    assert pilot.vehicle.motion.speed < 1e-9
    pilot.take_off()
    pilot.fly(20.0)
    mass = AIRFRAME.takeoff_mass_kg
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((0.0, 0.0), abs=0.01)
    assert pilot.vehicle.motion.tilt == pytest.approx(math.atan(push / (mass * GRAVITY)), abs=1e-3)
    pilot.set_mode(LAND)
    assert pilot.fly(20.0, until=lambda: pilot.vehicle.flight.landed)
    pilot.fly(1.0)
    assert pilot.vehicle.motion.speed < 1e-3


def test_a_parked_vehicle_stays_where_it_is_in_wind() -> None:
    pilot = ForeignPilot(world_with("wind.mean_ned=[8.0, -6.0, 0.0]", "wind.turbulence_m_s=3.0"))
    pilot.fly(60.0)
    assert pilot.vehicle.flight.landed
    assert math.hypot(*pilot.vehicle.state[:2]) < 0.01


def test_mean_wind_of_a_world_leans_the_vehicle_against_its_drag() -> None:
    pilot = ForeignPilot(world_with("wind.mean_ned=[-5.0, 0.0, 0.0]"))
    pilot.take_off()
    pilot.fly(8.0)
    drag, mass = 5.0 * AIRFRAME.body.drag_kg_s[0], AIRFRAME.takeoff_mass_kg
    assert pilot.vehicle.motion.tilt == pytest.approx(math.atan(drag / (mass * GRAVITY)), rel=0.03)
    _, _, pitch, _ = pilot.vehicle.motion.attitude_ned_frd
    assert pitch < 0.0  # nose down, into the wind from the north


def test_the_truth_tells_the_speed_through_the_air() -> None:
    pilot = ForeignPilot(world_with("wind.mean_ned=[-3.0, 4.0, 0.0]"), all_streams=True)
    pilot.fly(0.5)
    truth = pilot.last("HIL_STATE_QUATERNION")
    assert (truth.vx, truth.vy, truth.vz) == (0, 0, 0)
    assert truth.true_airspeed == pytest.approx(500, abs=2)
    for velocity, speed in (((-3.0, 4.0, 0.0), 0.0), ((3.0, -4.0, 0.0), 1000.0)):
        pilot.vehicle.state[POSITION], pilot.vehicle.state[VELOCITY] = (0.0, 0.0, -50.0), velocity
        pilot.fly(0.05)
        assert pilot.last("HIL_STATE_QUATERNION").true_airspeed == pytest.approx(speed, abs=60.0), "it falls meanwhile"


def test_turbulence_repeats_and_does_not_change_the_lidars_noise() -> None:
    scan = mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
    calm, gusty, again = (
        ForeignPilot(world_with(f"wind.turbulence_m_s={w20}"), seed=4, all_streams=True) for w20 in (0.0, 6.0, 6.0)
    )
    for pilot in (calm, gusty, again):
        pilot.fly(1.2)
        assert pilot.interval(scan, 0) == mavlink.MAV_RESULT_ACCEPTED
        pilot.take_off()
        pilot.fly(2.0)
    assert gusty.datagrams == again.datagrams
    at = [pilot.all("OBSTACLE_DISTANCE")[0].distances for pilot in (calm, gusty)]
    assert at[0] == at[1]
    assert gusty.vehicle.motion.position_ned != calm.vehicle.motion.position_ned


def test_worlds_without_the_tables_are_calm() -> None:
    table = msgspec.convert(
        {"name": "calm", "origin": {"latitude_deg": 0.0, "longitude_deg": 0.0, "altitude_m": 0.0}}, WorldTable
    )
    world = World.build(table)
    assert world.wind.mean_ned == (0.0, 0.0, 0.0) == world.force_ned
    assert world.wind.turbulence_m_s == 0.0


def test_a_steady_wind_keeps_it_off_neither_in_take_off_nor_in_return() -> None:
    pilot = ForeignPilot(world=world_with("wind.mean_ned=[12.0, 0.0, 0.0]"))
    pilot.fly(1.2)
    assert pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7) == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.arm() == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.fly(15.0, until=lambda: pilot.mode == HOLD)
    assert pilot.vehicle.motion.position_ned[0] > 0.2  # it was blown off, and had to learn the wind
    assert pilot.set_mode(RETURN) == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.fly(20.0, until=lambda: pilot.mode == LAND)
    assert pilot.fly(15.0, until=lambda: not pilot.armed) and pilot.vehicle.flight.crash is None
    assert math.hypot(*pilot.vehicle.motion.position_ned[:2]) < 0.3


@pytest.mark.parametrize("down_m_s", [-4.0, 3.0])
def test_a_steady_wind_from_above_or_below_keeps_it_off_neither_in_hold_nor_in_landing(down_m_s: float) -> None:
    pilot = ForeignPilot(world=world_with(f"wind.mean_ned=[0.0, 0.0, {down_m_s}]"))
    pilot.take_off()
    pilot.fly(15.0)
    assert pilot.height == pytest.approx(AIRFRAME.auto.takeoff_height_m, abs=0.1)
    held_off = down_m_s * AIRFRAME.body.drag_kg_s[2] / AIRFRAME.takeoff_mass_kg
    assert pilot.vehicle.flight.guidance.command["integral"][0][2] == pytest.approx(-held_off, rel=0.1)
    pilot.set_mode(LAND)
    assert pilot.fly(20.0, until=lambda: not pilot.armed)
    assert pilot.vehicle.flight.crash is None and pilot.vehicle.motion.impact_m_s < 1.0


@pytest.mark.parametrize(
    ("airframe", "down_m_s"),
    [
        ((), 3.0),
        (("battery.drives_speed=true", "battery.charge=0.5"), 0.0),
        (("rotors.thrust_share=[0.85, 0.85, 0.85, 0.85]",), 0.0),
    ],
)
def test_a_return_comes_home_in_a_downdraught_and_with_less_thrust_than_is_asked_for(
    airframe: tuple[str, ...], down_m_s: float
) -> None:
    world = world_with(f"wind.mean_ned=[0.0, 0.0, {down_m_s}]")
    pilot = ForeignPilot(world, airframe=airframe_with(*airframe))
    pilot.take_off()
    command = mavlink.MAV_CMD_DO_REPOSITION
    north = math.degrees(world.origin[0]) + 5.0 / 111e3
    x, y = round(north * 1e7), round(math.degrees(world.origin[1]) * 1e7)
    pilot.send(mavlink.MAVLink_command_int_message(1, 1, 6, command, 0, 0, -1.0, 1.0, 0.0, UNSET, x, y, pilot.height))
    assert pilot.fly(10.0, until=lambda: pilot.vehicle.motion.position_ned[0] > 4.0)
    assert pilot.set_mode(RETURN) == mavlink.MAV_RESULT_ACCEPTED
    assert pilot.fly(40.0, until=lambda: not pilot.armed) and pilot.vehicle.flight.crash is None
    assert math.hypot(*pilot.vehicle.motion.position_ned[:2]) < 0.5


def test_what_was_learned_of_the_wind_in_hold_is_kept_for_the_landing_and_forgotten_on_the_ground() -> None:
    pilot = ForeignPilot(world=world_with("wind.mean_ned=[0.0, 8.0, 0.0]"))
    pilot.take_off()
    pilot.fly(15.0)
    learned = pilot.vehicle.flight.guidance.command["integral"][0].copy()
    assert learned[1] == pytest.approx(-8.0 * AIRFRAME.body.drag_kg_s[1] / AIRFRAME.takeoff_mass_kg, rel=0.1)
    pilot.set_mode(LAND)
    pilot.fly(1.0)
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((0.0, 0.0), abs=0.05)
    assert pilot.fly(20.0, until=lambda: not pilot.armed)
    assert math.hypot(*pilot.vehicle.motion.position_ned[:2]) < 0.15
    pilot.set_mode(HOLD)
    assert pilot.vehicle.flight.guidance.command["integral"].tolist() == [[0.0, 0.0, 0.0]]


def test_what_was_learned_of_the_wind_is_forgotten_when_somebody_else_has_flown() -> None:
    """It may be another wind by then."""
    pilot = ForeignPilot(world=world_with("wind.mean_ned=[0.0, 8.0, 0.0]"))
    pilot.take_off()
    pilot.fly(5.0)
    integral = pilot.vehicle.flight.guidance.command["integral"][0]
    assert integral[1] < -0.5
    pilot.go_offboard()
    pilot.set_mode(HOLD)
    assert np.abs(integral).max() < 0.01
