"""Records, files and conditions that the tests of the log share."""

import random
import time
import tracemalloc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import (
    Channel,
    Chunk,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    MAGIC,
    FlightLog,
    LogReader,
    Record,
    read,
    record_type,
)

COUNT = record_type("/courier/count", "courier/Count", [("number", "int64"), ("filling", "uint8[]")])


TRACE = record_type(
    "/courier/trace",
    "courier/Trace",
    [("position_ned", "float64[3]"), ("phase", "uint8"), ("armed", "bool"), ("thrust", "float32")],
    {"position_ned": "m", "phase": "0=wait"},
)


EPOCH_NS = 1_700_000_000_123_456_789


DEADLINE_S = 20.0


Opener = Callable[..., FlightLog]


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.002)


def count(log: FlightLog, numbers: range, filling: Callable[[int], bytes] = lambda number: b"") -> None:
    for number in numbers:
        log.record(COUNT, number * 1000, COUNT.pack(number, filling(number)))


def is_written(log: FlightLog, records: int) -> bool:
    return log.written == records


def numbers_of(path: Path) -> list[int]:
    return [COUNT.unpack(record.data)["number"] for record in read(path, (COUNT.topic,))]


def frame_of(message: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, system, component)))


def noise(seed: int) -> Callable[[int], bytes]:
    """Fillings that can't be compressed, so that chunks are full soon."""
    generator = random.Random(seed)
    return lambda number: generator.randbytes(generator.randrange(3000))


def grown(what: Callable[[], object]) -> int:
    """Bytes that are still held after it."""
    tracemalloc.start()
    what()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held


def written(content: bytes, path: Path) -> tuple[list[Record], LogReader]:
    path.unlink(missing_ok=True)  # quicker than to cut it, and nobody's reader loses the bytes that it has mapped
    path.write_bytes(content)
    reader = LogReader(path)
    return list(reader.records()), reader


def rewrite(source: LogReader, records: list[Record], writer: Writer, between: Sequence[int] = ()) -> None:
    """The records as the mcap package writes them, and now and then a message on each of the channels `between`."""
    writer.add_metadata("flightlog", {"epoch_ns": str(source.epoch_ns)})
    channels = {}
    for topic, kind in source.topics.items():
        schema = writer.register_schema(kind.schema_name, "ros1msg", kind.definition.encode())
        channels[topic] = writer.register_channel(topic, "ros1", schema)
    for number, record in enumerate(records):
        log_time = source.epoch_ns + record.time_ns
        for channel in between if number % 50 == 0 else ():
            writer.add_message(channel, log_time, bytes(10), log_time)
        writer.add_message(channels[record.topic], log_time, record.data, log_time, record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]


def encoded(*records: McapRecord) -> bytes:
    """As the mcap package writes them."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


DEFINITION = encoded(Schema(1, b"float64 a", "ros1msg", "x/X"), Channel(1, "/x", "ros1", {}, 1))
"""The definition of channel 1, as long as a record is."""


START = MAGIC + encoded(Header("", ""), Metadata("flightlog", {"epoch_ns": "0"}))


def chunked(content: bytes, *, packed: bytes | None = None, size: int | None = None, cut: int = 0) -> bytes:
    """A log of one chunk that has no checksum, without its end; `cut` bytes of the chunk are missing."""
    packed = zstandard.compress(content) if packed is None else packed
    chunk = encoded(Chunk("zstd", packed + bytes(cut), 0, 0, 0, len(content) if size is None else size))
    return START + chunk[: len(chunk) - cut]


def chunk_ends(path: Path) -> list[tuple[int, int]]:
    """The end of each chunk in the file, and the messages up to there, by the mcap package."""
    ends = []
    total = 0
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                total += sum(isinstance(inner, Message) for inner in breakup_chunk(record))
                ends.append((file.tell(), total))
    return ends
