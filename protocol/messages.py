"""MAVLink messages to bytes and back: encoders and decoders compiled once from the metadata of pymavlink's classes.

The messages are instances of pymavlink's classes, as its own parser returns them; `dialect` is its generated module.
What pymavlink does for each packet (reordering, lengths, defaults) is done here once, when a message is first used.
"""

import reprlib
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

from fastcrc.crc16 import mcrf4xx  # required: without it pymavlink silently falls back to a slow one
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.framing import Frame

__all__ = [
    "HIGHEST_FLOAT",
    "AvailableModes",
    "ComponentMetadata",
    "CurrentMode",
    "Encoder",
    "Field",
    "Layout",
    "ProtocolVersion",
    "decode",
    "decoder_of",
    "dialect",
    "layout",
]

HIGHEST_FLOAT: Final = (2.0 - 2.0**-23) * 2.0**127
"""What a field of type float has room for."""
_pack_header = struct.Struct("<BxxBBB3s").pack
_FORMATS: Final = {
    "char": "s",
    "int8_t": "b",
    "uint8_t": "B",
    "int16_t": "h",
    "uint16_t": "H",
    "int32_t": "i",
    "uint32_t": "I",
    "int64_t": "q",
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
}


class _NewMessage(dialect.MAVLink_message):  # type: ignore[misc]
    """A message that the dialect does not have yet."""

    id: int
    fieldnames: tuple[str, ...]
    ordered_fieldnames: tuple[str, ...]
    fieldtypes: tuple[str, ...]
    array_lengths: tuple[int, ...]
    crc_extra: int

    def __init__(self, *values: Any) -> None:
        super().__init__(self.id, self.msgname)
        for name, value in zip(self.fieldnames, values, strict=True):
            setattr(self, name, value)


class AvailableModes(_NewMessage):
    """AVAILABLE_MODES."""

    id = 435
    msgname = "AVAILABLE_MODES"
    fieldnames = ("number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name")
    ordered_fieldnames = ("custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name")
    fieldtypes = ("uint8_t", "uint8_t", "uint8_t", "uint32_t", "uint32_t", "char")
    array_lengths = (0, 0, 0, 0, 0, 35)
    crc_extra = 134


class CurrentMode(_NewMessage):
    """CURRENT_MODE."""

    id = 436
    msgname = "CURRENT_MODE"
    fieldnames = ("standard_mode", "custom_mode", "intended_custom_mode")
    ordered_fieldnames = ("custom_mode", "intended_custom_mode", "standard_mode")
    fieldtypes = ("uint8_t", "uint32_t", "uint32_t")
    array_lengths = (0, 0, 0)
    crc_extra = 193


class ComponentMetadata(_NewMessage):
    """COMPONENT_METADATA."""

    id = 397
    msgname = "COMPONENT_METADATA"
    fieldnames = ordered_fieldnames = ("time_boot_ms", "file_crc", "uri")
    fieldtypes = ("uint32_t", "uint32_t", "char")
    array_lengths = (0, 0, 100)
    crc_extra = 182


class ProtocolVersion(_NewMessage):
    """PROTOCOL_VERSION."""

    id = 300
    msgname = "PROTOCOL_VERSION"
    fieldnames = ordered_fieldnames = (
        "version",
        "min_version",
        "max_version",
        "spec_version_hash",
        "library_version_hash",
    )
    fieldtypes = ("uint16_t", "uint16_t", "uint16_t", "uint8_t", "uint8_t")
    array_lengths = (0, 0, 0, 8, 8)
    crc_extra = 217


_CLASSES: Final = dialect.mavlink_map | {
    each.id: each for each in (AvailableModes, CurrentMode, ComponentMetadata, ProtocolVersion)
}
"""Message classes by id."""


class Field(NamedTuple):
    """A field of a message. `type` is MAVLink's name (`uint16_t`, `char`), `array_length` is 0 for a single value."""

    name: str
    type: str
    array_length: int

    @property
    def size(self) -> int:
        """Bytes."""
        return _struct(self).size


@dataclass(frozen=True, slots=True)
class Layout:
    """The payload of a message: little-endian without padding, fields in wire order, extensions after the others."""

    message_id: int
    name: str
    fields: tuple[Field, ...]
    size: int
    """Bytes of the payload with all extensions and all trailing zeros."""
    crc_extra: int


