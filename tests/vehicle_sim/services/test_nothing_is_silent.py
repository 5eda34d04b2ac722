"""Every command and every request of the dialect is answered within half a second of the vehicle's time, also what it
does not serve."""

import itertools
import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import ForeignPilot
from vehicle_sim.services.refusals import AGAIN_TICKS, NO_REQUESTS

HALF_A_SECOND = 0.5
COMMANDS = sorted(number for number in mavlink.enums["MAV_CMD"] if number < mavlink.MAV_CMD_ENUM_END)
QUESTIONS = (
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_GET_MESSAGE_INTERVAL,
    mavlink.MAV_CMD_REQUEST_MESSAGE,
)
UNASKED = {"HEARTBEAT", "EXTENDED_SYS_STATE"}
"""What the vehicle says anyway, in these tests."""
SETPOINTS = {
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
    "RC_CHANNELS_OVERRIDE",
}
"""Obeyed; there is no answer to a stream."""
ENDS = {"MISSION_ACK", "LOG_REQUEST_END", "PING"}
"""The last word of an exchange. A PING to one receiver is an answer."""


def answered(pilot: ForeignPilot, question: Any) -> list[Any]:
    """What is said because of it, until half a second later."""
    before = pilot.time_s
    heard: list[Any] = []

    def hears() -> bool:
        heard.extend(m for name in pilot.received.keys() - UNASKED for m in pilot.all(name, before))
        return bool(heard)

    pilot.send(question)
    assert pilot.fly(HALF_A_SECOND, until=hears), f"no answer to {question}"
    return heard


@pytest.mark.parametrize("value", [0.0, math.nan, 1.0])
def test_every_command(value: float) -> None:
    """By each of its messages; a refusal says why."""
    pilot = ForeignPilot()
    for number, whole in itertools.product(COMMANDS, (False, True)):
        if number == mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN and value == 1.0:
            continue  # it ends the vehicle
        if whole:
            question: Any = mavlink.MAVLink_command_int_message(1, 1, 6, number, 0, 0, *(value,) * 4, 0, 0, value)
        else:
            question = mavlink.MAVLink_command_long_message(1, 1, number, 0, *(value,) * 7)
        heard = answered(pilot, question)
        (ack,) = (each for each in heard if each.get_type() == "COMMAND_ACK")
        assert ack.command == number
        if ack.result != mavlink.MAV_RESULT_ACCEPTED and number not in QUESTIONS:
            assert any(each.get_type() == "STATUSTEXT" for each in heard), number


def test_every_message_that_can_be_asked_for() -> None:
    pilot = ForeignPilot()
    for number, command in itertools.product([*mavlink.mavlink_map, 300, 410, 435, 436, 437, 70_000], QUESTIONS):
        heard = answered(pilot, mavlink.MAVLink_command_long_message(1, 1, command, 0, number, *(0.0,) * 6))
        assert sum(each.get_type() == "COMMAND_ACK" for each in heard) == 1, (number, command)


def named(system: int) -> list[Any]:
    """Each message of the dialect that has one receiver, with nothing else in it."""
    found = []
    for message_class in mavlink.mavlink_map.values():
        types = dict(zip(message_class.ordered_fieldnames, message_class.array_lengths, strict=True))
        kinds = dict(zip(message_class.fieldnames, message_class.fieldtypes, strict=True))
        if "target_system" in message_class.fieldnames:
            blank = {
                name: b"" if kind == "char" else [0] * types[name] if types[name] else 0 for name, kind in kinds.items()
            }
            blank |= {"target_system": system} | ({"target_component": 1} if "target_component" in blank else {})
            found.append(message_class(**blank))
    return found


def test_every_message_to_the_vehicle() -> None:
    questions = [
        each for each in named(1) if each.get_type() not in SETPOINTS | ENDS and each.get_msgId() not in NO_REQUESTS
    ]
    assert len(questions) > 60
    for question in questions:
        answered(ForeignPilot(), question)


def test_what_is_for_others_is_left_to_them() -> None:
    pilot = ForeignPilot()
    for message in named(2):
        pilot.send(message)
    pilot.fly(HALF_A_SECOND)
    assert pilot.received.keys() == UNASKED


def test_what_is_no_request_has_no_answer() -> None:
    pilot = ForeignPilot()
    for message in named(1):
        if message.get_msgId() in NO_REQUESTS:
            pilot.send(message)
    pilot.fly(HALF_A_SECOND)
    assert pilot.received.keys() == UNASKED


def test_a_stream_of_what_is_not_served_has_a_text_a_second() -> None:
    pilot = ForeignPilot()
    for _ in range(3 * AGAIN_TICKS):
        pilot.send(mavlink.MAVLink_gps_inject_data_message(1, 1, 0, [0] * 110))
        pilot.fly(0.004)
    assert pilot.texts == ["GPS_INJECT_DATA is not supported"] * 3


def test_refusals_in_the_words_of_their_protocols() -> None:
    pilot = ForeignPilot()
    (ack,) = answered(pilot, mavlink.MAVLink_mission_request_partial_list_message(1, 1, 0, -1, 1))
    assert (ack.get_type(), ack.type, ack.mission_type) == ("MISSION_ACK", mavlink.MAV_MISSION_UNSUPPORTED, 1)
    (terrain,) = answered(pilot, mavlink.MAVLink_terrain_check_message(471234567, 81234567))
    assert (terrain.lat, terrain.lon, terrain.spacing) == (471234567, 81234567, 0), "unknown"
    (stream,) = answered(pilot, mavlink.MAVLink_request_data_stream_message(1, 1, 6, 4, 1))
    assert (stream.stream_id, stream.on_off) == (6, 0)
    (parameter,) = answered(pilot, mavlink.MAVLink_param_ext_set_message(1, 1, b"CAM_MODE", b"1", 1))
    assert (parameter.param_id, parameter.param_result) == ("CAM_MODE", mavlink.PARAM_ACK_VALUE_UNSUPPORTED)
    heard = answered(pilot, mavlink.MAVLink_set_gps_global_origin_message(1, 1, 2, 3))
    (origin,) = (each for each in heard if each.get_type() == "GPS_GLOBAL_ORIGIN")
    world = pilot.vehicle.world.origin
    assert (origin.latitude, origin.altitude) == (round(math.degrees(world[0]) * 1e7), round(world[2] * 1e3))
    assert pilot.texts == ["SET_GPS_GLOBAL_ORIGIN is not supported"]
