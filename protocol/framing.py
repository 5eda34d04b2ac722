"""Bytes to whole valid MAVLink frames, v1 and v2. No I/O and no clock.

Packet formats: https://mavlink.io/en/guide/serialization.html.
"""

import re
import struct
from typing import Final, Literal, NamedTuple

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

_unpack_v1 = struct.Struct("<xBBBBB").unpack_from
_unpack_v2 = struct.Struct("<xBBxBBBHB").unpack_from
_next_magic = re.compile(b"[\xfd\xfe]").search
_new_tuple = tuple.__new__
_CRC_EXTRA: Final[dict[int, bytes]] = {
    message_id: bytes((message_class.crc_extra,)) for message_id, message_class in dialect.mavlink_map.items()
}


class Frame(NamedTuple):
    """One frame as it was on the wire."""

    message_id: int
    system: int
    component: int
    sequence: int
    payload: bytes
    """As sent: v2 cuts trailing zero bytes, and extensions that the dialect lacks may follow its last field."""
    raw: bytes
    """The whole frame, magic to checksum or signature."""
    version: int
    """1 or 2."""
    signed: bool
    """Carries a signature, which nobody has verified."""
    known: bool
    """In the dialect, so the checksum was right; an unknown one can't be checked (see `Framer`)."""
    checksum: int


class Framer:
    """Takes any bytes in any cut and yields the same whole valid frames.

    After anything invalid the search goes on one byte past its magic, so that a corrupt frame costs only itself.
    A frame is valid if its checksum is right and no incompatibility flag but "signed" is set. The checksum of an
    unknown message can't be computed; it is carried if another magic byte or the end of a datagram follows directly and
    no valid frame lies inside.

    At most one frame (280 bytes) and one byte are kept between calls.
    Always: bytes fed = bytes of frames returned + `bad_bytes` + bytes kept.
    """

    __slots__ = ("_pending", "bad_bytes", "bad_frames", "unknown_frames")

    def __init__(self) -> None:
        self._pending = b""
        self.bad_bytes = 0
        """Bytes that belong to no frame."""
        self.bad_frames = 0
        """Candidates with a wrong checksum or an unsupported flag (a magic byte within garbage looks the same)."""
        self.unknown_frames = 0

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that these bytes complete."""
        return self._scan(data, at_end=False)

    def flush(self) -> list[Frame]:
        """Settle what is kept: nothing more belongs to it."""
        return self._scan(b"", at_end=True) if self._pending else []

    def datagram(self, data: bytes) -> list[Frame]:
        """`feed` and `flush` in one."""
        return self._scan(data, at_end=True)

    def _scan(self, data: bytes, at_end: bool) -> list[Frame]:
        if self._pending:
            data = self._pending + data
        size = len(data)
        frames: list[Frame] = []
        inside: Frame | None = None
        inside_at = 0
        at = 0
        while at < size:
            frame = _frame_at(data, at, size)
            if frame and not frame.known:
                end = at + len(frame.raw)
                if end == size and not at_end:
                    break
                if end < size and data[end] not in _MAGICS:
                    frame = False
                else:
                    # The last find is kept: a flood of candidates must not search the same bytes again and again.
                    if inside is None or inside_at <= at or inside_at + len(inside.raw) > end:
                        inside, inside_at = _known_frame_within(data, at + 1, end)
                    if inside is None:
                        self.unknown_frames += 1
                    else:
                        frame = False
            if frame:
                frames.append(frame)
                at += len(frame.raw)
                continue
            if frame is None and not at_end:
                break
            if frame is False and data[at] in _MAGICS:
                self.bad_frames += 1
            found = _next_magic(data, at + 1)
            skip_to = found.start() if found else size
            self.bad_bytes += skip_to - at
            at = skip_to
        self._pending = data[at:]
        return frames


def _frame_at(data: bytes, at: int, size: int) -> Frame | Literal[False] | None:
    """The frame that begins at data[at]; False if none does, None if data[:size] is too short to tell."""
    magic = data[at]
    if magic == _MAGIC_V2:
        if size - at < _HEADER_V2:
            return None
        length, flags, sequence, system, component, id_low, id_high = _unpack_v2(data, at)
        if flags > _SIGNED:
            return False
        version = 2
        message_id = id_low | id_high << 16
        start = at + _HEADER_V2
        stop = start + length
        end = stop + _CHECKSUM + _SIGNATURE if flags else stop + _CHECKSUM
    elif magic == _MAGIC_V1:
        if size - at < _HEADER_V1:
            return None
        length, sequence, system, component, message_id = _unpack_v1(data, at)
        flags = 0
        version = 1
        start = at + _HEADER_V1
        stop = start + length
        end = stop + _CHECKSUM
    else:
        return False
    if end > size:
        return None
    checksum = data[stop] | data[stop + 1] << 8
    extra = _CRC_EXTRA.get(message_id)
    if extra is None:
        known = False
    elif mcrf4xx(data[at + 1 : stop] + extra) == checksum:
        known = True
    else:
        return False
    return _new_tuple(  # Frame(...) in half the time
        Frame,
        (
            message_id,
            system,
            component,
            sequence,
            data[start:stop],
            data[at:end],
            version,
            flags != 0,
            known,
            checksum,
        ),
    )


def _known_frame_within(data: bytes, at: int, limit: int) -> tuple[Frame | None, int]:
    """The first frame of a known message that lies within data[at:limit], and where it begins."""
    while found := _next_magic(data, at, limit):
        frame = _frame_at(data, found.start(), limit)
        if frame and frame.known:
            return frame, found.start()
        at = found.start() + 1
    return None, 0
