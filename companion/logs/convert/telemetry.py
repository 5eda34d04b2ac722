"""Telemetry logs (.tlog) to flight logs and back."""

from collections.abc import Iterator
from pathlib import Path

from companion.logs.traffic import open_traffic
from companion.logs.writer import Writer
from protocol import tlog
from protocol.flightlog import LogReader
from protocol.framing import Framer
from protocol.tlog import Entry

FROM_TLOG = "telemetry log"
"""Metadata of a flight log that was made from one: each of its datagrams is an entry as it was."""


def to_flight_log(source: Path, target: Path) -> int:
    """Make a flight log of a telemetry log, with the messages decoded; how many entries it has.

    Raises FlightLogError if the one can't be read or the other can't be made.
    """
    traffic = open_traffic(source)
    with Writer(target, traffic.epoch_ns, {FROM_TLOG: {"source": source.name}}) as writer:
        for sequence, sent in enumerate(traffic.sent()):
            writer.datagram(sent.time_ns, sequence & 0xFFFF_FFFF, sent.direction, sent.address, sent.data)
    return writer.count


def from_flight_log(source: Path, target: Path) -> int:
    """Make a telemetry log of a flight log, a frame an entry; how many. One that was a telemetry log becomes the same
    bytes again.

    Raises FlightLogError if the one can't be read or the other can't be made.
    """
    log = LogReader(source)
    traffic = open_traffic(source)
    epoch_ns = traffic.epoch_ns or round(_started_s(log) * 1e9)
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


def _started_s(log: LogReader) -> float:
    try:
        return float(log.metadata["flight"]["started_unix_s"])
    except (KeyError, ValueError):
        return 0.0
