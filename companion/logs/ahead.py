"""What a recorded flight's planner answered, made again by a process that runs ahead of the replay which needs it.

The log tells what was asked, so nobody need wait for the autopilot to ask it once more. What it does ask is compared:
if it is anything else, the answers made ahead are of no use.
"""

import contextlib
import multiprocessing
import os
import threading
from collections import OrderedDict, deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from companion.avoidance.planner import PlanningPipeline, PlanRequest, PlanResult, result_bytes
from companion.config_avoidance import Avoidance
from companion.link import wire_ranges
from companion.link.refusals import RefusedError
from companion.records import ASKED
from companion.runtime.interrupts import start_uninterrupted
from companion.runtime.mailbox import Inbox, Outbox, mailbox
from companion.runtime.planning import pack_request
from companion.state import EVERY_HEIGHT, Scan
from protocol.flightlog import LogReader

_RING = "/OBSTACLE_DISTANCE"
_RINGS = 64
"""The latest, of which a request is about one."""
_WORTH_IT = 2_000_000
"""Bytes of log, some 20 s of flight; for less the process is hardly started."""
_SLOTS = 16
"""Answers that are ready, or in use."""
_LOOK_S = 1.0


class DivergedError(Exception):
    """The replay asks something else than the flight did, or there are no more results."""


def worth_it(log: LogReader) -> bool:
    """The log says what was asked and has the rings, it is long enough, and there is a core for it."""
    kind = log.topics.get(ASKED.topic)
    tells = kind is not None and kind.definition == ASKED.definition
    tells = tells and any(topic.endswith(_RING) for topic in log.topics)
    return tells and log.path.stat().st_size >= _WORTH_IT and len(os.sched_getaffinity(0)) > 1


class Ahead:
    """A `PlannerBackend` whose `take` waits as long as it takes, and raises DivergedError."""

    ready = True
    fault: str | None = None

    def __init__(self, path: Path, settings: Avoidance) -> None:
        # A copy of this process has all that is needed; it would copy the locks that other threads hold, too.
        context: Any = multiprocessing.get_context("fork" if threading.active_count() == 1 else "spawn")
        self._results, theirs = mailbox(context, _SLOTS, result_bytes(settings))
        self._free = context.Semaphore(_SLOTS - 2)
        ours = self._results if context.get_start_method() == "fork" else None
        arguments = (theirs, ours, self._free, os.getpid(), path, settings)
        self._process = context.Process(target=_run, args=arguments, name="courier-ahead", daemon=True)
        start_uninterrupted(self._process)
        theirs.close()
        self._open: deque[PlanRequest] = deque()

    @property
    def pid(self) -> int | None:
        """The process's number; None before it was started."""
        pid: int | None = self._process.pid
        return pid

    def ask(self, request: PlanRequest) -> None:
        self._open.append(request)

    def take(self, patience_s: float) -> PlanResult | None:
        if not self._open:
            return None
        request = self._open.popleft()
        if request.fence is not None or request.in_the_way != EVERY_HEIGHT:  # a record of a request does not hold them
            raise DivergedError
        try:
            asked, result = self._results.take()
        except (EOFError, OSError):
            raise DivergedError from None
        self._free.release()
        if asked != _identity(request):
            raise DivergedError
        made: PlanResult = result
        return made

    def close(self) -> None:
        self._results.close()
        self._process.kill()
        self._process.join()


def _identity(request: PlanRequest) -> bytes:
    """All that an answer depends on."""
    scan = request.scan
    ring = (scan.bearings_frd, scan.ranges_m, scan.hit, scan.known)
    return b"".join((pack_request(request), *(values.tobytes() for values in ring)))


def _run(
    results: Outbox,
    copied: Inbox | None,
    free: Any,
    replay: int,
    path: Path,
    settings: Avoidance,
) -> None:
    """The process: answer what the log asks, up to its end or to a request that it does not tell whole."""
    if copied is not None:  # with this end open here, nobody would notice that the replay's is closed
        copied.close()
    with contextlib.suppress(Exception), contextlib.closing(results):  # what is wrong with the log the replay says
        pipeline, log = PlanningPipeline(settings, results.empty), LogReader(path)
        kinds = {topic: kind for topic, kind in log.topics.items() if topic.endswith(_RING)}
        rings: OrderedDict[tuple[int, int], Scan] = OrderedDict()
        for record in log.records((*kinds, ASKED.topic)):
            if record.topic != ASKED.topic:
                with contextlib.suppress(RefusedError):
                    message = SimpleNamespace(**kinds[record.topic].unpack(record.data))
                    scan = wire_ranges.obstacle_distance(message, record.time_ns)
                    rings[scan.time_ns, scan.boot_time_us] = scan
                while len(rings) > _RINGS:
                    rings.popitem(last=False)
                continue
            request = _request(ASKED.unpack(record.data), rings)
            if request is None:
                return
            while not free.acquire(timeout=_LOOK_S):
                if os.getppid() != replay:  # it was killed
                    return
            results.put((_identity(request), pipeline.answer(request)))


def _request(asked: dict[str, Any], rings: OrderedDict[tuple[int, int], Scan]) -> PlanRequest | None:
    """The request of a record; None if its ring is not there."""
    scan = rings.get((asked["ring_ns"], asked["ring_boot_us"]))
    if scan is None:
        return None
    position, attitude, here, velocity, goal = (
        np.array(asked[name]) for name in ("position_ned", "attitude_ned_frd", "here_ned", "velocity_ned", "goal_ned")
    )
    return PlanRequest(
        asked["number"],
        asked["asked_ns"],
        scan,
        (position, attitude),
        asked["ground_down"],
        here,
        velocity,
        None if np.isnan(goal).any() else goal,
        asked["speed"],
        margin=asked["margin"],
    )
