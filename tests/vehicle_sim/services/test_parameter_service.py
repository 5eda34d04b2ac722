"""The simulated vehicle's parameters, as an unmodified pymavlink reads them."""

import math
import struct
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.firmware.px4 import FIRMWARE
from protocol.messages import Encoder
from protocol.toml_files import ROOT
from protocol.vehicle_parameters import GRAVITY
from tests.vehicle_sim.foreign_pilot import AIRFRAME, EMPTY, HOLD, LAND, RETURN, ForeignPilot, airframe_with
from vehicle_sim.services.parameter_store import OBEYED, Parameters, Refusal
from vehicle_sim.services.parameter_table import TABLE
from vehicle_sim.vehicle import Vehicle

VEHICLE = Vehicle(AIRFRAME, EMPTY)
OUT = Encoder(255, 190)
INT32, REAL32 = mavlink.MAV_PARAM_TYPE_INT32, mavlink.MAV_PARAM_TYPE_REAL32
HASH = "_HASH_CHECK"


def raw(message: Any) -> bytes:
    """The value's four bytes; pymavlink's float would change some of them."""
    return bytes(message.get_msgbuf()[10:14])


def value(message: Any) -> float:
    """PX4's convention: an integer's bytes stand in the float."""
    if message.param_type == INT32:
        return float(struct.unpack("<i", raw(message))[0])
    assert message.param_type == REAL32
    return float(message.param_value)


def ask(pilot: ForeignPilot, name: bytes, index: int = -1, target: tuple[int, int] = (1, 1)) -> None:
    pilot.send(mavlink.MAVLink_param_request_read_message(*target, name, index))
    pilot.fly(0.02)


def listed(pilot: ForeignPilot) -> list[Any]:
    """The answers to one request for the list."""
    before = pilot.time_s
    pilot.send(mavlink.MAVLink_param_request_list_message(1, 1))
    pilot.fly(1.0)
    return pilot.all("PARAM_VALUE", before)


def put(pilot: ForeignPilot, name: bytes, number: float, kind: int = REAL32) -> Any:
    """Set one; the PARAM_ERROR or None, and the PARAM_VALUE that came, if any."""
    if kind == INT32:
        (number,) = struct.unpack("<f", struct.pack("<i", int(number)))
    before = pilot.time_s
    pilot.send(mavlink.MAVLink_param_set_message(1, 1, name, number, kind))
    pilot.fly(0.004)
    errors, values = pilot.all("PARAM_ERROR", before), pilot.all("PARAM_VALUE", before)
    return (errors[-1].error if errors else None), (value(values[-1]) if values else None)


def px4_hash(told: list[Any]) -> bytes:
    """PX4's parameters.cpp: a CRC-32 that starts at 0 and is not inverted, bit by bit."""
    crc = 0
    for message in told:
        if message.param_id == "COM_FLIGHT_UUID":
            continue
        for byte in message.param_id.encode() + raw(message):
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc.to_bytes(4, "little")


def test_what_it_does_is_what_its_parameters_say() -> None:
    pilot = ForeignPilot()
    first, *told = listed(pilot)
    assert (first.param_id, first.param_type, raw(first)) == (HASH, mavlink.MAV_PARAM_TYPE_UINT32, px4_hash(told))
    assert [each.param_index for each in told] == [*range(told[0].param_count)]
    assert [each.param_id for each in told] == sorted(TABLE)
    values = {each.param_id: value(each) for each in told}
    assert values["COM_OF_LOSS_T"] == 1.0 and values["COM_OBL_RC_ACT"] == 4 and values["COM_FAIL_ACT_T"] == 5.0
    assert values["COM_DISARM_LAND"] == 2.0 and values["COM_RCL_EXCEPT"] == 7
    assert values["NAV_DLL_ACT"] == 0 and values["MPC_XY_CRUISE"] == AIRFRAME.auto.cruise_speed_m_s
    assert values["MPC_THR_HOVER"] * AIRFRAME.body.max_thrust_n == pytest.approx(AIRFRAME.body.mass_kg * GRAVITY)
    tilt = math.radians(values["MPC_TILTMAX_AIR"])
    assert GRAVITY * math.tan(tilt) == pytest.approx(AIRFRAME.auto.acceleration_limit_m_s2)
    assert {name for question in FIRMWARE.parameters for name in question} <= set(values), "all that the companion asks"


def test_the_list_does_not_flood_a_link() -> None:
    pilot = ForeignPilot()
    pilot.datagrams.clear()
    listed(pilot)
    assert max(map(len, pilot.datagrams)) < 200
    times = pilot.times("PARAM_VALUE")
    assert times[-1] - times[0] == pytest.approx(len(TABLE) / 500.0, abs=0.01)


