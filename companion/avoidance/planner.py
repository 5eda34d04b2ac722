"""The methods on the map, and what the guard looks at: ring -> tracks -> grid -> view -> free space and way.

All of it is too slow for the loop that flies. It is asked with one `PlanRequest` a ring, outside of the loop, and its
`PlanResult` is an event. The result depends on the requests so far and on nothing else: a log need only tell when each
one came.
"""

import math

import msgspec
import numpy as np
from msgspec.structs import replace

from companion.avoidance.astar import AStar, AStarSettings, GridPath, Integers
from companion.avoidance.rrt import Rrt, RrtSettings
from companion.avoidance.shortcut import corner_speeds, line_cost, shorten
from companion.avoidance.steering import NO_WAY, Way
from companion.avoidance.vfh import Vfh, VfhSettings
from companion.config import Avoidance, picked
from companion.perception.distance_field import Floats
from companion.perception.free_space import Empty, FreeSpace, empty_here, space_bytes
from companion.perception.local_map import LocalMap
from companion.perception.map_view import MapView, to_certain
from companion.state import Scan
from protocol.arrays import Array

_HULL_M = 0.6
"""From an occupied cell's centre to where a corner may be cut."""
_TO_SEE = 0.08
"""m short of what is tight: from there it is seen what there is."""
_LEAST_ROOM, _MOST_ROOM = 0.15, 1.5
_UNKNOWN_ROOM = 0.5
"""m of room at a corner, beyond the window."""


_SMALL_BYTES = 1 << 16
"""For an answer's way and its points."""


class PlanRequest(msgspec.Struct, frozen=True):
    """A ring, and where the vehicle was and wanted to when it was heard."""

    number: int
    """From 1, without gaps."""
    asked_ns: int
    scan: Scan
    pose: tuple[Array, Array]
    """Position (3,) NED and attitude (4,) NED to FRD at the ring's own time."""
    ground_down: float
    """m, NED: returns below are the ground."""
    here: Array
    """(3,) m, NED"""
    velocity: Array
    """(3,) m/s"""
    goal: Array | None
    """(3,) m, NED; None if no way is wanted."""
    speed: float
    """m/s, the highest."""


class PlanResult(msgspec.Struct, frozen=True):
    """To one question."""

    number: int
    asked_ns: int
    space: FreeSpace
    clearance: float
    """m from the hull to the nearest occupied cell's centre; inf if nothing is near."""
    way: Way
    blocked: bool
    """The straight line to the goal comes too near to something."""


def result_bytes(settings: Avoidance) -> int:
    """No answer's arrays are larger than that."""
    return space_bytes(settings.map.cells, settings.map.cell) + _SMALL_BYTES


class PlanningPipeline:
    """Answers questions, in their order."""

    def __init__(self, settings: Avoidance, empty: Empty = empty_here) -> None:
        """`empty`: where the large arrays of the next answer are to lie."""
        self.surroundings = LocalMap(settings, empty)
        self.planner = Planner(settings) if settings.mapped else None

    def answer(self, question: PlanRequest) -> PlanResult:
        """Take a ring in, and say what is free and where to go."""
        surroundings, here, goal = self.surroundings, question.here, question.goal
        surroundings.add(question.scan, question.pose, question.ground_down, question.asked_ns)
        view = surroundings.look(question.asked_ns)
        way, blocked = NO_WAY, False
        if self.planner is not None and goal is not None:
            way = self.planner.way(view, here, question.velocity, goal, question.speed)
            blocked = self.planner.blocked(view, here, goal)
        space = surroundings.free_space(here, question.asked_ns, tight=way.tight)
        clearance = surroundings.clearance(here)
        return PlanResult(question.number, question.asked_ns, space, clearance, way, blocked)


