"""Flight logs as ULog (docs.px4.io, "ULog File Format"), for the tools that read it and no MCAP.

Topics are the MAVLink messages and the companion's own records under their names in lower case. PX4's own topics
(`vehicle_attitude`, ...) are written beside them where a message holds the same quantities, so that its tools find
what they plot. What ULog has no type for (text and bytes of varying length) is left out, but the texts themselves
become its logged messages. There is no way back: a ULog holds no traffic.
"""

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from protocol.flightlog import SCALARS, TEXT, FlightLogError, LogReader, Record, RecordType

_HEADER = b"ULog\x01\x12\x35\x01"
_HEAD = struct.Struct("<HB")
_STAMP = struct.Struct("<Q")
_NAMES = {"bool": "bool", "float32": "float", "float64": "double"}
_INSTANCES = 256
_LEVELS = (ord("6"), ord("7"), ord("6"), ord("4"), ord("3"), ord("2"))
"""Of a text (0 unknown, 1 debug, ... 5 fatal) as syslog's digit."""


class _Twin(NamedTuple):
    """A PX4 topic that a message is the same as."""

    topic: str
    fields: str
    """As ULog has them, behind the timestamp."""
    convert: Callable[[RecordType, bytes], bytes]


def to_ulog(source: Path, target: Path) -> int:
    """Write a ULog file; how many records of data it has. Raises FlightLogError if it can't be read or made."""
    log = LogReader(source)
    writer = _Ulog(log)
    try:
        with target.open("xb") as file:
            file.writelines(writer.parts())
    except OSError as error:
        raise FlightLogError(f"{target}: {error.strerror or error}") from error
    return writer.count


class _Ulog:
    def __init__(self, log: LogReader) -> None:
        self.count = 0
        self._log = log
        self._kinds = {topic: kind for topic, kind in log.topics.items() if _fits(kind)}
        self._targets: dict[str, list[tuple[int, Callable[[RecordType, bytes], bytes]]]] = {}

    def parts(self) -> Iterator[bytes]:
        """The file, bit by bit."""
        first_us = next((record.time_ns // 1000 for record in self._log.records()), 0)
        yield _HEADER + _STAMP.pack(max(first_us, 0))
        yield _message("B", bytes(40))
        flight = self._log.metadata.get("flight", {})
        for key, value in {"sys_name": "Courier", "ver_sw": flight.get("courier", ""), **_plain(flight)}.items():
            yield _info(key, value)
        yield from self._definitions()
        for record in self._log.records():
            yield from self._data(record)

    def _definitions(self) -> Iterator[bytes]:
        formats: dict[str, str] = {}
        topics: list[tuple[str, str, Callable[[RecordType, bytes], bytes]]] = []
        for topic, kind in self._kinds.items():
            name = _name(topic)
            layout = "".join(f"{_field(field.kind, field.length)} {field.name};" for field in kind.fields)
            if formats.setdefault(name, layout) != layout:
                continue  # the same name with other fields, from a sender of another dialect
            topics.append((topic, name, lambda _, data: data))
            twin = _TWINS.get(name)
            if twin is not None:
                formats[twin.topic] = twin.fields
                topics.append((topic, twin.topic, twin.convert))
        for name, layout in formats.items():
            yield _message("F", f"{name}:uint64_t timestamp;{layout}".encode())
        instances: dict[str, int] = {}
        for number, (topic, name, convert) in enumerate(topics):
            instance = instances[name] = instances.get(name, -1) + 1
            if instance < _INSTANCES:
                self._targets.setdefault(topic, []).append((number, convert))
                yield _message("A", struct.pack("<BH", instance, number) + name.encode())

    def _data(self, record: Record) -> Iterator[bytes]:
        stamp = _STAMP.pack(max(record.time_ns // 1000, 0))
        for number, convert in self._targets.get(record.topic, ()):
            self.count += 1
            yield _message("D", struct.pack("<H", number) + stamp + convert(self._kinds[record.topic], record.data))
        if record.topic == TEXT.topic:
            text = TEXT.unpack(record.data)
            yield _message("L", bytes((_LEVELS[min(text["level"], 5)],)) + stamp + text["message"].encode())


def _fits(kind: RecordType) -> bool:
    return kind.size is not None and kind.topic != TEXT.topic and all(field.kind in SCALARS for field in kind.fields)


def _name(topic: str) -> str:
    """The message's own name for traffic, "companion_trace" and the like for others."""
    parts = topic.strip("/").split("/")
    return (parts[3] if parts[0] == "mavlink" and len(parts) == 4 else "_".join(parts)).lower()


def _field(kind: str, length: int | None) -> str:
    name = _NAMES.get(kind, f"{kind}_t")
    return name if length is None else f"{name}[{length}]"


def _plain(flight: dict[str, str]) -> dict[str, str]:
    return {name: flight[name] for name in ("mission", "output", "pace", "seed", "git") if flight.get(name)}


def _message(kind: str, content: bytes) -> bytes:
    return _HEAD.pack(len(content), ord(kind)) + content


def _info(key: str, value: str) -> bytes:
    text = value.encode()
    name = f"char[{len(text)}] {key}".encode()
    return _message("I", bytes((len(name),)) + name + text)


def _same(*names: str) -> Callable[[RecordType, bytes], bytes]:
    """Those fields, as they are, one behind the other."""

    def convert(kind: RecordType, data: bytes) -> bytes:
        values = kind.unpack(data)
        found = (values[name] for name in names)
        flat = [number for value in found for number in (value if isinstance(value, tuple) else (value,))]
        return struct.pack(f"<{len(flat)}f", *flat)

    return convert


_TWINS = {
    "attitude_quaternion": _Twin("vehicle_attitude", "float[4] q;", _same("q1", "q2", "q3", "q4")),
    "local_position_ned": _Twin(
        "vehicle_local_position",
        "float x;float y;float z;float vx;float vy;float vz;",
        _same("x", "y", "z", "vx", "vy", "vz"),
    ),
    "attitude_target": _Twin(
        "vehicle_rates_setpoint",
        "float roll;float pitch;float yaw;",
        _same("body_roll_rate", "body_pitch_rate", "body_yaw_rate"),
    ),
}
"""PX4's names (msg/*.msg) for what these messages are made of there."""
