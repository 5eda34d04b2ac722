"""The MAVLink side: answers, streams, times, repeatability; an unmodified pymavlink reads all of it."""

import hashlib
import itertools
import math
from collections import Counter

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.frames import to_body, to_local
from tests.vehicle_sim.foreign_pilot import (
    AIRFRAME,
    EMPTY,
    HOLD,
    OFFBOARD,
    UNSET,
    ForeignPilot,
    airframe_with,
    tilted,
    world_with_wall,
)
from vehicle_sim.autopilot.modes import Severity
from vehicle_sim.services.profiles import Profile
from vehicle_sim.vehicle import DATAGRAM_BYTES

ACCEPTED, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)
FORWARD = tilted(-0.15, (0.3, 1.0, 0.0))


def test_heartbeat_is_a_px4_quadrotors() -> None:
    pilot = ForeignPilot()
    pilot.fly(3.1)
    beat = pilot.last("HEARTBEAT")
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 1)
    assert (beat.type, beat.autopilot, beat.base_mode, beat.custom_mode) == (2, 12, 29, HOLD)
    assert beat.system_status == mavlink.MAV_STATE_STANDBY
    assert pilot.times("HEARTBEAT") == pytest.approx((0.004, 1.0, 2.0, 3.0))


def test_a_change_of_mode_or_arming_is_reported_at_once() -> None:
    pilot = ForeignPilot()
    pilot.fly(1.2)
    pilot.arm()
    assert pilot.times("HEARTBEAT")[-1] == pytest.approx(pilot.time_s)
    assert pilot.armed
    pilot.set_mode(OFFBOARD)  # rejected, as there is no setpoint: nothing to say
    assert pilot.times("HEARTBEAT")[-1] < pilot.time_s


FIRST_RATES = {
    "HEARTBEAT": 1.0,
    "ATTITUDE_QUATERNION": 50.0,
    "LOCAL_POSITION_NED": 50.0,
    "ODOMETRY": 31.25,  # 30 Hz asked, whole ticks given
    "GLOBAL_POSITION_INT": 10.0,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 5.0,
    "BATTERY_STATUS": 0.5,
    "ATTITUDE_TARGET": 10.0,
    "ATTITUDE": 10.0,
    "SERVO_OUTPUT_RAW": 10.0,
    "HOME_POSITION": 0.5,
    "HIL_STATE_QUATERNION": 20.75,  # 20 Hz asked: 166 times in 8 s
    "GPS_RAW_INT": 5.0,
    "OBSTACLE_DISTANCE": 15.625,
    "DISTANCE_SENSOR": 2 * 15.625,
    "MISSION_CURRENT": 1.0,
    "UNKNOWN_436": 0.5,  # CURRENT_MODE, which pymavlink's dialect does not have
}
ONBOARD_RATES = FIRST_RATES | {
    "ATTITUDE": 125.0,  # 100 Hz asked
    "LOCAL_POSITION_NED": 31.25,
    "GLOBAL_POSITION_INT": 50.0,
    "GPS_GLOBAL_ORIGIN": 1.0,
    "ALTITUDE": 10.0,
    "VFR_HUD": 10.0,
    "SYSTEM_TIME": 1.0,
    "SYS_STATUS": 5.0,
    "OBSTACLE_DISTANCE": 10.0,
    "DISTANCE_SENSOR": 2 * 10.0,
    "TIMESYNC": 10.0,
    "PING": 1.0,
}
GROUND_RATES = {
    "HEARTBEAT": 1.0,
    "ATTITUDE": 15.625,  # 15 Hz asked
    "ATTITUDE_QUATERNION": 10.0,
    "ATTITUDE_TARGET": 2.0,
    "BATTERY_STATUS": 0.5,
    "DISTANCE_SENSOR": 2 * 0.5,
    "EXTENDED_SYS_STATE": 1.0,
    "GLOBAL_POSITION_INT": 5.0,
    "GPS_GLOBAL_ORIGIN": 1.0,
    "GPS_RAW_INT": 5.0,
    "HOME_POSITION": 0.5,
    "LOCAL_POSITION_NED": 1.0,
    "OBSTACLE_DISTANCE": 1.0,
    "ALTITUDE": 1.0,
    "VFR_HUD": 4.0,
    "SERVO_OUTPUT_RAW": 1.0,
    "SYS_STATUS": 1.0,
    "MISSION_CURRENT": 1.0,
    "UNKNOWN_436": 0.5,
}


