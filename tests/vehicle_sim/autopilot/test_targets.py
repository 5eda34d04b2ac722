"""OFFBOARD by position, velocity and acceleration; sticks; the orbit."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.frames import to_geodetic
from protocol.messages import HIGHEST_FLOAT
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, HOLD, OFFBOARD, RETURN, UNSET, ForeignPilot
from vehicle_sim.autopilot.circle import Circle
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.autopilot.tracking import Target, Tracker

ACCEPTED, REJECTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
LOCAL, BODY = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED
POSITION, VELOCITY, ACCELERATION, YAW, YAW_RATE = 0x007, 0x038, 0x1C0, 0x400, 0x800
ALL = POSITION | VELOCITY | ACCELERATION | YAW | YAW_RATE
NONE = (0.0, 0.0, 0.0)
Three = tuple[float, float, float]


def setpoint(
    pilot: ForeignPilot,
    uses: int,
    *,
    frame: int = LOCAL,
    position: Three = NONE,
    velocity: Three = NONE,
    acceleration: Three = NONE,
    yaw: tuple[float, float] = (0.0, 0.0),
) -> Callable[[], None]:
    """Sends a SET_POSITION_TARGET_LOCAL_NED that ignores all but what is used."""
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, frame, ALL & ~uses, *position, *velocity, *acceleration, *yaw
    )
    return lambda: pilot.send(message)


@pytest.fixture
def aloft() -> ForeignPilot:
    pilot = ForeignPilot()
    pilot.take_off()
    return pilot


def fly(pilot: ForeignPilot, seconds: float, each: Callable[[], None]) -> None:
    """In OFFBOARD, with ten setpoints a second."""
    each()
    assert pilot.set_mode(OFFBOARD) == ACCEPTED
    for _ in range(round(seconds / 0.1)):
        each()
        pilot.fly(0.1)
    assert pilot.mode == OFFBOARD


def test_a_position_is_reached_with_its_heading(aloft: ForeignPilot) -> None:
    fly(aloft, 9.0, setpoint(aloft, POSITION | YAW, position=(5.0, -4.0, -6.0), yaw=(1.2, 0.0)))
    assert aloft.vehicle.motion.position_ned == pytest.approx((5.0, -4.0, -6.0), abs=0.15)
    assert aloft.vehicle.motion.yaw == pytest.approx(1.2, abs=0.02)


def test_a_velocity_is_reached_whatever_the_drag(aloft: ForeignPilot) -> None:
    fly(aloft, 7.0, setpoint(aloft, VELOCITY | YAW_RATE, velocity=(4.0, -2.0, -0.5), yaw=(0.0, 0.4)))
    assert aloft.vehicle.motion.velocity_ned == pytest.approx((4.0, -2.0, -0.5), abs=0.12)
    assert aloft.vehicle.motion.rates_frd[2] == pytest.approx(0.4, abs=0.06)


def test_body_axes_turn_with_the_nose(aloft: ForeignPilot) -> None:
    fly(aloft, 3.0, setpoint(aloft, POSITION | YAW, position=(0.0, 0.0, -3.0), yaw=(math.pi / 2.0, 0.0)))
    fly(aloft, 5.0, setpoint(aloft, VELOCITY, frame=BODY, velocity=(3.0, 1.0, 0.0)))
    assert aloft.vehicle.motion.velocity_ned == pytest.approx((-1.0, 3.0, 0.0), abs=0.15)


def test_height_by_position_and_the_rest_by_velocity_or_acceleration(aloft: ForeignPilot) -> None:
    uses = VELOCITY & ~0x20 | POSITION & ~0x03
    fly(aloft, 5.0, setpoint(aloft, uses, velocity=(0.0, 2.0, 9.0), position=(9.0, 9.0, -4.0)))
    assert aloft.vehicle.motion.velocity_ned[1] == pytest.approx(2.0, abs=0.15)
    assert aloft.vehicle.motion.position_ned[2] == pytest.approx(-4.0, abs=0.15)
    before = aloft.vehicle.motion.velocity_ned
    uses = ACCELERATION & ~0x100 | POSITION & ~0x03
    fly(aloft, 0.5, setpoint(aloft, uses, acceleration=(2.0, 0.0, 0.0), position=(0.0, 0.0, -4.0)))
    gained = aloft.vehicle.motion.velocity_ned[0] - before[0]
    assert gained == pytest.approx(2.0 * 0.5, rel=0.35), "less the lag of attitude, and drag"


def test_a_place_on_earth(aloft: ForeignPilot) -> None:
    latitude, longitude, altitude = to_geodetic(np.array([4.0, 3.0, -5.0]), EMPTY.origin)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
    message = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, mavlink.MAV_FRAME_GLOBAL_INT, ALL & ~POSITION, x, y, altitude, *NONE, *NONE, 0.0, 0.0
    )
    fly(aloft, 8.0, lambda: aloft.send(message))
    assert aloft.vehicle.motion.position_ned == pytest.approx((4.0, 3.0, -5.0), abs=0.15)


@pytest.mark.parametrize("altitude", [math.nan, math.inf, -math.inf])
def test_a_place_without_an_altitude_brakes(aloft: ForeignPilot, altitude: float) -> None:
    """It leaves the height open."""
    latitude, longitude, _ = to_geodetic(np.array([40.0, 30.0, -5.0]), EMPTY.origin)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    message = mavlink.MAVLink_set_position_target_global_int_message(
        0, 1, 1, frame, ALL & ~POSITION, x, y, altitude, *NONE, *NONE, 0.0, 0.0
    )
    before = aloft.vehicle.motion.position_ned
    fly(aloft, 2.0, lambda: aloft.send(message))
    assert aloft.vehicle.motion.position_ned == pytest.approx(before, abs=0.1)


@pytest.mark.parametrize(
    ("uses", "frame", "said"),
    [
        (0, LOCAL, "invalid"),
        (YAW, LOCAL, "invalid"),
        (POSITION, BODY, "invalid"),
        (POSITION, mavlink.MAV_FRAME_LOCAL_ENU, "unsupported"),
    ],
)
def test_what_asks_for_nothing_is_no_setpoint(uses: int, frame: int, said: str) -> None:
    pilot = ForeignPilot()
    setpoint(pilot, uses, frame=frame)()
    pilot.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, LOCAL, ALL & ~ACCELERATION | 512, *NONE, *NONE, *NONE, 0.0, 0.0
        )
    )
    pilot.fly(0.004)
    whole = "".join(pilot.texts)  # a long text comes in pieces
    assert said in whole and "force not supported" in whole
    assert not pilot.vehicle.flight.setpoints.stream.has_begun


@pytest.mark.parametrize("uses", [VELOCITY, ACCELERATION])
def test_the_largest_numbers_askew_to_the_axes_are_no_setpoint(aloft: ForeignPilot, uses: int) -> None:
    """Turned by 45 degrees they are 1.4 times as large, and POSITION_TARGET_LOCAL_NED has no room for them."""
    assert aloft.interval(mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED, 4000) == ACCEPTED
    turn = setpoint(aloft, POSITION | YAW, position=(0.0, 0.0, -aloft.height), yaw=(math.pi / 4.0, 0.0))
    fly(aloft, 2.0, turn)
    place = aloft.vehicle.motion.position_ned
    largest = (HIGHEST_FLOAT, HIGHEST_FLOAT, 0.0)
    setpoint(aloft, uses, frame=BODY, velocity=largest, acceleration=largest)()
    aloft.fly(0.1)
    assert "SET_POSITION_TARGET_LOCAL_NED invalid" in "".join(aloft.texts)
    fly(aloft, 0.5, turn)
    assert aloft.vehicle.motion.position_ned == pytest.approx(place, abs=0.1)


def test_half_a_velocity_brakes(aloft: ForeignPilot) -> None:
    """As PX4 does with a setpoint that leaves an axis open."""
    fly(aloft, 2.0, setpoint(aloft, VELOCITY, velocity=(3.0, 0.0, 0.0)))
    fly(aloft, 4.0, setpoint(aloft, 0x08, velocity=(3.0, 0.0, 0.0)))
    assert aloft.vehicle.motion.speed < 0.1


def test_from_the_ground_and_back_to_it_by_velocity() -> None:
    pilot = ForeignPilot()
    pilot.fly(1.1)
    stay = setpoint(pilot, POSITION)
    stay()
    assert pilot.set_mode(OFFBOARD) == ACCEPTED
    assert pilot.arm() == ACCEPTED
    fly(pilot, 0.5, stay)
    fly(pilot, 0.5, setpoint(pilot, VELOCITY))
    assert max(pilot.vehicle.motion.rotor_speeds) < 1.0, "there is nothing to lift off for"
    fly(pilot, 4.0, setpoint(pilot, VELOCITY, velocity=(0.0, 0.0, -1.0)))
    assert pilot.height == pytest.approx(3.6, abs=0.5)
    fly(pilot, 7.0, setpoint(pilot, VELOCITY, velocity=(0.0, 0.0, 0.7)))
    assert pilot.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND
    assert pilot.vehicle.flight.crash is None


# --- sticks ---


def sticks(pilot: ForeignPilot, x: int = 0, y: int = 0, z: int = 500, r: int = 0) -> Callable[[], None]:
    """x ahead, y right, z up (500 in the middle), r clockwise."""
    return lambda: pilot.send(mavlink.MAVLink_manual_control_message(1, x, y, z, r, 0))


def by_hand(pilot: ForeignPilot, mode: Mode, seconds: float, each: Callable[[], None]) -> None:
    if pilot.mode != mode.custom_mode:
        each()
        assert pilot.set_mode(mode.custom_mode) == ACCEPTED
    for _ in range(round(seconds / 0.1)):
        each()
        pilot.fly(0.1)


def test_position_mode_flies_ahead_of_the_nose_and_stops_where_it_is_let_go(aloft: ForeignPilot) -> None:
    by_hand(aloft, Mode.POSITION, 1.0, sticks(aloft, r=600))
    yaw = aloft.vehicle.motion.yaw
    assert yaw == pytest.approx(math.radians(90.0), abs=0.4)
    by_hand(aloft, Mode.POSITION, 4.0, sticks(aloft, x=600))
    speed = 0.6 * AIRFRAME.auto.cruise_speed_m_s
    yaw = aloft.vehicle.motion.yaw
    assert aloft.vehicle.motion.velocity_ned[:2] == pytest.approx(
        (speed * math.cos(yaw), speed * math.sin(yaw)), abs=0.2
    )
    height = aloft.height
    by_hand(aloft, Mode.POSITION, 4.0, sticks(aloft))
    assert aloft.vehicle.motion.speed < 0.1
    place = aloft.vehicle.motion.position_ned
    by_hand(aloft, Mode.POSITION, 3.0, sticks(aloft))
    assert aloft.vehicle.motion.position_ned == pytest.approx(place, abs=0.1)
    assert aloft.height == pytest.approx(height, abs=0.1)


def test_altitude_mode_tilts_and_keeps_the_height(aloft: ForeignPilot) -> None:
    height = aloft.height
    by_hand(aloft, Mode.ALTITUDE, 2.0, sticks(aloft, y=200))
    assert aloft.vehicle.motion.velocity_ned[1] > 1.0
    assert aloft.vehicle.motion.tilt == pytest.approx(0.2 * math.radians(35.0), abs=0.02)
    assert aloft.height == pytest.approx(height, abs=0.1)
    by_hand(aloft, Mode.ALTITUDE, 2.0, sticks(aloft, z=1000))
    assert aloft.vehicle.motion.velocity_ned[2] == pytest.approx(-AIRFRAME.auto.climb_speed_m_s, abs=0.2)


@pytest.mark.parametrize("mode", [Mode.STABILIZED, Mode.MANUAL])
def test_stabilized_mode_sets_the_tilt(aloft: ForeignPilot, mode: Mode) -> None:
    by_hand(aloft, mode, 0.8, sticks(aloft, x=300))
    assert aloft.vehicle.motion.tilt == pytest.approx(0.3 * math.radians(35.0), abs=0.02)
    assert aloft.vehicle.motion.velocity_ned[0] > 0.5


def test_acro_mode_sets_the_rates(aloft: ForeignPilot) -> None:
    by_hand(aloft, Mode.ACRO, 0.5, sticks(aloft, r=500, y=100))
    assert aloft.vehicle.motion.rates_frd[2] == pytest.approx(math.radians(50.0), rel=0.05)
    assert aloft.vehicle.motion.rates_frd[0] == pytest.approx(math.radians(10.0), rel=0.1)


def test_taking_off_and_landing_by_hand() -> None:
    pilot = ForeignPilot()
    pilot.fly(1.1)
    assert pilot.set_mode(Mode.POSITION.custom_mode) == ACCEPTED
    assert pilot.arm() == REJECTED
    assert pilot.texts == ["Arming denied: no manual control"]
    sticks(pilot, z=0)()
    assert pilot.arm() == ACCEPTED
    by_hand(pilot, Mode.POSITION, 2.5, sticks(pilot, z=900))
    assert pilot.height > 1.0
    by_hand(pilot, Mode.POSITION, 7.0, sticks(pilot, z=150))
    assert not pilot.armed and pilot.vehicle.flight.crash is None


def test_lost_sticks_end_in_a_return(aloft: ForeignPilot) -> None:
    assert aloft.set_mode(Mode.POSITION.custom_mode) == REJECTED
    by_hand(aloft, Mode.POSITION, 0.5, sticks(aloft))
    assert aloft.mode == Mode.POSITION.custom_mode
    lost_s = aloft.time_s
    assert aloft.fly(1.0, until=lambda: aloft.mode == RETURN)
    assert aloft.time_s - lost_s == pytest.approx(0.4, abs=0.02), "half a second after the last of them"
    assert aloft.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL


def test_channels_are_sticks(aloft: ForeignPilot) -> None:
    pulses = (1500, 1600, 1500, 1500, *(0,) * 4)
    by_hand(aloft, Mode.POSITION, 3.0, lambda: aloft.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *pulses)))
    assert aloft.vehicle.motion.velocity_ned[0] == pytest.approx(0.2 * AIRFRAME.auto.cruise_speed_m_s, abs=0.1)


# --- orbit ---


@pytest.mark.parametrize("radius", [6.0, -6.0])
def test_an_orbit_goes_round_its_centre_and_faces_it(radius: float) -> None:
    aloft = ForeignPilot()
    aloft.take_off()
    here = (UNSET, UNSET)
    assert aloft.command(mavlink.MAV_CMD_DO_ORBIT, radius, 2.0, 0.0, UNSET, *here, UNSET) == ACCEPTED
    assert aloft.mode == Mode.ORBIT.custom_mode
    aloft.interval(mavlink.MAVLINK_MSG_ID_ORBIT_EXECUTION_STATUS, 500_000)
    aloft.fly(6.0)
    swept, before, height = 0.0, None, aloft.height
    for _ in range(30):
        aloft.fly(0.2)
        north, east, _ = aloft.vehicle.motion.position_ned
        assert math.hypot(north, east) == pytest.approx(6.0, abs=0.3)
        angle = math.atan2(east, north)
        swept += 0.0 if before is None else math.remainder(angle - before, math.tau)
        before = angle
        facing = math.remainder(aloft.vehicle.motion.yaw - angle - math.pi, math.tau)
        assert abs(facing) < 0.2
    assert swept == pytest.approx(math.copysign(2.0 * 5.8 / 6.0, radius), abs=0.2)
    assert aloft.height == pytest.approx(height, abs=0.1)
    assert aloft.last("ORBIT_EXECUTION_STATUS").radius == radius
    assert aloft.set_mode(HOLD) == ACCEPTED
    aloft.fly(4.0)
    assert aloft.vehicle.motion.speed < 0.1


@pytest.mark.parametrize("radius", [0.5, 1001.0])
def test_an_orbit_that_is_too_small_or_large_is_denied(aloft: ForeignPilot, radius: float) -> None:
    nowhere = (UNSET,) * 3
    assert aloft.command(mavlink.MAV_CMD_DO_ORBIT, radius, 2.0, 0.0, 0.0, *nowhere) == mavlink.MAV_RESULT_DENIED
    assert aloft.mode == HOLD
    assert ForeignPilot().command(mavlink.MAV_CMD_DO_ORBIT, 5.0, 2.0, 0.0, 0.0, *nowhere) == REJECTED


@pytest.mark.parametrize(
    ("asked", "given"), [((30.0, 40.0, 9.0), (7.2, 9.6, 1.0)), ((3.0, 4.0, -9.0), (3.0, 4.0, -2.0))]
)
def test_no_target_is_followed_faster_than_the_parameters_say(asked: Three, given: Three) -> None:
    settings = replace(Settings.of(AIRFRAME), max_speed_m_s=12.0, max_climb_m_s=2.0, max_sink_m_s=1.0)
    motion, tracker = ForeignPilot().vehicle.motion._replace(touching=False), Tracker(AIRFRAME, settings)
    tracker.follow(Target(velocity_ned=asked), motion, landed=False)
    way = tracker.command["position_ned"][0] - motion.position_ned
    assert way * AIRFRAME.auto.position_gain_1_s == pytest.approx(given)


@pytest.mark.parametrize(("off_m", "share"), [(0.0, 1.0), (1.0, 1.0), (1.5, 0.5), (2.5, 0.0)])
def test_a_circle_is_gone_round_near_to_it_alone(off_m: float, share: float) -> None:
    motion = ForeignPilot().vehicle.motion._replace(position_ned=(20.0 + off_m, 0.0, -5.0))
    _, east, _ = Circle((0.0, 0.0, -5.0), radius_m=20.0, speed_m_s=2.0).target(motion).velocity_ned
    assert east == pytest.approx(2.0 * share)
