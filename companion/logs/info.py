"""Description of a log: when, how long, how it was flown, how it ended. Of a finished flight log only the summary is
read."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from companion.logs.leaps import WithoutLeaps
from companion.logs.recordings import as_date, started_unix_s
from companion.logs.verdict import verdict_of
from companion.outcomes import Verdict
from protocol.flightlog import LogReader
from protocol.flightlog.summary import read_summary

if TYPE_CHECKING:
    from protocol.flightlog.tlog import TlogReader


@dataclass(frozen=True, slots=True)
class Info:
    """Description of a log."""

    path: Path
    kind: Literal["flight log", "telemetry log"]
    size_bytes: int
    started_unix_s: float | None
    """Wall clock; None where the log does not say it."""
    duration_s: float
    """From its first message to its last; of a telemetry log without leaps of its clock."""
    topics: dict[str, int]
    """Messages on each."""
    problem: str | None = None
    """What is wrong with it, as far as it was read."""
    complete: bool = True
    flight: dict[str, str] = field(default_factory=dict)
    """How it was flown: mission, output, pace, seed, versions."""
    result: dict[str, str] = field(default_factory=dict)
    """How it ended; empty if the flight was cut off."""
    verdict: Verdict | None = None
    """How it came out; None if it is no flight of this companion."""
    vehicle: dict[str, str] = field(default_factory=dict)
    """Firmware, version and parameters of the vehicle; empty if the flight was cut off."""
    attachments: dict[str, int] = field(default_factory=dict)
    """Sizes (bytes) of the files in it."""


def info(path: Path, *, check: bool = False) -> Info:
    """Describe a flight log or a telemetry log. `check`: read all of it and check every CRC.

    Raises FlightLogError if it can't be opened or is neither.
    """
    path = Path(path)
    summary = None if check else read_summary(path)
    if summary is not None:
        span_ns = summary.first_log_time, summary.last_log_time
        return _flight_info(path, summary.metadata, span_ns, topics=summary.topics, attachments=summary.attachments)
    # Imported here: what follows needs the MAVLink dialect, which costs more than the summary.
    from companion.logs.traffic import open_log

    log = open_log(path)
    return _read(log) if isinstance(log, LogReader) else _telemetry(log)


def _read(log: LogReader) -> Info:
    counts: Counter[str] = Counter()
    first_ns, last_ns = None, 0
    for record in log.records():
        counts[record.topic] += 1
        first_ns = record.time_ns if first_ns is None else min(first_ns, record.time_ns)
        last_ns = max(last_ns, record.time_ns)
    return _flight_info(
        log.path,
        log.metadata,
        (log.epoch_ns + (first_ns or 0), log.epoch_ns + last_ns),
        topics=dict(sorted(counts.items())),
        attachments={name: len(content) for name, content in log.attachments.items()},
        problem=log.problem,
        complete=log.complete,
    )


def _flight_info(path: Path, metadata: dict[str, dict[str, str]], span_ns: tuple[int, int], **rest: Any) -> Info:
    first_ns, last_ns = span_ns
    flight = metadata.get("flight", {})
    started = started_unix_s(metadata)
    if started is None and metadata.get("flightlog", {}).get("epoch_ns", "0") != "0":
        started = as_date(first_ns * 1e-9)
    return Info(
        path=path,
        kind="flight log",
        size_bytes=path.stat().st_size,
        started_unix_s=started,
        duration_s=(last_ns - first_ns) * 1e-9,
        flight=flight,
        result=metadata.get("result", {}),
        verdict=verdict_of(path, metadata),
        vehicle=metadata.get("vehicle", {}),
        **rest,
    )


def _telemetry(log: "TlogReader") -> Info:
    from protocol.framing import Framer
    from protocol.messages import layout

    framer = Framer()
    counts: Counter[tuple[int, int, int, bool]] = Counter()
    clock = WithoutLeaps()
    first_ns, last_ns = None, 0
    for time_us, data in log.entries():
        time_ns = clock.take(1000 * time_us)
        first_ns = time_ns if first_ns is None else min(first_ns, time_ns)
        last_ns = max(last_ns, time_ns)
        for frame in framer.datagram(data):
            counts[frame.system, frame.component, frame.message_id, frame.known] += 1
    topics = {
        f"/mavlink/{system}/{component}/{layout(number).name if known else f'UNKNOWN_{number}'}": count
        for (system, component, number, known), count in counts.items()
    }
    problem = log.problem
    if problem is None and framer.bad_bytes:
        problem = f"{log.path}: {framer.bad_bytes} bytes in it belong to no sound frame"
    return Info(
        path=log.path,
        kind="telemetry log",
        size_bytes=log.path.stat().st_size,
        started_unix_s=as_date((first_ns or 0) * 1e-9),
        duration_s=(last_ns - (first_ns or 0)) * 1e-9,
        topics=dict(sorted(topics.items())),
        problem=problem,
        complete=problem is None,
    )