@pytest.mark.parametrize(
    ("profile", "rates"),
    [(Profile.FIRST, FIRST_RATES), (Profile.ONBOARD, ONBOARD_RATES), (Profile.GROUND, GROUND_RATES)],
)
def test_every_stream_at_its_default_rate(profile: Profile, rates: dict[str, float]) -> None:
    """Those of PX4's mavlink_main.cpp on its two links, in whole ticks."""
    vehicle, reader = ForeignPilot().vehicle, mavlink.MAVLink(None)
    channel = vehicle.open_channel(profile)
    count: Counter[str] = Counter()
    for _ in range(2000):
        vehicle.step()
        for datagram in vehicle.collect(channel):
            count.update(message.get_type() for message in reader.parse_buffer(datagram) or [])
    count.subtract({"HEARTBEAT": 1, "EXTENDED_SYS_STATE": 1, "UNKNOWN_436": 1})  # said once at the start as well
    assert count == {name: round(8.0 * rate) for name, rate in rates.items()}


@pytest.mark.parametrize(
    ("profile", "intervals_s"),
    [
        (Profile.FIRST, (None, None, None, None)),
        (Profile.ONBOARD, (0.02, 1.0, 1.0, 2.0)),
        (Profile.GROUND, (None, 1.0, 2.0, 10.0)),
    ],
)
def test_what_is_measured_is_sent_by_a_vehicle_that_has_sensors(
    profile: Profile, intervals_s: tuple[float | None, ...]
) -> None:
    names = "HIGHRES_IMU", "SCALED_PRESSURE", "ESTIMATOR_STATUS", "VIBRATION"
    numbers = [getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in names]
    for airframe, expected in ((airframe_with('estimator.sensors="gnss"'), intervals_s), (AIRFRAME, (0,) * 4)):
        telemetry = ForeignPilot(airframe=airframe).vehicle.open_channel(profile).telemetry
        assert [telemetry.interval_us(number) for number in numbers] == [
            -1 if each is None else round(1e6 * each) for each in expected
        ]


@pytest.mark.parametrize("asked_us", [4000, 8000, 10_000, 20_000, 50_000, 1_000_000, 100])
def test_intervals_are_obeyed_in_whole_ticks(asked_us: int) -> None:
    pilot = ForeignPilot()
    assert pilot.interval(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, asked_us) == ACCEPTED
    pilot.fly(2.2)
    gaps = set(np.round(np.diff(pilot.times("LOCAL_POSITION_NED")) * 1e6).astype(int).tolist())
    assert gaps == {max(4000, asked_us // 4000 * 4000)}


def test_an_interval_can_be_ended_reset_and_read() -> None:
    pilot = ForeignPilot(all_streams=True)
    position = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    assert pilot.interval(position, -1) == ACCEPTED
    pilot.fly(0.5)
    assert not pilot.all("LOCAL_POSITION_NED")
    pilot.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, position)
    assert pilot.last("MESSAGE_INTERVAL").interval_us == -1
    assert pilot.interval(position, 0) == ACCEPTED
    pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL, position)
    assert pilot.last("MESSAGE_INTERVAL").interval_us == 20_000
    assert pilot.interval(99_999, 4000) == DENIED
    assert pilot.interval(position, UNSET) == DENIED
    assert pilot.interval(position, -7) == DENIED


@pytest.mark.parametrize("asked_us", [3e9, 1e38])
def test_the_longest_interval_is_what_can_be_told(asked_us: float) -> None:
    pilot = ForeignPilot()
    position = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    assert pilot.interval(position, asked_us) == ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, position) == ACCEPTED
    assert pilot.last("MESSAGE_INTERVAL").interval_us == pytest.approx(2**31, abs=4000.0)


def test_all_streams_can_be_switched_off() -> None:
    pilot = ForeignPilot()
    for message_id in pilot.vehicle.telemetry.message_ids:
        assert pilot.interval(message_id, -1) == ACCEPTED
    pilot.datagrams.clear()
    pilot.fly(3.0)
    assert pilot.datagrams == []


