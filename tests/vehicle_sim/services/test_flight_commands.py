"""Commands that fly, beside those that the tests of the modes give; what lists the modes."""

import math
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.dialects.v20 import development

from protocol.framing import Framer
from protocol.messages import decode
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, HOLD, OFFBOARD, RETURN, UNSET, ForeignPilot
from tests.vehicle_sim.mission_uploader import RELATIVE, at, upload
from vehicle_sim.autopilot.modes import Mode

ACCEPTED, REJECTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
DENIED, FAILED = mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
WAYPOINT = mavlink.MAV_CMD_NAV_WAYPOINT


@pytest.fixture
def pilot() -> ForeignPilot:
    return ForeignPilot()


@pytest.fixture
def aloft() -> ForeignPilot:
    pilot = ForeignPilot()
    pilot.take_off()
    return pilot


def test_pymavlinks_table_of_px4_modes_is_obeyed_and_read_back(pilot: ForeignPilot) -> None:
    names = {"MANUAL", "STABILIZED", "ACRO", "ALTCTL", "POSCTL", "LOITER", "MISSION", "RTL", "OFFBOARD", "TAKEOFF"}
    for name, (base_mode, main, sub) in mavutil.px4_map.items():
        if name in names:
            assert pilot.command(mavlink.MAV_CMD_DO_SET_MODE, base_mode, main, sub) == ACCEPTED, name
            assert mavutil.mode_string_v10(pilot.last("HEARTBEAT")) == name
    assert len(names & mavutil.px4_map.keys()) == len(names)


def test_set_mode_is_answered_as_its_command(pilot: ForeignPilot) -> None:
    for base_mode, custom_mode, mode in (
        (1, OFFBOARD, OFFBOARD),
        (64 | 8, 0, 3 << 16),
        (4, 0, Mode.MISSION.custom_mode),
    ):
        before = pilot.time_s
        pilot.send(mavlink.MAVLink_set_mode_message(1, base_mode, custom_mode))
        pilot.fly(0.004)
        (ack,) = pilot.all("COMMAND_ACK", before)
        assert (ack.command, ack.result) == (mavlink.MAV_CMD_DO_SET_MODE, ACCEPTED)
        assert pilot.mode == mode


def test_what_speaks_against_arming_is_said_on_request(pilot: ForeignPilot) -> None:
    checks = mavlink.MAV_CMD_RUN_PREARM_CHECKS
    assert pilot.command(checks) == ACCEPTED and pilot.texts == ["Preflight Fail: estimator is starting"]
    pilot.fly(1.2)
    assert pilot.command(checks) == ACCEPTED and len(pilot.texts) == 1


def test_parameters_are_reset_on_the_ground_alone(pilot: ForeignPilot) -> None:
    storage, parameters = mavlink.MAV_CMD_PREFLIGHT_STORAGE, pilot.vehicle.parameters
    first, facts = parameters["MPC_XY_CRUISE"], (parameters["MAV_SYS_ID"], parameters["MPC_THR_HOVER"])
    before = parameters.checksum()
    assert parameters.set("MPC_XY_CRUISE", 4.0) is None and parameters.set("SYS_AUTOSTART", 4001) is None
    assert [pilot.command(storage, each) for each in (0, 1)] == [ACCEPTED] * 2
    assert parameters["MPC_XY_CRUISE"] == 4.0
    pilot.fly(1.2)
    pilot.arm()
    assert pilot.command(storage, 2) == REJECTED and parameters["MPC_XY_CRUISE"] == 4.0
    pilot.disarm()
    assert pilot.command(storage, 2) == ACCEPTED
    assert parameters["MPC_XY_CRUISE"] == first and parameters.checksum() == before
    assert (parameters["MAV_SYS_ID"], parameters["MPC_THR_HOVER"]) == facts
    assert pilot.command(storage, 3) == DENIED


