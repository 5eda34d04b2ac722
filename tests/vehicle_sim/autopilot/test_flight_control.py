"""Modes, arming and failsafes, seen from the wire by an unmodified pymavlink."""

import math
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.frames import to_geodetic
from tests.vehicle_sim.foreign_pilot import (
    AIRFRAME,
    EMPTY,
    HOLD,
    LAND,
    OFFBOARD,
    RETURN,
    TAKEOFF,
    UNSET,
    ForeignPilot,
    tilted,
    world_with_wall,
)
from vehicle_sim.autopilot.modes import TRANSITIONS, Mode
from vehicle_sim.services.identity import Identity

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED, UNSUPPORTED = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_UNSUPPORTED
ON_GROUND, IN_AIR = mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_IN_AIR
FORWARD = tilted(-0.2, (0.0, 1.0, 0.0))


@pytest.fixture
def pilot() -> ForeignPilot:
    return ForeignPilot()


@pytest.fixture
def aloft() -> ForeignPilot:
    """A pilot of the last PX4 that takes torques."""
    pilot = ForeignPilot(identity=Identity(firmware=(1, 13)))
    pilot.take_off()
    return pilot


def test_take_off_hold_landing_and_disarming(aloft: ForeignPilot) -> None:
    pilot = aloft
    assert pilot.landed_state == IN_AIR
    assert pilot.height == pytest.approx(AIRFRAME.rest_height_m + AIRFRAME.auto.takeoff_height_m, abs=0.05)
    pilot.fly(5.0)
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((0.0, 0.0), abs=1e-3)
    assert pilot.height == pytest.approx(AIRFRAME.rest_height_m + AIRFRAME.auto.takeoff_height_m, abs=1e-2)
    assert pilot.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    assert pilot.mode == LAND
    assert pilot.fly(20.0, until=lambda: pilot.landed_state == ON_GROUND)
    landed_s = pilot.time_s
    assert pilot.armed
    assert pilot.fly(3.0, until=lambda: not pilot.armed)
    assert pilot.time_s - landed_s == pytest.approx(2.0, abs=0.01)
    assert "Disarmed by landing" in pilot.texts
    assert pilot.vehicle.summary().outcome == "landed"
    assert pilot.vehicle.summary().contacts == 0


def test_takeoff_to_an_altitude_above_the_sea_and_above_home(pilot: ForeignPilot) -> None:
    pilot.fly(1.2)
    rest_m, sea_m = AIRFRAME.rest_height_m, EMPTY.origin[2]
    assert pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 6, sea_m + rest_m + 4.0) == ACCEPTED
    pilot.arm()
    pilot.fly(8.0)
    assert pilot.height == pytest.approx(rest_m + 4.0, abs=0.02)
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    pilot.send(mavlink.MAVLink_command_int_message(1, 1, relative, 22, 0, 0, *(UNSET,) * 4, 0, 0, 6.0))
    pilot.fly(8.0)
    assert pilot.height == pytest.approx(rest_m + 6.0, abs=0.02)
    assert pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 6, 3.0) == mavlink.MAV_RESULT_DENIED


def test_landing_detected_needs_ground_quiet_and_half_a_second(aloft: ForeignPilot) -> None:
    aloft.set_mode(LAND)
    assert aloft.fly(20.0, until=lambda: aloft.vehicle.motion.touching)
    touched_s = aloft.time_s
    assert aloft.landed_state == mavlink.MAV_LANDED_STATE_LANDING
    aloft.fly(5.0, until=lambda: aloft.landed_state == ON_GROUND)
    assert 0.5 <= aloft.time_s - touched_s < 1.5