@cache
def layout(message_id: int) -> Layout:
    """The layout of a message. Raises KeyError for one that the dialect does not have."""
    message_class = _CLASSES[message_id]
    types = dict(zip(message_class.fieldnames, message_class.fieldtypes, strict=True))
    fields = tuple(
        Field(name, types[name], length)
        for name, length in zip(message_class.ordered_fieldnames, message_class.array_lengths, strict=True)
    )
    return Layout(message_id, message_class.msgname, fields, _struct(*fields).size, message_class.crc_extra)


def decode(frame: Frame) -> Any | None:
    """The message as pymavlink's parser returns it, or None if the dialect does not have it.

    Trailing zeros are restored, and the bytes after the last known field (a newer sender's extensions) are ignored. A
    text ends at its first zero byte; all its bytes are in `_{name}_raw`. `get_payload` is the payload as sent,
    `get_header` the frame. Values are not checked: NaN and an empty payload pass.
    """
    return _decoders[frame.message_id](frame)


def decoder_of(message_id: int) -> Callable[[Frame], Any]:
    """`decode` for the frames of one message, one call shorter."""
    return _decoders[message_id]


class Encoder:
    """One sender: its ids and its sequence counter. It writes MAVLink 2, unsigned, without trailing zeros."""

    __slots__ = ("component", "sequence", "system")

    def __init__(self, system: int, component: int) -> None:
        if not (0 < system < 256 and 0 < component < 256):
            raise ValueError(f"a sender's ids are 1 to 255, not {system}/{component}")
        self.system = system
        self.component = component
        self.sequence = 0
        """Sequence number of the next frame."""

    def encode(self, message: Any) -> bytes:
        """A frame with this message, which does not change.

        Raises ValueError, naming message and field, for a value that does not fit.
        """
        packer = _packers[type(message)]
        return self._frame(packer, packer.message(message))

    def encode_fields(self, message_class: type[Any], *fields: Any) -> bytes:
        """The same from the arguments of the message's constructor, without an instance. Extensions may be left out.

        Texts are bytes; one that is too long is cut as pymavlink does. Raises ValueError, naming message and field,
        for a value that does not fit, and TypeError for a wrong number of fields.
        """
        packer = _packers[message_class]
        return self._frame(packer, packer.fields(*fields))

    def encode_payload(self, message_class: type[Any], payload: bytes) -> bytes:
        """The same from the packed fields, in wire order."""
        return self._frame(_packers[message_class], payload)

    def _frame(self, packer: "_Packer", full_payload: bytes) -> bytes:
        payload = full_payload.rstrip(b"\0") or b"\0"
        body = _pack_header(len(payload), self.sequence, self.system, self.component, packer.message_id) + payload
        checksum = mcrf4xx(body + packer.crc_extra)
        self.sequence = (self.sequence + 1) & 0xFF
        return b"\xfd" + body + checksum.to_bytes(2, "little")


@dataclass(frozen=True, slots=True)
class _Packer:
    message_id: bytes
    crc_extra: bytes
    fields: Callable[..., bytes]
    """Packs the constructor's arguments into a full payload."""
    message: Callable[[Any], bytes]


class _Decoders(dict[int, Callable[[Frame], Any]]):
    """By message id, compiled at the first use. Unknown ids are not kept: a peer could fill the memory with them."""

    def __missing__(self, message_id: int) -> Callable[[Frame], Any]:
        message_class = _CLASSES.get(message_id)
        if message_class is None:
            return lambda frame: None
        decoder = self[message_id] = _compile_decoder(message_class)
        return decoder


_decoders = _Decoders()


class _Packers(dict[type[Any], _Packer]):
    def __missing__(self, message_class: type[Any]) -> _Packer:
        if _CLASSES.get(getattr(message_class, "id", None)) is not message_class:
            raise ValueError(f"{message_class.__name__} is no message of the dialect")
        packer = self[message_class] = _compile_packer(message_class)
        return packer


_packers = _Packers()


def _struct(*fields: Field) -> struct.Struct:
    return struct.Struct("<" + "".join(f"{field.array_length or ''}{_FORMATS[field.type]}" for field in fields))


def _compile(name: str, source: str, names: dict[str, Any]) -> Any:
    # the source consists of the dialect's names only, never of received bytes
    exec(compile(source, f"<{name}>", "exec"), names)
    return names[name]


