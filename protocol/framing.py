"""MAVLink framing: from bytes to whole valid frames of MAVLink 1 and 2. No I/O and no clock.

Packet formats: https://mavlink.io/en/guide/serialization.html.
"""

import re
import struct
from operator import attrgetter
from sys import maxsize
from typing import Final

import msgspec
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

_MAGIC_V1: Final = 0xFE
_MAGIC_V2: Final = 0xFD
_MAGICS: Final = b"\xfd\xfe"
_SIGNED: Final = 0x01
_SIGNATURE: Final = 13
_CHECKSUM: Final = 2
_HEADER_V1: Final = 6
_HEADER_V2: Final = 10
_MOST_STEPS: Final = 400
"""Places in a datagram that are looked at and hold no frame of a known message: some 0.5 ms."""

_unpack_v1 = struct.Struct("<xBBBBB").unpack_from
_unpack_v2 = struct.Struct("<xBBxBBBHB").unpack_from
_next_magic = re.compile(b"[\xfd\xfe]").search
_CRC_EXTRA: Final[dict[int, bytes]] = {
    message_id: bytes((message_class.crc_extra,)) for message_id, message_class in dialect.mavlink_map.items()
}


class Frame(msgspec.Struct, frozen=True, gc=False):
    """One frame as it was on the wire. It is a Struct because that is made in half a named tuple's time."""

    message_id: int
    system: int
    component: int
    sequence: int
    payload: bytes
    """As sent: MAVLink 2 cuts trailing zero bytes, and extensions that the dialect lacks may follow the last field."""
    raw: bytes
    """The whole frame, magic to checksum or signature."""
    version: int
    """Version of MAVLink: 1 or 2."""
    signed: bool
    """Carries a signature, which nobody has verified."""
    known: bool
    """The message is in the dialect, so the checksum was verified; that of others can't be (see `Framer`)."""
    checksum: int

    # pymavlink's names for a decoded message's header. A header object of its own would cost a tenth of the decoding.
    mlen = property(lambda self: len(self.payload))
    seq = property(attrgetter("sequence"))
    srcSystem = property(attrgetter("system"))  # noqa: N815
    srcComponent = property(attrgetter("component"))  # noqa: N815
    msgId = property(attrgetter("message_id"))  # noqa: N815
    incompat_flags = property(lambda self: _SIGNED if self.signed else 0)
    compat_flags = property(lambda self: self.raw[3] if self.version == 2 else 0)


