"""Makes a whole log of one that was cut off or damaged, in a new file, and says what is lost."""

from dataclasses import dataclass
from pathlib import Path

from companion.logs.recordings import copied_metadata, printable
from companion.logs.target import output
from companion.logs.traffic import open_log
from companion.logs.writer import Writer
from protocol.flightlog import DATAGRAM, FlightLogError, LogReader, tlog
from protocol.framing import Framer

_LARGEST_STEP = 2
"""Step of the sequence between two records of a whole log: a status line between them has a number, too."""
_MOST_GAPS_LISTED = 10


@dataclass(frozen=True, slots=True)
class Repair:
    """What a repair came to."""

    target: Path | None
    """The whole file; None if there was nothing to repair."""
    kept: int
    """Messages or entries."""
    last_s: float
    """Latest time of those kept, since the flight's start or the telemetry log's first entry."""
    lost: list[str]
    """What is missing, a line each."""


def repair(source: Path, target: Path | None = None) -> Repair:
    """Write what is whole of `source` to `target`, a new file (by default `NAME_repaired` beside it).

    Raises FlightLogError if `source` can't be read, or `target` can't be written, exists or has the suffix of another
    kind of log.
    """
    log = open_log(source)
    suffix = ".mcap" if isinstance(log, LogReader) else ".tlog"
    target = target or source.with_name(f"{source.stem}_repaired{suffix}")
    if target.suffix in (".mcap", ".tlog") and target.suffix != suffix:
        raise FlightLogError(f"{target}: {source} is repaired as what it is, a {suffix}")
    return _flight(log, target) if isinstance(log, LogReader) else _telemetry(log, target)


def _flight(log: LogReader, target: Path) -> Repair:
    kept, last_ns, gaps = _survey(log)
    if log.problem is None:
        return Repair(None, kept, last_ns * 1e-9, [])
    lost = [log.problem.removeprefix(f"{log.path}: "), *gaps]
    metadata = copied_metadata(log)
    metadata["repair"] = {"source": printable(log.path.name), "lost": "\n".join(lost)}
    with output(target) as draft, Writer(draft, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        kinds = log.topics
        for record in log.records():
            writer.record(kinds[record.topic], record.time_ns, record.sequence, record.data)
    return Repair(target, kept, last_ns * 1e-9, lost)


def _survey(log: LogReader) -> tuple[int, int, list[str]]:
    """Number of messages that can be read, time of the last one (ns), and where some are missing."""
    kept, last_ns, sequence = 0, 0, None
    gaps: list[str] = []
    for record in log.records():
        kept += 1
        if record.topic == DATAGRAM.topic or not record.topic.startswith("/mavlink/"):
            step = 0 if sequence is None else (record.sequence - sequence) & 0xFFFF_FFFF
            if step > _LARGEST_STEP:
                gaps.append(f"{step - 1} records between {last_ns * 1e-9:.3f} and {record.time_ns * 1e-9:.3f} s")
            sequence = record.sequence
        last_ns = max(last_ns, record.time_ns)
    more = len(gaps) - _MOST_GAPS_LISTED
    return kept, last_ns, [*gaps[:_MOST_GAPS_LISTED], *([f"{more} more such gaps"] if more > 0 else [])]


def _telemetry(log: tlog.TlogReader, target: Path) -> Repair:
    kept, lost_bytes = 0, 0
    first_us, last_us = None, 0
    for entry in log.entries():
        whole = _whole(entry)
        kept += len(whole)
        lost_bytes += len(entry.data) - sum(len(each.data) for each in whole)
        if whole:
            first_us = entry.time_us if first_us is None else min(first_us, entry.time_us)
            last_us = max(last_us, entry.time_us)
    last_s = (last_us - (first_us or 0)) * 1e-6
    lost = [log.problem.removeprefix(f"{log.path}: ")] if log.problem else []
    lost += [f"{lost_bytes} bytes that belong to no sound frame"] * bool(lost_bytes)
    if not lost:
        return Repair(None, kept, last_s, [])
    with output(target) as draft:
        tlog.write(draft, (each for entry in log.entries() for each in _whole(entry)))
    return Repair(target, kept, last_s, lost)


def _whole(entry: tlog.Entry) -> list[tlog.Entry]:
    """An entry for each valid frame in `entry`: there are several where a stamp is damaged or missing."""
    return [tlog.Entry(entry.time_us, frame.raw) for frame in Framer().datagram(entry.data)]
