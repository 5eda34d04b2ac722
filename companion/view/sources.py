"""Where a live page gets its flight from: a log, the log of a flight that is in the air, or a link.

All of them give their records as the same batches, and none of them sends anything.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from companion.logs.recordings import flights
from companion.logs.verdict import verdict_of
from companion.outcomes import Verdict, recorded
from companion.view.batches import BATCH, Batch, batch, batches
from protocol.clock import RealClock
from protocol.flightlog import DATAGRAM, FlightLogError, LogFollower, LogReader, RecordType
from protocol.flightlog.mavlink_records import message_type
from protocol.framing import Framer
from protocol.messages import layout
from protocol.transport import Transport

_DATAGRAMS_A_POLL = 5000
_MOST_KINDS = 4096
"""Pairs of a message and its sender that are shown; noise must not use up the memory."""
_CHUNK_S = 0.15
"""Time that a flight's log takes to show a record (s)."""
_GROWS_S = 10.0
"""A flight's log is written to each tenth of a second; one that was not for so long was cut off."""


class Source(Protocol):
    """What a page asks of a flight."""

    name: str
    problem: str | None
    """Why the flight's records are not complete, or None."""

    @property
    def world(self) -> bytes:
        """The world's file, empty while it is not known."""

    @property
    def settings(self) -> bytes:
        """The companion's settings as JSON, empty while they are not known."""

    @property
    def verdict(self) -> Verdict | None:
        """How the flight came out; None while that is not known."""

    @property
    def ended(self) -> bool:
        """Whether nothing more will come."""

    delay_s: float
    """How late new records come (s)."""

    def poll(self) -> Iterator[Batch]:
        """The new records, without waiting. Raises FlightLogError or TransportError if the source can't be read any
        more."""


class FinishedLog:
    """A log that nobody writes to any more; the first poll gives all of it."""

    def __init__(self, log: LogReader) -> None:
        self.name = str(log.path)
        self.world = log.attachments.get("world.toml", b"")
        self.settings = log.attachments.get("settings.json", b"")
        self.verdict = verdict_of(log.path, log.metadata)
        self.ended = False
        self.delay_s = 0.0
        self.problem = log.problem
        self._log = log

    def poll(self) -> Iterator[Batch]:
        if not self.ended:
            yield from batches(self._log)
            self.ended, self.problem = True, self._log.problem


class GrowingLog:
    """A log that is being written; each poll gives the chunks that have become whole since the last one.

    Reading takes nothing from the flight but a look at its file. Damage ends it with an error. It has ended, too, while
    nothing is written: then it was cut off.
    """

    def __init__(self, path: Path) -> None:
        self.problem: str | None = None
        self._unfinished: Verdict | None = None
        """On a flight whose log was cut off."""
        self.delay_s = _CHUNK_S
        self._held: dict[str, tuple[list[int], list[bytes]]] = {}
        self._open(path)

    def _open(self, path: Path) -> None:
        """The file is opened when it is read first."""
        self.name = str(path)
        self._path = path
        self._log = LogFollower(path, lambda topic: topic != DATAGRAM.topic)

    @property
    def world(self) -> bytes:
        return self._log.attachments.get("world.toml", b"")

    @property
    def settings(self) -> bytes:
        return self._log.attachments.get("settings.json", b"")

    @property
    def verdict(self) -> Verdict | None:
        found = recorded(self._log.metadata.get("result", {}))
        return self._unfinished if found is None and self.problem is not None else found

    @property
    def ended(self) -> bool:
        return self._log.ended or self.problem is not None

    def poll(self) -> Iterator[Batch]:
        yield from self._poll()
        is_left = not self._log.ended and _is_left(self._path)
        if is_left and self.problem is None:
            with suppress(FlightLogError):  # gone meanwhile
                self._unfinished = verdict_of(self._path, self._log.metadata)
        self.problem = "cut off" if is_left else None

    def _poll(self) -> Iterator[Batch]:
        for records in self._log.poll():
            for topic, time_ns, _, data in records:
                try:
                    times, parts = self._held[topic]
                except KeyError:
                    times, parts = self._held[topic] = [], []
                times.append(time_ns)
                parts.append(data)
            if any(len(times) >= BATCH for times, _ in self._held.values()):
                yield from self._give()
        yield from self._give()

    def _give(self) -> Iterator[Batch]:
        held, self._held = self._held, {}
        kinds = self._log.topics
        for topic, (times, parts) in held.items():
            yield from batch(kinds[topic], times, parts)


class NextFlight(GrowingLog):
    """The flight that begins next in a folder; nothing until then."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.name = f"none yet: waiting for one in {folder}"
        self._folder = folder
        self._earlier = flights(folder)
        self._waits = True

    def poll(self) -> Iterator[Batch]:
        if self._waits:
            begun = flights(self._folder) - self._earlier
            if not begun:
                return
            self._waits = False
            self._open(begun.pop())
        yield from super().poll()


class Link:
    """A vehicle's telemetry over a transport, as it arrives; times count from the page's start."""

    def __init__(self, url: str, transport: Transport, world: bytes) -> None:
        self.name = url
        self.world = world
        self.settings = b""
        self.verdict = None
        self.ended = False
        self.delay_s = 0.0
        self.problem: str | None = None
        self._transport = transport
        self._clock = RealClock()
        self._framer = Framer()
        self._kinds: dict[tuple[int, int, int], tuple[RecordType, int, Callable[[bytes], bytes] | None] | None] = {}

    def poll(self) -> Iterator[Batch]:
        held: dict[str, tuple[RecordType, list[int], list[bytes]]] = {}
        feed = self._framer.datagram if self._transport.preserves_datagrams else self._framer.feed
        for _ in range(_DATAGRAMS_A_POLL):
            data = self._transport.receive(0.0)
            if data is None:
                break
            now = self._clock.now_ns()
            for frame in feed(data):
                known = self._kind(frame.message_id, frame.system, frame.component) if frame.known else None
                if known is None:
                    continue
                kind, size, convert = known
                payload = frame.payload.ljust(size, b"\0")[:size]
                _, times, parts = held.setdefault(kind.topic, (kind, [], []))
                times.append(now)
                parts.append(convert(payload) if convert else payload)
        for kind, times, parts in held.values():
            yield from batch(kind, times, parts)

    def _kind(
        self, message: int, system: int, component: int
    ) -> tuple[RecordType, int, Callable[[bytes], bytes] | None] | None:
        key = message, system, component
        if key not in self._kinds:
            topic = f"/mavlink/{system}/{component}/{layout(message).name}"
            self._kinds[key] = message_type(message, topic) if len(self._kinds) < _MOST_KINDS else None
        return self._kinds[key]


def open_log(path: Path) -> Source:
    """A log as a source: a growing one if it has no end yet and was written to within the last 10 s.

    Raises FlightLogError if it can't be opened or is no flight log.
    """
    log = LogReader(path)
    return FinishedLog(log) if log.complete or _is_left(path) else GrowingLog(path)


def _is_left(path: Path) -> bool:
    """Whether nobody writes to a log any more, as far as its time tells."""
    with suppress(OSError):  # gone meanwhile
        return time.time() - path.stat().st_mtime >= _GROWS_S
    return True
