"""The parts of a ULog file (docs.px4.io, "ULog File Format"), byte for byte. Times are in microseconds."""

import struct

_MOST_BYTES = 0xFFFF
"""Size of one part at most."""

_HEADER = b"ULog\x01\x12\x35\x01"
_HEAD = struct.Struct("<HB")
_STAMP = struct.Struct("<Q")
_DATA = struct.Struct("<HQ")
_SUBSCRIPTION = struct.Struct("<BH")
_LONGEST_INFO = 1024
"""Bytes of an information part's text."""


def header(first_us: int) -> bytes:
    """The beginning of a file, before all other parts."""
    return _HEADER + _STAMP.pack(first_us) + _part("B", bytes(40))


def information(key: str, value: str) -> bytes:
    """One of the facts about the whole file."""
    text = value.encode()[:_LONGEST_INFO]
    return _part("I", _named(f"char[{len(text)}] {key}") + text)


def parameter(name: str, value: float | int) -> bytes:
    """A parameter's value at the beginning; whole ones as 32 bits."""
    kind, form = ("int32_t", "<i") if isinstance(value, int) else ("float", "<f")
    return _part("P", _named(f"{kind} {name}") + struct.pack(form, value))


def definition(topic: str, fields: str) -> bytes:
    """The fields of a topic, behind the timestamp: `float x;float y;`."""
    return _part("F", _defined(topic, fields))


def subscription(number: int, topic: str, instance: int = 0) -> bytes:
    """From now on the records of this number are of that topic. Definitions come before all of these."""
    return _part("A", _SUBSCRIPTION.pack(instance, number) + topic.encode())


def record(number: int, time_us: int, fields: bytes) -> bytes:
    """Packed fields of the topic that has this number."""
    return _part("D", _DATA.pack(number, time_us) + fields)


def text(severity: int, time_us: int, words: str) -> bytes:
    """A logged message, with syslog's severity (0 to 7)."""
    return _part("L", (bytes((ord("0") + severity,)) + _STAMP.pack(time_us) + words.encode())[:_MOST_BYTES])


def fits(topic: str, fields: str, size: int) -> bool:
    """Whether the definition, and records of this size, fit one part."""
    return max(len(_defined(topic, fields)), _DATA.size + size) <= _MOST_BYTES


def _defined(topic: str, fields: str) -> bytes:
    return f"{topic}:uint64_t timestamp;{fields}".encode()


def _named(key: str) -> bytes:
    return bytes((len(key),)) + key.encode()


def _part(kind: str, content: bytes) -> bytes:
    return _HEAD.pack(len(content), ord(kind)) + content
