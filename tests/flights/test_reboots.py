"""A vehicle that reboots in flight."""

from collections.abc import Callable
from typing import Any

import pytest

from companion.mission.plan import Phase
from companion.outcomes import Outcome
from companion.supervision.states import State
from protocol.framing import Framer
from protocol.messages import Encoder, decode, dialect
from studies.joined import Joined, mission_of

SILENT_NS = 2_000_000_000
"""So long a reboot takes."""


def rebooting(start: list[int], *, armed: bool, later_ns: int) -> Callable[[int, bytes], bytes]:
    """A meddler: from `start` on the vehicle says nothing for a while, then says whether it is `armed`, and
    by its attitudes, which come `later_ns`, that it has a new clock."""
    encoder = Encoder(1, 1)

    def meddle(now: int, data: bytes) -> bytes:
        if now < start[0]:
            return data
        heard = b""
        for frame in Framer().datagram(data) if now > start[0] + SILENT_NS else ():
            message: Any = decode(frame)
            if frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
                base = message.base_mode if armed else message.base_mode & ~dialect.MAV_MODE_FLAG_SAFETY_ARMED
                said = message.type, message.autopilot, base, message.custom_mode, message.system_status, 3
                heard += encoder.encode_fields(dialect.MAVLink_heartbeat_message, *said)
            elif frame.message_id != dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
                continue
            elif now > start[0] + SILENT_NS + later_ns:
                fields = [getattr(message, name) for name in message.fieldnames[1:8]]
                boot_ms = (now - start[0]) // 1_000_000
                heard += encoder.encode_fields(dialect.MAVLink_attitude_quaternion_message, boot_ms, *fields)
        return heard

    return meddle


@pytest.mark.parametrize(("armed", "later_ns"), [(False, 0), (False, 1_100_000_000), (True, 0)])
def test_nobody_saw_a_vehicle_land_that_rebooted(armed: bool, later_ns: int) -> None:
    """One that goes on flying, as ArduPilot after its watchdog, is landed."""
    start = [10**18]
    meddle = rebooting(start, armed=armed, later_ns=later_ns)
    joined = Joined(mission_of("hover"), meddle=meddle, overrides=("avoidance.method=none",))
    joined.fly(until=lambda joined: joined.autopilot.navigator.phase is Phase.ROUTE)
    start[0] = joined.vehicle.time_ns
    joined.fly(limit_s=4.0)
    supervisor = joined.autopilot.supervisor
    assert supervisor.verdict is not None and any("rebooted" in text for text in joined.said)
    if armed:
        assert supervisor.state is State.WITHDRAW and supervisor.verdict.outcome is Outcome.LANDED_EARLY
    else:
        assert supervisor.state is State.ENDED and supervisor.verdict.outcome is Outcome.LOST
        assert not supervisor.verdict.outcome.leaves_it_whole