class Planner:
    """A way at each view: corners with their speeds, by A* or by sampling; else the direction that VFH+ chooses."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._astar = AStar(picked(AStarSettings, settings.plan), settings.map.cells)
        self._vfh = Vfh(picked(VfhSettings, settings.vfh))
        self._tight: Integers | None = None
        """(n, 2) cells of the world along the way that was chosen last, if it was tight."""
        self._rrt = None
        if settings.method == "rrt":
            self._rrt = Rrt(picked(RrtSettings, settings.rrt, inflation=settings.plan.inflation))

    def way(self, view: MapView, here: Array, velocity: Array, goal: Array, speed: float) -> Way:
        """From a place (3,) with a velocity (3,) NED to a goal (3,), at most at `speed` (m/s)."""
        way = None
        if self._settings.method == "astar":
            way = self._planned(view, here, goal, speed)
        elif self._rrt is not None:
            way = self._sampled(self._rrt, view, here, goal, speed)
        if way is not None:
            return way
        bearing = self._vfh.choose(view, here, velocity, goal)
        return replace(NO_WAY, bearing=bearing, detour=0.0 if self._settings.method == "vfh" else math.inf)

    def blocked(self, view: MapView, here: Array, goal: Array) -> bool:
        """The straight line to the goal comes too near to something."""
        inflation = self._settings.plan.inflation
        start, end = (place[:2] / view.cell - np.array(view.corner) - 0.5 for place in (here, goal))
        near = view.to_occupied
        return line_cost(near, near, inflation, view.cell, start[0], start[1], end) == math.inf

    def _planned(self, view: MapView, here: Array, goal: Array, speed: float) -> Way | None:
        """With room, if that is no long way round; else tight, or to what may be a gap, if that costs less. A tight way
        is gone on with as long as no other one is much cheaper, and until there is room again."""
        plan = self._settings.plan
        prices = self._astar.prices(view)
        path = self._astar.plan(view, prices, here, goal)
        before, self._tight = self._tight, None
        cell, near = view.cell_of(here), view.to_occupied
        narrow = before is not None and view.contains(cell) and near[cell] < plan.inflation
        if path is not None and path.detour <= plan.detour and not narrow:
            return self._flyable(path, view, prices, here, goal, speed, plan.inflation)
        squeezed = prices + plan.squeeze * np.maximum(1.0 - near / plan.inflation, 0.0) ** 2
        squeezed += plan.doubt * np.maximum(1.0 - near / plan.tight, 0.0) ** 2
        certain = to_certain(view)
        tight = self._astar.plan(view, squeezed, here, goal, plan.tight, certain)
        least = math.inf if tight is None else tight.cost
        if before is not None:
            same = self._astar.again(before - np.array(view.corner), view, squeezed, here, goal, plan.tight, certain)
            if same is not None and same.cost < least + plan.habit:
                tight, least = same, same.cost - plan.habit
        if tight is not None and (path is None or least < path.cost):
            self._tight = tight.cells + np.array(view.corner)
            tight = _up_to_doubt(tight, view, plan.tight)
            return replace(self._flyable(tight, view, squeezed, here, goal, speed, plan.tight), tight=True)
        if path is None:
            return None
        if narrow:
            self._tight = path.cells + np.array(view.corner)
        return replace(self._flyable(path, view, prices, here, goal, speed, plan.inflation), tight=narrow)

    def _flyable(
        self, path: GridPath, view: MapView, prices: Floats, here: Array, goal: Array, speed: float, inflation: float
    ) -> Way:
        corners = shorten(path, view, prices, inflation)
        last = view.cell_of(goal)
        if path.whole:
            if not view.contains(last):
                corners = np.concatenate((corners, goal[None, :2]))
            elif view.to_occupied[last] >= inflation:
                corners[-1] = goal[:2]
        corners[0] = here[:2]
        if len(corners) == 1:
            corners = np.concatenate((corners, (goal if path.whole else here)[None, :2]))
        return self._timed(corners, view, speed, path.detour)

    def _sampled(self, rrt: Rrt, view: MapView, here: Array, goal: Array, speed: float) -> Way | None:
        corners = rrt.plan(view, here, goal)
        if corners is None:
            return None
        if not view.contains(view.cell_of(goal)):
            corners = np.concatenate((corners, goal[None, :2]))
        length = float(np.hypot(*np.diff(corners, axis=0).T).sum())
        return self._timed(corners, view, speed, length - math.dist(here[:2].tolist(), goal[:2].tolist()))

    def _timed(self, corners: Array, view: MapView, speed: float, detour: float) -> Way:
        room = np.array([_room(view, corner) for corner in corners])
        course = self._settings.course
        speeds = corner_speeds(corners, room, speed, course.acceleration, course.braking)
        return Way(corners, speeds, detour=detour)


def _up_to_doubt(path: GridPath, view: MapView, room: float) -> GridPath:
    """The part of a path up to where the first thing nearer than `room` (m), which may not be there, is seen from: a
    little before it if there is so much space, the start at least."""
    near = view.to_occupied[path.cells[:, 0], path.cells[:, 1]]
    away = np.flatnonzero(near >= room)
    first = int(away[0]) if len(away) else len(near)  # out of what it is in
    doubtful = first + np.flatnonzero(near[first:] < room)
    if not len(doubtful):
        return path
    seen_from = np.flatnonzero(near[: doubtful[0]] >= room + _TO_SEE)
    end = int(seen_from[-1]) + 1 if len(seen_from) else max(int(doubtful[0]), 1)
    return replace(path, cells=path.cells[:end], costs=path.costs[:end], whole=False)


def _room(view: MapView, place: Array) -> float:
    """m within which a corner may be cut."""
    cell = view.cell_of(place)
    if not view.contains(cell):
        return _UNKNOWN_ROOM
    return float(min(max(view.to_occupied[cell] - _HULL_M, _LEAST_ROOM), _MOST_ROOM))
