"""The only loop that touches clock, sockets and the log: real time by absolute deadlines, or lockstep by the
vehicle's clock."""

import contextlib
import gc
import logging
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from types import FrameType

from companion.autopilot import Autopilot
from companion.events import Datagram, Event, PlanReady, Reaction, Tick, operation_record, tick_record
from companion.records import ASKED, LOGGED, LOOP, OPERATION, PLANNED, TICK
from companion.runtime.driver import Driver
from companion.runtime.memory import give_back
from companion.runtime.planning import Planning, pack_request, pack_result
from companion.runtime.progress import Progress
from companion.runtime.router import Router
from companion.runtime.side_links import NONE, SideLinks
from companion.runtime.vehicle_notes import VehicleNotes
from companion.state import Announcement, Severity
from companion.supervision.operations import LandRequest, LogFault, LogRecovered
from companion.supervision.states import FLYING, State
from companion.trace import Thinning
from protocol.clock import RealClock
from protocol.flightlog import Direction, FlightLog
from protocol.flightlog.console import Console
from protocol.guarded_link import drain, forward, inmost, news, stopped
from protocol.transport import LOCKSTEP_SPIN_S, Transport, TransportError, Udp

TICK_NS = 4_000_000
"""250 Hz"""
_LOG_LEVEL = {0: 50, 1: 50, 2: 50, 3: 40, 4: 30, 5: 20, 6: 20}
"""MAV_SEVERITY -> `logging`'s level."""
SPIN_S = 4e-4
"""A tick is spun for from so long before it: a sleeping core may wake late."""
_STATUS_EVERY_S = 0.2
_LOG_CHECK_NS = 100_000_000
_LATENCIES_NS = 100_000_000
_MOST_SENSED = 4
"""Datagrams of a sensor's link a tick; a scan needs one, or eight each 16 ticks."""
_LONGEST_NS = 2**32 - 1
_LOCKSTEP_PATIENCE_S = 10.0
"""A busy machine lets a vehicle that is there stand still for seconds."""
_START_PATIENCE_S = 0.2
LATE_NS = 2_000_000
"""Half a period: a tick later than that has missed its deadline."""
_LATEST_NS = 2**61
"""73 years: later times, and what is reckoned from them, leave the log's fields."""
_TIMESYNC_ASKS = bytes((111, 0, 0)) + bytes(8)
"""The message's id and tc1 = 0."""


