"""What comes from outside is taken whole or not at all; what goes out is what PX4 and ArduPilot obey."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from companion.link import wire
from companion.outputs import OUTPUTS
from companion.state import Output, Setpoint
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
        with pytest.raises(wire.RefusedError, match=fields[0].msgname):
            reader(through_the_wire(*spoilt))


def test_quaternion_of_no_length_is_refused_and_a_rough_one_made_unit() -> None:
    for q in ((0.0, 0.0, 0.0, 0.0), (1.2, 0.0, 0.0, 0.0), (0.5, 0.5, 0.5, 0.0)):
        with pytest.raises(wire.RefusedError):
            wire.attitude_quaternion(through_the_wire(ATTITUDE[0], 0, *q, 0.0, 0.0, 0.0))
    report = wire.attitude_quaternion(through_the_wire(ATTITUDE[0], 7, 0.999, 0.0, 0.0, 0.01, 0.1, -0.2, 0.3))
    assert np.linalg.norm(report.attitude_ned_frd) == pytest.approx(1.0)
    assert np.allclose(report.rates_frd, [0.1, -0.2, 0.3])
    assert report.boot_time_ms == 7


def test_euler_angles_and_quaternion_agree() -> None:
    report = wire.attitude(through_the_wire(*EULER))
    assert np.allclose(report.attitude_ned_frd, from_euler(0.1, -0.2, 3.0), atol=1e-6)


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
    scan = wire.obstacle_distance(ring(distances, offset=10.0), 99)
    assert scan.time_ns == 99 and scan.boot_time_us == 5000
    assert math.degrees(scan.bearings_frd[18]) == pytest.approx(100.0)
    assert (scan.ranges_m[18], scan.hit[18], scan.known[18]) == (4.0, True, True)
    assert (scan.hit[36], scan.known[36]) == (False, False)
    assert (scan.ranges_m[54], scan.hit[54]) == (15.0, True)
    assert (scan.ranges_m[0], scan.hit[0], scan.known[0]) == (15.0, False, True)
    counter = wire.obstacle_distance(ring(distances, f=-5.0), 0)
    assert math.degrees(counter.bearings_frd[18]) == pytest.approx(-90.0)


@pytest.mark.parametrize(
    "changes", [{"frame": 0}, {"f": math.nan}, {"offset": math.inf}, {"max": 10}, {"f": 400.0}], ids=str
)
def test_impossible_rings_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(wire.RefusedError, match="OBSTACLE_DISTANCE"):
        wire.obstacle_distance(ring([500] * 72, **changes), 0)


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
    assert wire.vehicle_text(message) == "?[2Jlow??battery"
