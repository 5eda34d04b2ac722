"""The datagrams of a log, whoever wrote it."""

import hashlib
import stat
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from protocol.flightlog import DATAGRAM, Direction, FlightLogError, LogReader, Record, tlog
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
                yield self._unpacked(record)
            return
        framer = Framer()
        for time_us, data in self.log.entries():
            incoming = all(map(tlog.from_vehicle, framer.datagram(data)))
            yield Sent(time_us * 1000 - self.epoch_ns, Direction.IN if incoming else Direction.OUT, "", data)

    def _unpacked(self, record: Record) -> Sent:
        try:
            values = DATAGRAM.unpack(record.data)
            return Sent(record.time_ns, Direction(values["direction"]), values["address"], values["data"])
        except (struct.error, ValueError) as error:
            at_s = record.time_ns * 1e-9
            raise FlightLogError(f"{self.log.path}: the datagram at {at_s:.3f} s is damaged: {error}") from error


def open_log(path: Path) -> LogReader | tlog.TlogReader:
    """A flight log or a telemetry log. Raises FlightLogError if it is neither, is empty or can't be opened."""
    try:
        state = path.stat()
    except OSError as error:
        raise FlightLogError(f"{path}: {error.strerror or error}") from error
    if not stat.S_ISREG(state.st_mode):
        raise FlightLogError(f"{path}: not a file")
    if not state.st_size:
        raise FlightLogError(f"{path}: an empty file")
    try:
        return LogReader(path)
    except FlightLogError:
        return tlog.TlogReader(path)


def open_traffic(path: Path) -> Traffic:
    """A flight log's or a telemetry log's. Raises FlightLogError as `open_log`."""
    return traffic_of(open_log(path))


def traffic_of(log: LogReader | tlog.TlogReader) -> Traffic:
    """What was sent, of a log that is open."""
    if isinstance(log, LogReader):
        return Traffic(log, log.epoch_ns)
    return Traffic(log, next(iter(log.entries())).time_us * 1000)


@dataclass(frozen=True, slots=True)
class Digest:
    """What a log's traffic is, in short."""

    hashes: dict[Direction, str]
    """SHA-256 over each direction's datagrams with time and length, as `flightlog.digest`."""
    problem: str | None
    """What is wrong with the log."""


def digest(path: Path) -> Digest:
    """Of a flight log or a telemetry log. Raises FlightLogError if it can't be read or has no traffic."""
    traffic = open_traffic(path)
    sums = {direction: hashlib.sha256() for direction in Direction}
    empty = True
    for sent in traffic.sent():
        empty = False
        sums[sent.direction].update(struct.pack("<qI", sent.time_ns, len(sent.data)) + sent.data)
    if empty:
        raise FlightLogError(f"{path}: there is no datagram in it")
    return Digest({direction: total.hexdigest() for direction, total in sums.items()}, traffic.problem)