def test_returns_home_high_and_lands_there(aloft: ForeignPilot) -> None:
    pilot = aloft
    pilot.go_offboard()
    pilot.fly(3.0, lambda: pilot.attitude(FORWARD))
    assert pilot.vehicle.motion.position_ned[0] > 3.0
    assert pilot.set_mode(RETURN) == ACCEPTED
    highest = 0.0
    for _ in range(60):
        pilot.fly(1.0)
        highest = max(highest, pilot.height)
        if not pilot.armed:
            break
    assert highest == pytest.approx(AIRFRAME.auto.return_height_m + AIRFRAME.rest_height_m, abs=0.6)
    assert not pilot.armed
    assert math.hypot(*pilot.vehicle.motion.position_ned[:2]) < 0.1


def test_hold_brakes_and_stays(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    aloft.fly(2.0, lambda: aloft.attitude(FORWARD))
    speed, north = aloft.vehicle.motion.velocity_ned[0], aloft.vehicle.motion.position_ned[0]
    assert speed > 1.5
    assert aloft.set_mode(HOLD) == ACCEPTED
    aloft.fly(12.0)
    stopped = aloft.vehicle.motion.position_ned[0]
    assert 0.2 < stopped - north < speed + 1.0
    aloft.fly(3.0)
    assert aloft.vehicle.motion.position_ned[0] == pytest.approx(stopped, abs=0.01)


# --- reposition ---


GLOBAL, RELATIVE = mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
HERE = 2**31 - 1


def send_to(
    pilot: ForeignPilot,
    north_east: tuple[float, float] | tuple[int, int],
    z: float,
    *,
    frame: int = GLOBAL,
    flags: float = 1.0,
    speed: float = -1.0,
    yaw: float = UNSET,
) -> int:
    """COMMAND_INT as MAVSDK's goto sends it, to metres from the origin or, of ints, 1e-7 degrees; the result."""
    north, east = north_east
    if isinstance(north, int) and isinstance(east, int):
        x, y = north, east
    else:
        latitude, longitude, _ = to_geodetic(np.array([north, east, 0.0]), EMPTY.origin)
        x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
    number = mavlink.MAV_CMD_DO_REPOSITION
    pilot.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, speed, flags, 0.0, yaw, x, y, z))
    before = pilot.time_s
    pilot.fly(0.004)
    (ack,) = pilot.all("COMMAND_ACK", before)
    assert ack.command == number
    return int(ack.result)


def test_reposition_flies_there_and_holds(aloft: ForeignPilot) -> None:
    sea_m = EMPTY.origin[2]
    aloft.go_offboard()
    assert send_to(aloft, (20.0, -15.0), sea_m + 6.0, speed=3.0, yaw=1.0) == ACCEPTED
    assert aloft.mode == HOLD
    fastest = 0.0
    for _ in range(40):
        aloft.fly(0.5)
        fastest = max(fastest, math.hypot(*aloft.vehicle.motion.velocity_ned[:2]))
    assert 2.5 < fastest < 3.05, "the limit, less what the drag takes"
    assert aloft.vehicle.motion.position_ned == pytest.approx((20.0, -15.0, -6.0), abs=0.05)
    assert aloft.vehicle.motion.yaw == pytest.approx(1.0, abs=0.01)
    assert aloft.mode == HOLD and aloft.vehicle.motion.speed < 0.02


def test_unset_values_of_a_reposition_stay_and_heights_may_be_above_home(aloft: ForeignPilot) -> None:
    rest_m = AIRFRAME.rest_height_m
    assert send_to(aloft, (HERE, HERE), 5.0, frame=RELATIVE) == ACCEPTED
    aloft.fly(8.0)
    assert aloft.vehicle.motion.position_ned == pytest.approx((0.0, 0.0, -5.0 - rest_m), abs=0.05)
    assert send_to(aloft, (4.0, 0.0), UNSET) == ACCEPTED
    aloft.fly(8.0)
    assert aloft.vehicle.motion.position_ned == pytest.approx((4.0, 0.0, -5.0 - rest_m), abs=0.05)
    nan = (UNSET,) * 3
    assert aloft.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, *nan, EMPTY.origin[2] + 3.0) == ACCEPTED
    aloft.fly(8.0)
    assert aloft.vehicle.motion.position_ned == pytest.approx((4.0, 0.0, -3.0), abs=0.05)


