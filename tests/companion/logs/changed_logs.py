"""Logs changed on purpose, and what is in them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mcap.writer

from companion.logs.writer import Writer
from protocol.flightlog import DATAGRAM, Direction, LogReader, Record
from protocol.flightlog.tlog import Entry, write
from protocol.messages import Encoder, dialect

Flyer = Callable[..., Path]


def rewritten(
    source: Path,
    target: Path,
    change: Callable[[Record], Sequence[Record]] = lambda record: (record,),
    flight: dict[str, str] | None = None,
    end: dict[str, str] | None = None,
    attachment: Callable[[str, bytes], bytes] = lambda name, content: content,
) -> Path:
    """`source` with each record replaced by what `change` makes of it, entries of the metadata "flight" and "flightlog
    end" set, and the attachments by what `attachment` makes of them."""
    log = LogReader(source)
    kinds = log.topics
    metadata = {name: table for name, table in log.metadata.items() if name != "flightlog"}
    for name, entries in (("flight", flight), ("flightlog end", end)):
        metadata[name] = metadata.get(name, {}) | (entries or {})
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, attachment(name, content))
        for record in log.records():
            for each in change(record):
                writer.record(kinds[each.topic], each.time_ns, each.sequence, each.data)
    return target


def heartbeat(number: int) -> bytes:
    """A vehicle's, with a number in it."""
    return Encoder(1, 1).encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, number, 4, 3)


def sent(record: Record) -> bytes | None:
    """The bytes, if it is a datagram that went out."""
    if record.topic != DATAGRAM.topic or record.data[0] != Direction.OUT:
        return None
    data = DATAGRAM.unpack(record.data)["data"]
    assert isinstance(data, bytes)
    return data


def foreign(
    target: Path, topics: dict[str, tuple[str, str, list[tuple[int, bytes]]]], metadata: Any = None, **options: Any
) -> Path:
    """A log by the mcap package: of each topic the schema's name, its ROS 1 text, and the records with their times."""
    with target.open("wb") as file:
        writer = mcap.writer.Writer(file, **options)
        writer.start()
        for name, table in (metadata or {"flightlog": {"epoch_ns": "0"}}).items():
            writer.add_metadata(name, table)
        for topic, (name, definition, records) in topics.items():
            schema = writer.register_schema(name, "ros1msg", definition.encode())
            channel = writer.register_channel(topic, "ros1", schema)
            for number, (time_ns, data) in enumerate(records):
                writer.add_message(channel, time_ns, data, time_ns, number)
        writer.finish()  # type: ignore[no-untyped-call]
    return target


def telemetry_log(target: Path, *messages: Any, every_us: int = 100_000, start_us: int = 1_700_000_000_000_000) -> Path:
    """A telemetry log of pymavlink's messages from the vehicle 1/1, or of frames as they are."""
    sender = dialect.MAVLink(None, 1, 1)
    frames = [each if isinstance(each, bytes) else bytes(each.pack(sender)) for each in messages]
    write(target, (Entry(start_us + number * every_us, frame) for number, frame in enumerate(frames)))
    return target


def stream_log(target: Path, messages: Sequence[bytes], piece: int) -> Path:
    """A flight log over a serial line: the vehicle's messages, of which each read brought a piece of so many bytes, and
    one of the companion's between any two pieces."""
    stream, ours = (
        b"".join(messages),
        Encoder(245, 191).encode_fields(dialect.MAVLink_heartbeat_message, 6, 8, 0, 0, 4, 3),
    )
    with Writer(target, 1_700_000_000_000_000_000, {"flight": {"whole_datagrams": "False"}}) as writer:
        for number, at in enumerate(range(0, len(stream), piece)):
            time_ns = 1_000_000 * number
            for direction, data in ((Direction.IN, stream[at : at + piece]), (Direction.OUT, ours)):
                writer.record(DATAGRAM, time_ns, number, DATAGRAM.pack(direction, "/dev/ttyS0", data))
    return target
