"""The backends that answer requests to map and planner outside of the loop that flies, and when their results count.

In real time a process of its own answers, and a result counts at the first tick that finds it. In lockstep, where the
vehicle waits anyway and no clock is read, it counts a fixed simulated time after its request.
"""

import contextlib
import math
import multiprocessing
import select
import signal
from collections import deque
from multiprocessing import util
from typing import TYPE_CHECKING, Protocol

import numpy as np

from companion.avoidance.global_planner import EACH, GlobalPlanner
from companion.avoidance.planner import PlanningPipeline, PlanRequest, PlanResult, result_bytes
from companion.avoidance_methods import methods_in_use
from companion.config_avoidance import Avoidance
from companion.perception.local_map import LocalMap
from companion.plugins import PluginError
from companion.records import ASKED, PLANNED, PLANNED_CORNERS
from companion.runtime.interrupts import end_with_parent, start_uninterrupted
from companion.runtime.mailbox import Outbox, mailbox
from companion.runtime.memory import give_back
from companion.state import Scan
from companion.supervision.operations import PlannerFault, PlannerReady, PlannerStarting
from protocol.arrays import Array

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_BEARINGS = np.radians(np.arange(0.0, 360.0, 5.0))
_EACH_WALL = 3
"""Scans of each wall that is made up in a rehearsal: after so many it counts."""
_PATIENCE_S = 10.0
"""For an answer that must be waited for."""
_MOST_UNANSWERED = 24
"""Requests on their way, each 2 kB: so many fit into any pipe."""
_MOST_WAITING = 76
"""Requests that wait here for a planner that stands still. With those on their way they span 6 s; by then a flight is
landed for want of a map."""


class PlannerBackend(Protocol):
    """Answers requests in their order."""

    ready: bool
    """It answers."""

    @property
    def fault(self) -> str | None:
        """Why there will be no more results."""

    def ask(self, request: PlanRequest) -> None:
        """Returns at once."""

    def take(self, patience_s: float) -> PlanResult | None:
        """The next result; None if there is none within that time."""

    def close(self) -> None:
        """Give everything back."""


class InProcessPlanner:
    """Computes a result in this process, when it is taken."""

    ready = True
    fault: str | None = None

    def __init__(self, settings: Avoidance) -> None:
        self.pipeline = PlanningPipeline(settings)
        self._requests: deque[PlanRequest] = deque()

    def ask(self, request: PlanRequest) -> None:
        self._requests.append(request)

    def take(self, patience_s: float) -> PlanResult | None:
        return self.pipeline.answer(self._requests.popleft()) if self._requests else None

    def close(self) -> None:
        """Nothing to give back."""


class PlannerProcess:
    """In a process of its own, which ends with this one. Nothing here waits for it: until it is ready it is asked
    nothing, and answers nothing."""

    def __init__(self, settings: Avoidance) -> None:
        """Start it."""
        plugin = settings.plugin
        self._name = "the planner's process" if plugin is None else f"the process of {plugin.kind.value} {plugin.text}"
        self._ended = f"{self._name} has ended by itself"
        context = multiprocessing.get_context("spawn")
        asked, self._requests = context.Pipe(duplex=False)
        self._results, answered = mailbox(context, _MOST_UNANSWERED + 2, result_bytes(settings))
        arguments = (asked, answered, settings)
        self._process = context.Process(target=_think, args=arguments, name="courier-planner", daemon=True)
        start_uninterrupted(self._process)
        # At this program's exit multiprocessing waits for it, after a SIGTERM, which it ignores.
        util.Finalize(self, self._process.kill, exitpriority=0)
        asked.close()
        answered.close()
        self._poll = select.poll()
        self._poll.register(self._results.fileno(), select.POLLIN | select.POLLHUP)
        self.ready = False
        self._unanswered = 0
        self._waiting: deque[PlanRequest] = deque()
        self._fault: str | None = None

    @property
    def fault(self) -> str | None:
        """Why there will be no more results."""
        if self._fault is not self._ended or self._process.exitcode is None:
            return self._fault
        return f"{self._ended} (exit code {self._process.exitcode})"

    @property
    def pid(self) -> int | None:
        """The process's number; None before it was started."""
        return self._process.pid

    def ask(self, request: PlanRequest) -> None:
        if self._fault is not None or not self.ready:
            return
        if self._unanswered < _MOST_UNANSWERED:
            self._send(request)
        elif len(self._waiting) < _MOST_WAITING:  # more would fill the pipe, and stop the loop that flies
            self._waiting.append(request)
        else:
            self._fault = f"{self._name} has left {_MOST_UNANSWERED + _MOST_WAITING} requests unanswered"

    def _send(self, request: PlanRequest) -> None:
        try:
            self._requests.send(request)
            self._unanswered += 1
        except OSError:
            self._fault = self._ended

    def take(self, patience_s: float) -> PlanResult | None:
        """As of any; or None because it has just got ready."""
        nothing_comes = self.ready and not self._unanswered
        if self._fault is not None or nothing_comes or not self._poll.poll(1e3 * patience_s):
            return None
        try:
            result: PlanResult | str | None = self._results.take()
        except (EOFError, OSError):
            self._fault = self._ended
            return None
        if result is None:
            self.ready = True
            return None
        if isinstance(result, str):
            self._fault = result
            return None
        self._unanswered -= 1
        if self._waiting:
            self._send(self._waiting.popleft())
        return result

    def close(self) -> None:
        self._requests.close()
        self._results.close()
        self._process.join(_PATIENCE_S)
        if self._process.is_alive():
            self._process.kill()