class Framer:
    """Finds the frames in a stream of bytes; how the bytes are divided between calls makes no difference.

    A frame is valid if its checksum is right and no incompatibility flag but "signed" is set. After anything invalid
    the search goes on one byte behind its magic byte, so that a corrupt frame costs only itself. The checksum of a
    message that the dialect lacks can't be computed. Such a frame is returned if another magic byte or the end of a
    datagram follows directly and no valid frame of a known message lies inside (`carry_unknown=False`: never).

    What is left of a datagram after `_MOST_STEPS` places without a frame is not searched any more: it is one bad piece.

    At most one frame (280 bytes) is kept between calls. The attributes `bad_bytes`, `bad_frames` and `unknown_frames`
    count since the start: bytes fed = bytes of frames returned + `bad_bytes` + bytes kept.
    """

    __slots__ = ("_carry_unknown", "_pending", "_steps", "bad_bytes", "bad_frames", "unknown_frames")

    def __init__(self, *, carry_unknown: bool = True) -> None:
        self._carry_unknown = carry_unknown
        self._pending = b""
        self._steps = 0
        """So many places without a frame may still be looked at in this call."""
        self.bad_bytes = 0
        """Bytes that belong to no returned frame."""
        self.bad_frames = 0
        """Candidates refused for a wrong checksum or an unsupported flag. A magic byte in other bytes counts, too."""
        self.unknown_frames = 0
        """Frames returned of messages that the dialect lacks."""

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that these bytes complete."""
        self._steps = maxsize
        return self._scan(data, False)

    def flush(self) -> list[Frame]:
        """The frames in the bytes kept, if no more bytes follow them."""
        return self.datagram(b"") if self._pending else []

    def datagram(self, data: bytes) -> list[Frame]:
        """The frames of a datagram: `feed` and `flush` in one."""
        self._steps = _MOST_STEPS
        return self._scan(data, True)

    def _scan(self, data: bytes, at_end: bool) -> list[Frame]:
        if self._pending:
            data = self._pending + data
        size = len(data)
        frames: list[Frame] = []
        inside: tuple[int, int] | None = None
        at = 0
        while at < size and self._steps > 0:
            magic = data[at]
            if magic == _MAGIC_V2 and at + _HEADER_V2 <= size:
                length, flags, sequence, system, component, id_low, id_high = _unpack_v2(data, at)
                message_id = id_low | id_high << 16
                start = at + _HEADER_V2
                stop = start + length
                end = stop + _CHECKSUM + _SIGNATURE if flags else stop + _CHECKSUM
            elif magic == _MAGIC_V1 and at + _HEADER_V1 <= size:
                length, sequence, system, component, message_id = _unpack_v1(data, at)
                flags = 0
                start = at + _HEADER_V1
                stop = start + length
                end = stop + _CHECKSUM
            else:
                flags = 0
                end = size + 1 if magic in _MAGICS else at

            if at < end <= size and flags <= _SIGNED:
                checksum = data[stop] | data[stop + 1] << 8
                extra = _CRC_EXTRA.get(message_id)
                if extra is not None:
                    valid = mcrf4xx(data[at + 1 : stop] + extra) == checksum
                elif end == size and not at_end:
                    break
                else:
                    valid, inside = self._check_unknown(data, at, end, inside)
                if valid:
                    version = 2 if magic == _MAGIC_V2 else 1
                    known = extra is not None
                    payload = data[start:stop]
                    raw = data[at:end] if end - at < size else data
                    frames.append(
                        Frame(
                            message_id, system, component, sequence, payload, raw, version, flags != 0, known, checksum
                        )
                    )
                    at = end
                    continue
            if end > size and flags <= _SIGNED:
                if not at_end:
                    break
            elif end > at:
                self.bad_frames += 1
            self._steps -= 1
            found = _next_magic(data, at + 1)
            skip_to = found.start() if found else size
            self.bad_bytes += skip_to - at
            at = skip_to
        if at_end and at < size:
            at = self._leave(at, size)
        self._pending = data[at:] if at < size else b""
        return frames

    def _leave(self, at: int, size: int) -> int:
        """Count what is not searched any more as one bad piece; the place behind it."""
        self.bad_frames += 1
        self.bad_bytes += size - at
        return size

    def _check_unknown(
        self, data: bytes, start: int, end: int, inside: tuple[int, int] | None
    ) -> tuple[bool, tuple[int, int] | None]:
        """Whether data[start:end] is a frame of an unknown message, and where a known one lies inside, if one does.

        `inside` is the last such place: a flood of candidates must not search the same bytes again and again.
        """
        if not self._carry_unknown or (end < len(data) and data[end] not in _MAGICS):
            return False, inside
        if inside is None or inside[0] <= start or inside[1] > end:
            self._steps -= 1 + data.count(_MAGICS[:1], start + 1, end) + data.count(_MAGICS[1:], start + 1, end)
            inside = _known_frame_within(data, start + 1, end)
        self.unknown_frames += inside is None
        return inside is None, inside


def _known_frame_within(data: bytes, start: int, stop: int) -> tuple[int, int] | None:
    """Start and end of the first frame of a known message within data[start:stop], or None."""
    frames = Framer(carry_unknown=False).datagram(data[start:stop])
    if not frames:
        return None
    at = data.index(frames[0].raw, start)
    return at, at + len(frames[0].raw)
