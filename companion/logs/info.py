"""What a log is, at once: a finished flight log is not read but for its summary."""

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Literal

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from companion.logs.recordings import as_date, started_unix_s
from companion.logs.traffic import open_log
from protocol.flightlog import MAGIC, FlightLogError, LogReader
from protocol.flightlog.tlog import TlogReader
from protocol.framing import Framer
from protocol.messages import layout

_FOOTER = struct.Struct("<BQQQI")
_RECORD = struct.Struct("<BQ")


@dataclass(frozen=True, slots=True)
class Info:
    """A log from outside."""

    path: Path
    kind: Literal["flight log", "telemetry log"]
    size_bytes: int
    started_unix_s: float | None
    """By the wall's clock; None where the log does not know it."""
    duration_s: float
    """From its first message to its last, on the clock of its times."""
    topics: dict[str, int]
    """Messages on each."""
    problem: str | None = None
    """What is wrong with it, as far as was looked."""
    complete: bool = True
    flight: dict[str, str] = field(default_factory=dict)
    """How it was flown: mission, output, pace, seed, versions."""
    result: dict[str, str] = field(default_factory=dict)
    """How it ended; empty for a flight that did not come to its end."""
    attachments: dict[str, int] = field(default_factory=dict)
    """Files in it with their sizes."""


def info(path: Path, *, check: bool = False) -> Info:
    """Describe a flight log or a telemetry log. `check`: read all of it and check every CRC.

    Raises FlightLogError if it can't be opened or is neither.
    """
    path = Path(path)
    if not check:
        summarised = _from_summary(path)
        if summarised is not None:
            return summarised
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
        **rest,
    )


def _telemetry(log: TlogReader) -> Info:
    framer = Framer()
    counts: Counter[tuple[int, int, int, bool]] = Counter()
    first_us, last_us = None, 0
    for time_us, data in log.entries():
        first_us = time_us if first_us is None else min(first_us, time_us)
        last_us = max(last_us, time_us)
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
        started_unix_s=as_date((first_us or 0) * 1e-6),
        duration_s=(last_us - (first_us or 0)) * 1e-6,
        topics=dict(sorted(topics.items())),
        problem=problem,
        complete=problem is None,
    )


def _from_summary(path: Path) -> Info | None:
    """None for a file without a sound summary, for whatever reason."""
    length = _FOOTER.size + len(MAGIC)
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            footer_at = size - length
            if footer_at < len(MAGIC):
                return None
            file.seek(footer_at)
            end = file.read(length)
            opcode, _, start, offsets_start, crc = _FOOTER.unpack_from(end)
            if opcode != Opcode.FOOTER or end[_FOOTER.size :] != MAGIC or not 0 < start <= offsets_start < footer_at:
                return None
            file.seek(start)
            content = file.read(footer_at - start)
            if zlib.crc32(end[: _FOOTER.size - 4], zlib.crc32(content)) != crc:
                return None
            return _Summary(path, file, start, content, offsets_start - start).info()
    except OSError as error:
        raise FlightLogError(f"{path}: {error.strerror or error}") from error


class _Summary:
    """The end of a finished MCAP file."""

    def __init__(self, path: Path, file: BinaryIO, summary_start: int, content: bytes, offsets_at: int) -> None:
        self._path = path
        self._file = file
        self._start = summary_start
        self._content = content
        self._offsets_at = offsets_at
        self._groups: dict[int, tuple[int, int]] = {}

    def info(self) -> Info | None:
        """None if it is not such a summary as a flight log's."""
        try:
            for offset in self._parse(self._offsets_at, len(self._content), records.SummaryOffset.read):
                self._groups[offset.group_opcode] = offset.group_start - self._start, offset.group_length
            channels = {each.id: each.topic for each in self._group(Opcode.CHANNEL, records.Channel.read)}
            (statistics,) = self._group(Opcode.STATISTICS, records.Statistics.read)
            metadata = {}
            for index in self._group(Opcode.METADATA_INDEX, records.MetadataIndex.read):
                self._file.seek(index.offset + _RECORD.size)
                content = self._file.read(index.length - _RECORD.size)
                metadata[index.name] = records.Metadata.read(ReadDataStream(BytesIO(content))).metadata
            attached = list(self._group(Opcode.ATTACHMENT_INDEX, records.AttachmentIndex.read))
            topics: Counter[str] = Counter()
            for channel, count in statistics.channel_message_counts.items():
                topics[channels[channel]] += count
        except (McapError, ValueError, struct.error, KeyError, OverflowError, MemoryError):
            return None
        return _flight_info(
            self._path,
            metadata,
            (statistics.message_start_time, statistics.message_end_time),
            topics=dict(sorted(topics.items())),
            attachments={each.name: each.data_size for each in attached},
        )

    def _group(self, opcode: Opcode, read: Callable[[ReadDataStream], Any]) -> Iterator[Any]:
        start, length = self._groups.get(opcode, (0, 0))
        return self._parse(start, start + length, read)

    def _parse(self, position: int, stop: int, read: Callable[[ReadDataStream], Any]) -> Iterator[Any]:
        while position < stop:
            _, length = _RECORD.unpack_from(self._content, position)
            position += _RECORD.size
            yield read(ReadDataStream(BytesIO(self._content[position : position + length])))
            position += length
