"""A link that takes time, between both sides of a `Joined`: each way on its own, with jitter and losses from a seed."""

import heapq
from collections import deque
from dataclasses import dataclass

import numpy as np

from protocol.framing import Framer
from protocol.messages import Encoder, dialect
from vehicle_sim.timing import TICK_NS

_POSITION = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED


@dataclass(frozen=True)
class Lateness:
    """What a link does to its datagrams. s; what overtakes another arrives before it."""

    there: float = 0.0
    """From the vehicle to the companion."""
    back: float = 0.0
    """From the companion to the vehicle."""
    jitter: float = 0.0
    """Each datagram takes so much more or less, evenly spread; never less than no time."""
    position: float = 0.0
    """By how much the vehicle's position is older than its attitude when it is sent."""
    loss: float = 0.0
    """The share of the datagrams that never arrive, each way."""


class Way:
    """One direction."""

    def __init__(self, delay: float, lateness: Lateness, rng: np.random.Generator) -> None:
        self._delay, self._lateness, self._rng = delay, lateness, rng
        self._under_way: list[tuple[int, int, bytes]] = []
        self._count = 0

    def send(self, data: bytes, now_ns: int) -> None:
        """A datagram sets out."""
        late, self._count = self._lateness, self._count + 1
        lost, spread = self._rng.random(2)
        if lost < late.loss:
            return
        takes = max(self._delay + (2.0 * spread - 1.0) * late.jitter, 0.0)
        heapq.heappush(self._under_way, (now_ns + round(takes * 1e9), self._count, data))

    def arrived(self, now_ns: int) -> list[bytes]:
        """The datagrams that have arrived by now, in that order."""
        out = []
        while self._under_way and self._under_way[0][0] <= now_ns:
            out.append(heapq.heappop(self._under_way)[2])
        return out


class LateLink:
    """Both directions, and a vehicle whose estimator is late with its position."""

    def __init__(self, lateness: Lateness, seed: int) -> None:
        there, back = np.random.default_rng([seed, 18]).spawn(2)
        self.there, self.back = Way(lateness.there, lateness, there), Way(lateness.back, lateness, back)
        self._positions: deque[bytes] = deque(maxlen=1 + round(lateness.position * 1e9 / TICK_NS))

    def aged(self, data: bytes) -> bytes:
        """What the vehicle sends in a tick, with the position, and its time, of some ticks before."""
        if self._positions.maxlen == 1:
            return data
        out = b""
        for frame in Framer().datagram(data):
            if frame.message_id != _POSITION:
                out += frame.raw
                continue
            self._positions.append(frame.payload.ljust(28, b"\0"))
            encoder = Encoder(frame.system, frame.component)
            encoder.sequence = frame.sequence
            fields = np.frombuffer(self._positions[0], "<u4, 6<f4")[0]
            out += encoder.encode_fields(
                dialect.MAVLink_local_position_ned_message, int(fields[0]), *map(float, fields[1])
            )
        return out
