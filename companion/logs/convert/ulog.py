"""Converts flight logs to ULog (docs.px4.io, "ULog File Format"), for tools that don't read MCAP.

Topics are the MAVLink messages and the companion's own records, with their names in lower case. PX4's own topics
(`vehicle_attitude`, ...) are written beside them where a message holds the same quantities, so that PX4's tools find
what they plot. Fields that ULog has no type for (text and bytes of varying length) and messages over its limit of
64 KiB are left out; texts become logged messages. A ULog can't be converted back, since it holds no traffic.
"""

import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from companion.known_topics import is_foreign
from companion.logs.recordings import has_texts, records, unpack
from protocol import ulog
from protocol.flightlog import SCALARS, TEXT, LogReader, Record, RecordType
from protocol.messages import dialect, layout

_NAMES = {"bool": "bool", "float32": "float", "float64": "double"}
_MOST_INSTANCES = 256
_LEVELS = (6, 7, 6, 4, 3, 2)
"""syslog's severity for each level of a text: 0 unknown, 1 debug, ... 5 fatal."""


class _Equivalent(NamedTuple):
    """A PX4 topic with the same quantities as a message."""

    topic: str
    fields: str
    """As ULog has them, behind the timestamp."""
    sources: tuple[str, ...]
    """The message's fields that hold these values."""


class _Conversion(NamedTuple):
    """What a record is converted to."""

    name: str
    fields: str
    """As ULog has them, behind the timestamp."""
    size: int
    """Bytes of these."""
    convert: Callable[[Record], bytes]

    @property
    def fits(self) -> bool:
        """Whether it fits a ULog message."""
        return ulog.fits(self.name, self.fields, self.size)


def to_ulog(log: LogReader, target: Path) -> int:
    """Write a ULog file; returns its number of data records.

    Raises FlightLogError if the log can't be read, OSError if the file can't be made.
    """
    writer = _Ulog(log)
    with target.open("xb") as file:
        file.writelines(writer.parts())
    return writer.count


