"""MAVLink 2 signing (https://mavlink.io/en/guide/message_signing.html): sign what goes out, judge what comes in.

No I/O and no clock: times are timestamps of MAVLink, 10 us since 2015, and arguments. What comes in is judged in this
order: flag, signature (compared in constant time), timestamp; state changes last, so that nobody without the key
changes any. What must outlive the process is a `Memory`. It is written down ahead of time, as limits: nothing is sent
or accepted beyond the limits that were last written down. So a program that was killed repeats no timestamp, and takes
no frame that it has taken before.
"""

import hmac
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache
from hashlib import sha256
from typing import Final

from fastcrc.crc16 import mcrf4xx

from protocol.framing import Frame

KEY_SIZE: Final = 32
SECOND: Final = 100_000
"""A second in a timestamp's units."""
_EPOCH_NS: Final = 1_420_070_400_000_000_000
"""2015-01-01 as Unix time."""
LAST: Final = 2**48 - 1
_SIGNATURE: Final = 13
_HEADER: Final = 10
_CHECKSUM: Final = 2
_MOST_AHEAD: Final = 60 * SECOND
"""A timestamp further ahead of our clock is refused."""
_MOST_BEHIND: Final = 60 * SECOND
"""A stream that was never heard may begin so far behind our clock."""
_WINDOW: Final = SECOND
"""A frame that others have overtaken is taken for so long after them,"""
_WINDOW_FRAMES: Final = 256
"""and while no more than so many frames were newer."""
_MOST_LAG: Final = 5 * SECOND
"""Between the streams of one sender: its clock is one, so what lags further was recorded elsewhere."""
_MOST_STREAMS: Final = 64
_LEASE: Final = SECOND
"""Limits are written down so far ahead. What a sender says in that time after a restart of this program is refused; a
program takes longer to start."""
_RADIO_STATUS: Final = 109
_UNSIGNED: Final = frozenset({_RADIO_STATUS})
"""Accepted without a signature: a telemetry radio, which knows no key, writes it into the stream. Not under the name of
a sender that signs."""

Stream = tuple[int, int, int]
"""System, component and link id of a sender."""


REFUSED: Final = "signing_"
"""Before a refusal's name, as a count in a log's result."""


class Refusal(Enum):
    """Why a frame was refused; the value is its name as a count."""

    UNSIGNED = "unsigned"
    FORGED = "forged"
    """The signature is not that of our key."""
    REPLAYED = "replayed"
    """Heard before, or too old to tell."""
    OTHER_LINK = "other_link"
    """The sender's, from another of its links, and old."""
    AHEAD = "ahead"
    """More than a minute ahead of our clock."""
    BEHIND = "behind"
    """Signed for a new stream, and more than a minute behind our clock."""
    CROWDED = "crowded"
    """Signed for one stream too many."""


IN_WORDS: Final = {
    Refusal.UNSIGNED: "it has no signature; does the sender have the key?",
    Refusal.FORGED: "its signature is wrong; does the sender have this key?",
    Refusal.REPLAYED: "it was heard before, or is too old to tell",
    Refusal.OTHER_LINK: "it is an old one from another link of its sender",
    Refusal.AHEAD: "its timestamp is over a minute ahead; set the clocks of both sides",
    Refusal.BEHIND: "its timestamp is over a minute behind; set the clocks of both sides",
    Refusal.CROWDED: f"there are {_MOST_STREAMS} senders already",
}


@dataclass(frozen=True, slots=True)
class Memory:
    """What outlives the process: no timestamp up to these is sent or accepted again."""

    sent: int = 0
    """Our own clock, which starts no earlier."""
    heard: Mapping[Stream, int] = field(default_factory=dict)

    def merged(self, other: "Memory") -> "Memory":
        """The later of both: programs that share a key share its memory."""
        heard = dict(self.heard)
        for stream, limit in other.heard.items():
            heard[stream] = max(limit, heard.get(stream, 0))
        newest = sorted(heard.items(), key=lambda each: each[1])[-_MOST_STREAMS:]
        return Memory(max(self.sent, other.sent), dict(newest))


