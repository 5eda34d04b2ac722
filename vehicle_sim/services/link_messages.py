"""What a link is measured with: requests of TIMESYNC and PING."""

from itertools import count

from protocol.messages import Encoder, dialect
from vehicle_sim.services.snapshot import Snapshot


class LinkMessages:
    """Encoders, one a message."""

    def __init__(self, encoder: Encoder) -> None:
        self._encode = encoder.encode_fields
        self._numbers = count()

    def timesync(self, now: Snapshot) -> bytes:
        return self._encode(dialect.MAVLink_timesync_message, 0, now.now_ns)

    def ping(self, now: Snapshot) -> bytes:
        """A request to all: system and component 0."""
        number = next(self._numbers) & 0xFFFFFFFF
        return self._encode(dialect.MAVLink_ping_message, now.now_us, number, 0, 0)
