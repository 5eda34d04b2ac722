"""AUTOPILOT_VERSION says what is served: for each bit of the dialect, a question whose answer shows it."""

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import OFFBOARD, ForeignPilot
from vehicle_sim.services.identity import Identity

OLD, NEW = Identity(firmware=(1, 13)), Identity()
MISSION, FENCE, RALLY = (
    mavlink.MAV_MISSION_TYPE_MISSION,
    mavlink.MAV_MISSION_TYPE_FENCE,
    mavlink.MAV_MISSION_TYPE_RALLY,
)


def answers(question: object, *names: str) -> Callable[[ForeignPilot], bool]:
    """Whether one of these messages comes within half a second."""

    def holds(pilot: ForeignPilot) -> bool:
        before = pilot.time_s
        pilot.send(question)
        pilot.fly(0.5)
        return any(pilot.all(name, before) for name in names)

    return holds


def follows(setpoint: object) -> Callable[[ForeignPilot], bool]:
    """Whether a stream of this setpoint opens OFFBOARD, and not another one."""

    def holds(pilot: ForeignPilot) -> bool:
        pilot.take_off()
        pilot.fly(1.1, lambda: pilot.send(setpoint))
        pilot.set_mode(OFFBOARD)
        pilot.fly(0.1, lambda: pilot.send(setpoint))
        return pilot.mode == OFFBOARD

    return holds


def takes(mission_type: int) -> Callable[[ForeignPilot], bool]:
    return answers(mavlink.MAVLink_mission_count_message(1, 1, 1, mission_type), "MISSION_REQUEST_INT")


def executes(command: int, *params: float) -> Callable[[ForeignPilot], bool]:
    """Whether a command is known."""
    return lambda pilot: pilot.command(command, *params) != mavlink.MAV_RESULT_UNSUPPORTED


def floats_in_missions(pilot: ForeignPilot) -> bool:
    return answers(mavlink.MAVLink_mission_request_message(1, 1, 0, MISSION), "MISSION_ITEM")(pilot)


def integers_bytewise(pilot: ForeignPilot) -> bool:
    pilot.send(mavlink.MAVLink_param_request_read_message(1, 1, b"SYS_AUTOSTART", -1))
    pilot.fly(0.02)
    message = pilot.last("PARAM_VALUE")
    sent = int.from_bytes(message.get_msgbuf()[10:14], "little")
    return bool(sent == pilot.vehicle.parameters["SYS_AUTOSTART"] != round(message.param_value))


def never(_: ForeignPilot) -> bool:
    """No question of the dialect shows it, and this vehicle does not have it."""
    return False


LEVEL = [1.0, 0.0, 0.0, 0.0]
FTP = mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [1, 0, 0, 3] + [0] * 247)
POSITION = (0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0xDF8, 0.0, 0.0, -2.5, *(0.0,) * 8)
GLOBAL = (0, 1, 1, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 0xDF8, 470000000, 80000000, 2.5, *(0.0,) * 8)
PROBES: dict[str, Callable[[ForeignPilot], bool]] = {
    "MISSION_FLOAT": floats_in_missions,
    "PARAM_FLOAT": never,
    "MISSION_INT": takes(MISSION),
    "COMMAND_INT": answers(
        mavlink.MAVLink_command_int_message(1, 1, 0, 31010, 0, 0, *(0.0,) * 4, 0, 0, 0.0), "COMMAND_ACK"
    ),
    "PARAM_ENCODE_BYTEWISE": integers_bytewise,
    "FTP": answers(FTP, "FILE_TRANSFER_PROTOCOL"),
    "SET_ATTITUDE_TARGET": follows(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, LEVEL, 0, 0, 0, 0.5)),
    "SET_POSITION_TARGET_LOCAL_NED": follows(mavlink.MAVLink_set_position_target_local_ned_message(*POSITION)),
    "SET_POSITION_TARGET_GLOBAL_INT": follows(mavlink.MAVLink_set_position_target_global_int_message(*GLOBAL)),
    "TERRAIN": never,
    "RESERVED3": follows(
        mavlink.MAVLink_set_actuator_control_target_message(0, 0, 1, 1, [0.0, 0.0, 0.0, 0.475, 0, 0, 0, 0])
    ),
    "FLIGHT_TERMINATION": executes(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0),
    "COMPASS_CALIBRATION": executes(mavlink.MAV_CMD_DO_START_MAG_CAL),
    "MAVLINK2": lambda pilot: pilot.fly(0.02) or pilot.datagrams[-1][0] == 0xFD,
    "MISSION_FENCE": takes(FENCE),
    "MISSION_RALLY": takes(RALLY),
    "RESERVED2": never,
    "PARAM_ENCODE_C_CAST": never,
    "COMPONENT_IMPLEMENTS_GIMBAL_MANAGER": never,
    "COMPONENT_ACCEPTS_GCS_CONTROL": never,
    "GRIPPER": executes(mavlink.MAV_CMD_DO_GRIPPER, 1, 0),
}
PREFIX = "MAV_PROTOCOL_CAPABILITY_"
BITS = {
    entry.name.removeprefix(PREFIX): bit
    for bit, entry in mavlink.enums["MAV_PROTOCOL_CAPABILITY"].items()
    if not entry.name.endswith("ENUM_END")
}


def capabilities(pilot: ForeignPilot) -> int:
    pilot.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    return int(pilot.last("AUTOPILOT_VERSION").capabilities)


def test_every_bit_has_a_question() -> None:
    assert PROBES.keys() == BITS.keys()


@pytest.mark.parametrize("name", PROBES)
def test_a_bit_is_set_if_and_only_if_it_is_served(name: str) -> None:
    for identity in (OLD, NEW) if name == "RESERVED3" else (NEW,):
        pilot = ForeignPilot(identity=identity, all_streams=name == "MAVLINK2")
        claimed = bool(capabilities(pilot) & BITS[name])
        assert PROBES[name](pilot) is claimed, (name, identity)


def test_no_other_bit_is_set() -> None:
    assert capabilities(ForeignPilot()) & ~sum(BITS.values()) == 0


@pytest.mark.parametrize(("identity", "version", "torques"), [(OLD, 0x010D00FF, True), (NEW, 0x011000FF, False)])
def test_the_version_is_the_firmwares(identity: Identity, version: int, torques: bool) -> None:
    """PX4 1.13 is the last that takes actuator controls."""
    pilot = ForeignPilot(identity=identity)
    assert bool(capabilities(pilot) & BITS["RESERVED3"]) is torques
    assert pilot.last("AUTOPILOT_VERSION").flight_sw_version == version
