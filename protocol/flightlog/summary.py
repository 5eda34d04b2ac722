"""The summary at the end of a finished log, which says what is in it without the messages being read."""

import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from protocol.flightlog.chunks import DAMAGE
from protocol.flightlog.mcap_format import FOOTER, MAGIC, RECORD_HEADER, FlightLogError


@dataclass(frozen=True, slots=True)
class Summary:
    """What a finished log holds."""

    metadata: dict[str, dict[str, str]]
    attachments: dict[str, int]
    """Their sizes (bytes)."""
    topics: dict[str, int]
    """Messages on each."""
    first_log_time: int
    """ns since 1970, as that of the last message."""
    last_log_time: int


def read_summary(path: Path) -> Summary | None:
    """The summary of a log; None if it has none, or a damaged one. Raises FlightLogError if the file can't be read."""
    length = FOOTER.size + len(MAGIC)
    try:
        with path.open("rb") as file:
            footer_at = file.seek(0, 2) - length
            if footer_at < len(MAGIC):
                return None
            file.seek(footer_at)
            end = file.read(length)
            opcode, _, start, offsets_start, crc = FOOTER.unpack_from(end)
            if opcode != Opcode.FOOTER or end[FOOTER.size :] != MAGIC or not 0 < start <= offsets_start < footer_at:
                return None
            file.seek(start)
            content = file.read(footer_at - start)
            if zlib.crc32(end[: FOOTER.size - 4], zlib.crc32(content)) != crc:
                return None
            return _parse(file, content, start, offsets_start - start)
    except OSError as error:
        raise FlightLogError(f"{path}: {error.strerror or error}") from error
    except (*DAMAGE, MemoryError):
        return None


def _parse(file: BinaryIO, content: bytes, summary_start: int, offsets_at: int) -> Summary:
    """The summary's `content`, whose table of groups is at `offsets_at`. Raises one of DAMAGE or MemoryError."""
    groups = {
        each.group_opcode: (each.group_start - summary_start, each.group_length)
        for each in _each(content, offsets_at, len(content), records.SummaryOffset.read)
    }

    def group(opcode: Opcode, read: Callable[[ReadDataStream], Any]) -> Iterator[Any]:
        start, length = groups.get(opcode, (0, 0))
        return _each(content, start, start + length, read)

    channels = {each.id: each.topic for each in group(Opcode.CHANNEL, records.Channel.read)}
    (statistics,) = group(Opcode.STATISTICS, records.Statistics.read)
    metadata = {}
    for index in group(Opcode.METADATA_INDEX, records.MetadataIndex.read):
        file.seek(index.offset + RECORD_HEADER.size)
        table = file.read(index.length - RECORD_HEADER.size)
        metadata[index.name] = records.Metadata.read(ReadDataStream(BytesIO(table))).metadata
    attachments = group(Opcode.ATTACHMENT_INDEX, records.AttachmentIndex.read)
    topics: Counter[str] = Counter()
    for channel, count in statistics.channel_message_counts.items():
        topics[channels[channel]] += count
    return Summary(
        metadata=metadata,
        attachments={each.name: each.data_size for each in attachments},
        topics=dict(sorted(topics.items())),
        first_log_time=statistics.message_start_time,
        last_log_time=statistics.message_end_time,
    )


def _each(content: bytes, position: int, stop: int, read: Callable[[ReadDataStream], Any]) -> Iterator[Any]:
    while position < stop:
        _, length = RECORD_HEADER.unpack_from(content, position)
        position += RECORD_HEADER.size
        yield read(ReadDataStream(BytesIO(content[position : position + length])))
        position += length
