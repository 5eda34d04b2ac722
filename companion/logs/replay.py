"""A flight flown again: the recorded events into a new autopilot, what it sends beside what was sent."""

import gc
import json
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import msgspec

from companion.autopilot import Autopilot
from companion.avoidance.planner import PlanRequest, PlanResult
from companion.events import Datagram, Event, PlanReady, Reaction, operation_of, tick_of
from companion.known_topics import is_foreign
from companion.logs.ahead import Ahead, DivergedError, worth_it
from companion.logs.difference import Differ, Difference, Series
from companion.logs.recorded import Recorded, flown_overrides, open_flight, other_commit, other_versions
from companion.logs.recordings import check_size, copied_metadata
from companion.logs.target import output
from companion.logs.writer import Writer
from companion.records import LEGACY_REQUEST, LOGGED, OPERATION, PLANNED, TICK, TRACE
from companion.runtime.driver import Driver, Plans
from companion.runtime.planning import InProcessPlanner, PlannerBackend, Planning
from companion.runtime.runner import lockstep_time
from companion.trace import Thinning
from protocol.clock import RealClock
from protocol.flightlog import DATAGRAM, Direction, FlightLogError, Record, RecordType, datagram_of

_MOST_BETWEEN = 2
"""Records that follow each other in the file may be that far apart in their sequence: a line of progress is counted
and not kept."""


@dataclass(frozen=True, slots=True)
class Replay:
    """How a flight went the second time."""

    differences: list[Difference]
    """None: every byte was the same."""
    notes: list[str]
    """What to know of the log: other versions, a cut, missing records."""
    datagrams: int
    """Compared; `bytes` in all."""
    bytes: int
    traces: int
    """Records of the trace that were compared, too; 0 for a log without them or with others than today's."""
    flown_s: float
    """From the first event to the last."""
    wall_s: float
    """What it took, but for opening the log."""
    series: dict[tuple[str, str], Series]
    """By message and field, if asked for."""
    problem: str | None
    """What is wrong with the log."""

    @property
    def times_real_time(self) -> float:
        """How many times as fast as the flight."""
        return self.flown_s / self.wall_s if self.wall_s else 0.0


def replay(
    path: Path,
    settings: Path | None = None,
    overrides: Sequence[str] = (),
    *,
    keeps_series: bool = False,
    trace: Path | None = None,
) -> Replay:
    """Fly the log's flight again, with other settings if any are given.

    `trace`: a new file, where the log goes with the trace of every control step, as it is now, and the settings that it
    was made with. Raises FlightLogError for what is no log of a flight or if that can't be written, TomlFileError for
    settings that can't be used.
    """
    flight = open_flight(path, settings, overrides)
    clock = RealClock()
    second = None
    if settings is None and not overrides and trace is None and worth_it(flight.log):
        second = _flown_ahead(flight, keeps_series=keeps_series)
    if second is None:
        with _copy(flight, trace, settings, overrides) as writer, _no_garbage_collection():
            planner = InProcessPlanner(flight.settings.avoidance)
            second = _Second(flight, _autopilot(flight), planner, writer, keeps_series=keeps_series)
            second.fly()
    wall_s = clock.now_ns() * 1e-9
    differ = second.differ
    flown = flight.log.metadata["flight"]
    commit = other_commit(flown) if differ.differences else []
    return Replay(
        differences=differ.differences,
        notes=[*other_versions(flown, flight.settings), *commit, *second.notes],
        datagrams=differ.datagrams,
        bytes=differ.bytes,
        traces=differ.traces,
        flown_s=second.flown_s,
        wall_s=wall_s,
        series=dict(differ.series),
        problem=flight.log.problem,
    )


def _flown_ahead(flight: Recorded, *, keeps_series: bool) -> "_Second | None":
    """With the planner's answers from a process that runs ahead; None if this flight asks something else."""
    autopilot = _autopilot(flight)  # before the process starts, which then has what that loads
    planner = Ahead(flight.log.path, flight.settings.avoidance)
    try:
        with _no_garbage_collection():
            second = _Second(flight, autopilot, planner, None, keeps_series=keeps_series)
            second.fly()
    except DivergedError:
        return None
    finally:
        planner.close()
    return second


def _autopilot(flight: Recorded) -> Autopilot:
    return Autopilot(flight.settings, flight.body, flight.mission, flight.output, flight.adoption)


