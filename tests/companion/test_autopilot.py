"""What the autopilot makes of its messages, without a vehicle."""

import pytest

from companion.autopilot import Autopilot
from companion.events import Datagram, Tick
from companion.runtime.files import load_body, load_settings
from companion.state import Output
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import mission_of

HOVER = mission_of("hover")


@pytest.mark.parametrize("ahead_ns", [100_000_000_000, -3_000_000_000])
def test_a_measurement_is_as_old_as_the_vehicles_clock_says(ahead_ns: int) -> None:
    """A vehicle whose clock is far from ours, and whose telemetry is 20 ms old."""
    autopilot = Autopilot(load_settings(None, []), load_body(HOVER.vehicle), HOVER, Output.RATES)
    vehicle, now, age_ns = Encoder(1, 1), 5_000_000_000, 20_000_000
    autopilot.handle(Datagram(now, vehicle.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, 0, 4, 3)))
    asked = [decode(frame) for frame in Framer().datagram(autopilot.handle(Tick(now)).datagram)]
    (question,) = (each for each in asked if each is not None and each.get_msgId() == dialect.MAVLINK_MSG_ID_TIMESYNC)
    answer = (question.ts1 + ahead_ns, question.ts1)
    autopilot.handle(Datagram(now, vehicle.encode_fields(dialect.MAVLink_timesync_message, *answer)))
    boot_ms = (now + ahead_ns - age_ns) // 1_000_000
    attitude = (boot_ms, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    autopilot.handle(Datagram(now, vehicle.encode_fields(dialect.MAVLink_attitude_quaternion_message, *attitude)))
    assert autopilot.link.delays.take(boot_ms, now, autopilot.link.peer) == now - age_ns
