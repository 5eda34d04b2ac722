"""The shell behind SERIAL_CONTROL."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import ForeignPilot
from vehicle_sim.services.shell import PROMPT

SHELL, RESPOND = mavlink.SERIAL_CONTROL_DEV_SHELL, mavlink.SERIAL_CONTROL_FLAG_RESPOND


def type_in(pilot: ForeignPilot, text: str, device: int = SHELL, flags: int = RESPOND) -> list[bytes]:
    """The pieces of the answer, which must come with the next tick."""
    before, data = pilot.time_s, text.encode()
    pilot.send(mavlink.MAVLink_serial_control_message(device, flags, 0, 0, len(data), list(data.ljust(70, b"\0"))))
    pilot.fly(0.004)
    answers = pilot.all("SERIAL_CONTROL", before)
    assert all(each.flags == mavlink.SERIAL_CONTROL_FLAG_REPLY and each.device == device for each in answers)
    return [bytes(each.data[: each.count]) for each in answers]


def run(pilot: ForeignPilot, line: str) -> str:
    text = b"".join(type_in(pilot, line + "\n")).decode()
    assert text.endswith(f"\n{PROMPT}")
    return text.removesuffix(f"\n{PROMPT}")


def test_parameters_are_shown_and_set_and_what_is_unknown_is_said() -> None:
    pilot = ForeignPilot()
    assert (
        run(pilot, "param show MIS_TAKEOFF_ALT") == f"MIS_TAKEOFF_ALT : {pilot.vehicle.parameters['MIS_TAKEOFF_ALT']:g}"
    )
    assert run(pilot, "param set MIS_TAKEOFF_ALT 4.5") == "MIS_TAKEOFF_ALT : 4.5"
    assert run(pilot, "param set COM_OBL_RC_ACT 3") == "COM_OBL_RC_ACT : 3"
    assert pilot.vehicle.parameters["MIS_TAKEOFF_ALT"] == 4.5 and pilot.vehicle.parameters["COM_OBL_RC_ACT"] == 3
    assert run(pilot, "param set COM_OF_LOSS_T 99") == "COM_OF_LOSS_T: value out of range"
    assert run(pilot, "param set MAV_SYS_ID 9") == "MAV_SYS_ID: read only"
    assert run(pilot, "param set COM_OF_LOSS_T soon") == "COM_OF_LOSS_T: soon is no value"
    assert run(pilot, "param show CAL_ACC0_ID") == "CAL_ACC0_ID : 1310988"
    assert run(pilot, "param show NO_SUCH") == "NO_SUCH: no such parameter"
    assert run(pilot, "top") == "top: command not found, try help"
    assert "1.16" in run(pilot, "ver all")


@pytest.mark.parametrize("assignment", ["SYS_HAS_MAG 99999999999", "SYS_PARAM_VER 2147483648", "BAT1_V_CHARGED -1e300"])
def test_a_value_that_no_message_can_tell_is_out_of_range(assignment: str) -> None:
    pilot = ForeignPilot()
    name, before = assignment.split()[0], pilot.vehicle.parameters.checksum()
    assert run(pilot, f"param set {assignment}") == f"{name}: value out of range"
    assert pilot.vehicle.parameters.checksum() == before
    assert run(pilot, "param set BAT1_V_CHARGED 3.4028234663852886e38").startswith("BAT1_V_CHARGED : 3.4")
    pilot.send(mavlink.MAVLink_param_request_list_message(1, 1))
    pilot.fly(0.5)
    assert len(pilot.all("PARAM_VALUE")) == len(pilot.vehicle.parameters.names) + 2, "the change, the hash, and all"


def test_a_list_is_cut_where_it_says_so() -> None:
    pilot = ForeignPilot()
    lines = run(pilot, "param show").splitlines()
    assert len(lines) == 61 and f"... {len(pilot.vehicle.parameters.names) - 60} more" in lines[-1]
    assert all(line.startswith("GF_") for line in run(pilot, "param show GF_*").splitlines())


def test_a_line_comes_in_pieces_and_an_empty_one_asks_for_the_prompt() -> None:
    pilot = ForeignPilot()
    assert type_in(pilot, "par") == [] and type_in(pilot, "am") == []
    assert b"param set" in b"".join(type_in(pilot, "\r"))
    assert type_in(pilot, "\n") == [PROMPT.encode()]


def test_other_ports_are_empty_and_answers_are_not_answered() -> None:
    pilot = ForeignPilot()
    assert type_in(pilot, "help\n", device=mavlink.SERIAL_CONTROL_DEV_GPS1) == [b""]
    assert type_in(pilot, "help\n", flags=mavlink.SERIAL_CONTROL_FLAG_REPLY) == []


@pytest.mark.parametrize("text", ["\0\0\0\n", "x" * 70, "\x7f\x80\n"])
def test_nothing_that_is_typed_ends_it(text: str) -> None:
    pilot = ForeignPilot()
    for _ in range(10):
        type_in(pilot, text[:70])
    assert b"param show" in b"".join(type_in(pilot, "\nhelp\n"))
