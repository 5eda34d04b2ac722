"""Converts telemetry logs (.tlog) to flight logs and back."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from companion.logs.recordings import printable, started_unix_s
from companion.logs.traffic import Traffic, traffic_of
from companion.logs.writer import Writer
from protocol.flightlog import LogReader, tlog
from protocol.flightlog.tlog import Entry

FROM_TLOG = "telemetry log"
"""Name of the metadata of a flight log that was made from a telemetry log: each datagram is an entry of that."""


def to_flight_log(traffic: Traffic, target: Path, metadata: Mapping[str, Mapping[str, str]] | None = None) -> int:
    """Make a flight log of a telemetry log, with its messages decoded and with additional metadata.

    Returns the number of entries. Raises FlightLogError if the log can't be read or the target can't be made.
    """
    source = {FROM_TLOG: {"source": printable(traffic.log.path.name)}}
    with Writer(target, traffic.epoch_ns, {**source, **(metadata or {})}) as writer:
        for sequence, (time_ns, direction, address, data) in enumerate(traffic.datagrams()):
            writer.datagram(time_ns, sequence & 0xFFFF_FFFF, direction, address, data)
    return writer.count


def from_flight_log(log: LogReader, target: Path) -> int:
    """Make a telemetry log of a flight log, an entry for each frame, at the time when it was whole. A flight log made
    by `to_flight_log` becomes the same bytes again.

    Returns the number of entries. Raises FlightLogError if the log can't be read or the target can't be made.
    """
    traffic = traffic_of(log)
    epoch_ns = traffic.epoch_ns or round((started_unix_s(log.metadata) or 0.0) * 1e9)
    as_it_was = FROM_TLOG in log.metadata

    def entries() -> Iterator[Entry]:
        for datagram, frames in traffic.framed():
            time_us = max(epoch_ns + datagram.time_ns, 0) // 1000
            if as_it_was:
                yield Entry(time_us, datagram.data)
            else:
                yield from (Entry(time_us, frame.raw) for frame in frames)

    return tlog.write(target, entries())