def test_scans_come_no_faster_than_the_lidars_rate() -> None:
    pilot = ForeignPilot()
    pilot.interval(mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, 4000)
    pilot.fly(2.0)
    assert np.diff(pilot.times("OBSTACLE_DISTANCE")).min() == pytest.approx(1.0 / AIRFRAME.lidar.rate_hz, abs=0.004)


@pytest.mark.parametrize("rate_hz", [251.0, 1e7])
def test_a_lidar_faster_than_the_ticks_is_told_with_each(rate_hz: float) -> None:
    pilot = ForeignPilot(airframe=airframe_with(f"lidar.rate_hz={rate_hz}"), all_streams=True)
    pilot.fly(0.2)
    assert len(pilot.times("OBSTACLE_DISTANCE")) == 50


def test_messages_of_one_instant_travel_together() -> None:
    pilot = ForeignPilot()
    pilot.fly(0.1)
    pilot.interval(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, 8000)
    pilot.interval(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 8000)
    pilot.fly(0.1)
    assert set(pilot.times("LOCAL_POSITION_NED")) <= set(pilot.times("ATTITUDE_QUATERNION"))


def test_a_vehicle_that_has_a_home_can_be_armed() -> None:
    """MAVSDK's `health_all_ok` waits for it, and its users arm then."""
    pilot = ForeignPilot()
    home = mavlink.MAVLINK_MSG_ID_HOME_POSITION
    pilot.interval(home, 4000)
    assert pilot.fly(2.0, until=lambda: bool(pilot.all("HOME_POSITION")))
    assert pilot.arm() == ACCEPTED


# --- commands ---


@pytest.mark.parametrize("target", [(1, 1), (1, 0), (0, 0)])
def test_each_command_is_answered_to_its_sender(target: tuple[int, int]) -> None:
    for pilot, ids in ((ForeignPilot(component=191), (1, 191)), (ForeignPilot(component=25), (1, 25))):
        pilot.send(mavlink.MAVLink_command_long_message(*target, 31010, 0, *(0.0,) * 7))
        pilot.send(mavlink.MAVLink_command_int_message(*target, 0, 31011, 0, 0, *(0.0,) * 4, 0, 0, 0.0))
        pilot.fly(0.004)
        answers = pilot.all("COMMAND_ACK")
        assert [(a.command, a.result) for a in answers] == [(31010, UNSUPPORTED), (31011, UNSUPPORTED)]
        assert {(a.target_system, a.target_component) for a in answers} == {ids}


@pytest.mark.parametrize("target", [(2, 1), (1, 191), (0, 2)])
def test_messages_for_others_are_ignored(target: tuple[int, int]) -> None:
    pilot = ForeignPilot()
    pilot.fly(1.2)
    pilot.send(mavlink.MAVLink_command_long_message(*target, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, *(0.0,) * 6))
    pilot.fly(0.1)
    assert not pilot.all("COMMAND_ACK")
    assert not pilot.armed

    def setpoint() -> None:
        pilot.send(mavlink.MAVLink_set_attitude_target_message(0, *target, 7, [1.0, 0, 0, 0], 0, 0, 0, 0.5))

    pilot.fly(0.4, setpoint)
    assert not pilot.vehicle.flight.setpoints.stream.has_begun


@pytest.mark.parametrize("params", [(1, 4, 9), (1, 10, 0), (1, 0, 0), (1, 4, 1.5), (0, 6, 0), (UNSET, 6, 0)])
def test_unknown_modes_are_denied(params: tuple[float, ...]) -> None:
    pilot = ForeignPilot()
    assert pilot.command(mavlink.MAV_CMD_DO_SET_MODE, *params) == DENIED


def test_messages_on_request() -> None:
    pilot = ForeignPilot()
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == DENIED, "not yet"
    pilot.fly(1.0)
    for message_id, name in (
        (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION"),
        (mavlink.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION"),
        (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, "EXTENDED_SYS_STATE"),
        (mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, "BATTERY_STATUS"),
    ):
        before = pilot.time_s
        assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id) == ACCEPTED
        assert pilot.all(name, before)
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999) == DENIED
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, UNSET) == DENIED
    assert pilot.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_GET_HOME_POSITION) == ACCEPTED
    assert pilot.last("AUTOPILOT_VERSION").flight_sw_version >> 8 == 0x011000