def test_a_ground_station_that_knows_the_hash_ends_the_list() -> None:
    pilot = ForeignPilot()
    pilot.send(mavlink.MAVLink_param_request_list_message(1, 1))
    pilot.fly(0.004)
    pilot.send(mavlink.MAVLink_param_set_message(1, 1, HASH.encode(), 0.0, mavlink.MAV_PARAM_TYPE_UINT32))
    pilot.fly(0.1)
    assert len(pilot.all("PARAM_VALUE")) == 2
    ask(pilot, HASH.encode())
    assert raw(pilot.last("PARAM_VALUE")) == raw(pilot.all("PARAM_VALUE")[0])


def test_one_is_read_by_name_or_by_index() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"COM_OF_LOSS_T")
    by_name = pilot.last("PARAM_VALUE")
    ask(pilot, b"", by_name.param_index)
    by_index = pilot.last("PARAM_VALUE")
    assert by_name.param_id == by_index.param_id == "COM_OF_LOSS_T" and value(by_index) == 1.0


def test_a_value_is_set_told_and_hashed() -> None:
    pilot = ForeignPilot()
    before = listed(pilot)[0]
    assert put(pilot, b"COM_DISARM_LAND", 3.5) == (None, 3.5)
    assert put(pilot, b"NAV_DLL_ACT", 3, INT32) == (None, 3)
    assert put(pilot, b"CAL_MAG0_ID", -2, INT32) == (None, -2)
    first, *told = listed(pilot)
    assert raw(first) == px4_hash(told) != raw(before)
    assert {each.param_id: value(each) for each in told}["COM_DISARM_LAND"] == 3.5


@pytest.mark.parametrize(
    ("name", "number", "kind", "refusal"),
    [
        (b"COM_DISARM_LAND", math.nan, REAL32, Refusal.VALUE_OUT_OF_RANGE),
        (b"COM_OF_LOSS_T", 61.0, REAL32, Refusal.VALUE_OUT_OF_RANGE),
        (b"COM_DL_LOSS_T", 4, INT32, Refusal.VALUE_OUT_OF_RANGE),
        (b"COM_OBL_RC_ACT", 6, INT32, Refusal.VALUE_OUT_OF_RANGE),
        (b"COM_OF_LOSS_T", 2, INT32, Refusal.TYPE_MISMATCH),
        (b"NAV_DLL_ACT", 2.0, REAL32, Refusal.TYPE_MISMATCH),
        (b"NAV_DLL_ACT", 2.0, mavlink.MAV_PARAM_TYPE_UINT8, Refusal.TYPE_MISMATCH),
        (b"MPC_THR_HOVER", 0.5, REAL32, Refusal.READ_ONLY),
    ],
)
def test_a_refusal_is_said_with_the_value_that_stays(name: bytes, number: float, kind: int, refusal: int) -> None:
    pilot = ForeignPilot()
    ask(pilot, name)
    before = value(pilot.last("PARAM_VALUE"))
    assert put(pilot, name, number, kind) == (refusal, before)


def test_every_limit_and_every_fact_can_be_set_as_a_message_has_it() -> None:
    """32 bits have no 0.2 and no 0.03: they come as a little more or less."""
    parameters = Vehicle(AIRFRAME, EMPTY).parameters
    for name, entry in TABLE.items():
        if entry.is_integer:
            continue
        numbers = [parameters[name]] if parameters.is_fact(name) else [entry.least, entry.most]
        for number in numbers:
            if number is not None:
                assert parameters.set(name, struct.unpack("<f", struct.pack("<f", number))[0]) is None, name
                assert parameters.set(name, float(number)) is None, name
    assert parameters.set("BAT_LOW_THR", 0.1199999) is Refusal.VALUE_OUT_OF_RANGE


def test_a_reset_brings_back_what_the_vehicles_file_has_beyond_the_limits() -> None:
    airframe = airframe_with("auto.land_speed_m_s=0.4")
    assert (TABLE["MPC_LAND_SPEED"].least or 0.0) > 0.4
    parameters = Vehicle(airframe, EMPTY).parameters
    changes: list[bool] = []
    parameters.on_change = lambda: changes.append(True)
    assert parameters.set("MPC_LAND_SPEED", 0.8) is None
    assert parameters.reset() == ["MPC_LAND_SPEED"] and parameters["MPC_LAND_SPEED"] == 0.4
    assert len(changes) == 2 and parameters.reset() == []


def test_what_it_does_not_have_is_said() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"NOT_THERE")
    error = pilot.last("PARAM_ERROR")
    assert (error.param_id, error.error) == ("NOT_THERE", mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)
    ask(pilot, b"", len(TABLE))
    assert pilot.last("PARAM_ERROR").error == mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST
    assert put(pilot, b"NOT_THERE", 1.0) == (Refusal.DOES_NOT_EXIST, None)
    assert pilot.all("PARAM_VALUE") == []


