"""What recordings are, whoever wrote them: flight logs, telemetry logs, and files made from them."""

import contextlib
import math
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode

from companion.known_topics import is_foreign
from protocol.flightlog import FILE_NAME, MAGIC, TEXT, FlightLogError, LogReader, Record, RecordType

EXPORT_LIBRARY = "courier foxglove"
"""Library in the header of a file that `companion foxglove` wrote. Such a file can be made again from its recording."""
_EXPORT_HEADER = (
    MAGIC
    + struct.pack("<BQII", Opcode.HEADER, 8 + len(EXPORT_LIBRARY), 0, len(EXPORT_LIBRARY))
    + EXPORT_LIBRARY.encode()
)
"""First bytes of such a file: the header has no profile."""
SETPOINTS = frozenset({"SET_ATTITUDE_TARGET", "SET_ACTUATOR_CONTROL_TARGET", "SET_POSITION_TARGET_LOCAL_NED"})
"""Messages by which a companion flies a vehicle."""
FARTHEST_M = 1e5
"""A position (m) or a velocity (m/s) beyond is none, nor is one that is not a number: no companion flies by it."""
_EARLIEST_S = 0.0
"""1970, in seconds since then."""
_LATEST_S = 253_402_214_400.0
"""End of the year 9999, the last that `datetime` has, in seconds since 1970."""


def flights(logs: Path) -> set[Path]:
    """The logs in a folder of flights. Raises FlightLogError if it can't be looked into."""
    try:
        return set(logs.glob(f"*/{FILE_NAME}"))
    except OSError as error:
        raise FlightLogError(f"{printable(logs)}: {error.strerror}") from error


def newest(logs: Path) -> Path:
    """The log that was written to last in a folder of flights. Raises FlightLogError if there is none."""
    found = max(flights(logs), key=lambda path: path.stat().st_mtime, default=None)
    if found is None:
        raise FlightLogError(f"{logs}: there is no flight in it")
    return found


def is_export(path: Path) -> bool:
    """Whether `companion foxglove` made that file."""
    return _start(path) == _EXPORT_HEADER


def is_recording(path: Path) -> bool:
    """Whether that file is a flight log or a telemetry log, whole or damaged, and no export of one."""
    from protocol.flightlog.tlog import is_tlog  # it loads the MAVLink dialect

    head = _start(path)
    if not head or is_export(path):
        return False
    if head.startswith(MAGIC) or is_tlog(path):
        return True
    with contextlib.suppress(FlightLogError):
        LogReader(path)
        return True
    return False


def _start(path: Path) -> bytes:
    """First bytes of the file; empty if there is no file or it can't be read."""
    with contextlib.suppress(OSError):
        if path.is_file():
            with path.open("rb") as file:
                return file.read(len(_EXPORT_HEADER))
    return b""


def started_unix_s(metadata: Mapping[str, Mapping[str, str]]) -> float | None:
    """Wall clock at the flight's start (s since 1970), from a log's metadata; None where it is missing or no date."""
    try:
        started = float(metadata["flight"]["started_unix_s"])
    except (KeyError, ValueError):
        return None
    return as_date(started)


def copied_metadata(log: LogReader) -> dict[str, dict[str, str]]:
    """The metadata of a log for a copy of it, but for "flightlog", which says what is of the file alone. It still says
    what is missing, and that the last event may lack its answer, where nobody closed the log or its end is lost."""
    copied = {name: table for name, table in log.metadata.items() if name not in ("flightlog", "flightlog end")}
    lost_end = log.abandoned or ("the end of its source is damaged or missing" if log.problem is not None else None)
    if lost_end is not None or log.missing:
        copied["flightlog end"] = {"reason": lost_end or "closed", **log.missing}
    return copied


def whole_datagrams(metadata: Mapping[str, Mapping[str, str]]) -> bool:
    """Whether the vehicle's datagrams of a log hold whole frames, and not pieces of a stream (serial, TCP)."""
    return metadata.get("flight", {}).get("whole_datagrams") != "False"


def as_date(unix_s: float) -> float | None:
    """`unix_s` itself, or None if it is no date from 1970 to 9999."""
    return unix_s if math.isfinite(unix_s) and _EARLIEST_S <= unix_s < _LATEST_S else None


def has_texts(log: LogReader) -> bool:
    """Whether the log has the companion's own texts, which repeat those of the vehicle."""
    kind = log.topics.get(TEXT.topic)
    return kind is not None and not is_foreign(kind) and next(log.records((TEXT.topic,)), None) is not None


def printable(text: object) -> str:
    """`text` with what UTF-8 can't encode escaped: file names on Linux may be any bytes."""
    return str(text).encode(errors="backslashreplace").decode()


def records(log: LogReader, kinds: Mapping[str, RecordType]) -> Iterator[Record]:
    """The records on the topics of `kinds`. Raises FlightLogError for one whose size isn't its schema's."""
    for record in log.records(kinds):
        check_size(log, kinds[record.topic], record)
        yield record


def check_size(log: LogReader, kind: RecordType, record: Record) -> None:
    """Raises FlightLogError for a record whose size isn't its schema's."""
    if kind.size is not None and len(record.data) != kind.size:
        raise _misfit(log, record)


def unpack(log: LogReader, kind: RecordType, record: Record) -> dict[str, Any]:
    """A record's fields by name. Raises FlightLogError if it is shorter than its schema says."""
    try:
        return kind.unpack(record.data)
    except struct.error as error:
        raise _misfit(log, record) from error


def commanded(log: LogReader) -> set[str]:
    """The systems that setpoints were sent to, by the first one of each sender. Raises FlightLogError."""
    kinds = {
        topic: kind
        for topic, kind in log.topics.items()
        if topic.startswith("/mavlink/") and topic.rpartition("/")[2] in SETPOINTS and not is_foreign(kind)
    }
    first = ((kind, next(log.records((topic,)), None)) for topic, kind in kinds.items())
    return {str(unpack(log, kind, record)["target_system"]) for kind, record in first if record is not None}


def _misfit(log: LogReader, record: Record) -> FlightLogError:
    at_s = record.time_ns * 1e-9
    return FlightLogError(f"{log.path}: the record on {record.topic} at {at_s:.3f} s is not as its schema says")