def timestamp(unix_ns: int) -> int:
    """The timestamp of a Unix time; a clock from before 2015 says 0."""
    return min(max((unix_ns - _EPOCH_NS) // 10_000, 0), LAST)


class Window:
    """The timestamps of one stream: which may still come."""

    __slots__ = ("_arrivals", "_floor", "_seen", "limit", "newest")

    def __init__(self, floor: int) -> None:
        self.newest = self._floor = self.limit = floor
        """`limit`: up to there it is written down."""
        self._seen: set[int] = set()
        self._arrivals: deque[int] = deque()

    def is_new(self, stamp: int) -> bool:
        """It was not taken yet, and is not too old to tell."""
        newest = self.newest
        return stamp > newest or (stamp > self._floor and stamp > newest - _WINDOW and stamp not in self._seen)

    def lease(self) -> None:
        """Set the limit, of a stream that was heard."""
        if self._seen:
            self.limit = self.newest + _LEASE

    def take(self, stamp: int) -> None:
        """It was accepted."""
        self._seen.add(stamp)
        self._arrivals.append(stamp)
        if stamp > self.newest:
            self.newest = stamp
        if len(self._arrivals) > _WINDOW_FRAMES:
            oldest = self._arrivals.popleft()  # what is older than any that was forgotten is too old
            self._seen.remove(oldest)
            if oldest > self._floor:
                self._floor = oldest


class Signing:
    """One key, and all that this program sends and hears with it. Raises ValueError for a key that has not 32 bytes."""

    def __init__(self, key: bytes, memory: Memory | None = None, now: int = 0, *, link_id: int = 0) -> None:
        if len(key) != KEY_SIZE:
            raise ValueError(f"a key has {KEY_SIZE} bytes, not {len(key)}")
        self.refused = dict.fromkeys(Refusal, 0)
        """How many frames, for each reason."""
        self._keyed = sha256(key)
        self._link = bytes((link_id,))
        memory = memory or Memory()
        self._sent = self._sent_limit = memory.sent
        self._due = False
        self._apart = max(max(memory.heard.values(), default=0) - now, 0)
        """Those whom we have heard before are at least so far ahead of our clock, which may have lost time since."""
        self._streams = {stream: Window(floor) for stream, floor in memory.heard.items()}
        self._newest: dict[tuple[int, int], int] = {}
        """Newest timestamp of each sender, whatever the link."""
        for (system, component, _), floor in memory.heard.items():
            self._newest[system, component] = max(floor, self._newest.get((system, component), 0))

    @property
    def due(self) -> bool:
        """`leased` is to be written down before anything that was signed or accepted since leaves or acts."""
        return self._due

    def leased(self, now: int) -> Memory:
        """What is to be written down now; it lasts for a second of traffic. Raised for those who spoke, no others."""
        if self._due:
            self._due = False
            self._sent_limit = min(max(self._sent, now) + _LEASE, LAST)
            for window in self._streams.values():
                window.lease()
        return Memory(self._sent_limit, {stream: window.limit for stream, window in self._streams.items()})

    # -- out -----------------------------------------------------------------------------------------------------------

    def sign(self, datagram: bytes, now: int) -> bytes:
        """Whole frames of MAVLink 2 without signatures, each with its signature."""
        stamp, at = max(now, self._sent + 1), 0
        parts: list[bytes] = []
        while at < len(datagram):
            stop = at + _HEADER + datagram[at + 1]
            body = (
                datagram[at : at + 2]
                + b"\x01"
                + datagram[at + 3 : stop]
                + _flipped(datagram[stop : stop + 2], stop - at)
            )
            body += self._link + stamp.to_bytes(6, "little")
            self._sent, stamp, at = stamp, stamp + 1, stop + _CHECKSUM
            parts += body, self._signature(body)
        self._due = self._due or self._sent > self._sent_limit
        return b"".join(parts)

    def _signature(self, body: bytes) -> bytes:
        keyed = self._keyed.copy()
        keyed.update(body)
        return keyed.digest()[:6]

    # -- in ------------------------------------------------------------------------------------------------------------

    def accepts(self, frame: Frame, now: int) -> bool:
        """Judge a frame, and count it if it is refused."""
        refusal = self.judge(frame, now)
        if refusal is None:
            return True
        self.refused[refusal] += 1
        return False

    def judge(self, frame: Frame, now: int) -> Refusal | None:
        """Why a frame is refused; None: it is accepted, and remembered."""
        sender, raw = (frame.system, frame.component), frame.raw
        if not frame.signed:
            listed = frame.message_id in _UNSIGNED and sender not in self._newest
            return None if listed else Refusal.UNSIGNED
        if not hmac.compare_digest(self._signature(raw[:-6]), raw[-6:]):
            return Refusal.FORGED
        stamp = int.from_bytes(raw[-12:-6], "little")
        if stamp > now + self._apart + _MOST_AHEAD:
            return Refusal.AHEAD
        stream = (*sender, raw[-_SIGNATURE])
        window, newest = self._streams.get(stream), self._newest.get(sender, -1)
        if window is None:
            refusal = self._refuse_new(stamp, newest, now)
            if refusal is not None:
                return refusal
            window = self._streams[stream] = Window(stamp - 1)
        elif not window.is_new(stamp):
            return Refusal.REPLAYED
        elif stamp < newest - _MOST_LAG:
            return Refusal.OTHER_LINK
        window.take(stamp)
        self._newest[sender] = max(stamp, newest)
        if stamp > window.limit:
            self._due = True
        return None

    def _refuse_new(self, stamp: int, newest: int, now: int) -> Refusal | None:
        """Why no stream begins with this timestamp, whose sender's newest on another link is `newest`."""
        if stamp <= newest:
            return Refusal.OTHER_LINK
        if stamp < now - _MOST_BEHIND:
            return Refusal.BEHIND
        if len(self._streams) >= _MOST_STREAMS:
            oldest = min(self._streams, key=lambda each: self._streams[each].newest)
            if self._streams[oldest].newest >= now - _MOST_BEHIND:
                return Refusal.CROWDED
            del self._streams[oldest]  # what could be replayed of it is refused as a new stream that is behind
        return None


def unsigned(frame: Frame) -> bytes:
    """The frame without its signature, with the checksum that goes with that."""
    raw = frame.raw
    if not frame.signed:
        return raw
    stop = len(raw) - _SIGNATURE - _CHECKSUM
    return raw[:2] + b"\0" + raw[3:stop] + _flipped(raw[stop : stop + _CHECKSUM], stop)


def _flipped(checksum: bytes, length: int) -> bytes:
    """The checksum of a frame, `length` bytes before it, whose flag "signed" changes. A CRC is linear, so that the
    message's own byte of it need not be known."""
    return (int.from_bytes(checksum, "little") ^ _difference(length)).to_bytes(_CHECKSUM, "little")


@cache
def _difference(length: int) -> int:
    """What the flag "signed" changes in a checksum over frame[1:length] and the message's own byte."""
    return mcrf4xx(b"\0\x01" + bytes(length - 2)) ^ mcrf4xx(bytes(length))
