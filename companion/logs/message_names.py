"""The names and fields of messages that the dialect lacks, from the definitions of pymavlink's other dialects.

A log carries such messages as UNKNOWN_{id}: their checksums could not be verified. For their names the definitions are
read as text, and only where a log has one: to import them takes a while.
"""

import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import Any

_MOST_BYTES = 255
"""A payload of MAVLink has no more."""
_UNKNOWN = re.compile(r"(.*/)UNKNOWN_(\d+)")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_MESSAGE = re.compile(r'<message(?=[^>]*\sid="(\d+)")(?=[^>]*\sname="(\w+)")')
_INCLUDE = re.compile(r"<include>([\w.]+)</include>")


def with_name(topic: str) -> str:
    """The topic of a message with its name, where any dialect has one; others as they are."""
    unknown = _UNKNOWN.fullmatch(topic)
    name = None if unknown is None else _names().get(int(unknown[2]))
    return topic if unknown is None or name is None else f"{unknown[1]}{name}"


def decoded(topic: str, record: dict[str, Any]) -> dict[str, Any] | None:
    """The fields of a record of a message that the dialect lacks; None for others, where no dialect has it, and for
    what is no payload.

    Trailing zeros are restored, and bytes after the last field that is known are ignored, as for other messages.
    """
    unknown = _UNKNOWN.fullmatch(topic)
    number = -1 if unknown is None else int(unknown[2])
    payload = record.get("payload")
    if number not in _names() or not isinstance(payload, bytes) or len(payload) > _MOST_BYTES:
        return None
    from pymavlink.dialects.v20 import all as everything

    head = bytes((len(payload), 0, 0, 0, 1, 1)) + number.to_bytes(3, "little")
    checksum = everything.x25crc(head + payload)
    checksum.accumulate(bytes((everything.mavlink_map[number].crc_extra,)))
    frame = b"\xfd" + head + payload + checksum.crc.to_bytes(2, "little")
    message = everything.MAVLink(None).decode(bytearray(frame))
    return {name: getattr(message, name) for name in message.get_fieldnames()}


@cache
def _names() -> dict[int, str]:
    """By id, of all dialects that pymavlink's `all` includes."""
    found = importlib.util.find_spec("pymavlink")
    if found is None or found.origin is None:
        return {}
    folder = Path(found.origin).parent / "dialects" / "v20"
    names: dict[int, str] = {}
    waiting, seen = ["all.xml"], set[str]()
    while waiting:
        file = waiting.pop()
        if file in seen or not (folder / file).is_file():
            continue
        seen.add(file)
        text = _COMMENT.sub("", (folder / file).read_text(encoding="utf-8"))
        names |= {int(number): name for number, name in _MESSAGE.findall(text)}
        waiting += _INCLUDE.findall(text)
    return names