def _think(requests: "Connection", results: Outbox, settings: Avoidance) -> None:
    """The process: answer until the other side is gone."""
    end_with_parent()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    try:
        _serve(requests, results, settings)
    except (PluginError, KeyboardInterrupt) as error:
        if settings.plugin is None:
            raise
        # No interrupt reaches this process: it is one of the plug-in's own.
        fault = error if isinstance(error, PluginError) else settings.plugin.broken(error)
        with contextlib.suppress(OSError):
            results.put(str(fault))
        raise SystemExit(1) from None


def _serve(requests: "Connection", results: Outbox, settings: Avoidance) -> None:
    rehearse(settings)
    pipeline = PlanningPipeline(settings, results.empty)
    give_back()
    with contextlib.suppress(EOFError, OSError):
        results.put(None)
        while True:
            results.put(pipeline.answer(requests.recv()))


def rehearse(settings: Avoidance) -> None:
    """Answer some requests about made-up scans, so that everything is compiled."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    for method in methods_in_use(settings.method):
        pipeline = PlanningPipeline(settings.by(method))
        for k in range(16 + 2 * _EACH_WALL):
            time_ns = k * 66_000_000
            ranges = _walker(k) if k < 16 else _wall(gap_m=1.2 if k < 16 + _EACH_WALL else 0.0)
            known = np.full(72, k != 15)
            scan = Scan(time_ns, time_ns // 1000, _BEARINGS, ranges, (ranges < 15.0) & known, known)
            here = np.array([0.1 * min(k, 15), 0.0, -3.0])
            goal, velocity = 20.0 * here, np.array([1.5, 0.0, 0.0])
            speed = settings.course.smooth_from + (1.0 if k % 2 else -1.0)
            pipeline.answer(PlanRequest(k + 1, time_ns, scan, (here, upright), -0.5, here, velocity, goal, speed))
        pipeline.local_map.free_space(here, time_ns, tight=True)  # none of those paths is tight by all settings
        if pipeline.global_planner is not None:
            _go_back(pipeline.global_planner, pipeline.local_map, here, goal)


def _go_back(planner: GlobalPlanner, local_map: LocalMap, here: Array, goal: Array) -> None:
    """From the goal to a place so far away that ways are looked for in all that is remembered, the second beside the
    first."""
    for place in (goal, *(here,) * (EACH + 1)):
        planner.local_goal(place, goal, lambda: local_map.look_far(0))


def _walker(step: int) -> Array:
    """(72,) m: a thing that walks around."""
    ranges = np.full(72, 15.0)
    ranges[(np.arange(4) + step % 14 - 2) % 72] = 5.0
    return ranges


def _wall(gap_m: float) -> Array:
    """(72,) m: a wall 3 m ahead with a gap, and walls to the other sides."""
    ahead, aside = np.cos(_BEARINGS), np.abs(np.sin(_BEARINGS))
    with np.errstate(divide="ignore"):
        wall, sides = np.where(ahead > 0.0, 3.0 / ahead, np.inf), np.minimum(4.0 / aside, 4.0 / np.abs(ahead))
    ranges: Array = np.minimum(np.where(wall * aside < 0.5 * gap_m, 15.0, wall), np.where(aside > 0.3, sides, 15.0))
    return np.minimum(ranges, 15.0)


class Planning:
    """Requests out, results in when they count. `delay_s`: in lockstep, from a request to its result; None in
    real time."""

    def __init__(self, backend: PlannerBackend, delay_s: float | None) -> None:
        self._backend = backend
        self._delay_ns = None if delay_s is None else round(delay_s * 1e9)
        self._due: deque[int] = deque()
        self._ready, self._failed = True, False

    def ask(self, request: PlanRequest) -> None:
        self._backend.ask(request)
        if self._delay_ns is not None:
            self._due.append(request.asked_ns + self._delay_ns)

    def due(self, now_ns: int) -> PlanResult | None:
        """The next result that counts by now; to be called until there is none."""
        if self._delay_ns is None:
            return self._backend.take(0.0)
        if not self._due or now_ns < self._due[0]:
            return None
        self._due.popleft()
        return self._backend.take(_PATIENCE_S)

    def news(self, now_ns: int) -> PlannerStarting | PlannerReady | PlannerFault | None:
        """What has become of the backend since this was asked last, where at first it was taken to be ready."""
        ready, fault = self._backend.ready, self._backend.fault
        if fault is not None:
            failed, self._failed = self._failed, True
            return None if failed else PlannerFault(now_ns, fault)
        if ready is self._ready:
            return None
        self._ready = ready
        return PlannerReady(now_ns) if ready else PlannerStarting(now_ns)

    def close(self) -> None:
        self._backend.close()


def pack_request(request: PlanRequest) -> bytes:
    """The payload of an ASKED record."""
    position, attitude = request.pose
    return ASKED.pack(
        request.number,
        request.asked_ns,
        request.scan.time_ns,
        request.scan.boot_time_us,
        *position.tolist(),
        *attitude.tolist(),
        request.ground_down,
        *request.here.tolist(),
        *request.velocity.tolist(),
        *((math.nan,) * 3 if request.goal is None else request.goal.tolist()),
        request.speed,
        request.margin,
    )


def pack_result(answer: PlanResult) -> bytes:
    """The payload of a PLANNED record."""
    corners = answer.path.vertices[:PLANNED_CORNERS]
    record = np.zeros(1, PLANNED.dtype)
    record["number"], record["asked_ns"], record["corners"] = answer.number, answer.asked_ns, len(corners)
    record["way_ned"][0, : 2 * len(corners)] = corners.ravel()
    record["speeds"][0, : len(corners)] = answer.path.speeds[:PLANNED_CORNERS]
    return record.tobytes()