# --- time ---


def test_timesync_is_answered_with_its_own_time() -> None:
    pilot = ForeignPilot()
    pilot.fly(0.4)
    asked_ns = pilot.vehicle.time_ns
    pilot.send(mavlink.MAVLink_timesync_message(0, 123_456_789_012_345))
    pilot.fly(0.004)
    answer = pilot.last("TIMESYNC")
    assert (answer.tc1, answer.ts1) == (asked_ns, 123_456_789_012_345)
    pilot.send(mavlink.MAVLink_timesync_message(5, 6))
    pilot.fly(0.1)
    assert len(pilot.all("TIMESYNC")) == 1


def test_ping_is_answered_once() -> None:
    pilot = ForeignPilot()
    pilot.send(mavlink.MAVLink_ping_message(77, 3, 0, 0))
    pilot.send(mavlink.MAVLink_ping_message(78, 4, 1, 1))  # an answer, not a question
    pilot.fly(0.1)
    (pong,) = pilot.all("PING")
    assert (pong.time_usec, pong.seq, pong.target_system, pong.target_component) == (77, 3, 1, 191)


def test_lockstep_ends_each_tick_with_its_time_and_takes_no_late_answer() -> None:
    pilot = ForeignPilot(lockstep=True, all_streams=True)
    pilot.fly(1.0)
    asked = [message.ts1 for message in pilot.all("TIMESYNC")]
    assert asked == [4_000_000 * k for k in range(1, 251)]
    reader = mavlink.MAVLink(None)
    for datagram in pilot.datagrams:
        assert reader.parse_buffer(datagram)[-1].get_type() == "TIMESYNC"

    vehicle, sender = pilot.vehicle, mavlink.MAVLink(None, 1, 191)
    ping = mavlink.MAVLink_ping_message(1, 1, 0, 0).pack(sender)
    vehicle.receive(ping + mavlink.MAVLink_timesync_message(1, vehicle.time_ns - 4_000_000).pack(sender))
    assert vehicle.answered_ns == -1
    vehicle.receive(ping + mavlink.MAVLink_timesync_message(1, vehicle.time_ns).pack(sender))
    assert vehicle.answered_ns == vehicle.time_ns
    pilot.fly(0.004)
    assert len(pilot.all("PING")) == 1


# --- what the messages say ---


@pytest.fixture(scope="module")
def moving() -> ForeignPilot:
    """In the air, tilted, yawed, moving; every message in every tick, the scans as fast as they come."""
    pilot = ForeignPilot(world_with_wall(12.0), all_streams=True)
    pilot.take_off()
    pilot.go_offboard(lambda: pilot.rates((0.0, 0.0, 0.3)))
    pilot.fly(1.2, lambda: pilot.attitude(FORWARD))
    for message_id in pilot.vehicle.telemetry.message_ids:
        pilot.interval(message_id, 4000)
        pilot.attitude(FORWARD)
    pilot.fly(0.1, lambda: pilot.attitude(FORWARD))
    return pilot