class _Ulog:
    def __init__(self, log: LogReader) -> None:
        self.count = 0
        self._log = log
        self._kinds = log.topics
        self._texts = _texts(log)
        self._targets: dict[str, list[tuple[int, Callable[[Record], bytes]]]] = {}

    def parts(self) -> Iterator[bytes]:
        """The file's content, part by part."""
        definitions = list(self._definitions())
        kinds = {topic: self._kinds[topic] for topic in {*self._targets, *self._texts}}
        first_us = min((record.time_ns // 1000 for record in self._log.records(kinds)), default=0)
        before_us = max(-first_us, 0)  # stamps are unsigned
        yield ulog.header(first_us + before_us)
        flight = self._log.metadata.get("flight", {})
        for key, value in {"sys_name": "Courier", "ver_sw": flight.get("courier", ""), **_plain(flight)}.items():
            yield ulog.information(key, value)
        yield from definitions
        for record in records(self._log, kinds):
            yield from self._data(record, record.time_ns // 1000 + before_us)

    def _definitions(self) -> Iterator[bytes]:
        formats: dict[str, str] = {}
        topics = [
            (topic, conversion)
            for topic, kind in self._kinds.items()
            for conversion in self._conversions(topic, kind)
            # The same name with other fields is from a sender of another dialect.
            if conversion.fits and formats.setdefault(conversion.name, conversion.fields) == conversion.fields
        ]
        for name, fields in formats.items():
            yield ulog.definition(name, fields)
        instances: dict[str, int] = {}
        for number, (topic, conversion) in enumerate(topics):
            instance = instances[conversion.name] = instances.get(conversion.name, -1) + 1
            if instance < _MOST_INSTANCES:
                self._targets.setdefault(topic, []).append((number, conversion.convert))
                yield ulog.subscription(number, conversion.name, instance)

    def _data(self, record: Record, time_us: int) -> Iterator[bytes]:
        for number, convert in self._targets.get(record.topic, ()):
            self.count += 1
            yield ulog.record(number, time_us, convert(record))
        said = self._texts.get(record.topic)
        if said is not None:
            level, text = said(unpack(self._log, self._kinds[record.topic], record))
            yield ulog.text(level, time_us, text)

    def _conversions(self, topic: str, kind: RecordType) -> Iterator[_Conversion]:
        """What a topic's records become: the same fields, and PX4's own topic if there is an equivalent."""
        texts = _text_lengths(kind)
        if any(field.kind not in SCALARS and field.name not in texts for field in kind.fields):
            return
        if any(field.is_variable and field.name not in texts for field in kind.fields):
            return
        names = {field.name for field in kind.fields}
        numbers = {field.name for field in kind.fields if field.kind in SCALARS and field.length is None}
        fields, format_ = "", "<"
        for field in kind.fields:
            length = texts.get(field.name)
            own = f"{_type(field.kind, field.length)} " if length is None else f"char[{length}] "
            name = field.name
            while name == "timestamp" or (name != field.name and name in names):
                name += "_"  # ULog's own comes first
            fields += f"{own}{name};"
            format_ += field.format if length is None else f"{length}s"
        packed = struct.Struct(format_)

        def again(record: Record) -> bytes:
            return packed.pack(*_flat(unpack(self._log, kind, record).values()))

        yield _Conversion(_name(topic), fields, packed.size, again if texts else lambda record: record.data)
        px4 = _EQUIVALENTS.get(_name(topic))
        if px4 is not None and numbers.issuperset(px4.sources):
            floats = struct.Struct(f"<{len(px4.sources)}f")

            def same(record: Record) -> bytes:
                values = unpack(self._log, kind, record)
                return floats.pack(*(values[name] for name in px4.sources))

            yield _Conversion(px4.topic, px4.fields, floats.size, same)


def _texts(log: LogReader) -> dict[str, Callable[[dict[str, Any]], tuple[int, str]]]:
    """Topics with texts, and for each a function from a record's fields to its severity (as syslog's) and its text."""
    kinds = log.topics
    if has_texts(log):
        return {TEXT.topic: lambda said: (_LEVELS[min(said["level"], 5)], said["message"])}
    return {
        topic: lambda said: (min(said["severity"], 7), said["text"])
        for topic, kind in kinds.items()
        if topic.startswith("/mavlink/") and topic.endswith("/STATUSTEXT") and not is_foreign(kind)
    }


def _text_lengths(kind: RecordType) -> dict[str, int]:
    """Lengths of a MAVLink message's char arrays by field; the log has them as strings without trailing zeros."""
    number = _MESSAGES.get(kind.schema_name)
    fields = () if number is None else layout(number).fields
    if [field.name for field in fields] != [field.name for field in kind.fields]:
        return {}
    pairs = zip(fields, kind.fields, strict=True)
    return {field.name: field.array_length for field, ours in pairs if ours.kind == "string" and field.array_length}


def _flat(values: Any) -> Iterator[Any]:
    for value in values:
        if isinstance(value, tuple):
            yield from value
        else:
            yield value.encode() if isinstance(value, str) else value


def _name(topic: str) -> str:
    """The message's own name for MAVLink traffic, "companion_trace" and the like for others."""
    parts = topic.strip("/").split("/")
    name = parts[3] if parts[0] == "mavlink" and len(parts) == 4 else "_".join(parts)
    return re.sub(r"[^a-z0-9_-]", "_", name.lower()) or "_"


def _type(kind: str, length: int | None) -> str:
    name = _NAMES.get(kind, f"{kind}_t")
    return name if length is None else f"{name}[{length}]"


def _plain(flight: dict[str, str]) -> dict[str, str]:
    return {name: flight[name] for name in ("mission", "output", "pace", "seed", "git") if flight.get(name)}


_MESSAGES = {f"mavlink/{message.msgname}": number for number, message in dialect.mavlink_map.items()}
_EQUIVALENTS = {
    "attitude_quaternion": _Equivalent("vehicle_attitude", "float[4] q;", ("q1", "q2", "q3", "q4")),
    "local_position_ned": _Equivalent(
        "vehicle_local_position",
        "float x;float y;float z;float vx;float vy;float vz;",
        ("x", "y", "z", "vx", "vy", "vz"),
    ),
    "attitude_target": _Equivalent(
        "vehicle_rates_setpoint",
        "float roll;float pitch;float yaw;",
        ("body_roll_rate", "body_pitch_rate", "body_yaw_rate"),
    ),
}
"""PX4's topics (msg/*.msg) from which it makes these messages."""
