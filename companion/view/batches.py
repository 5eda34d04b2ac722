"""The records of a log in batches: the arrays that the report, the live page and its sources work on."""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.flightlog import DATAGRAM, LogReader, RecordType

Table = NDArray[np.void]
Batch = tuple[str, RecordType, NDArray[np.int64], Any]
"""Topic, type, times (n,) in ns and the records: a structured array (n,), or a list of n dicts if they vary in size."""

BATCH = 4096
"""Records of one topic that are handed on together."""


def batches(log: LogReader) -> Iterator[Batch]:
    """All topics of a log except the raw datagrams. Records that do not fit their schema are left out."""
    times: dict[str, list[int]] = {}
    parts: dict[str, list[bytes]] = {}
    kinds = log.topics
    wanted = frozenset(kinds) - {DATAGRAM.topic}
    for record in log.records(wanted):
        topic = record.topic
        try:
            held = parts[topic]
        except KeyError:
            held, times[topic] = parts.setdefault(topic, []), []
        held.append(record.data)
        times[topic].append(record.time_ns)
        if len(held) >= BATCH:
            yield from batch(kinds[topic], times[topic], held)
            parts[topic], times[topic] = [], []
    for topic, held in parts.items():
        yield from batch(kinds[topic], times[topic], held)


def batch(kind: RecordType, times: list[int], held: list[bytes]) -> Iterator[Batch]:
    """One batch of the records of a topic, or none if no record fits the schema."""
    size = kind.size
    if size is None:
        values = [_unpacked(kind, data) for data in held]
        kept = [(at, value) for at, value in zip(times, values, strict=True) if value is not None]
        if kept:
            yield kind.topic, kind, np.array([at for at, _ in kept], np.int64), [value for _, value in kept]
        return
    if any(len(data) != size for data in held):
        whole = [(at, data) for at, data in zip(times, held, strict=True) if len(data) == size]
        times, held = [at for at, _ in whole], [data for _, data in whole]
    if held:
        yield kind.topic, kind, np.array(times, np.int64), np.frombuffer(b"".join(held), kind.dtype)


def _unpacked(kind: RecordType, data: bytes) -> dict[str, Any] | None:
    try:
        return kind.unpack(data)
    except struct.error:
        return None


def sender_and_name(topic: str) -> tuple[str, str] | None:
    """Sender ("system/component") and message of a topic "/mavlink/SYSTEM/COMPONENT/NAME"; None for any other topic."""
    parts = topic.split("/")
    return (f"{parts[2]}/{parts[3]}", parts[4]) if len(parts) == 5 and parts[1] == "mavlink" else None
