"""Logs changed on purpose, and what is in them."""

from collections.abc import Callable, Sequence
from pathlib import Path

from companion.logs.writer import Writer
from protocol.flightlog import DATAGRAM, Direction, LogReader, Record
from protocol.messages import Encoder, dialect

Flyer = Callable[..., Path]


def rewritten(
    source: Path,
    target: Path,
    change: Callable[[Record], Sequence[Record]] = lambda record: (record,),
    flight: dict[str, str] | None = None,
) -> Path:
    """`source` with each record replaced by what `change` makes of it, and entries of the metadata "flight" set."""
    log = LogReader(source)
    kinds = log.topics
    metadata = {name: table for name, table in log.metadata.items() if name != "flightlog"}
    metadata["flight"] = metadata.get("flight", {}) | (flight or {})
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
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