@pytest.mark.parametrize(
    ("place", "z", "options", "result"),
    [
        ((900_000_001, 0), 500.0, {}, DENIED),
        ((0, -1_800_000_001), 500.0, {}, DENIED),
        ((HERE, 85_456_000), 500.0, {}, DENIED),
        ((10.0, 0.0), math.inf, {}, DENIED),
        ((10.0, 0.0), -1.0, {"frame": RELATIVE}, DENIED),
        ((20_000.0, 0.0), 500.0, {}, DENIED),
        ((10.0, 0.0), 5.0, {"frame": mavlink.MAV_FRAME_LOCAL_NED}, DENIED),
        ((10.0, 0.0), 500.0, {"flags": 0.0}, UNSUPPORTED),
        ((10.0, 0.0), 500.0, {"flags": 3.0}, UNSUPPORTED),
        ((10.0, 0.0), 500.0, {"flags": UNSET}, UNSUPPORTED),
    ],
)
def test_an_impossible_place_is_refused_and_changes_nothing(
    aloft: ForeignPilot, place: tuple[float, float], z: float, options: dict[str, Any], result: int
) -> None:
    aloft.set_mode(LAND)
    assert send_to(aloft, place, z, **options) == result
    assert aloft.mode == LAND


def test_reposition_is_refused_on_the_ground(pilot: ForeignPilot) -> None:
    pilot.fly(1.2)
    assert send_to(pilot, (10.0, 0.0), 500.0) == REJECTED
    assert pilot.arm() == ACCEPTED
    assert send_to(pilot, (10.0, 0.0), 500.0) == REJECTED
    assert "Reposition rejected: not in the air" in pilot.texts


# --- OFFBOARD ---


def test_offboard_in_the_air_needs_a_setpoint_that_is_young_enough(aloft: ForeignPilot) -> None:
    """One suffices, as PX4's code has it."""
    assert aloft.set_mode(OFFBOARD) == REJECTED
    aloft.attitude()
    aloft.fly(1.1)
    assert aloft.set_mode(OFFBOARD) == REJECTED
    assert aloft.mode == HOLD
    aloft.attitude()
    aloft.fly(0.9)
    assert aloft.set_mode(OFFBOARD) == ACCEPTED
    assert aloft.texts.count("Offboard rejected: no setpoint stream") == 2


def test_a_disarmed_vehicle_takes_any_mode_and_stays_in_it(pilot: ForeignPilot) -> None:
    for mode in Mode:
        if mode.is_selectable and mode.main != 3 and mode is not Mode.TAKEOFF:
            assert pilot.set_mode(mode.custom_mode) == ACCEPTED
            pilot.fly(1.2)
            assert pilot.mode == mode.custom_mode
    assert not pilot.texts


@pytest.mark.parametrize("kind", ["attitude", "rates", "torque"])
def test_each_kind_of_setpoint_flies(kind: str) -> None:
    pilot = ForeignPilot(identity=Identity(firmware=(1, 13)))
    hover = AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n

    def torque() -> None:
        controls = [0.0, 0.0, 0.0, hover, 0.0, 0.0, 0.0, 0.0]
        pilot.send(mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, controls))

    each = {"attitude": pilot.attitude, "rates": lambda: pilot.rates((0.0, 0.0, 0.3)), "torque": torque}[kind]
    pilot.take_off()
    before = pilot.height
    pilot.go_offboard(each)
    pilot.fly(2.0, each)
    assert pilot.height == pytest.approx(before, abs=0.05)
    assert pilot.vehicle.motion.rates_frd[2] == pytest.approx(0.3 if kind == "rates" else 0.0, abs=0.01)