def test_states_agree_with_each_other_and_with_the_truth(moving: ForeignPilot) -> None:
    truth = moving.vehicle.motion
    position, attitude, euler = (moving.last(n) for n in ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION", "ATTITUDE"))
    assert math.hypot(position.vx, position.vy) > 1.0
    assert (position.x, position.y, position.z) == pytest.approx(truth.position_ned, rel=1e-6)
    assert (position.vx, position.vy, position.vz) == pytest.approx(truth.velocity_ned, rel=1e-6)
    q = np.array([attitude.q1, attitude.q2, attitude.q3, attitude.q4])
    assert q == pytest.approx(truth.attitude_ned_frd, rel=1e-6)
    assert position.time_boot_ms == attitude.time_boot_ms == truth.time_ns // 1_000_000
    assert math.sin(euler.yaw) == pytest.approx(2.0 * (q[0] * q[3] + q[1] * q[2]) / math.cos(euler.pitch), abs=1e-5)
    assert math.sin(euler.pitch) == pytest.approx(2.0 * (q[0] * q[2] - q[3] * q[1]), abs=1e-6)

    odometry = moving.last("ODOMETRY")
    assert (odometry.frame_id, odometry.child_frame_id) == (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD)
    body = np.array(to_body(q, np.array([position.vx, position.vy, position.vz])))
    assert (odometry.vx, odometry.vy, odometry.vz) == pytest.approx(body, abs=1e-5)


def test_global_position_leads_back_to_the_local_one(moving: ForeignPilot) -> None:
    message, local = moving.last("GLOBAL_POSITION_INT"), moving.last("LOCAL_POSITION_NED")
    geodetic = (math.radians(message.lat * 1e-7), math.radians(message.lon * 1e-7), message.alt * 1e-3)
    back = to_local(geodetic, moving.vehicle.world.origin)
    assert back == pytest.approx((local.x, local.y, local.z), abs=0.012)
    assert message.relative_alt * 1e-3 == pytest.approx(moving.height - AIRFRAME.rest_height_m, abs=2e-3)
    assert message.hdg == pytest.approx(math.degrees(moving.vehicle.motion.yaw) % 360.0 * 100.0, abs=1.0)


def test_ground_truth_has_the_accelerometers_reading(moving: ForeignPilot) -> None:
    truth = moving.last("HIL_STATE_QUATERNION")
    history = moving.all("LOCAL_POSITION_NED")[-3:]
    dt = (history[2].time_boot_ms - history[0].time_boot_ms) * 1e-3
    gained = np.array([getattr(history[2], name) - getattr(history[0], name) for name in ("vx", "vy", "vz")])
    felt = np.array(to_body(np.array(truth.attitude_quaternion), gained / dt - np.array([0.0, 0.0, 9.81])))
    assert (truth.xacc, truth.yacc, truth.zacc) == pytest.approx(felt / 9.81e-3, abs=12.0)
    assert truth.zacc < -900


def test_a_scan_is_of_the_pose_at_its_own_time(moving: ForeignPilot) -> None:
    scan = moving.last("OBSTACLE_DISTANCE")
    assert (scan.frame, scan.increment, scan.increment_f, scan.angle_offset) == (12, 5, 5.0, 0.0)
    sent_s = moving.times("OBSTACLE_DISTANCE")[-1]
    assert sent_s - scan.time_usec * 1e-6 == pytest.approx(AIRFRAME.lidar.latency_s)
    (then,) = [m for m in moving.all("LOCAL_POSITION_NED") if m.time_boot_ms == scan.time_usec // 1000]
    assert min(scan.distances) * 0.01 == pytest.approx(11.5 - then.x, abs=0.25)
    forward, down = moving.all("DISTANCE_SENSOR")[-2:]
    assert (forward.orientation, down.orientation) == (0, 25)
    assert down.current_distance * 0.01 == pytest.approx(-then.z / math.cos(moving.vehicle.motion.tilt), abs=0.15)


def test_attitude_target_echoes_the_setpoint(moving: ForeignPilot) -> None:
    echo = moving.last("ATTITUDE_TARGET")
    assert echo.q == pytest.approx(FORWARD, abs=1e-6)
    assert echo.type_mask == 7
    assert echo.thrust == pytest.approx(AIRFRAME.takeoff_mass_kg * 9.81 / AIRFRAME.body.max_thrust_n, abs=1e-6)


def test_servo_outputs_lift_the_vehicle(moving: ForeignPilot) -> None:
    servo = moving.last("SERVO_OUTPUT_RAW")
    shares = [((getattr(servo, f"servo{i}_raw") - 1000) / 1000.0) ** 2 for i in range(1, 5)]
    lift = sum(shares) * AIRFRAME.body.rotor_max_thrust_n
    assert lift == pytest.approx(AIRFRAME.takeoff_mass_kg * 9.81, rel=0.02)


def test_battery_runs_down(moving: ForeignPilot) -> None:
    first, last = moving.all("BATTERY_STATUS")[0], moving.last("BATTERY_STATUS")
    assert last.current_consumed > first.current_consumed
    assert 10_500 < last.voltages[0] < 12_600
    assert last.current_battery > 300


def test_a_voltage_beyond_16_bits_is_told_in_parts() -> None:
    airframe = airframe_with("battery.full_v=75.6", "battery.empty_v=60.0")
    pilot = ForeignPilot(airframe=airframe, all_streams=True)
    pilot.fly(2.1)
    assert pilot.last("SYS_STATUS").voltage_battery == 65535
    first, second, *rest = pilot.last("BATTERY_STATUS").voltages
    assert first == 65534 and first + second == pytest.approx(75_600, abs=10) and rest == [65535] * 8


def test_a_battery_says_how_low_it_is() -> None:
    states = {0.5: 1, 0.14: 2, 0.06: 3, 0.04: 4}  # ok, low, critical, emergency
    for charge, state in states.items():
        pilot = ForeignPilot(airframe=airframe_with(f"battery.charge={charge}"), all_streams=True)
        pilot.fly(2.1)
        assert pilot.last("BATTERY_STATUS").charge_state == state


def test_mavsdk_gets_what_it_waits_for() -> None:
    pilot = ForeignPilot(all_streams=True)
    pilot.fly(2.1)
    status = pilot.last("SYS_STATUS")
    assert status.onboard_control_sensors_present & status.onboard_control_sensors_health & 0x27 == 0x27
    assert status.onboard_control_sensors_health & 0x10100000 == 0x10100000
    for name in ("HOME_POSITION", "GLOBAL_POSITION_INT", "GPS_RAW_INT", "BATTERY_STATUS", "EXTENDED_SYS_STATE"):
        assert pilot.all(name), name


@pytest.mark.parametrize(("letters", "count"), [(120, 3), (100, 3), (51, 2)])
def test_a_long_text_goes_in_numbered_pieces(letters: int, count: int) -> None:
    """The last one is not full, which says that it is the last."""
    pilot = ForeignPilot()
    text = "".join(itertools.islice(itertools.cycle("abcdefghij klmnopqrst"), letters))
    pilot.vehicle.flight.announce(Severity.INFO, text)
    pilot.fly(0.004)
    pieces = pilot.all("STATUSTEXT")
    assert "".join(piece.text for piece in pieces) == text
    assert [piece.chunk_seq for piece in pieces] == list(range(count))
    assert [len(piece.text) == 50 for piece in pieces] == [True] * (count - 1) + [False]
    assert len({piece.id for piece in pieces}) == 1
    assert pieces[0].id != 0


# --- the wire ---


def test_datagrams_are_whole_small_and_without_gaps(moving: ForeignPilot) -> None:
    reader = mavlink.MAVLink(None)  # not robust: raises for a bad byte
    sequence = []
    for datagram in moving.datagrams:
        assert 0 < len(datagram) <= DATAGRAM_BYTES
        sequence += [message.get_msgbuf()[4] for message in reader.parse_buffer(datagram)]
    assert reader.buf_len() == 0
    assert sequence == [k % 256 for k in range(len(sequence))]


def test_garbage_is_ignored() -> None:
    pilot = ForeignPilot()
    rng = np.random.default_rng(6)
    for _ in range(200):
        pilot.vehicle.receive(rng.bytes(int(rng.integers(0, 400))))
        frame = bytearray(mavlink.MAVLink_ping_message(1, 1, 0, 0).pack(mavlink.MAVLink(None, 1, 191)))
        frame[int(rng.integers(0, len(frame)))] ^= 0x41
        pilot.vehicle.receive(bytes(frame))
    pilot.fly(0.1)
    assert not pilot.all("PING")
    assert pilot.arm() == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def flight_digest(seed: int) -> str:
    pilot = ForeignPilot(world_with_wall(12.0), seed=seed, lockstep=True, all_streams=True)
    pilot.take_off()
    pilot.go_offboard()
    pilot.fly(1.0, lambda: pilot.attitude(FORWARD))
    return hashlib.sha256(b"".join(pilot.datagrams)).hexdigest()


def test_same_seed_same_bytes() -> None:
    assert flight_digest(1) == flight_digest(1) != flight_digest(2)


def test_the_world_may_be_empty() -> None:
    pilot = ForeignPilot(EMPTY, all_streams=True)
    pilot.take_off()
    assert pilot.vehicle.summary().least_clearance_m is None