@contextmanager
def _copy(
    flight: Recorded, target: Path | None, settings: Path | None, overrides: Sequence[str]
) -> Iterator[Writer | None]:
    """A log with all that is around the messages of the one that is flown again; none without a file for it."""
    if target is None:
        yield None
        return
    log, attachments = flight.log, flight.log.attachments
    metadata = copied_metadata(log)
    if settings is not None or overrides:
        attachments = {**attachments, "settings.json": msgspec.json.encode(flight.settings)}
        flown = metadata["flight"]
        given = [*flown_overrides(flight.log), *overrides]
        metadata["flight"] = {**flown, "overrides": json.dumps(given)}
        metadata["what if"] = {"settings": str(settings or ""), "overrides": json.dumps(list(overrides))}
    with output(target) as draft, Writer(draft, log.epoch_ns, metadata) as writer:
        for name, content in attachments.items():
            writer.attach(name, content)
        yield writer


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """As in flight."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class _Second:
    """The second flight. Which event's answer goes into which datagram is as in `runner.Runner`."""

    def __init__(
        self,
        flight: Recorded,
        autopilot: Autopilot,
        planner: PlannerBackend,
        writer: Writer | None,
        *,
        keeps_series: bool,
    ) -> None:
        recorded = flight.log.topics.get(TRACE.topic)
        known = [kind for kind in (LOGGED, TRACE) if recorded is not None and kind.definition == recorded.definition]
        self._compares_trace = bool(known)
        self._thinning = Thinning(flight.trace_rate) if known == [LOGGED] else None
        self.differ = Differ(keeps_series=keeps_series, trace=known[0] if known else LOGGED)
        self.notes: list[str] = []
        self.flown_s = 0.0
        self._flight = flight
        self._topics = flight.log.topics
        self._writer = writer
        self._copied = 0
        """Records in the copy, but for messages: these have the number of their datagram."""
        self._datagram_number = 0
        self._planner = planner
        plans: Plans = _AsRecorded(planner)
        planned = self._topics.get(PLANNED.topic)
        if planned is None or is_foreign(planned):
            # What it asks now, having asked nothing then, is answered as in lockstep.
            plans = Planning(planner, flight.settings.avoidance.answer_delay)
        self._driver = Driver(autopilot, plans, after=self._react)
        self._somebody = False
        """Whether there is anybody to send to yet."""
        self._held = b""
        """Answers that go out with the next tick's."""
        self._due: list[tuple[int, bytes]] = []
        """Sent now, and not yet seen in the log."""
        self._traces: list[bytes] = []
        self._now = 0
        self._events: dict[str, Callable[[int, bytes], None]] = {
            DATAGRAM.topic: self._datagram,
            TICK.topic: self._tick,
            PLANNED.topic: self._planned,
            OPERATION.topic: lambda now, record: self._operation(OPERATION, now, record),
            LEGACY_REQUEST.topic: lambda now, record: self._operation(LEGACY_REQUEST, now, record),
        }
        """What to do with the time and the data of each."""
        for topic in sorted(self._events.keys() & self._topics.keys()):
            if is_foreign(self._topics[topic]):
                del self._events[topic]
                self._say(f"{topic} is left out: it has not the fields that the name says")

    def fly(self) -> None:
        """All events up to the log's end, or to where records are missing. FlightLogError if that is at its beginning,
        if nothing was sent, and for a record that is not as its schema says."""
        log, topics, writer, events = self._flight.log, self._topics, self._writer, self._events
        if TRACE.topic in topics and not self._compares_trace:
            self._say("the log's trace is not today's, and is not compared")
        first_ns, last_ns, sequence = None, 0, -1
        wanted = [topic for topic in topics if not topic.startswith("/mavlink/")]
        for record in log.records(wanted if writer is None else topics):
            topic, now, number, data = record
            if writer is not None and topic.startswith("/mavlink/"):
                self._copy(writer, record)
                continue
            if (number - sequence) & 0xFFFF_FFFF > _MOST_BETWEEN:
                if sequence < 0:
                    lost = f"its beginning, up to {now * 1e-9:.3f} s, is missing"
                    raise FlightLogError(f"{log.path}: {lost}: the rest can't be flown again without it")
                self._say(f"records are missing after {last_ns * 1e-9:.3f} s: flown again up to there")
                break
            sequence = number
            if topic == TRACE.topic:
                if self._compares_trace:
                    check_size(log, topics[topic], record)
                    self._trace(now, data)
                continue
            if writer is not None:
                self._copy(writer, record)
            event = events.get(topic)
            if event is not None:
                check_size(log, topics[topic], record)
                event(now, data)
                last_ns = now
                if first_ns is None:
                    first_ns = now
        else:
            if log.problem is None and log.abandoned is None:  # else the last event's answer may be missing
                self._overdue()
        if not self.differ.datagrams:  # here, where no copy has its name yet
            raise FlightLogError(f"{log.path}: there is nothing in it that was sent")
        if log.problem is not None:
            self._say(log.problem)
        missing = [f"{count} {name}" for name, count in log.missing.items() if name != "undecoded"]
        if missing:
            self._say(f"records did not reach the log in flight ({', '.join(missing)}): it can't come out the same")
        self.flown_s = (last_ns - (first_ns or 0)) * 1e-9

    def _copy(self, writer: Writer, record: Record) -> None:
        number = self._datagram_number
        if not record.topic.startswith("/mavlink/"):
            self._copied += 1
            number = self._copied
            if record.topic == DATAGRAM.topic:
                self._datagram_number = number
        writer.record(self._topics[record.topic], record.time_ns, number, record.data)

    def _say(self, note: str) -> None:
        self.notes.append(note)

    def _datagram(self, now: int, record: bytes) -> None:
        """One that was received, or sent."""
        try:
            direction, has_address, data = datagram_of(record)
        except struct.error as error:
            raise self._damaged("datagram", now, error) from error
        if direction == Direction.FORWARDED:  # from a ground station to the vehicle: the companion had no part in it
            return
        if direction == Direction.OUT:
            self._somebody = True
            self.differ.datagram(now, data, self._due.pop(0)[1] if self._due else b"")
            return
        if self._due or self._traces:
            self._overdue()
        if direction == Direction.SENSOR:  # as in flight, what it leads to is sent with the next tick's
            self._held += self._driver.handle(Datagram(now, data, whole=False, sensor=True))
            return
        self._somebody = self._somebody or has_address
        answer = self._driver.handle(Datagram(now, data, self._flight.whole_datagrams))
        if not self._flight.lockstep:
            self._send(now, answer)
        elif lockstep_time(data) is not None:
            self._held += answer

    def _tick(self, now: int, record: bytes) -> None:
        if self._due or self._traces:
            self._overdue()
        answer = self._held + self._driver.tick(now, tick_of(now, record).late_ns)
        self._held = b""
        self._send(now, answer)

    def _planned(self, now: int, record: bytes) -> None:
        """The answer of that number; it depends on all questions before, whose answers may have been lost."""
        number = PLANNED.unpack(record)["number"]
        answer = self._planner.take(0.0)
        while answer is not None and answer.number < number:
            answer = self._planner.take(0.0)
        if answer is not None:
            self._held += self._driver.handle(PlanReady(now, answer))

    def _operation(self, kind: RecordType, now: int, record: bytes) -> None:
        try:
            operation = operation_of(kind, now, record)
        except (struct.error, ValueError) as error:
            raise self._damaged("operation", now, error) from error
        self._held += self._driver.handle(operation)

    def _damaged(self, what: str, now: int, error: Exception) -> FlightLogError:
        return FlightLogError(f"{self._flight.log.path}: the {what} at {now * 1e-9:.3f} s is damaged: {error}")

    def _react(self, event: Event, reaction: Reaction) -> None:
        self._now = event.time_ns
        if reaction.trace is not None:
            self._thought(event.time_ns, reaction.trace)

    def _thought(self, now: int, trace: bytes) -> None:
        if self._writer is not None:
            self._copied += 1
            self._writer.record(TRACE, now, self._copied, trace)
        if self._thinning is not None:
            self._traces += [data for _, data in self._thinning.step(now, trace)]
        else:
            self._traces.append(trace)

    def _send(self, now: int, data: bytes) -> None:
        if data:
            self._due.append((now, data))

    def _overdue(self) -> None:
        """The next event is there: what is still due was not sent the first time."""
        if self._due and self._somebody:
            for now, data in self._due:
                self.differ.datagram(now, b"", data)
        self._due.clear()
        if self._compares_trace:
            for data in self._traces:
                self.differ.trace(self._now, b"", data)
        self._traces.clear()

    def _trace(self, now: int, record: bytes) -> None:
        if not self._traces and self._thinning is not None:  # the flight's end: what was left over
            self._traces = [data for _, data in self._thinning.rest()]
        self.differ.trace(now, record, self._traces.pop(0) if self._traces else b"")


class _AsRecorded:
    """Requests go to the planner; the log says when its results counted."""

    def __init__(self, planner: PlannerBackend) -> None:
        self._planner = planner

    def ask(self, request: PlanRequest) -> None:
        self._planner.ask(request)

    def due(self, now_ns: int) -> PlanResult | None:
        return None