def test_the_version_of_the_protocol(pilot: ForeignPilot) -> None:
    for command in (mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION, mavlink.MAV_CMD_REQUEST_MESSAGE):
        assert pilot.command(command, 300) == ACCEPTED
        version: Any = next(decode(f) for f in Framer().feed(pilot.datagrams[-1]) if f.message_id == 300)
        assert (version.version, version.min_version) == (200, 100)


def test_standard_modes(pilot: ForeignPilot) -> None:
    standard = mavlink.MAV_CMD_DO_SET_STANDARD_MODE
    assert pilot.command(standard, 5) == ACCEPTED and pilot.mode == RETURN
    assert pilot.command(standard, 1) == ACCEPTED and pilot.mode == Mode.POSITION.custom_mode
    assert pilot.command(standard, 3) == FAILED
    assert pilot.command(standard, UNSET) == FAILED


def test_modes_are_listed_and_the_current_one_is_told(pilot: ForeignPilot) -> None:
    listed = [mode for mode in Mode if mode is not Mode.DESCEND]
    pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 435, 0)
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 435, 2) == ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 435, len(listed) + 1) == DENIED
    pilot.set_mode(RETURN)
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 436) == ACCEPTED
    reader = development.MAVLink(None)
    told = [m for datagram in pilot.datagrams for m in reader.parse_buffer(datagram) or []]
    modes = [m for m in told if m.get_type() == "AVAILABLE_MODES"]
    assert [m.mode_index for m in modes] == [*range(1, len(listed) + 1), 2]
    assert {m.number_modes for m in modes} == {len(listed)}
    assert {m.custom_mode: (m.standard_mode, m.mode_name) for m in modes} == {
        mode.custom_mode: (mode.standard, "" if mode.standard else mode.label) for mode in listed
    }
    assert {m.custom_mode for m in modes if m.properties & 2} == {Mode.TERMINATION.custom_mode}
    current = [m for m in told if m.get_type() == "CURRENT_MODE"][-1]
    assert (current.standard_mode, current.custom_mode, current.intended_custom_mode) == (5, RETURN, RETURN)


def test_speed_altitude_and_home(aloft: ForeignPilot) -> None:
    sea_m = EMPTY.origin[2]
    assert aloft.command(mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, sea_m + 5.0, mavlink.MAV_FRAME_GLOBAL) == ACCEPTED
    aloft.fly(5.0)
    assert aloft.height == pytest.approx(5.0, abs=0.1)
    assert aloft.command(mavlink.MAV_CMD_DO_SET_HOME, 1) == ACCEPTED
    assert aloft.vehicle.flight.home_ned == pytest.approx(aloft.vehicle.motion.position_ned, abs=0.01)
    _, _, _, x, y, _ = at(0, 7.0, 0.0, 0.0)
    place = (x * 1e-7, y * 1e-7)
    assert aloft.command(mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, *place, UNSET) == DENIED
    assert aloft.command(mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, *place, sea_m) == ACCEPTED
    # a COMMAND_LONG has places in 32 bits: a metre or two
    assert aloft.vehicle.flight.home_ned == pytest.approx((7.0, 0.0, 0.0), abs=2.0)
    assert aloft.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, UNSET, *at_degrees(40.0), UNSET) == ACCEPTED
    assert aloft.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 2.0, -1) == ACCEPTED
    aloft.fly(3.0)
    assert 1.5 < math.hypot(*aloft.vehicle.motion.velocity_ned[:2]) < 2.05
    assert aloft.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, -1, -1) == ACCEPTED
    aloft.fly(2.5)
    assert math.hypot(*aloft.vehicle.motion.velocity_ned[:2]) > 3.0


