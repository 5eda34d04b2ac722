"""The records of a log in batches: the arrays that the report, the live page and its sources work on."""

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.known_topics import is_foreign
from companion.logs.leaps import is_leap
from protocol.flightlog import DATAGRAM, FlightLogError, LogReader, Record, RecordType

Table = NDArray[np.void]
Batch = tuple[str, RecordType, NDArray[np.int64], Any]
"""Topic, type, times (n,) in ns and the records: a structured array (n,), or a list of n dicts if they vary in size."""

BATCH = 4096
"""Records of one topic that are handed on together."""
_MOST_HELD = 100
"""Records that may be looked at before it is known whether a log's clock leapt."""


class Leap(NamedTuple):
    """A leap of a log's clock, or a pause of half an hour or more: it is left out of the times."""

    at_ns: int
    """When it comes, in times without it and those before."""
    by_ns: int
    """Negative where the clock was set back."""


def batches(log: LogReader, leaps: list[Leap] | None = None) -> Iterator[Batch]:
    """All topics of a log except the raw datagrams, in times without leaps, which are added to `leaps`. What
    `batch` leaves out is left out."""
    times: dict[str, list[int]] = {}
    parts: dict[str, list[bytes]] = {}
    kinds = log.topics
    wanted = frozenset(kinds) - {DATAGRAM.topic}
    for record, time_ns in _without_leaps(log.records(wanted), [] if leaps is None else leaps):
        topic = record.topic
        try:
            held = parts[topic]
        except KeyError:
            held, times[topic] = parts.setdefault(topic, []), []
        held.append(record.data)
        times[topic].append(time_ns)
        if len(held) >= BATCH:
            yield from batch(kinds[topic], times[topic], held)
            parts[topic], times[topic] = [], []
    for topic, held in parts.items():
        yield from batch(kinds[topic], times[topic], held)


def _without_leaps(records: Iterator[Record], leaps: list[Leap]) -> Iterator[tuple[Record, int]]:
    """Records and their times (ns). The clock has leapt where a topic's own times do: a file may have its topics one
    after the other."""
    last: dict[str, int] = {}
    held: list[Record] = []
    before_ns: int | None = None
    left_out_ns = 0
    for record in records:
        topic, time_ns, _, _ = record
        if before_ns is None or not (held or is_leap(time_ns - before_ns)):
            before_ns = last[topic] = time_ns
            yield record, time_ns - left_out_ns
            continue
        held.append(record)
        if topic not in last and len(held) < _MOST_HELD:
            continue
        if topic in last and is_leap(time_ns - last[topic]):
            step_ns = held[0].time_ns - before_ns
            leaps.append(Leap(before_ns - left_out_ns, step_ns))
            left_out_ns += step_ns
        for each in held:
            last[each.topic] = each.time_ns
            yield each, each.time_ns - left_out_ns
        held, before_ns = [], time_ns
    for record in held:
        yield record, record.time_ns - left_out_ns


def batch(kind: RecordType, times: list[int], held: list[bytes]) -> Iterator[Batch]:
    """One batch of the records of a topic, or none if no record fits the schema, if that has no fields, or if the topic
    is not what its name says. Raises FlightLogError for a time beyond 63 bits."""
    if not kind.fields or is_foreign(kind):
        return
    size = kind.size
    if size is None:
        values = [_unpacked(kind, data) for data in held]
        kept = [(at, value) for at, value in zip(times, values, strict=True) if value is not None]
        if kept:
            yield kind.topic, kind, _times(kind, [at for at, _ in kept]), [value for _, value in kept]
        return
    if any(len(data) != size for data in held):
        whole = [(at, data) for at, data in zip(times, held, strict=True) if len(data) == size]
        times, held = [at for at, _ in whole], [data for _, data in whole]
    if held:
        yield kind.topic, kind, _times(kind, times), np.frombuffer(b"".join(held), kind.dtype)


def _times(kind: RecordType, times: list[int]) -> NDArray[np.int64]:
    try:
        return np.array(times, np.int64)
    except OverflowError:
        raise FlightLogError(f"{kind.topic}: a record's time is beyond 292 years") from None


def _unpacked(kind: RecordType, data: bytes) -> dict[str, Any] | None:
    try:
        return kind.unpack(data)
    except struct.error:
        return None


def sender_and_name(topic: str) -> tuple[str, str] | None:
    """Sender ("system/component") and message of a topic "/mavlink/SYSTEM/COMPONENT/NAME"; None for any other topic."""
    parts = topic.split("/")
    return (f"{parts[2]}/{parts[3]}", parts[4]) if len(parts) == 5 and parts[1] == "mavlink" else None
