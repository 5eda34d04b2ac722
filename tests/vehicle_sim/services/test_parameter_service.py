"""The simulated vehicle's parameters, as an unmodified pymavlink reads them."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.firmware.px4 import FIRMWARE
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, ForeignPilot


def value(message: mavlink.MAVLink_param_value_message) -> float:
    """PX4's convention: an integer's bytes stand in the float."""
    if message.param_type == mavlink.MAV_PARAM_TYPE_INT32:
        return float(struct.unpack("<i", struct.pack("<f", message.param_value))[0])
    assert message.param_type == mavlink.MAV_PARAM_TYPE_REAL32
    return float(message.param_value)


def ask(pilot: ForeignPilot, name: bytes, index: int = -1, target: tuple[int, int] = (1, 1)) -> None:
    pilot.send(mavlink.MAVLink_param_request_read_message(*target, name, index))
    pilot.fly(0.02)


def test_what_it_does_is_what_its_parameters_say() -> None:
    pilot = ForeignPilot()
    pilot.send(mavlink.MAVLink_param_request_list_message(1, 1))
    pilot.fly(0.02)
    told = pilot.all("PARAM_VALUE")
    assert [each.param_index for each in told] == [*range(told[0].param_count)]
    assert [each.param_id for each in told] == sorted(each.param_id for each in told)
    values = {each.param_id: value(each) for each in told}
    assert values["COM_OF_LOSS_T"] == 1.0 and values["COM_OBL_RC_ACT"] == 4 and values["COM_FAIL_ACT_T"] == 5.0
    assert values["COM_DISARM_LAND"] == 2.0 and values["COM_RCL_EXCEPT"] == 7
    assert values["MPC_THR_HOVER"] * AIRFRAME.body.max_thrust_n == pytest.approx(AIRFRAME.body.mass_kg * GRAVITY)
    tilt = math.radians(values["MPC_TILTMAX_AIR"])
    assert GRAVITY * math.tan(tilt) == pytest.approx(AIRFRAME.auto.acceleration_limit_m_s2)
    assert {name for question in FIRMWARE.parameters for name in question} <= set(values), "all that the companion asks"


def test_one_is_read_by_name_or_by_index() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"COM_OF_LOSS_T")
    by_name = pilot.last("PARAM_VALUE")
    ask(pilot, b"", by_name.param_index)
    by_index = pilot.last("PARAM_VALUE")
    assert by_name.param_id == by_index.param_id == "COM_OF_LOSS_T" and value(by_index) == 1.0


def test_what_it_does_not_have_or_change_is_said() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"NOT_THERE")
    error = pilot.last("PARAM_ERROR")
    assert (error.param_id, error.error) == ("NOT_THERE", mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)
    pilot.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 9.0, mavlink.MAV_PARAM_TYPE_REAL32))
    pilot.fly(0.02)
    assert pilot.last("PARAM_ERROR").error == mavlink.MAV_PARAM_ERROR_READ_ONLY
    ask(pilot, b"COM_OF_LOSS_T")
    assert value(pilot.last("PARAM_VALUE")) == 1.0


def test_a_request_for_another_vehicle_is_not_answered() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"COM_OF_LOSS_T", target=(2, 1))
    assert pilot.all("PARAM_VALUE") == [] and pilot.all("PARAM_ERROR") == []