@pytest.mark.parametrize("frame", [mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT])
def test_orbits_and_homes_have_altitudes_above_the_sea_in_any_frame(aloft: ForeignPilot, frame: int) -> None:
    """MAVSDK sends the one with the frame of the other, and PX4 does not look at it."""
    _, _, _, x, y, _ = at(0, 3.0, 4.0, 0.0)
    sea_m = EMPTY.origin[2]
    for command, params in ((mavlink.MAV_CMD_DO_ORBIT, (5.0, 1.0)), (mavlink.MAV_CMD_DO_SET_HOME, (0.0, 0.0))):
        aloft.send(
            mavlink.MAVLink_command_int_message(1, 1, frame, command, 0, 0, *params, 0.0, UNSET, x, y, sea_m + 6.0)
        )
        aloft.fly(0.004)
        assert aloft.last("COMMAND_ACK").result == ACCEPTED
    circle = aloft.vehicle.flight.guidance.circle
    assert circle is not None and circle.center_ned == pytest.approx((3.0, 4.0, -6.0), abs=0.02)
    assert aloft.vehicle.flight.home_ned == pytest.approx((3.0, 4.0, -6.0), abs=0.02)


@pytest.mark.parametrize("home_m", [-10.0, 10.0])
def test_takeoff_to_an_altitude_above_the_sea_wherever_home_was_set(pilot: ForeignPilot, home_m: float) -> None:
    pilot.fly(1.2)
    latitude, longitude, sea_m = EMPTY.origin
    home = math.degrees(latitude), math.degrees(longitude), sea_m + home_m
    assert pilot.command(mavlink.MAV_CMD_DO_SET_HOME, 0, UNSET, UNSET, UNSET, *home) == ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 6, sea_m + 4.0) == ACCEPTED
    pilot.arm()
    pilot.fly(8.0)
    assert pilot.height == pytest.approx(4.0, abs=0.02)


def at_degrees(north: float) -> tuple[float, float]:
    _, _, _, x, y, _ = at(0, north, 0.0, 0.0)
    return x * 1e-7, y * 1e-7


def test_pause_and_continue(aloft: ForeignPilot) -> None:
    assert aloft.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == REJECTED, "there is no mission"
    aloft.set_mode(RETURN)
    assert aloft.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED and aloft.mode == HOLD


def test_termination_is_the_end(aloft: ForeignPilot) -> None:
    end = mavlink.MAV_CMD_DO_FLIGHTTERMINATION
    assert ForeignPilot().command(end, 1) == DENIED, "only armed"
    assert aloft.command(end, 0) == DENIED
    assert aloft.command(end, 1) == ACCEPTED
    assert aloft.mode == Mode.TERMINATION.custom_mode
    assert aloft.set_mode(HOLD) == REJECTED
    assert aloft.command(mavlink.MAV_CMD_NAV_TAKEOFF, *(UNSET,) * 7) == REJECTED
    assert aloft.fly(3.0, until=lambda: aloft.vehicle.flight.crash is not None)
    assert AIRFRAME.ground.crash_speed_m_s < aloft.vehicle.motion.impact_m_s


@pytest.mark.parametrize("action", [1, 2])
def test_a_reboot_ends_the_program_of_a_disarmed_vehicle(pilot: ForeignPilot, action: int) -> None:
    reboot = mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
    pilot.fly(1.1)
    pilot.arm()
    assert pilot.command(reboot, action) == DENIED
    pilot.disarm()
    assert pilot.command(reboot, 0) == ACCEPTED
    assert pilot.command(reboot, 4) == DENIED
    assert not pilot.vehicle.ended
    assert pilot.command(reboot, action) == ACCEPTED
    assert pilot.vehicle.ended


