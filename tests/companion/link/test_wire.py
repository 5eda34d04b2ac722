"""What comes from outside is taken whole or not at all; what goes out is what PX4 and ArduPilot obey."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from companion.link import wire, wire_ranges
from companion.link.refusals import RefusedError, RefusedRingError
from companion.link.vehicle_texts import vehicle_text
from companion.outputs import OUTPUTS
from companion.reports import BatteryReading, RangeBelow
from companion.state import BatteryLevel, Output, Setpoint
from protocol.arrays import Array
from protocol.frames import from_euler
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect


def through_the_wire(message_class: type[Any], *fields: Any) -> Any:
    """As a peer would decode it."""
    (frame,) = Framer().datagram(Encoder(1, 1).encode_fields(message_class, *fields))
    return decode(frame)


ATTITUDE = [dialect.MAVLink_attitude_quaternion_message, 1000, 1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3]
POSITION = [dialect.MAVLink_local_position_ned_message, 1000, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3]
EULER = [dialect.MAVLink_attitude_message, 1000, 0.1, -0.2, 3.0, 0.1, 0.2, 0.3]
READERS = [(ATTITUDE, wire.attitude_quaternion), (POSITION, wire.local_position), (EULER, wire.attitude)]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e30])
@pytest.mark.parametrize(("fields", "reader"), READERS)
def test_one_bad_value_refuses_the_message(fields: list[Any], reader: Callable[[Any], object], bad: float) -> None:
    reader(through_the_wire(*fields))
    for index in range(2, len(fields)):
        spoilt = [*fields]
        spoilt[index] = bad
        with pytest.raises(RefusedError, match=fields[0].msgname):
            reader(through_the_wire(*spoilt))


def test_quaternion_of_no_length_is_refused_and_a_rough_one_made_unit() -> None:
    for q in ((0.0, 0.0, 0.0, 0.0), (1.2, 0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.0)):
        with pytest.raises(RefusedError):
            wire.attitude_quaternion(through_the_wire(ATTITUDE[0], 0, *q, 0.0, 0.0, 0.0))
    report = wire.attitude_quaternion(through_the_wire(ATTITUDE[0], 7, 0.999, 0.0, 0.0, 0.01, 0.1, -0.2, 0.3))
    assert np.linalg.norm(report.attitude_ned_frd) == pytest.approx(1.0)
    assert np.allclose(report.rates_frd, [0.1, -0.2, 0.3])
    assert report.boot_time_ms == 7


def test_euler_angles_and_quaternion_agree() -> None:
    report = wire.attitude(through_the_wire(*EULER))
    assert np.allclose(report.attitude_ned_frd, from_euler(0.1, -0.2, 3.0), atol=1e-6)


NAN = math.nan
PX4_VARIANCES = [0.01, *[NAN] * 5, 0.02, *[NAN] * 4, 0.03, *[NAN] * 9]
"""As PX4 1.16 sends them, in the frame of the world; see tests/data/px4_offboard.tlog."""


def odometry(
    velocity_covariance: list[float],
    child: int = dialect.MAV_FRAME_LOCAL_NED,
    q: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0),
    kind: int = dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    quality: int = 0,
) -> Any:
    motion = (1.0, 2.0, -3.0, list(q), 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
    frames = 5_000_000, dialect.MAV_FRAME_LOCAL_NED, child
    return through_the_wire(
        dialect.MAVLink_odometry_message, *frames, *motion, [NAN] * 21, velocity_covariance, 7, kind, quality
    )


def upper(covariance: Array) -> list[float]:
    """The covariance of a velocity (3, 3), with rates that are certain, row by row."""
    whole = np.zeros((6, 6))
    whole[:3, :3] = covariance
    row: list[float] = whole[np.triu_indices(6)].tolist()
    return row


def variance_of(message: Any) -> list[float]:
    report = wire.odometry(message)
    assert report is not None and report.velocity_variance is not None and report.reset_counter == 7
    variance: list[float] = report.velocity_variance.tolist()
    return variance


def test_the_less_certain_horizontal_axis_counts_for_both() -> None:
    assert variance_of(odometry(PX4_VARIANCES)) == pytest.approx([0.02, 0.02, 0.03])


def test_a_velocity_of_the_body_is_as_certain_in_the_world_as_its_attitude_says() -> None:
    """Uncertain along the nose alone: which points up, or half north and half east."""
    nose = upper(np.diag([0.04, 0.0, 0.0]))
    body = dialect.MAV_FRAME_BODY_FRD
    up, aside = tuple(from_euler(0.0, math.pi / 2, 0.0)), tuple(from_euler(0.0, 0.0, math.pi / 4))
    assert variance_of(odometry(nose, body, up)) == pytest.approx([0.0, 0.0, 0.04], abs=1e-8)
    assert variance_of(odometry(nose, body, aside)) == pytest.approx([0.02, 0.02, 0.0], abs=1e-8)
    tied = upper(np.array(((0.02, 0.02, 0.0), (0.02, 0.02, 0.0), (0.0, 0.0, 0.01))))  # both axes err as one
    assert variance_of(odometry(tied, body, aside)) == pytest.approx([0.04, 0.04, 0.01], abs=1e-8)


def test_a_body_that_lies_on_two_axes_keeps_each_of_its_variances() -> None:
    """The nose points east, the right side down, and the belly north."""
    variances = upper(np.diag([0.01, 0.04, 0.02]))
    lying = variance_of(odometry(variances, dialect.MAV_FRAME_BODY_FRD, (0.5, 0.5, 0.5, 0.5)))
    assert lying == pytest.approx([0.02, 0.02, 0.04])


@pytest.mark.parametrize("unknown", [[0.0] * 21, [NAN] * 21, [NAN, *PX4_VARIANCES[1:]]])
def test_what_is_not_known_of_the_velocity_is_none(unknown: list[float]) -> None:
    report = wire.odometry(odometry(unknown))
    assert report is not None and report.velocity_variance is None and report.reset_counter == 7


def test_odometry_of_another_estimator_or_a_failed_one_is_none() -> None:
    assert wire.odometry(odometry(PX4_VARIANCES, kind=dialect.MAV_ESTIMATOR_TYPE_VIO)) is None
    assert wire.odometry(odometry(PX4_VARIANCES, quality=-1)) is None


@pytest.mark.parametrize(
    "message",
    [
        odometry([-0.01, *PX4_VARIANCES[1:]]),
        odometry([math.inf, *PX4_VARIANCES[1:]]),
        odometry([1e6, *PX4_VARIANCES[1:]]),
        odometry(PX4_VARIANCES, dialect.MAV_FRAME_LOCAL_ENU),
        odometry(PX4_VARIANCES, dialect.MAV_FRAME_BODY_FRD, (1.2, 0.0, 0.0, 0.0)),
        odometry(PX4_VARIANCES, dialect.MAV_FRAME_BODY_FRD, (NAN, 0.0, 0.0, 0.0)),
    ],
)
def test_odometry_that_can_not_be_is_refused_and_the_flight_goes_on(message: Any) -> None:
    with pytest.raises(RefusedError, match="ODOMETRY") as refused:
        wire.odometry(message)
    assert not refused.value.grave


def ring(distances: list[int], **changes: float) -> Any:
    fields = {"min": 20, "max": 1500, "f": 5.0, "offset": 0.0, "frame": 12} | changes
    return through_the_wire(
        dialect.MAVLink_obstacle_distance_message,
        5000,
        0,
        distances,
        5,
        fields["min"],
        fields["max"],
        fields["f"],
        fields["offset"],
        fields["frame"],
    )


def test_ring() -> None:
    distances = [1501] * 72
    distances[18], distances[36], distances[54] = 400, 65535, 1500
    scan = wire_ranges.obstacle_distance(ring(distances, offset=10.0), 99)
    assert scan.time_ns == 99 and scan.boot_time_us == 5000
    assert math.degrees(scan.bearings_frd[18]) == pytest.approx(100.0)
    assert (scan.ranges_m[18], scan.hit[18], scan.known[18]) == (4.0, True, True)
    assert (scan.hit[36], scan.known[36]) == (False, False)
    assert (scan.ranges_m[54], scan.hit[54]) == (15.0, True)
    assert (scan.ranges_m[0], scan.hit[0], scan.known[0]) == (15.0, False, True)


def test_a_ring_against_the_clock_is_turned_round() -> None:
    """So that the beam before another is the one to its left."""
    distances = [1501] * 72
    distances[18], distances[19] = 400, 65535
    scan = wire_ranges.obstacle_distance(ring(distances, f=-5.0, offset=10.0), 0)
    assert (np.diff(scan.bearings_frd) > 0.0).all()
    (at,) = np.flatnonzero(scan.hit)
    assert math.degrees(scan.bearings_frd[at]) == pytest.approx(-80.0) and scan.ranges_m[at] == 4.0
    (unknown,) = np.flatnonzero(~scan.known)
    assert math.degrees(scan.bearings_frd[unknown]) == pytest.approx(-85.0)


@pytest.mark.parametrize(
    "changes", [{"frame": 0}, {"f": math.nan}, {"offset": math.inf}, {"max": 10}, {"f": 400.0}], ids=str
)
def test_impossible_rings_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(RefusedError, match="OBSTACLE_DISTANCE"):
        wire_ranges.obstacle_distance(ring([500] * 72, **changes), 0)


SETPOINT = Setpoint([0.5, -0.5, 0.5, -0.5], [0.1, 0.2, 0.3], [-0.1, 0.2, 0.4], 0.45)


def test_setpoints() -> None:
    for output, mask in ((Output.ATTITUDE, 0x07), (Output.RATES, 0x80)):
        message = through_the_wire(*flat(OUTPUTS[output].encode(SETPOINT, 1234, (1, 1))))
        assert message.get_type() == "SET_ATTITUDE_TARGET"
        assert message.type_mask == mask
        assert message.q == [0.5, -0.5, 0.5, -0.5]
        rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
        assert rates == pytest.approx((0.1, 0.2, 0.3))
        assert message.thrust == pytest.approx(0.45)
    message = through_the_wire(*flat(OUTPUTS[Output.ACTUATORS].encode(SETPOINT, 1234, (1, 1))))
    assert message.get_type() == "SET_ACTUATOR_CONTROL_TARGET" and message.group_mlx == 0
    assert message.controls == pytest.approx([-0.1, 0.2, 0.4, 0.45, 0, 0, 0, 0])


def flat(message: tuple[type[Any], tuple[Any, ...]]) -> tuple[Any, ...]:
    return (message[0], *message[1])


def test_status_text_fits_its_field() -> None:
    (fields,) = wire.statustext_fields(4, "ä" + "long " * 30)
    assert len(fields[1]) == 50 and fields[1].isascii()


def test_a_vehicles_text_does_nothing_to_a_terminal() -> None:
    message = through_the_wire(dialect.MAVLink_statustext_message, 4, b"\x1b[2Jlow\r\nbattery")
    assert vehicle_text(message.text) == "?[2Jlow??battery"


def test_the_tab_by_which_px4_tells_of_an_event_is_no_part_of_a_text() -> None:
    assert vehicle_text("Disarmed by landing\t") == "Disarmed by landing"


BATTERY: dict[str, Any] = {
    "id": 0,
    "battery_function": dialect.MAV_BATTERY_FUNCTION_ALL,
    "type": dialect.MAV_BATTERY_TYPE_LIPO,
    "temperature": 32767,
    "voltages": (11_100, *(65535,) * 9),
    "current_battery": -1,
    "current_consumed": -1,
    "energy_consumed": -1,
    "battery_remaining": 42,
    "time_remaining": 0,
    "charge_state": dialect.MAV_BATTERY_CHARGE_STATE_OK,
    "voltages_ext": (0,) * 4,
    "mode": 0,
    "fault_bitmask": 0,
}


def battery(**changes: Any) -> BatteryReading:
    reading = wire.battery_status(
        through_the_wire(dialect.MAVLink_battery_status_message, *{**BATTERY, **changes}.values()), 7
    )
    assert reading is not None
    return reading


def test_a_battery_is_read_in_volts_and_shares() -> None:
    reading = battery(id=3)
    assert (reading.source, reading.time_ns, reading.level) == (3, 7, BatteryLevel.FINE)
    assert reading.charge == pytest.approx(0.42) and reading.volts == pytest.approx(11.1) and reading.cell_volts is None


def test_what_is_not_known_of_a_battery_is_none() -> None:
    assert battery(battery_remaining=-1).charge is None
    assert battery(battery_remaining=127).charge is None
    assert battery(voltages=(65535,) * 10).volts is None
    absent = battery(voltages=(0, *(65535,) * 9), battery_remaining=0)
    assert absent.charge is None and absent.volts is None


def test_the_lowest_cell_counts() -> None:
    cells = (3900, 3850, 3400, 3950, *(65535,) * 6)
    assert battery(voltages=cells).cell_volts == pytest.approx(3.4)
    assert battery(voltages=(4000,) * 10, voltages_ext=(3900, 3100, 0, 0)).cell_volts == pytest.approx(3.1)
    high = battery(voltages=(65534, 2000, *(65535,) * 8))
    assert high.volts == pytest.approx(67.534) and high.cell_volts is None


STATES = {
    dialect.MAV_BATTERY_CHARGE_STATE_UNDEFINED: BatteryLevel.FINE,
    dialect.MAV_BATTERY_CHARGE_STATE_LOW: BatteryLevel.WARN,
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL: BatteryLevel.RETURN,
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY: BatteryLevel.LAND,
    dialect.MAV_BATTERY_CHARGE_STATE_FAILED: BatteryLevel.LAND,
    dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY: BatteryLevel.RETURN,
    99: BatteryLevel.FINE,
}


@pytest.mark.parametrize("state", STATES)
def test_the_state_of_a_battery_calls_for_something(state: int) -> None:
    reading = battery(charge_state=state)
    assert reading.level is STATES[state] and bool(reading.condition) is bool(reading.level)


@pytest.mark.parametrize("bit", [1 << bit for bit in range(12)])
def test_a_fault_of_a_battery_is_worth_a_word_at_least(bit: int) -> None:
    reading = battery(fault_bitmask=bit)
    assert reading.level >= BatteryLevel.WARN and reading.condition
    assert battery(fault_bitmask=bit, charge_state=dialect.MAV_BATTERY_CHARGE_STATE_FAILED).level is BatteryLevel.LAND


def test_a_cell_that_fails_calls_the_vehicle_home() -> None:
    reading = battery(fault_bitmask=dialect.MAV_BATTERY_FAULT_CELL_FAIL | dialect.MAV_BATTERY_FAULT_SPIKES)
    assert reading.level is BatteryLevel.RETURN and reading.condition == "spikes, cell fail"


def test_the_payload_s_battery_is_not_the_vehicle_s() -> None:
    fields = {**BATTERY, "battery_function": dialect.MAV_BATTERY_FUNCTION_PAYLOAD}
    message = through_the_wire(dialect.MAVLink_battery_status_message, *fields.values())
    assert wire.battery_status(message, 7) is None


@pytest.mark.parametrize(
    ("volts", "remaining", "health", "expected"),
    [
        (11_100, 42, True, (0.42, 11.1, BatteryLevel.FINE)),
        (11_100, 42, False, (0.42, 11.1, BatteryLevel.WARN)),
        (65535, -1, True, (None, None, BatteryLevel.FINE)),
        (0, 0, True, (None, None, BatteryLevel.FINE)),
    ],
)
def test_the_system_s_status_tells_of_the_battery(
    volts: int, remaining: int, health: bool, expected: tuple[float | None, float | None, BatteryLevel]
) -> None:
    bit = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    fields = bit, bit, bit if health else 0, 0, volts, -1, remaining, *(0,) * 9
    reading = wire.system_battery(through_the_wire(dialect.MAVLink_sys_status_message, *fields), 7)
    charge, whole, level = expected
    assert reading.level is level and reading.cell_volts is None
    assert reading.charge == (None if charge is None else pytest.approx(charge))
    assert reading.volts == (None if whole is None else pytest.approx(whole))


def test_a_ring_of_more_than_a_turn_is_none() -> None:
    """So many known beams times the increment; beams that are not measured reach anywhere."""
    for count, increment in ((72, 5.1), (72, 100.0), (4, 120.1)):
        distances = [500] * count + [65535] * (72 - count)
        with pytest.raises(RefusedRingError, match="beams over"):
            wire_ranges.obstacle_distance(ring(distances, f=increment), 0)
    for count, increment in ((72, 5.0), (72, -5.0), (4, 90.0), (1, 360.0)):
        distances = [500] * count + [65535] * (72 - count)
        assert wire_ranges.obstacle_distance(ring(distances, f=increment), 0).known.sum() == count


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("sectors", [72, 60, 45, 36, 24, 7])
def test_a_ring_has_the_beams_of_a_turn_alone(sectors: int, sign: float) -> None:
    """The unused rest of the array is no beam, at either end: the last beam is the first one's neighbour."""
    distances = [100 + k for k in range(sectors)] + [65535] * (72 - sectors)
    scan = wire_ranges.obstacle_distance(ring(distances, f=sign * 360.0 / sectors), 0)
    assert scan.bearings_frd.shape == scan.ranges_m.shape == (sectors,) and scan.known.all()
    step = np.diff([*scan.bearings_frd, scan.bearings_frd[0] + 2.0 * np.pi])
    assert step == pytest.approx(np.full(sectors, 2.0 * np.pi / sectors), abs=1e-6)
    assert np.argsort(scan.ranges_m).tolist() == list(range(sectors))[:: int(sign)]


