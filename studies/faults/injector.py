"""What sits between a vehicle and its companion and does harm, from a seed: datagrams are late, lost, doubled,
overtaken, damaged, flooded, and what the vehicle says is changed. Time is an argument; there is no clock and no socket.
"""

import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from protocol.framing import Framer
from protocol.messages import decode, dialect

Change = Callable[[int, bytes], bytes]
"""A time (ns) and a datagram of the vehicle -> what is sent in its place; nothing is sent for no bytes."""

JUNK = b"\xfe" * 9216
"""A datagram of a flood: each byte may be the beginning of a frame, and none is."""


@dataclass(frozen=True, slots=True)
class Link:
    """What a link does to its datagrams. Times in s; shares of the datagrams, each way."""

    there: float = 0.0
    """From the vehicle to the companion."""
    back: float = 0.0
    """From the companion to the vehicle."""
    jitter: float = 0.0
    """Each datagram takes so much more or less, evenly spread; never less than no time. Who overtakes arrives first."""
    loss: float = 0.0
    reordered: float = 0.0
    """Overtaken by the next one. At most half."""
    duplicated: float = 0.0
    corrupted: float = 0.0
    """One byte of it is another one."""
    flood: int = 0
    """So much JUNK beside each datagram to the companion."""


PERFECT = Link()


@dataclass(frozen=True, slots=True)
class Onset:
    """What begins in flight: so long after the vehicle first says that it is armed."""

    after_s: float
    link: Link | None = None
    """None: as before."""
    change: Change | None = None


class Way:
    """One direction."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._under_way: list[tuple[int, int, bytes]] = []
        self._overtaken: tuple[int, bytes] | None = None
        self._count = 0

    def send(self, data: bytes, link: Link, delay: float, now_ns: int) -> None:
        """A datagram sets out."""
        if link is PERFECT and self._overtaken is None:
            self._push(now_ns, data)
            return
        lost, corrupt, doubled, overtaken, where, *spread = self._rng.random(7)
        if lost < link.loss:
            return
        if corrupt < link.corrupted:
            data = _damaged(data, where)
        takes = [max(delay + (2.0 * each - 1.0) * link.jitter, 0.0) for each in spread]
        first, second = (now_ns + round(each * 1e9) for each in takes)
        if self._overtaken is None and overtaken < link.reordered / (1.0 - link.reordered):
            self._overtaken = first, data
            return
        self._push(first, data)
        if doubled < link.duplicated:
            self._push(second, data)
        if self._overtaken is not None:
            self._push(max(first, self._overtaken[0]), self._overtaken[1])
            self._overtaken = None

    def _push(self, arrives_ns: int, data: bytes) -> None:
        self._count += 1
        heapq.heappush(self._under_way, (arrives_ns, self._count, data))

    @property
    def next_ns(self) -> int | None:
        """When the next one arrives."""
        return self._under_way[0][0] if self._under_way else None

    def arrived(self, now_ns: int) -> list[bytes]:
        """The datagrams that have arrived by now, in that order."""
        out = []
        while self._under_way and self._under_way[0][0] <= now_ns:
            out.append(heapq.heappop(self._under_way)[2])
        return out


def _damaged(data: bytes, where: float) -> bytes:
    """`where`: in [0, 1). Its digits decide on the place and on the byte."""
    place = int(where * len(data))
    flipped = 1 + int(where * len(data) * 255.0) % 255
    return data[:place] + bytes((data[place] ^ flipped,)) + data[place + 1 :]


class Injector:
    """Both directions, each with its own random numbers. `link` may be set at any time; what is under way arrives."""

    def __init__(
        self, link: Link = PERFECT, change: Change | None = None, onset: Onset | None = None, *, seed: int = 1
    ) -> None:
        self.link = link
        self.change = change
        """Changes what the vehicle says."""
        self.began_ns: int | None = None
        """When the onset began; one that changes what the vehicle says begins where that first differs from what the
        vehicle would have said: what stands still anyhow is not frozen yet."""
        self.keeps_step = link is PERFECT and change is None and onset is None
        """Nothing is ever late or changed, so that both sides may fly in lockstep."""
        self._onset = onset
        self._armed_ns: int | None = None
        there, back = np.random.default_rng([seed, 18]).spawn(2)
        self._there, self._back = Way(there), Way(back)

    def to_companion(self, data: bytes, now_ns: int) -> None:
        """The vehicle sends a datagram."""
        if self._onset is not None:
            self._look_for_onset(self._onset, data, now_ns)
        if self.change is not None:
            whole, data = data, self.change(now_ns, data)
            if self.began_ns is None and data != whole:
                self.began_ns = now_ns
        if data:
            self._there.send(data, self.link, self.link.there, now_ns)
        for _ in range(self.link.flood):
            self._there.send(JUNK, self.link, self.link.there, now_ns)

    def to_vehicle(self, data: bytes, now_ns: int) -> None:
        """The companion sends a datagram."""
        self._back.send(data, self.link, self.link.back, now_ns)

    def at_companion(self, now_ns: int) -> list[bytes]:
        """What the companion hears by now."""
        return self._there.arrived(now_ns)

    def at_vehicle(self, now_ns: int) -> list[bytes]:
        """What the vehicle hears by now."""
        return self._back.arrived(now_ns)

    @property
    def next_ns(self) -> int | None:
        """When the next datagram arrives, at either side."""
        return min((each for each in (self._there.next_ns, self._back.next_ns) if each is not None), default=None)

    def _look_for_onset(self, onset: Onset, data: bytes, now_ns: int) -> None:
        if self._armed_ns is None and _says_armed(data):
            self._armed_ns = now_ns
        if self._armed_ns is not None and now_ns >= self._armed_ns + round(onset.after_s * 1e9):
            self.link, self.change, self._onset = onset.link or self.link, onset.change or self.change, None
            if onset.change is None:
                self.began_ns = now_ns


def _says_armed(data: bytes) -> bool:
    for frame in Framer().datagram(data):
        if frame.message_id == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            message = decode(frame)
            if message is not None and message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED:
                return True
    return False
