"""What a flight says while it is flown, read from its log as that grows. The flight takes no notice."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from companion.mission.plan import Phase
from companion.records import LOGGED, OPERATION, OperationKind
from protocol.flightlog import DATAGRAM, TEXT, FlightLogError, LogFollower

Triple = tuple[float, float, float]

_LOOK_S = 0.05
"""The log grows each tenth of a second."""
_SILENT_S = 10.0
_MOST_WAITING = 2000
"""Records that wait for a listener: one that does not keep up loses the oldest."""
_REFUSED = "order refused: "
"""Said of an order that is not taken."""


@dataclass(frozen=True, slots=True)
class State:
    """The vehicle, some 50 times a second."""

    time_s: float
    """On the companion's clock."""
    phase: Phase
    """What the flight is about."""
    step: int
    """Number of the step of what is flown, from 0; it never falls."""
    position_ned: Triple
    """m, in the vehicle's own frame."""
    velocity_ned: Triple
    """m/s"""
    attitude_ned_frd: tuple[float, float, float, float]
    """Quaternion w, x, y, z."""
    target_ned: Triple
    """m; where it flies to at the moment."""
    clearance_m: float
    """From the hull to the nearest thing seen; inf if there is none."""


@dataclass(frozen=True, slots=True)
class Event:
    """A sentence of companion or vehicle."""

    time_s: float
    """On the companion's clock."""
    level: int
    """1 debug, 2 info, 3 warning, 4 error, 5 fatal."""
    source: str
    """Who said it: a part of the companion, or the vehicle."""
    text: str
    """The sentence."""


class Orders:
    """What has become of the orders of a flight, by their numbers: 0 is the mission that it began with.

    The log has each order in turn, right behind it what was said to it, and then how it is flown.
    """

    def __init__(self) -> None:
        self.taken = 0
        """The latest that was not refused: it is flown in place of those before."""
        self.refused: dict[int, str] = {}
        """What was said to those that were refused."""
        self.done: set[int] = set()
        """After these the vehicle waited, before it took another one."""
        self._heard, self._heard_ns = 0, 0

    def hear(self, time_ns: int) -> None:
        """The flight has read the next order."""
        self._heard += 1
        self._heard_ns = time_ns

    def answer(self, text: str) -> None:
        """Something was said: of an order, if it is the first after that was read."""
        if self._heard in (self.taken, *self.refused):
            return
        if text.startswith(_REFUSED):
            self.refused[self._heard] = text
        else:
            self.taken = self._heard

    def wait(self, time_ns: int) -> None:
        """The vehicle waited at that time. The log has some states later than an order that came after them."""
        if time_ns > self._heard_ns:
            self.done.add(self.taken)


class Telemetry:
    """Follows the log of a flight, and hands out its records."""

    def __init__(self) -> None:
        self.ended = False
        self.state: State | None = None
        """The latest."""
        self.orders = Orders()
        """What has become of the orders so far."""
        self.silent = False
        """Nothing has come for so long, once something had: the log can't be written or read any more."""
        self._listeners: list[tuple[str, asyncio.Queue[tuple[int, dict[str, Any]] | None]]] = []
        self._news = asyncio.Event()

    async def follow(self, path: Path, flight: "asyncio.Future[Any]") -> None:
        """Read the log until the flight is over. Raises FlightLogError if it is damaged."""
        log, over, quiet_s = LogFollower(path, lambda topic: topic != DATAGRAM.topic), False, 0.0
        try:
            while not over:
                over = flight.done()  # what was written before is read in this round
                quiet_s += _LOOK_S  # by looks: a program that was busy with something else has missed nothing
                for records in log.poll():
                    kinds, quiet_s = log.topics, 0.0
                    for topic, time_ns, _, data in records:
                        self._take(topic, time_ns, kinds[topic].unpack, data)
                # Whoever flew may write a report, for long, once the log is complete.
                self.silent = self.state is not None and quiet_s > _SILENT_S and not log.ended
                self._tell()
                await asyncio.sleep(_LOOK_S)
        except FlightLogError:
            self.silent = True
            self._tell()
            raise

    def end(self) -> None:
        """Nothing more will come."""
        self.ended = True
        for _, queue in self._listeners:
            _put(queue, None)
        self._tell()

    def _tell(self) -> None:
        self._news.set()
        self._news = asyncio.Event()

    async def news(self) -> None:
        """Wait until the log was looked at again, or has ended."""
        if not self.ended:
            await self._news.wait()

    def _take(self, topic: str, time_ns: int, unpack: Any, data: bytes) -> None:
        wanted = [queue for end, queue in self._listeners if topic.endswith(end)]
        if not wanted and topic not in (LOGGED.topic, TEXT.topic, OPERATION.topic):
            return
        fields = unpack(data)
        if topic == LOGGED.topic:
            self.state = state_of(time_ns, fields)
            if self.state.phase is Phase.WAIT:
                self.orders.wait(time_ns)
        elif topic == TEXT.topic:
            self.orders.answer(fields["message"])
        elif topic == OPERATION.topic and fields["kind"] == OperationKind.ORDER:
            self.orders.hear(time_ns)
        for queue in wanted:
            _put(queue, (time_ns, fields))

    async def records(self, topic: str) -> AsyncIterator[tuple[int, dict[str, Any]]]:
        """The time (ns) and the fields of each record from now on whose topic ends so, until the flight ends."""
        if self.ended:
            return
        queue: asyncio.Queue[tuple[int, dict[str, Any]] | None] = asyncio.Queue(_MOST_WAITING)
        listener = topic, queue
        self._listeners.append(listener)
        try:
            while (record := await queue.get()) is not None:
                yield record
        finally:
            self._listeners.remove(listener)


def _put(queue: "asyncio.Queue[Any]", record: Any) -> None:
    if queue.full():
        queue.get_nowait()
    queue.put_nowait(record)


def state_of(time_ns: int, fields: dict[str, Any]) -> State:
    """A record of the trace as a state."""
    return State(
        time_ns * 1e-9,
        Phase(fields["phase"]),
        fields["step"],
        fields["position_ned"],
        fields["velocity_ned"],
        fields["attitude_ned_frd"],
        fields["target_ned"],
        fields["clearance"],
    )


def event_of(time_ns: int, fields: dict[str, Any]) -> Event:
    """A line of the log as an event."""
    return Event(time_ns * 1e-9, fields["level"], fields["name"], fields["message"])