class Runner:
    """Flies an autopilot over a transport until it has ended; without a clock in lockstep."""

    def __init__(
        self,
        autopilot: Autopilot,
        transport: Transport,
        log: FlightLog,
        clock: RealClock | None,
        planning: Planning,
        *,
        console: bool = False,
        beside: SideLinks = NONE,
    ) -> None:
        self._autopilot = autopilot
        self._planning = planning
        self._driver = Driver(autopilot, planning, self._record, self._react)
        self._commanded = False
        """A control step was taken since this was asked last."""
        self._transport = transport
        self._beside = beside
        self._sensor = beside.sensor
        self._log = log
        self._clock = clock
        self._landing_requested = False
        self._locked = False
        self._progress = Progress(autopilot)
        self._console = Console(panels=False) if console else None
        """For when the log's recorder, which shows what is in the log, has gone."""
        self._began_ns: int | None = None
        self._now = 0
        self._checked_log_ns = 0
        self._log_failed = False
        self._notes = VehicleNotes(autopilot.link, log, self.say)
        self._thinning = Thinning(autopilot.settings.log.trace_rate)
        self._latencies: list[int] = []
        self._told_latencies_ns = 0
        self._status_due = 0.0
        self.missed_deadlines = 0
        """Ticks that began more than half a period late."""
        self.failure: str | None = None
        """What went wrong in the loop itself."""

    def run(self) -> None:
        """Fly. Ends when the autopilot has ended, the link is gone for good, or the loop itself has failed."""
        with _landing_on_signal(self._request_landing), _no_garbage_collection():
            for part in (self._fly, self._keep_rest):
                try:
                    part()
                except TransportError as error:
                    self.failure = f"the link is gone: {error}"
                except Exception as error:
                    # A broken invariant: stop commanding, and the vehicle's own failsafe takes it down.
                    self.failure = self.failure or f"the companion's loop failed: {error!r}"
                    self.say(logging.CRITICAL, traceback.format_exc())
            if self.failure is not None:
                flying = self._autopilot.supervisor.state in FLYING - {State.RELINQUISHED}
                rest = "; setpoints have stopped, the vehicle holds and lands by itself" if flying else ""
                self.say(logging.CRITICAL, self.failure + rest)
                with contextlib.suppress(Exception):  # whatever is wrong, with the stations perhaps
                    word = self._autopilot.link.outbox.last_word(Announcement(Severity.CRITICAL, self.failure + rest))
                    self._beside.tell(word, self._transport, self._now)

    def _fly(self) -> None:
        if self._clock is None:
            self._lockstep()
        else:
            with _real_time_priority():
                self._real_time(self._clock)

    def _keep_rest(self) -> None:
        self._keep(self._thinning.rest())
        self._tell_latencies(self._now)

    @property
    def flown_s(self) -> float:
        """From the first event to the last, on the companion's clock."""
        return 0.0 if self._began_ns is None else (self._now - self._began_ns) * 1e-9

    def _request_landing(self) -> None:
        self._landing_requested = True

    # -- lockstep ------------------------------------------------------------------------------------------------------

    def _lockstep(self) -> None:
        """The vehicle's tick is the clock: answer each, and never look at the wall."""
        now = 0
        answer = b""
        autopilot, transport = self._autopilot, self._transport
        end = inmost(transport)
        if isinstance(end, Udp):
            end.spin_s = LOCKSTEP_SPIN_S
        find_s = autopilot.settings.supervision.find_timeout
        give_up = time.monotonic() + find_s
        while not autopilot.ended:
            data = transport.receive(_LOCKSTEP_PATIENCE_S if answer else _START_PATIENCE_S)
            began = time.perf_counter_ns()
            if data is None and stopped(transport):
                continue
            if data is None:
                # There is no clock (yet, or any more): go on by the wall, so that the silence is noticed.
                if answer or time.monotonic() > give_up:
                    self._send(now, self._tick(now, 0))
                    now += round((max(_LOCKSTEP_PATIENCE_S, find_s) + 1.0) * 1e9)
                    self._send(now, self._tick(now, 0))
                continue
            tick_ns = lockstep_time(data)
            if tick_ns is None:
                self._datagram(now, data)
                continue
            if tick_ns == now and answer:
                transport.send(answer)  # it was sent again: the answer was late or lost
                continue
            now = max(tick_ns, now)
            answer = self._datagram(now, data) + self._tick(now, 0)
            self._send(now, answer)
            self._took(now, began)

    # -- real time -----------------------------------------------------------------------------------------------------

    def _real_time(self, clock: RealClock) -> None:
        """Datagrams are handled as they come, ticks at absolute deadlines: sleep, then spin for the last part."""
        autopilot, transport = self._autopilot, self._transport
        drain(transport)  # what queued up before the start is old
        self._beside.begin()
        overrun_ns = round(autopilot.settings.supervision.overrun * 1e9)
        self._send(clock.now_ns(), self._hear_planner(clock.now_ns()))
        due = clock.now_ns() + TICK_NS
        while not autopilot.ended:
            wait = clock.wall_seconds_until(due)
            data = transport.receive(max(wait - SPIN_S, 0.0))
            while data is None and clock.now_ns() < due:
                data = transport.receive(0.0)
            now = clock.now_ns()
            if now - due > overrun_ns:  # the loop stood still: it is told so before anything that queued up meanwhile
                due = self._beat(now, due, clock)
            if data is not None:
                began = time.perf_counter_ns()
                self._send(now, self._datagram(now, data))
                self._took(now, began)
                if self._beside.router is not None:
                    self._beside.router.heard(data)
            if now >= due:
                due = self._beat(now, due, clock)

    def _beat(self, now: int, due: int, clock: RealClock) -> int:
        """A tick that was due; when the next one is."""
        late = now - due
        if late > LATE_NS * clock.factor:
            self.missed_deadlines += 1
        self._send(now, self._tick(now, late))
        if self._beside.router is not None:
            self._route(self._beside.router, now)
        return due + TICK_NS * (1 + late // TICK_NS)

    # -- events --------------------------------------------------------------------------------------------------------

    def _datagram(self, now: int, data: bytes) -> bytes:
        """What is to be sent for a datagram."""
        answer = self._driver.handle(Datagram(now, data, self._transport.preserves_datagrams))
        if not self._locked and self._autopilot.link.vehicle is not None:
            self._transport.lock()
            self._locked = True
        return answer

    def _tick(self, now: int, late_ns: int) -> bytes:
        """One beat of the loop with what it brings along; what is to be sent."""
        answer = b""
        if self._landing_requested:
            self._landing_requested = False
            answer += self._driver.handle(LandRequest(now))
        if now - self._checked_log_ns >= _LOG_CHECK_NS:
            self._checked_log_ns = now
            answer += self._look_around(now)
        for order in self._beside.orders.take(now):
            answer += self._driver.handle(order)
        if self._sensor is not None:
            answer += self._sense(self._sensor, now)
        return answer + self._driver.tick(now, late_ns)

    def _sense(self, sensor: Transport, now: int) -> bytes:
        """What a sensor on a link of its own has sent since the last tick."""
        answer = b""
        try:
            for _ in range(_MOST_SENSED):
                data = sensor.receive(0.0)
                if data is None:
                    break
                answer += self._driver.handle(Datagram(now, data, whole=False, sensor=True))
        except TransportError as error:
            self._sensor = None
            self.say(logging.ERROR, f"the sensor's link is gone: {error}")
        return answer

    def _route(self, router: Router, now: int) -> None:
        """Between the vehicle and the ground stations: what these send goes into the log, and is no event."""
        for address, data in router.pump(now):
            if self._transport.peer:
                self._log.datagram(now, Direction.FORWARDED, address, forward(self._transport, data))
        for trouble in router.troubles():
            self.say(logging.WARNING, trouble)

    def _look_around(self, now: int) -> bytes:
        """What need not be done at each tick: the log's health, the progress line."""
        wall = time.monotonic()
        if self._console is not None and wall >= self._status_due:
            self._status_due = wall + _STATUS_EVERY_S
            status = self._progress.status(now, self.flown_s)
            speaker = self._log if self._recorder_speaks() else self._console
            speaker.status(status)
        for trouble in news(self._transport):
            self.say(logging.WARNING, trouble)
        self._notes.take(now, ready=self._autopilot.supervisor.state >= State.ENGAGE)
        answer = self._hear_planner(now)
        fault = self._log.fault
        if (fault is not None) != self._log_failed:  # its words change with the time that it lasts
            self._log_failed = fault is not None
            answer += self._driver.handle(LogRecovered(now) if fault is None else LogFault(now, fault))
        return answer

    def _hear_planner(self, now: int) -> bytes:
        news = self._planning.news(now)
        return b"" if news is None else self._driver.handle(news)

    def _record(self, event: Event) -> None:
        """Each event goes into the log before it is handled."""
        self._now = now = event.time_ns
        if self._began_ns is None:
            self._began_ns = now
        match event:
            case Datagram():
                direction, end = Direction.IN, self._transport
                if event.sensor and self._sensor is not None:
                    direction, end = Direction.SENSOR, self._sensor
                self._log.datagram(now, direction, end.peer, event.data)
            case Tick():
                self._log.record(TICK, now, tick_record(event))
            case PlanReady():
                self._log.record(PLANNED, now, pack_result(event.result))
            case _:
                self._log.record(OPERATION, now, operation_record(event))

    def _react(self, event: Event, reaction: Reaction) -> None:
        """What an event led to goes into the log, and on the console."""
        if reaction.trace is not None:
            self._commanded = True
            self._keep(self._thinning.step(event.time_ns, reaction.trace))
        if reaction.plan_request is not None:
            self._log.record(ASKED, event.time_ns, pack_request(reaction.plan_request))
        for announcement in reaction.announcements:
            self.say(_LOG_LEVEL[announcement.severity], announcement.text)

    def say(self, level: int, text: str) -> None:
        """Into the log, and by its recorder on the console; straight to the console where the log can't take it."""
        try:
            self._log.text(self._now, level, "companion", text)
        except Exception:  # whatever is wrong: a word of it, and no end of the flight
            said = False
        else:
            said = self._recorder_speaks()
        if not said and self._console is not None:
            self._console.text(f"{self._now * 1e-9:9.3f} {logging.getLevelName(level):7} companion: {text}")

    def _recorder_speaks(self) -> bool:
        """The console's lines are the recorder's, as long as there is one."""
        if not self._log_failed:
            return True
        try:
            os.kill(self._log.recorder_pid, 0)
        except ProcessLookupError:
            return False
        return True

    def _keep(self, traces: list[tuple[int, bytes]]) -> None:
        for time_ns, trace in traces:
            self._log.record(LOGGED, time_ns, trace)

    def _took(self, now: int, began_ns: int) -> None:
        """A command has left, if there was one; its datagram was received at `began_ns` of the wall's clock."""
        if not self._commanded:
            return
        self._commanded = False
        self._latencies.append(min(time.perf_counter_ns() - began_ns, _LONGEST_NS))
        if now - self._told_latencies_ns >= _LATENCIES_NS:
            self._tell_latencies(now)

    def _tell_latencies(self, now: int) -> None:
        self._told_latencies_ns = now
        if self._latencies:
            self._log.record(LOOP, now, LOOP.pack(max(self._latencies), self._latencies))
            self._latencies.clear()

    def _send(self, now: int, data: bytes) -> None:
        if data and self._transport.peer:  # before anybody is known there is nobody to send to
            self._transport.send(data)
            self._log.datagram(now, Direction.OUT, self._transport.peer, data)
            if self._beside.router is not None:
                self._beside.router.said(data)


def lockstep_time(datagram: bytes) -> int | None:
    """The time (ns) that the datagram's last frame, TIMESYNC with tc1 = 0, says it is; None if that is not its last
    frame, or the time is negative or beyond 73 years."""
    start = datagram.rfind(_TIMESYNC_ASKS) - 7  # what follows in such a frame is too short to hold that once more
    if start < 0 or datagram[start] != 0xFD:
        return None
    length = len(datagram) - start - 12
    if not 8 < length <= 16 or datagram[start + 1] != length:  # ts1 is cut of its zero bytes
        return None
    time_ns = int.from_bytes(datagram[start + 18 : -2], "little")  # a negative one is beyond all, too
    return time_ns if time_ns <= _LATEST_NS else None


@contextlib.contextmanager
def _landing_on_signal(request: Callable[[], None]) -> Iterator[None]:
    """The first Ctrl-C or SIGTERM asks for a landing, the second ends the program. A terminal that hangs up asks for a
    landing however often it says so, unless that is ignored (nohup). The main thread alone gets signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def first(number: int, frame: FrameType | None) -> None:
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, signal.default_int_handler)
        request()

    handlers = {signal.SIGINT: first, signal.SIGTERM: first}
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        handlers[signal.SIGHUP] = lambda number, frame: request()
    before = {each: signal.signal(each, handler) for each, handler in handlers.items()}
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextlib.contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """The loop makes no cycles; a full collection would take milliseconds."""
    give_back()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@contextlib.contextmanager
def _real_time_priority() -> Iterator[None]:
    """Where the system grants it; without it the loop is as good as the machine is idle."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    except (OSError, AttributeError):
        yield
        return
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