def test_a_request_for_another_vehicle_is_not_answered() -> None:
    pilot = ForeignPilot()
    ask(pilot, b"COM_OF_LOSS_T", target=(2, 1))
    assert pilot.all("PARAM_VALUE") == [] and pilot.all("PARAM_ERROR") == []


@settings(max_examples=200, deadline=None)
@given(st.integers(-(2**31), 2**31 - 1))
def test_every_integer_keeps_its_bytes(number: int) -> None:
    """Also those whose bytes are a NaN that a copy between float registers would change."""
    vehicle = VEHICLE
    payload = struct.pack("<iBB16sB", number, 1, 1, b"CAL_ACC0_ID", INT32)
    vehicle.receive(OUT.encode_payload(mavlink.MAVLink_param_set_message, payload))
    assert vehicle.parameters["CAL_ACC0_ID"] == number
    (datagram,) = vehicle.collect(vehicle.channel)
    (answer,) = [m for m in mavlink.MAVLink(None).parse_buffer(datagram) if m.get_type() == "PARAM_VALUE"]
    assert raw(answer) == number.to_bytes(4, "little", signed=True)


def obeying() -> Iterator[tuple[str, float]]:
    """A value other than the default for each that something obeys."""
    for name, bound in OBEYED.items():
        if bound.choices:
            yield name, next(each for each in bound.choices if each != Vehicle(AIRFRAME, EMPTY).parameters[name])
        else:
            entry = TABLE[name]
            more = entry.default + (1 if entry.most is None else min(1, entry.most - entry.default))
            yield name, more if more != entry.default else entry.default - 1


def test_what_is_obeyed_reaches_the_autopilot_and_comes_back() -> None:
    for name, number in obeying():
        vehicle = Vehicle(AIRFRAME, EMPTY)
        parameters: Parameters = vehicle.parameters
        number = round(number) if parameters.is_integer(name) else number
        before = str(vehicle.flight.settings)
        assert parameters.set(name, number) is None
        assert parameters[name] == number, name
        assert str(vehicle.flight.settings) != before, name


def test_the_page_names_what_is_obeyed_and_what_is_fixed() -> None:
    parameters = Vehicle(AIRFRAME, EMPTY).parameters
    page = (ROOT / "docs" / "vehicle-sim.md").read_text(encoding="utf-8")
    fixed = [name for name in TABLE if parameters.set(name, parameters[name] + 1) is Refusal.READ_ONLY]
    assert {name for name in TABLE if f"`{name}`" in page} == {*OBEYED, *fixed}


@pytest.mark.parametrize(
    ("factor", "expected"),
    [(5.0, (50, 25.0, 5.0, 2.5)), (0.1, (5, 0.5, 0.1, 0.05)), (100.0, (300, 60.0, 60.0, 35.0))],
)
def test_a_peer_counts_as_lost_after_the_same_real_time_at_any_pace(factor: float, expected: tuple[float, ...]) -> None:
    """As far as their limits let it: COM_DL_LOSS_T can't be below 5 s, nor above 300 s."""
    parameters = Vehicle(AIRFRAME, EMPTY).parameters
    parameters.scale_losses(factor)
    names = "COM_DL_LOSS_T", "COM_OBC_LOSS_T", "COM_OF_LOSS_T", "COM_RC_LOSS_T"
    assert tuple(parameters[name] for name in names) == pytest.approx(expected)
    parameters.reset()
    assert tuple(parameters[name] for name in names) == pytest.approx(expected)


def test_a_shorter_stream_loss_and_a_return_are_flown() -> None:
    pilot = ForeignPilot()
    put(pilot, b"MIS_TAKEOFF_ALT", 4.0)
    put(pilot, b"COM_OF_LOSS_T", 0.6)
    put(pilot, b"COM_FAIL_ACT_T", 0.5)
    put(pilot, b"COM_OBL_RC_ACT", 3, INT32)
    pilot.take_off()
    assert pilot.height == pytest.approx(4.0, abs=0.3)
    pilot.go_offboard()
    lost_s = pilot.time_s
    assert pilot.fly(1.0, until=lambda: pilot.mode == HOLD)
    assert pilot.time_s - lost_s == pytest.approx(0.6, abs=0.02)
    assert pilot.fly(1.0, until=lambda: pilot.mode == RETURN)
    assert pilot.time_s - lost_s == pytest.approx(1.1, abs=0.02)


def test_a_silent_user_is_not_landed_unless_asked_to() -> None:
    pilot = ForeignPilot()
    pilot.take_off()
    pilot.present = False
    assert not pilot.fly(12.0, until=lambda: pilot.mode != HOLD)
    put(pilot, b"NAV_DLL_ACT", 3, INT32)
    assert pilot.fly(0.1, until=lambda: pilot.mode == LAND)