def test_full_roll_control_is_the_bodys_full_torque(aloft: ForeignPilot) -> None:
    def roll() -> None:
        aloft.send(mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, [0.05, 0, 0, 0.5, 0, 0, 0, 0]))

    def level() -> None:
        aloft.send(mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, [0, 0, 0, 0.475, 0, 0, 0, 0]))

    aloft.go_offboard(level)
    aloft.fly(0.2, roll)
    before = aloft.vehicle.motion.rates_frd[0]
    aloft.fly(0.1, roll)
    gained = aloft.vehicle.motion.rates_frd[0] - before
    body = AIRFRAME.body
    assert gained == pytest.approx(0.1 * 0.05 * body.full_torque_nm[0] / body.inertia_kgm2[0], rel=0.03)


def test_a_lost_stream_ends_in_hold_then_landing(aloft: ForeignPilot) -> None:
    pilot = aloft
    pilot.go_offboard()
    pilot.fly(1.0, pilot.attitude)
    lost_s = pilot.time_s
    assert pilot.fly(1.1, until=lambda: pilot.mode == HOLD)
    assert pilot.time_s - lost_s == pytest.approx(1.0, abs=0.02)
    assert pilot.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    assert pilot.fly(6.0, pilot.attitude, until=lambda: pilot.mode == LAND)  # the stream is back: no matter
    assert pilot.time_s - lost_s == pytest.approx(6.0, abs=0.05)
    assert pilot.fly(20.0, pilot.attitude, until=lambda: not pilot.armed)
    assert [text for text in pilot.texts if "Failsafe" in text] == [
        "Failsafe: offboard stream lost, holding",
        "Failsafe: offboard stream lost, landing",
    ]
    assert OFFBOARD not in {m.custom_mode for m in pilot.all("HEARTBEAT", lost_s + 1.1)}


def test_hold_without_heartbeats_ends_in_landing(aloft: ForeignPilot) -> None:
    """Whoever had it hold has gone: no mode that is asked for may keep it up for ever."""
    pilot = aloft
    pilot.vehicle.parameters.set("NAV_DLL_ACT", 3)
    assert pilot.set_mode(HOLD) == ACCEPTED
    pilot.fly(15.0)
    assert pilot.mode == HOLD
    pilot.present = False
    assert not pilot.fly(8.9, until=lambda: pilot.mode == LAND)
    assert pilot.fly(1.1, until=lambda: pilot.mode == LAND)
    assert pilot.fly(20.0, until=lambda: not pilot.armed)
    assert [text for text in pilot.texts if "Failsafe" in text] == ["Failsafe: no heartbeat, landing"]


