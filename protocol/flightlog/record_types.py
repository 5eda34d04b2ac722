"""Types of records: a topic and the layout of what is on it, packed and unpacked by a schema.

A record is ROS 1 serialisation with a `ros1msg` schema (http://wiki.ros.org/msg): little-endian fields without padding.
A MAVLink payload of full length has the same form.
"""

import itertools
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from protocol.flightlog.mcap_format import UINT32, FlightLogError

if TYPE_CHECKING:  # numpy is imported where it is needed: the recorder starts 0.1 s sooner without it
    import numpy as np

SCALARS = {
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
"""Names of scalar types in ROS 1, with the code of each in `struct`."""
VARIABLE = -1
"""Length of a field that is an array of any number of values."""
_pack_length, _unpack_length = UINT32.pack, UINT32.unpack_from
_MAX_RECORD_BYTES = 1 << 24
"""Most bytes in the fields of fixed size; a definition that asks for more is refused as damaged."""


class Field(NamedTuple):
    """One field of a record."""

    name: str
    kind: str
    """A key of SCALARS, "string" or "time"."""
    length: int | None
    """None for a single value, otherwise the number of values in the array, or VARIABLE."""

    @property
    def is_variable(self) -> bool:
        """Whether its size differs from record to record."""
        return self.kind == "string" or self.length == VARIABLE

    @property
    def values(self) -> int:
        """Number of values as `struct` counts them, if it is fixed."""
        return 2 if self.kind == "time" else self.length or 1

    @property
    def size(self) -> int:
        """Bytes, if they are fixed."""
        return self.values * struct.calcsize("<" + SCALARS.get(self.kind, "I"))

    @property
    def format(self) -> str:
        """Its code in `struct`."""
        if self.kind == "time":
            return "II"
        code = SCALARS[self.kind]
        return code if self.length is None else f"{self.length}{code}"


class _FixedRun(NamedTuple):
    """Neighbouring fields of fixed size, packed and unpacked together."""

    layout: struct.Struct
    values: int
    places: tuple[tuple[str, int | slice], ...]
    """Each field's name, and the index or slice of its values among those of the layout."""


def _fixed_run(fields: list[Field]) -> _FixedRun:
    places: list[tuple[str, int | slice]] = []
    count = 0
    for field in fields:
        single = field.length is None and field.kind != "time"
        places.append((field.name, count if single else slice(count, count + field.values)))
        count += field.values
    return _FixedRun(struct.Struct("<" + "".join(field.format for field in fields)), count, tuple(places))


def _parse_field(name: str, text: str) -> Field:
    kind, bracket, rest = text.partition("[")
    if not bracket:
        length = None
    elif rest == "]":
        length = VARIABLE
    else:
        length = int(rest[:-1]) if rest[:-1].isdigit() and rest[-1] == "]" else 0
    if length == 0 or (kind not in SCALARS and (kind not in ("time", "string") or length is not None)):
        raise ValueError(f"{name}: {text} is no type that a log record can have")
    if not name.isidentifier():
        raise ValueError(f"{name}: not a name for a field")
    return Field(name, kind, length)


class RecordType:
    """One topic and the layout of its records; made by `record_type` or read from a file.

    `pack(*values)` gives the bytes. Values come in the order of the fields: arrays of fixed size are spread into single
    values, "time" is seconds and nanoseconds, "string" takes a str, of which what UTF-8 can't encode is escaped (a
    file's name may be any bytes), "uint8[]" bytes, other open arrays a sequence.
    Raises ValueError for a definition that a log record can't have.
    """

    __slots__ = ("_parts", "definition", "fields", "pack", "schema_name", "size", "topic")

    pack: Callable[..., bytes]
    size: int | None
    """Bytes of each record, or None if they vary."""

    def __init__(self, topic: str, schema_name: str, definition: str) -> None:
        self.topic = topic
        self.schema_name = schema_name
        self.definition = definition
        """The layout as ROS 1 writes it, one line a field; it may hold comments."""
        lines = (line.partition("#")[0] for line in definition.splitlines())
        words = (line.split() for line in lines if line.strip() and "=" not in line)  # "=" defines a constant
        self.fields = tuple(_parse_field(name, kind) for kind, name in words)
        if len({field.name for field in self.fields}) < len(self.fields):
            raise ValueError(f"{topic}: two fields have one name")
        if sum(field.size for field in self.fields if not field.is_variable) > _MAX_RECORD_BYTES:
            raise ValueError(f"{topic}: a record would have more than {_MAX_RECORD_BYTES} bytes")
        self._parts = self._compile()
        if any(field.is_variable for field in self.fields):
            self.size = None
            self.pack = self._pack_variable
        else:
            layout = struct.Struct("<" + "".join(field.format for field in self.fields))
            self.size = layout.size
            self.pack = layout.pack

    def _compile(self) -> list[_FixedRun | Field]:
        parts: list[_FixedRun | Field] = []
        for is_variable, group in itertools.groupby(self.fields, lambda field: field.is_variable):
            if is_variable:
                parts.extend(group)
            else:
                parts.append(_fixed_run(list(group)))
        return parts

    def _pack_variable(self, *values: Any) -> bytes:
        packed = []
        position = 0
        for part in self._parts:
            if isinstance(part, _FixedRun):
                packed.append(part.layout.pack(*values[position : position + part.values]))
                position += part.values
                continue
            value = values[position]
            position += 1
            if part.kind == "string":
                value = value.encode(errors="backslashreplace")
            packed.append(_pack_length(len(value)))
            if not isinstance(value, bytes):
                value = struct.pack(f"<{len(value)}{SCALARS[part.kind]}", *value)
            packed.append(value)
        if position != len(values):
            raise ValueError(f"{self.topic}: {position} values make a record, not {len(values)}")
        return b"".join(packed)

    def unpack(self, data: bytes) -> dict[str, Any]:
        """The record's fields by name: numbers, tuples, str, bytes (for uint8[]). Raises struct.error if `data` is too
        short."""
        values: dict[str, Any] = {}
        position = 0
        for part in self._parts:
            if isinstance(part, _FixedRun):
                found = part.layout.unpack_from(data, position)
                for name, place in part.places:
                    values[name] = found[place]
                position += part.layout.size
                continue
            (count,) = _unpack_length(data, position)
            position += 4
            code = "s" if part.kind in ("string", "uint8") else SCALARS[part.kind]
            value: Any = struct.unpack_from(f"<{count}{code}", data, position)
            position += struct.calcsize(f"<{count}{code}")
            if code == "s":
                value = value[0].decode(errors="replace") if part.kind == "string" else value[0]
            values[part.name] = value
        return values

    @property
    def dtype(self) -> "np.dtype[np.void]":
        """The layout for numpy, without padding. Raises FlightLogError if records vary in size."""
        import numpy as np

        if self.size is None:
            raise FlightLogError(f"{self.topic}: its records vary in size; read them one by one")
        columns: list[Any] = []
        for field in self.fields:
            kind: Any = [("sec", "<u4"), ("nsec", "<u4")] if field.kind == "time" else "<" + SCALARS[field.kind]
            columns.append((field.name, kind) if field.length is None else (field.name, kind, (field.length,)))
        return np.dtype(columns)


def record_type(
    topic: str, schema_name: str, fields: Sequence[tuple[str, str]], comments: Mapping[str, str] | None = None
) -> RecordType:
    """A type of record from its fields as (name, type): "float64", "float64[3]", "bool", "string", "uint8[]", "time".

    `comments` by field name (units, enums) are kept in the file's schema. Raises ValueError for an unknown type.
    """
    lines = []
    for name, kind in fields:
        _parse_field(name, kind)
        comment = (comments or {}).get(name)
        lines.append(f"{kind} {name}  # {comment}" if comment else f"{kind} {name}")
    return RecordType(topic, schema_name, "\n".join(lines) + "\n")


DATAGRAM = record_type(
    "/courier/datagrams",
    "courier/Datagram",
    [("direction", "uint8"), ("address", "string"), ("data", "uint8[]")],
    {"direction": "0 received, 1 sent, 2 sent on for a ground station, 3 received from a sensor's own link"},
)
TEXT = record_type(
    "/log",
    "foxglove_msgs/Log",
    [
        ("timestamp", "time"),
        ("level", "uint8"),
        ("message", "string"),
        ("name", "string"),
        ("file", "string"),
        ("line", "uint32"),
    ],
    {"level": "0 unknown, 1 debug, 2 info, 3 warning, 4 error, 5 fatal"},
)
_datagram_head = struct.Struct("<BI").unpack_from


def datagram_of(record: bytes) -> tuple[int, bool, bytes]:
    """Direction, whether there is an address, and data of a DATAGRAM record; faster than `unpack`."""
    direction, address = _datagram_head(record)
    return direction, address > 0, record[9 + address :]
