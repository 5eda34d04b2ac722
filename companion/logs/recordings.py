"""What files with recordings have in common, whoever wrote them, and their records as their schemas say."""

import contextlib
import math
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from protocol.flightlog import MAGIC, TEXT, FlightLogError, LogReader, Record, RecordType
from protocol.flightlog.tlog import is_tlog

DRAWN = "courier foxglove"
"""The library in the header of what `companion foxglove` writes: made from a recording, and at any time again."""
_DRAWN_HEAD = MAGIC + struct.pack("<BQII", Opcode.HEADER, 8 + len(DRAWN), 0, len(DRAWN)) + DRAWN.encode()
"""Without a profile."""
_EARLIEST_S, _LATEST_S = 0.0, 253_402_214_400.0
"""1970 and the end of the year 9999, where dates end."""


def is_drawn(path: Path) -> bool:
    """Whether `companion foxglove` made that file."""
    return _head(path) == _DRAWN_HEAD


def is_recording(path: Path) -> bool:
    """Whether that file is a flight log or a telemetry log, whole or damaged, that nothing can make again."""
    head = _head(path)
    if not head or is_drawn(path):
        return False
    if head.startswith(MAGIC) or is_tlog(path):
        return True
    with contextlib.suppress(FlightLogError):
        LogReader(path)
        return True
    return False


def _head(path: Path) -> bytes:
    """Nothing of what is no file, or can't be read."""
    with contextlib.suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                return file.read(len(_DRAWN_HEAD))
    return b""


def started_unix_s(metadata: Mapping[str, Mapping[str, str]]) -> float | None:
    """When the flight started by the wall's clock, from a log's metadata; None where it says none, or nonsense."""
    try:
        started = float(metadata["flight"]["started_unix_s"])
    except (KeyError, ValueError):
        return None
    return as_date(started)


def as_date(unix_s: float) -> float | None:
    """The same seconds since 1970, or None for what is no date."""
    return unix_s if math.isfinite(unix_s) and _EARLIEST_S <= unix_s < _LATEST_S else None


def has_texts(log: LogReader) -> bool:
    """Whether there are lines of the companion's own, which repeat what the vehicle says."""
    return next(log.records((TEXT.topic,)), None) is not None


def printable(text: object) -> str:
    """A path, or words with one in them, as UTF-8 can carry it: file names on Linux are any bytes."""
    return str(text).encode(errors="backslashreplace").decode()


def records(log: LogReader, kinds: Mapping[str, RecordType]) -> Iterator[Record]:
    """Those on these topics. Raises FlightLogError for one that has not its schema's size."""
    for record in log.records(kinds):
        size = kinds[record.topic].size
        if size is not None and len(record.data) != size:
            raise _misfit(log, record)
        yield record


def unpack(log: LogReader, kind: RecordType, record: Record) -> dict[str, Any]:
    """Its fields by name. Raises FlightLogError if it is cut."""
    try:
        return kind.unpack(record.data)
    except struct.error as error:
        raise _misfit(log, record) from error


def _misfit(log: LogReader, record: Record) -> FlightLogError:
    at_s = record.time_ns * 1e-9
    return FlightLogError(f"{log.path}: the record on {record.topic} at {at_s:.3f} s is not as its schema says")