def test_the_nose_points_at_what_is_of_interest_in_hold_and_in_a_mission() -> None:
    pilot = ForeignPilot()
    pilot.take_off()
    east = at(WAYPOINT, 0.0, 50.0, 0.0)[3:5]
    roi = mavlink.MAV_CMD_DO_SET_ROI_LOCATION
    pilot.send(mavlink.MAVLink_command_int_message(1, 1, RELATIVE, roi, 0, 0, *(UNSET,) * 4, *east, 0.0))
    pilot.fly(4.0)
    assert pilot.last("COMMAND_ACK").result == ACCEPTED
    assert pilot.vehicle.motion.yaw == pytest.approx(math.pi / 2.0, abs=0.02)
    assert upload(pilot, [at(WAYPOINT, 100.0, 0.0, 3.0)]) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_DO_SET_ROI, 3, 0, 0, 0, east[0] * 1e-7, east[1] * 1e-7, 0) == ACCEPTED
    assert pilot.set_mode(Mode.MISSION.custom_mode) == ACCEPTED
    pilot.fly(4.0)
    north = pilot.vehicle.motion.position_ned[0]
    assert north > 2.0 and pilot.vehicle.motion.yaw == pytest.approx(math.atan2(50.0, -north), abs=0.05)
    assert pilot.command(mavlink.MAV_CMD_DO_SET_ROI_NONE) == ACCEPTED
    assert pilot.fly(4.0, until=lambda: abs(pilot.vehicle.motion.yaw) < 0.1)
    assert pilot.command(mavlink.MAV_CMD_DO_SET_ROI, 1) == DENIED
    assert pilot.command(roi, *(UNSET,) * 7) == DENIED


REFUSED = (
    (mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 99),
    (mavlink.MAV_CMD_DO_SET_MODE, UNSET, 4, 2),
    (mavlink.MAV_CMD_DO_SET_STANDARD_MODE, 99),
    (mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, -9),
    (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 7),
    (mavlink.MAV_CMD_DO_REPOSITION, -1, 0),
    (mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, UNSET, UNSET, UNSET, 10),
    (mavlink.MAV_CMD_DO_ORBIT, 5, 1, 0, 0, 95, 200, 10),
    (mavlink.MAV_CMD_DO_CHANGE_ALTITUDE, 10, 3),
    (mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, 95, 0, 0),
    (mavlink.MAV_CMD_DO_SET_HOME, 0, 0, 0, 0, 10, 10, 0),
    (mavlink.MAV_CMD_MISSION_START, 0, 0),
    (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 5),
    (mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 2),
    (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1),
    (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0),
    (mavlink.MAV_CMD_DO_GRIPPER, 1, 9),
    (mavlink.MAV_CMD_DO_SET_ROI, 2),
    (mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0, 0, 0, 0, 95, 0, 0),
    (mavlink.MAV_CMD_INJECT_FAILURE, 99, 0, 0),
    (mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 9),
    (mavlink.MAV_CMD_PREFLIGHT_STORAGE, 9),
    (mavlink.MAV_CMD_PREFLIGHT_CALIBRATION, 1),
)
"""Commands that a vehicle at rest on its pad refuses."""


def test_each_refusal_comes_with_a_text() -> None:
    pilot = ForeignPilot()
    pilot.fly(1.2)
    for number, *params in REFUSED:
        before = pilot.time_s
        assert pilot.command(number, *params) != ACCEPTED, number
        assert len(pilot.all("STATUSTEXT", before)) == 1, number
    before = pilot.time_s
    assert pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU) == DENIED
    assert not pilot.all("STATUSTEXT", before), "a question"
    commands = pilot.vehicle._services._commands._commands
    always = {
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES,
        mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION,
        mavlink.MAV_CMD_GET_HOME_POSITION,
        mavlink.MAV_CMD_RUN_PREARM_CHECKS,
    }
    asked = {
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
        mavlink.MAV_CMD_REQUEST_MESSAGE,
    }
    assert commands.keys() == {row[0] for row in REFUSED} - {mavlink.MAV_CMD_PREFLIGHT_CALIBRATION} | always | asked


def test_a_reboot_and_an_injected_failure_are_refused_with_their_reasons(aloft: ForeignPilot) -> None:
    assert aloft.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1) == DENIED
    assert aloft.texts[-1] == "Shutdown rejected: armed"
    aloft.vehicle.parameters.set("SYS_FAILURE_EN", 0)
    assert aloft.command(mavlink.MAV_CMD_INJECT_FAILURE, 101, 1, 0) == DENIED
    assert aloft.texts[-1] == "Failure injection rejected: SYS_FAILURE_EN is 0"