def _compile_packer(message_class: Any) -> _Packer:
    shape = layout(message_class.id)
    arguments = ", ".join(message_class.fieldnames)
    names: dict[str, Any] = {"_Error": struct.error, "_misfit": _misfit}
    values = []
    scalars = "<"
    for field in shape.fields:
        own_struct = _struct(field)
        if field.array_length and field.type != "char":
            values.append(f"_pack_{field.name}(*{field.name})")
            scalars += f"{own_struct.size}s"
            names[f"_pack_{field.name}"] = own_struct.pack
        else:
            values.append(field.name)
            scalars += own_struct.format[1:]
    names["_pack"] = struct.Struct(scalars).pack
    source = f"""
def {shape.name}({arguments}):
    try:
        return _pack({", ".join(values)})
    except (_Error, OverflowError, TypeError) as _error:
        raise _misfit({shape.message_id}, ({arguments},)) from _error
"""
    pack = _compile(shape.name, source, names)
    pack.__defaults__ = message_class.__init__.__defaults__

    texts = {field.name for field in shape.fields if field.type == "char"}
    attributes = ", ".join(f"m._{name}_raw" if name in texts else f"m.{name}" for name in message_class.fieldnames)
    source = f"def message(m): return _pack({attributes})"
    return _Packer(
        message_id=shape.message_id.to_bytes(3, "little"),
        crc_extra=bytes((shape.crc_extra,)),
        fields=pack,
        message=_compile("message", source, {"_pack": pack}),
    )


def _misfit(message_id: int, values: tuple[Any, ...]) -> ValueError:
    """The error for the first of these values, in the constructor's order, that can't be packed."""
    shape = layout(message_id)
    fields = {field.name: field for field in shape.fields}
    for name, value in zip(_CLASSES[message_id].fieldnames, values, strict=True):
        field = fields[name]
        try:
            _struct(field).pack(*(value if field.array_length and field.type != "char" else (value,)))
        except (struct.error, OverflowError, TypeError):
            array = f"[{field.array_length}]" if field.array_length else ""
            return ValueError(f"{shape.name}.{name}: {reprlib.repr(value)} does not fit {field.type}{array}")
    return ValueError(f"{shape.name}: {reprlib.repr(values)} does not fit")


def _compile_decoder(message_class: Any) -> Callable[[Frame], Any]:
    shape = layout(message_class.id)
    blank = {"char": b"", "float": 0.0, "double": 0.0}
    by_name = {field.name: field for field in shape.fields}
    prototype = message_class(
        *(
            [0] * field.array_length if field.array_length and field.type != "char" else blank.get(field.type, 0)
            for field in map(by_name.__getitem__, message_class.fieldnames)
        )
    )
    # the first instance also fixes the order of the class's attributes, which CPython needs to store them fast
    own = {"_header", "_msgbuf", "_payload", "_crc"} | by_name.keys() | {f"_{name}_raw" for name in by_name}
    # attributes that the constructor sets and no packet changes are set without calling it
    constants = {name: value for name, value in vars(prototype).items() if name not in own}
    lines = [f"m.{name} = _constant{name}" for name in constants]

    names: dict[str, Any] = {"_len": len, "_new": object.__new__, "_class": message_class}
    targets = []
    scalars = ""
    offset = 0
    for field in shape.fields:
        own_struct = _struct(field)
        if not field.array_length:
            targets.append(f"m.{field.name}")
            scalars += own_struct.format[1:]
        elif field.type == "char":
            targets.append(f"m._{field.name}_raw")
            scalars += own_struct.format[1:]
            lines.append(f"m._{field.name}_raw = text = m._{field.name}_raw.rstrip(b'\\0')")
            lines.append(f"m.{field.name} = text.split(b'\\0', 1)[0].decode('ascii', 'replace')")
        else:
            scalars += f"{own_struct.size}x"
            lines.append(f"m.{field.name} = [*_unpack_{field.name}(payload, {offset})]")
            names[f"_unpack_{field.name}"] = own_struct.unpack_from
        offset += own_struct.size
    names["_unpack"] = struct.Struct("<" + scalars).unpack

    body = "\n    ".join(lines)
    source = f"""
def {shape.name}(frame):
    payload = frame.payload
    length = _len(payload)
    m = _new(_class)
    m._header = frame
    m._payload = payload
    m._msgbuf = frame.raw
    m._crc = frame.checksum
    if length < {shape.size}:
        payload = payload.ljust({shape.size}, b"\\0")
    elif length > {shape.size}:
        payload = payload[:{shape.size}]
    [{", ".join(targets)}] = _unpack(payload)
    {body}
    return m
"""
    names |= {f"_constant{name}": value for name, value in constants.items()}
    decoder: Callable[[Frame], Any] = _compile(shape.name, source, names)
    return decoder
