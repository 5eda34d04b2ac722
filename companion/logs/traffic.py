"""The datagrams of a flight log or a telemetry log."""

import hashlib
import stat
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from companion.logs.recordings import whole_datagrams
from protocol.flightlog import DATAGRAM, Direction, FlightLogError, LogReader, Record, tlog
from protocol.flightlog.mavlink_records import FrameFinder
from protocol.framing import Frame, Framer


class Datagram(NamedTuple):
    """A datagram as it was recorded."""

    time_ns: int
    """Since the log's time 0."""
    direction: Direction
    address: str
    """The other end's address; empty where the log does not say."""
    data: bytes


@dataclass(frozen=True, slots=True)
class Traffic:
    """The traffic of a log, in the order in which it was recorded."""

    log: LogReader | tlog.TlogReader
    epoch_ns: int
    """Wall clock at time 0 (ns since 1970); 0 where the log doesn't say it."""

    @property
    def problem(self) -> str | None:
        """What is wrong with the log, known after `datagrams` has read it."""
        return self.log.problem

    @property
    def whole_datagrams(self) -> bool:
        """Whether each of the vehicle's datagrams holds whole frames."""
        return not isinstance(self.log, LogReader) or whole_datagrams(self.log.metadata)

    def framed(self) -> Iterator[tuple[Datagram, list[Frame]]]:
        """As `datagrams`, each with the frames that it completes."""
        finder = FrameFinder(preserves_datagrams=self.whole_datagrams)
        for datagram in self.datagrams():
            yield datagram, finder.frames(datagram.direction, datagram.data)

    def datagrams(self) -> Iterator[Datagram]:
        """What each side sent; in a telemetry log each entry is a datagram. Raises FlightLogError for a damaged one."""
        if isinstance(self.log, LogReader):
            for record in self.log.records((DATAGRAM.topic,)):
                yield self._unpacked(record)
            return
        framer = Framer()
        for time_us, data in self.log.entries():
            incoming = all(map(tlog.from_vehicle, framer.datagram(data)))
            yield Datagram(time_us * 1000 - self.epoch_ns, Direction.IN if incoming else Direction.OUT, "", data)

    def _unpacked(self, record: Record) -> Datagram:
        try:
            values = DATAGRAM.unpack(record.data)
            return Datagram(record.time_ns, Direction(values["direction"]), values["address"], values["data"])
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
    """Traffic of a flight log or a telemetry log. Raises FlightLogError as `open_log`."""
    return traffic_of(open_log(path))


def traffic_of(log: LogReader | tlog.TlogReader) -> Traffic:
    """Traffic of a log that is open."""
    if isinstance(log, LogReader):
        return Traffic(log, log.epoch_ns)
    return Traffic(log, next(iter(log.entries())).time_us * 1000)


@dataclass(frozen=True, slots=True)
class Digest:
    """Fingerprint of a log's traffic."""

    hashes: dict[Direction, str]
    """As `flightlog.digest`."""
    problem: str | None
    """What is wrong with the log."""


def digest(path: Path) -> Digest:
    """Digest of a flight log or a telemetry log. Raises FlightLogError if it can't be read or has no traffic."""
    traffic = open_traffic(path)
    sums = {direction: hashlib.sha256() for direction in (Direction.IN, Direction.OUT)}
    empty = True
    for time_ns, direction, _, data in traffic.datagrams():
        empty = False
        sums.setdefault(direction, hashlib.sha256()).update(struct.pack("<qI", time_ns, len(data)) + data)
    if empty:
        raise FlightLogError(f"{path}: there is no datagram in it")
    return Digest({direction: total.hexdigest() for direction, total in sums.items()}, traffic.problem)
