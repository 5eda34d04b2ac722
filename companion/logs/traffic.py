"""The datagrams of a log, whoever wrote it."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from protocol import tlog
from protocol.flightlog import DATAGRAM, Direction, FlightLogError, LogReader
from protocol.framing import Framer


class Sent(NamedTuple):
    """Something that was sent."""

    time_ns: int
    """From the log's time 0."""
    direction: Direction
    address: str
    """Of the other end; empty where the log does not say."""
    data: bytes


@dataclass(frozen=True, slots=True)
class Traffic:
    """All of it, in the order in which it was written."""

    log: LogReader | tlog.TlogReader
    epoch_ns: int
    """The wall's clock at time 0, or 0 where the log does not know it."""

    @property
    def problem(self) -> str | None:
        """What is wrong with the log, once `sent` has come by."""
        return self.log.problem

    def sent(self) -> Iterator[Sent]:
        """What each side sent; in a telemetry log each frame is a datagram."""
        if isinstance(self.log, LogReader):
            for record in self.log.records((DATAGRAM.topic,)):
                values = DATAGRAM.unpack(record.data)
                yield Sent(record.time_ns, Direction(values["direction"]), values["address"], values["data"])
            return
        framer = Framer()
        for time_us, data in self.log.entries():
            incoming = all(map(tlog.from_vehicle, framer.datagram(data)))
            yield Sent(time_us * 1000 - self.epoch_ns, Direction.IN if incoming else Direction.OUT, "", data)


def open_traffic(path: Path) -> Traffic:
    """A flight log's or a telemetry log's. Raises FlightLogError if it is neither or can't be opened."""
    try:
        log = LogReader(path)
    except FlightLogError:
        if not path.is_file():
            raise
        telemetry = tlog.TlogReader(path)
        return Traffic(telemetry, next(iter(telemetry.entries())).time_us * 1000)
    return Traffic(log, log.epoch_ns)
