"""A log that was cut off or damaged made whole again, in a file of its own, and what of it is lost."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from companion.logs.writer import Writer
from protocol import tlog
from protocol.flightlog import DATAGRAM, FlightLogError, LogReader
from protocol.framing import Framer

_MOST_BETWEEN = 2
"""See replay."""
_MOST_GAPS_TOLD = 10


@dataclass(frozen=True, slots=True)
class Repair:
    """`target`: the whole file, None if there was nothing to repair."""

    target: Path | None
    kept: int
    """Messages or entries."""
    last_s: float
    """Time of the last one kept, from the flight's or the file's start."""
    lost: list[str]
    """A line each."""


def repair(source: Path, target: Path | None = None) -> Repair:
    """Write what is whole of `source` to `target` (`NAME_repaired` beside it), which may not exist yet.

    Raises FlightLogError if the one can't be read or the other not be written.
    """
    target = target or source.with_name(f"{source.stem}_repaired{source.suffix}")
    try:
        log = LogReader(source)
    except FlightLogError:
        if not source.is_file():
            raise
        return _telemetry(tlog.TlogReader(source), target)
    kept, last_ns, gaps = _look(log)
    if log.problem is None:
        return Repair(None, kept, last_ns * 1e-9, [])
    lost = [log.problem.removeprefix(f"{source}: "), *gaps]
    metadata = {name: table for name, table in log.metadata.items() if name not in ("flightlog", "flightlog end")}
    metadata["repair"] = {"source": source.name, "lost": "\n".join(lost)}
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        kinds = log.topics
        for record in log.records():
            writer.record(kinds[record.topic], record.time_ns, record.sequence, record.data)
    return Repair(target, kept, last_ns * 1e-9, lost)


def _look(log: LogReader) -> tuple[int, int, list[str]]:
    """Messages that can be read, the last one's time (ns), and where some are missing."""
    kept, last_ns, sequence = 0, 0, None
    gaps: list[str] = []
    for record in log.records():
        kept += 1
        if record.topic == DATAGRAM.topic or not record.topic.startswith("/mavlink/"):
            step = 0 if sequence is None else (record.sequence - sequence) & 0xFFFF_FFFF
            if step > _MOST_BETWEEN:
                gaps.append(f"{step - 1} records between {last_ns * 1e-9:.3f} and {record.time_ns * 1e-9:.3f} s")
            sequence = record.sequence
        last_ns = max(last_ns, record.time_ns)
    more = len(gaps) - _MOST_GAPS_TOLD
    return kept, last_ns, [*gaps[:_MOST_GAPS_TOLD], *([f"{more} more such gaps"] if more > 0 else [])]


def _telemetry(log: tlog.TlogReader, target: Path) -> Repair:
    lost_bytes = 0
    first_us, last_us = None, 0

    def sound() -> Iterator[tlog.Entry]:
        nonlocal lost_bytes, first_us, last_us
        framer = Framer()
        for entry in log.entries():
            whole = b"".join(frame.raw for frame in framer.datagram(entry.data)[:1])
            lost_bytes += len(entry.data) - len(whole)
            if whole:
                first_us = entry.time_us if first_us is None else first_us
                last_us = entry.time_us
                yield tlog.Entry(entry.time_us, whole)

    kept = tlog.write(target, sound())
    last_s = (last_us - (first_us or 0)) * 1e-6
    if not lost_bytes and log.problem is None:
        target.unlink()
        return Repair(None, kept, last_s, [])
    lost = [log.problem.removeprefix(f"{log.path}: ")] if log.problem else []
    return Repair(target, kept, last_s, [*lost, f"{lost_bytes} bytes that belong to no sound frame"])
