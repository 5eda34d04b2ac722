"""Telemetry logs (.tlog) to flight logs and back."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from companion.logs.recordings import printable, started_unix_s
from companion.logs.traffic import Traffic, traffic_of
from companion.logs.writer import Writer
from protocol.flightlog import LogReader, tlog
from protocol.flightlog.tlog import Entry
from protocol.framing import Framer

FROM_TLOG = "telemetry log"
"""Metadata of a flight log that was made from one: each of its datagrams is an entry as it was."""


def to_flight_log(traffic: Traffic, target: Path, metadata: Mapping[str, Mapping[str, str]] | None = None) -> int:
    """Make a flight log of a telemetry log, with the messages decoded and more metadata, if any; how many entries it
    has. Raises FlightLogError if the one can't be read or the other can't be made.
    """
    source = {FROM_TLOG: {"source": printable(traffic.log.path.name)}}
    with Writer(target, traffic.epoch_ns, {**source, **(metadata or {})}) as writer:
        for sequence, sent in enumerate(traffic.sent()):
            writer.datagram(sent.time_ns, sequence & 0xFFFF_FFFF, sent.direction, sent.address, sent.data)
    return writer.count


def from_flight_log(log: LogReader, target: Path) -> int:
    """Make a telemetry log of a flight log, a frame an entry; how many. One that was a telemetry log becomes the same
    bytes again.

    Raises FlightLogError if the one can't be read or the other can't be made.
    """
    traffic = traffic_of(log)
    epoch_ns = traffic.epoch_ns or round((started_unix_s(log.metadata) or 0.0) * 1e9)
    as_it_was = FROM_TLOG in log.metadata

    def entries() -> Iterator[Entry]:
        framer = Framer()
        for sent in traffic.sent():
            time_us = max(epoch_ns + sent.time_ns, 0) // 1000
            if as_it_was:
                yield Entry(time_us, sent.data)
            else:
                yield from (Entry(time_us, frame.raw) for frame in framer.datagram(sent.data))

    return tlog.write(target, entries())
