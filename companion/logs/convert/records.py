"""Records as their schemas say."""

import struct
from collections.abc import Iterator, Mapping
from typing import Any

from protocol.flightlog import FlightLogError, LogReader, Record, RecordType


def records(log: LogReader, kinds: Mapping[str, RecordType]) -> Iterator[Record]:
    """Those on these topics. Raises FlightLogError for one that has not its schema's size."""
    for record in log.records(kinds):
        size = kinds[record.topic].size
        if size is not None and len(record.data) != size:
            raise _misfit(log, record)
        yield record


def unpack(log: LogReader, kind: RecordType, record: Record) -> dict[str, Any]:
    """Its fields by name. Raises FlightLogError if it is cut."""
    try:
        return kind.unpack(record.data)
    except struct.error as error:
        raise _misfit(log, record) from error


def _misfit(log: LogReader, record: Record) -> FlightLogError:
    at_s = record.time_ns * 1e-9
    return FlightLogError(f"{log.path}: the record on {record.topic} at {at_s:.3f} s is not as its schema says")