def test_a_gap_below_a_second_changes_nothing(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    for _ in range(4):
        aloft.fly(0.9)
        aloft.attitude()
    assert aloft.mode == OFFBOARD


def test_a_command_ends_the_failsafe(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    aloft.fly(2.0)
    assert aloft.mode == HOLD
    aloft.go_offboard()
    assert aloft.last("HEARTBEAT").system_status == mavlink.MAV_STATE_ACTIVE
    aloft.fly(8.0, aloft.attitude)
    assert aloft.mode == OFFBOARD


def test_nothing_enters_offboard_by_itself() -> None:
    assert all(mode is not Mode.OFFBOARD for mode, _, _ in TRANSITIONS.values())


def test_nan_and_masked_thrust_are_no_thrust(aloft: ForeignPilot) -> None:
    """What PX4 does, and why a companion must never send them."""
    aloft.go_offboard()
    aloft.fly(0.3, lambda: aloft.attitude(thrust=math.nan))
    nan_fell = aloft.vehicle.motion.velocity_ned[2]
    other = ForeignPilot()
    other.take_off()
    other.go_offboard()
    other.fly(0.3, lambda: other.attitude(mask=7 | 64))
    assert nan_fell == pytest.approx(other.vehicle.motion.velocity_ned[2])
    assert nan_fell > 2.0


@pytest.mark.parametrize("q", [(math.nan, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (1.0, math.inf, 0.0, 0.0)])
def test_an_impossible_attitude_is_no_setpoint(aloft: ForeignPilot, q: tuple[float, ...]) -> None:
    aloft.go_offboard()
    aloft.fly(1.2, lambda: aloft.attitude(q, thrust=0.0))
    assert aloft.mode == HOLD
    assert all(map(math.isfinite, aloft.vehicle.state))


def test_a_quaternion_of_any_length_is_its_direction() -> None:
    ends = []
    for scale in (1.0, -2.5):
        pilot = ForeignPilot()
        pilot.take_off()
        pilot.go_offboard()
        q = tuple(scale * x for x in FORWARD)
        pilot.fly(1.0, lambda pilot=pilot, q=q: pilot.attitude(q))  # type: ignore[misc]
        ends.append(pilot.vehicle.motion.position_ned)
    assert ends[0] == pytest.approx(ends[1], abs=1e-6)


# --- arming ---


def test_arming_is_denied_with_the_reason(pilot: ForeignPilot) -> None:
    pilot.fly(0.5)
    assert pilot.arm() == REJECTED
    pilot.fly(0.7)
    assert pilot.set_mode(LAND) == ACCEPTED
    assert pilot.arm() == REJECTED
    assert not pilot.armed
    denied = [text for text in pilot.texts if "denied" in text]
    assert denied == ["Arming denied: estimator is starting", "Arming denied: mode land"]


def test_arming_in_offboard_needs_the_stream(pilot: ForeignPilot) -> None:
    pilot.fly(1.0)
    pilot.go_offboard()
    pilot.fly(1.1)
    assert pilot.arm() == REJECTED
    assert "Arming denied: no setpoint stream" in pilot.texts


def test_ready_to_arm_is_said_in_sys_status(pilot: ForeignPilot) -> None:
    pilot.interval(mavlink.MAVLINK_MSG_ID_SYS_STATUS, 100_000)
    ready = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    pilot.fly(0.5)
    assert not pilot.last("SYS_STATUS").onboard_control_sensors_health & ready
    pilot.fly(0.7)
    assert pilot.last("SYS_STATUS").onboard_control_sensors_health & ready


# --- what goes wrong, and the parcel ---


def test_flying_into_a_wall_is_a_crash() -> None:
    pilot = ForeignPilot(world_with_wall(8.0))
    pilot.take_off()
    pilot.go_offboard()
    assert pilot.fly(10.0, lambda: pilot.attitude(FORWARD), until=lambda: pilot.vehicle.flight.crash is not None)
    assert pilot.vehicle.motion.position_ned[0] == pytest.approx(7.5 - AIRFRAME.hull.radius_m, abs=0.03)
    pilot.fly(2.0, lambda: pilot.attitude(FORWARD))
    assert pilot.last("HEARTBEAT").system_status == mavlink.MAV_STATE_EMERGENCY
    assert not pilot.armed
    (text,) = [m for m in pilot.all("STATUSTEXT") if m.severity == mavlink.MAV_SEVERITY_EMERGENCY]
    assert text.text == "crash: hit wall"
    assert pilot.vehicle.motion.rotor_speeds == pytest.approx((0.0,) * 4, abs=1e-9)
    assert pilot.vehicle.motion.touching
    summary = pilot.vehicle.summary()
    assert (summary.outcome, summary.contacts, summary.contact_with) == ("crashed", 1, "wall")
    assert summary.least_clearance_m is not None
    assert summary.least_clearance_m <= 0.0
    assert pilot.arm() == REJECTED
    assert pilot.set_mode(HOLD) == REJECTED


def test_least_clearance_is_the_hulls_and_of_the_air_alone() -> None:
    pilot = ForeignPilot(world_with_wall(8.0))
    pilot.fly(1.0)
    assert pilot.vehicle.summary().least_clearance_m is None
    pilot.take_off()
    assert pilot.vehicle.summary().least_clearance_m == pytest.approx(7.5 - AIRFRAME.hull.radius_m, abs=1e-6)
    pilot.interval(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 4000)
    for seconds, axis in ((1.2, -1.0), (2.0, 1.0), (2.2, -1.0), (2.0, 1.0)):  # near, away, nearer, away
        pilot.go_offboard()
        pilot.fly(seconds, lambda axis=axis: pilot.attitude(tilted(0.2, (0.0, axis, 0.0))))  # type: ignore[misc]
        pilot.set_mode(HOLD)
        pilot.fly(2.0)
    furthest = max(m.x for m in pilot.all("LOCAL_POSITION_NED"))
    assert pilot.vehicle.summary().least_clearance_m == pytest.approx(7.5 - AIRFRAME.hull.radius_m - furthest, abs=1e-5)


def test_hitting_the_ground_fast_or_tilted_is_a_crash(aloft: ForeignPilot) -> None:
    aloft.go_offboard()
    assert aloft.fly(4.0, lambda: aloft.attitude(thrust=0.2), until=lambda: aloft.vehicle.flight.crash is not None)
    assert aloft.vehicle.summary().contact_with == "ground"
    assert aloft.vehicle.motion.impact_m_s > AIRFRAME.ground.crash_speed_m_s


def test_released_parcel_is_gone_and_thrust_is_too_much_then() -> None:
    pilot = ForeignPilot()
    pilot.take_off()
    pilot.go_offboard()
    hover = AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n
    release = mavlink.MAV_CMD_DO_GRIPPER
    assert pilot.command(release, 1, mavlink.GRIPPER_ACTION_GRAB) == ACCEPTED
    assert not pilot.vehicle.summary().released
    assert pilot.command(release, 1, mavlink.GRIPPER_ACTION_RELEASE) == ACCEPTED
    assert "Parcel released" in pilot.texts
    place = pilot.vehicle.motion.position_ned
    before = pilot.vehicle.motion.velocity_ned[2]
    pilot.fly(0.1, lambda: pilot.attitude(thrust=hover))
    body = AIRFRAME.body
    gained = before - pilot.vehicle.motion.velocity_ned[2]
    assert gained == pytest.approx(0.1 * 9.81 * body.parcel_mass_kg / body.mass_kg, rel=0.05)
    assert pilot.vehicle.summary().released_at_ned == pytest.approx(place, abs=0.01)
    assert pilot.command(release, 1, mavlink.GRIPPER_ACTION_RELEASE) == ACCEPTED
    assert pilot.texts[-1] == "Gripper: no parcel left"


def test_the_autopilot_knows_the_mass_without_the_parcel(aloft: ForeignPilot) -> None:
    before = aloft.height
    aloft.command(mavlink.MAV_CMD_DO_GRIPPER, 1, mavlink.GRIPPER_ACTION_RELEASE)
    aloft.fly(3.0)
    assert aloft.height == pytest.approx(before, abs=0.03)


def test_mode_numbers_are_px4s() -> None:
    numbered = [Mode.TAKEOFF, Mode.HOLD, Mode.RETURN, Mode.LAND, Mode.OFFBOARD]
    assert [mode.custom_mode for mode in numbered] == [TAKEOFF, HOLD, RETURN, LAND, OFFBOARD]


def test_nobody_comes_to_rest_below_the_ground(aloft: ForeignPilot) -> None:
    sinking = aloft.vehicle.motion._replace(position_ned=(0.0, 0.0, -0.5), velocity_ned=(2.0, 0.0, 3.0))
    north, _, down = aloft.vehicle.flight.guidance.stopping_point(sinking, landed=False)
    assert north > 0.0 and down == -AIRFRAME.ground.foot_height_m
