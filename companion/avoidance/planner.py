"""From scans to free space and a path: scan -> tracks -> map -> view -> path and free space.

All of it is too slow for the control loop. The loop sends one `PlanRequest` for each scan, and the `PlanResult` comes
back as an event. A result depends on the requests so far and on nothing else: a log need only record when each result
was taken.
"""

import math

import msgspec
import numpy as np
from msgspec.structs import replace

from companion.avoidance.global_planner import GlobalPlanner
from companion.avoidance.methods import path_planner
from companion.avoidance.path import NO_PATH, PATH_BYTES, Path
from companion.avoidance.shortcut import line_cost
from companion.avoidance_methods import FALLBACK
from companion.config_avoidance import Avoidance
from companion.perception.fence_band import Flat
from companion.perception.free_space import Empty, FreeSpace, empty_here, space_bytes
from companion.perception.local_map import LocalMap
from companion.perception.map_view import MapView
from companion.state import EVERY_HEIGHT, Scan
from protocol.arrays import Array

_SMALL_BYTES = PATH_BYTES + (1 << 15)
"""Room for the path and the points of a result."""


class PlanRequest(msgspec.Struct, frozen=True):
    """A scan, with the state and the goal of the vehicle when it arrived."""

    number: int
    """From 1, without gaps."""
    asked_ns: int
    scan: Scan
    pose: tuple[Array, Array]
    """Position (3,) m, NED and attitude (4,) NED to FRD at the time of the scan."""
    ground_down: float
    """m, NED: returns below are the ground."""
    here: Array
    """(3,) m, NED"""
    velocity: Array
    """(3,) m/s, NED"""
    goal: Array | None
    """(3,) m, NED; None if no path is wanted."""
    speed: float
    """m/s, the highest."""
    fence: Flat | None = None
    """Beyond it nothing is free; None without one."""
    in_the_way: tuple[float, float] = EVERY_HEIGHT
    """m above and below the vehicle up to which returns are in the way."""
    margin: float = 0.0
    """m by which obstacles are taken for larger than they are seen (`avoidance.drift_margin`)."""


class PlanResult(msgspec.Struct, frozen=True):
    """The result of one request."""

    number: int
    asked_ns: int
    space: FreeSpace
    clearance: float
    """m from the hull to the centre of the nearest occupied cell; inf if nothing is near."""
    path: Path
    blocked: bool
    """The straight line to the goal comes too near to an obstacle."""


def result_bytes(settings: Avoidance) -> int:
    """An upper bound of the size of a result's arrays."""
    return space_bytes(settings.map.cells, settings.map.cell) + _SMALL_BYTES


class PlanningPipeline:
    """Answers requests, in their order."""

    def __init__(self, settings: Avoidance, empty: Empty = empty_here) -> None:
        """`empty` makes the large arrays of the results."""
        self.local_map = LocalMap(settings, empty)
        self.planner = Planner(settings) if settings.mapped else None
        remembers = settings.map.beyond_window and settings.map.memory > settings.map.cells
        self.global_planner = GlobalPlanner(settings) if remembers and settings.method != FALLBACK else None

    def answer(self, request: PlanRequest) -> PlanResult:
        """Add the scan to the map; returns the free space and the path."""
        local_map, here, goal = self.local_map, request.here, request.goal
        local_map.margin = request.margin
        local_map.add(request.scan, request.pose, request.ground_down, request.asked_ns, request.in_the_way)
        view = local_map.look(request.asked_ns, request.fence)
        path, blocked = NO_PATH, False
        if self.planner is not None and goal is not None:
            path = self._path(self.planner, view, request, goal)
            blocked = self.planner.blocked(view, here, goal)
        space = local_map.free_space(here, request.asked_ns, tight=path.tight)
        clearance = local_map.clearance(here)
        return PlanResult(request.number, request.asked_ns, space, clearance, path, blocked)

    def _path(self, planner: "Planner", view: MapView, request: PlanRequest, goal: Array) -> Path:
        here, out = request.here, self.global_planner
        if out is None:
            return planner.path(view, here, request.velocity, goal, request.speed)
        local_goal = out.local_goal(here, goal, lambda: self.local_map.look_far(request.asked_ns, request.fence))
        path = planner.path(view, here, request.velocity, local_goal, request.speed)
        return path if local_goal is goal else replace(path, detour=max(path.detour, out.detour))


class Planner:
    """A path at each view, by the chosen method; else the direction that the fallback chooses."""

    def __init__(self, settings: Avoidance) -> None:
        self._inflation = settings.plan.inflation
        self._method = path_planner(settings.method, settings)
        self._fallback = path_planner(FALLBACK, settings)

    def path(self, view: MapView, here: Array, velocity: Array, goal: Array, speed: float) -> Path:
        """From a position with a velocity to a goal, (3,) each, m and m/s NED, at most at `speed` (m/s)."""
        path = self._method.plan(view, here, velocity, goal, speed)
        if path is not None:
            return path
        return replace(self._fallback.plan(view, here, velocity, goal, speed) or NO_PATH, detour=math.inf)

    def blocked(self, view: MapView, here: Array, goal: Array) -> bool:
        """Whether the straight line between two places (2,) or (3,), m, NED, comes nearer than the inflation to an
        occupied cell."""
        start, end = (place[:2] / view.cell - np.array(view.corner) - 0.5 for place in (here, goal))
        near = view.to_occupied
        return line_cost(near, near, self._inflation, view.cell, start[0], start[1], end) == math.inf
