"""The MAVLink messages of the datagrams as records of their own, each under its own topic."""

import functools
import struct
from collections.abc import Callable
from typing import Final, NamedTuple

from protocol.flightlog.mcap_file import McapFile
from protocol.flightlog.mcap_format import EMPTY_MESSAGE_LENGTH, MESSAGE_HEADER, Direction
from protocol.flightlog.record_types import SCALARS, RecordType, datagram_of, record_type
from protocol.framing import Frame, Framer
from protocol.messages import dialect, layout

_MOST_TOPICS: Final = 4096
"""Noise that looks like frames must not use up the file's channels, nor the memory."""
_pack_header = MESSAGE_HEADER.pack


class _Target(NamedTuple):
    """Where frames of one message from one sender go."""

    channel: int
    size: int
    """Bytes of the full payload; shorter ones are padded with zeros."""
    convert: Callable[[bytes], bytes] | None
    """From the payload to the record, where they differ."""


_ROS_TYPES: Final = {"float": "float32", "double": "float64", "char": "uint8"}
"""MAVLink's types under ROS 1's names, where these are not the same but for a "_t"."""


def message_type(message_id: int, topic: str) -> tuple[RecordType, int, Callable[[bytes], bytes] | None]:
    """Record type of a MAVLink message, size of its full payload, and the conversion from that to a record.

    The fields are in wire order and char arrays are strings. Without any, the payload is the record and the conversion
    is None. Raises KeyError for an id that the dialect doesn't have.
    """
    message = layout(message_id)
    fields: list[tuple[str, str]] = []
    cuts: list[tuple[int, int]] = []
    position = 0
    for name, kind, length in message.fields:
        ros_kind = _ROS_TYPES.get(kind, kind.removesuffix("_t"))
        size = max(length, 1) * struct.calcsize("<" + SCALARS[ros_kind])
        if kind == "char" and length:
            fields.append((name, "string"))
            cuts.append((position, position + size))
        else:
            fields.append((name, f"{ros_kind}[{length}]" if length else ros_kind))
        position += size
    described = dialect.mavlink_map[message_id]
    units, enums = described.fieldunits_by_name, described.fieldenums_by_name
    comments = {name: " ".join(filter(None, (units.get(name), enums.get(name)))) for name, _ in fields}
    message_record = record_type(topic, f"mavlink/{message.name}", fields, comments)
    return message_record, message.size, functools.partial(_with_strings, cuts) if cuts else None


def _with_strings(cuts: list[tuple[int, int]], payload: bytes) -> bytes:
    """`payload` with each char array, of which `cuts` has start and stop, as a string: its length, then its text."""
    parts: list[bytes] = []
    position = 0
    for start, stop in cuts:
        text = payload[start:stop].partition(b"\0")[0].decode(errors="replace").encode()
        parts += payload[position:start], len(text).to_bytes(4, "little"), text
        position = stop
    return b"".join((*parts, payload[position:]))


def _with_length(payload: bytes) -> bytes:
    return len(payload).to_bytes(4, "little") + payload


class FrameFinder:
    """Finds the frames in recorded datagrams, direction by direction. `preserves_datagrams`: as the link's; of one that
    does not (serial, TCP), and of a sensor's own, they are pieces of a stream, in which a frame may span several."""

    def __init__(self, *, preserves_datagrams: bool) -> None:
        self._preserves_datagrams = preserves_datagrams
        self._framers = [Framer() for _ in Direction]

    def frames(self, direction: int, data: bytes) -> list[Frame]:
        """The frames that a datagram completes."""
        framer = self._framers[direction]
        whole = self._preserves_datagrams and direction != Direction.SENSOR
        return framer.datagram(data) if whole else framer.feed(data)


class MessageWriter:
    """Writes the messages of datagrams into a file, each under `/mavlink/{system}/{component}/{NAME}`."""

    def __init__(self, file: McapFile, *, preserves_datagrams: bool) -> None:
        self._file = file
        self._finder = FrameFinder(preserves_datagrams=preserves_datagrams)
        self._targets: dict[tuple[int, int, int, bool], _Target] = {}

    def add(self, datagram: bytes, sequence: int, log_time: int) -> None:
        """Write the messages in `datagram`, a record of DATAGRAM, with its sequence and log time."""
        direction, _, data = datagram_of(datagram)
        for frame in self._finder.frames(direction, data):
            known = frame.known
            key = frame.message_id, frame.system, frame.component, known
            try:
                channel, size, convert = self._targets[key]
            except KeyError:
                if len(self._targets) >= _MOST_TOPICS:
                    continue
                channel, size, convert = self._targets[key] = self._new_target(*key)
            payload = frame.payload
            if len(payload) != size and known:
                payload = payload.ljust(size, b"\0")[:size]
            if convert is not None:
                payload = convert(payload)
            header = _pack_header(5, EMPTY_MESSAGE_LENGTH + len(payload), channel, sequence, log_time, log_time)
            self._file.add_message(channel, log_time, header + payload)

    def _new_target(self, message_id: int, system: int, component: int, known: bool) -> _Target:
        folder = f"/mavlink/{system}/{component}"
        if known:
            kind, size, convert = message_type(message_id, f"{folder}/{layout(message_id).name}")
            return _Target(self._file.add_channel(kind), size, convert)
        kind = record_type(f"{folder}/UNKNOWN_{message_id}", f"mavlink/UNKNOWN_{message_id}", [("payload", "uint8[]")])
        return _Target(self._file.add_channel(kind), 0, _with_length)