def test_distances_that_the_format_does_not_have_are_no_ring() -> None:
    with pytest.raises(RefusedRingError, match="distances beyond"):
        wire_ranges.obstacle_distance(ring([500] * 70 + [30_000, 40_000]), 0)
    assert not wire_ranges.obstacle_distance(ring([60_000] * 72), 0).hit.any(), "one word for nothing there"
    most = ring([500] * 72).max_distance
    assert wire_ranges.obstacle_distance(ring([500] * 70 + [most + 1, 60_000]), 0).hit.sum() == 70, (
        "beside the format's own"
    )


def distance_sensor(orientation: int, distance_cm: int, quality: int = 0) -> Any:
    return through_the_wire(
        dialect.MAVLink_distance_sensor_message, 1234, 20, 1500, distance_cm, 0, 1, orientation, 255, 0.0, 0.0,
        [0.0] * 4, quality,
    )  # fmt: skip


def test_a_range_finder_that_looks_down() -> None:
    down = int(dialect.MAV_SENSOR_ROTATION_PITCH_270)
    assert wire_ranges.range_below(distance_sensor(down, 137)) == RangeBelow(1234, 1.37)
    assert wire_ranges.range_below(distance_sensor(down, 1501)) == RangeBelow(1234, math.inf)
    for orientation, distance_cm, quality in ((0, 137, 0), (24, 137, 0), (down, 20, 0), (down, 137, 1)):
        assert wire_ranges.range_below(distance_sensor(orientation, distance_cm, quality)) is None


def sector_sensor(number: int, field_of_view: float, time_ms: int = 1234) -> Any:
    return through_the_wire(
        dialect.MAVLink_distance_sensor_message, time_ms, 20, 1500, 400, 0, number, 2, 255, field_of_view, 0.0,
        [0.0] * 4, 0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("sensor", "boot_time_ms"),
    [
        ((10, 0.0), 1134),  # ArduPilot's: sent up to a turn of its LiDAR after it was seen
        ((10, 0.0, 40), 0),
        ((1, 0.5), 1234),
        ((1, 0.38), None),  # narrower than half of an eighth of the ring
        ((1, 0.0), None),
    ],
)
def test_a_sector_is_as_old_as_its_sensor_makes_it_and_covers_its_eighth(
    sensor: tuple[Any, ...], boot_time_ms: int | None
) -> None:
    sector = wire_ranges.sector_distance(sector_sensor(*sensor))
    assert (None if sector is None else sector.boot_time_ms) == boot_time_ms
