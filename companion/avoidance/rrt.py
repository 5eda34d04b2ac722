"""The method "rrt": a sampling planner, BIT* or Informed RRT* of OMPL, for the shortest path by length.

Gammell, Srinivasa and Barfoot 2015 (BIT*) and 2014 (Informed RRT*), as in OMPL 2.0, with these differences:

- Whole motions are checked, not points along them: each cell that a motion touches must be at least the inflation away
  from an occupied one.
- Planning ends after a number of iterations, never after a time: samples and edges of BIT*, samples of Informed RRT*.
- If the straight line is allowed, it is the path. Any other path is shortened over places along itself.

The same view, start, goal and settings give the same path, whatever was planned before. OMPL's generators draw their
seeds from a global one: each plan sets that seed and creates its own generators. So no two threads of a process may
plan at the same time.
"""

import itertools
import math
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.astar import nearest_allowed_cell
from companion.avoidance.path import Path
from companion.avoidance.shortcut import timed_path
from companion.config_avoidance import Avoidance, AvoidanceRrt
from companion.perception.map_view import Cell, MapView
from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

Integers = NDArray[np.int64]

_WAY_OUT, _NEAR_GOAL = 4.0, 2.0
"""Inflations within which a forbidden start and a forbidden goal are replaced."""
_SHORTENING_PLACES = 96
"""Places along a path over which it is shortened."""


class RrtPlanner:
    """The method "rrt"."""

    def __init__(self, settings: Avoidance) -> None:
        self._course = settings.course
        self._rrt = Rrt(settings.rrt, settings.plan.inflation)

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        """See `methods.PathPlanner`."""
        vertices = self._rrt.plan(view, position, goal)
        if vertices is None:
            return None
        if not view.contains(view.cell_of(goal)):
            vertices = np.concatenate((vertices, goal[None, :2]))
        length = float(np.hypot(*np.diff(vertices, axis=0).T).sum())
        detour = length - math.dist(position[:2].tolist(), goal[:2].tolist())
        return timed_path(vertices, view, speed, self._course, detour)


class Rrt:
    """Plans by the planner that the settings name."""

    def __init__(self, settings: AvoidanceRrt, inflation: float) -> None:
        """`inflation`: m from the centre of an occupied cell that are forbidden."""
        self._inflation = inflation
        self._sampling = _Sampling(settings)

    def plan(self, view: MapView, start: Array, goal: Array) -> Array | None:
        """Vertices (k, 2) (m, NED) of a path from a place in the window to a place anywhere, (2,) or (3,) m, NED.

        The first is the start. Where that is forbidden, the nearest allowed place follows, as long as a line gets there
        without coming nearer to anything. The last is the goal. Where that is forbidden, it is the nearest allowed
        place; where it is beyond the window, the place at the window's border with the least detour. None: no path.
        """
        inflation = self._inflation
        begin, end = (place[:2] / view.cell - np.array(view.corner) - 0.5 for place in (start, goal))
        first, last = _cell(begin), _cell(end)
        if not view.contains(first):
            return None
        allowed = view.to_occupied >= inflation
        inflation_cells = inflation / view.cell
        lead = np.empty((0, 2))
        if not allowed[first]:
            lead = begin[None]
            outward = view.to_occupied >= view.to_occupied[first]
            begin = np.array(_way_out(allowed, outward, begin, math.ceil(_WAY_OUT * inflation_cells)), float)
        if not view.contains(last):
            end = np.array(_border_cell(allowed, begin, end), float)
        elif not allowed[last]:
            reach = math.ceil(_NEAR_GOAL * inflation_cells) + 1
            end = np.array(nearest_allowed_cell(view.states, view.to_occupied, last, inflation, reach), float)
        if not allowed[_cell(begin)] or not allowed[_cell(end)]:
            return None
        path = self._path(allowed, begin, end)
        if path is None:
            return None
        vertices: Array = (np.vstack([lead, path]) + np.array(view.corner) + 0.5) * view.cell
        return vertices

    def _path(self, allowed: BoolArray, begin: Array, end: Array) -> Array | None:
        """(k, 2) in cells, whole numbers at their centres, through allowed cells from one place (2,) to another."""
        if _clear(allowed, *begin, *end):
            return np.array([begin, end])
        found = self._sampling.solve(allowed, begin, end)
        return None if found is None else _shortened(found, allowed)


class _Sampling:
    """The part done by OMPL, in cells of the window, whole numbers at their centres."""

    def __init__(self, settings: AvoidanceRrt) -> None:
        # Imported here, since it takes 50 ms that the other methods need not spend.
        base, geometric, util = (import_module(f"ompl.{name}") for name in ("base", "geometric", "util"))

        util.setLogLevel(util.LOG_NONE)
        self._iterations, self._seed = settings.iterations, settings.seed
        self._base, self._set_seed = base, util.RNG.setSeed
        self._motions = type("Motions", (base.MotionValidator,), {"checkMotion": _check_motion})
        self._planner = geometric.BITstar if settings.planner == "bit*" else geometric.InformedRRTstar

    def solve(self, allowed: BoolArray, begin: Array, end: Array) -> Array | None:
        """Path (k, 2) from an allowed place (2,) to another through allowed cells (rows, columns); None if none is
        found."""
        self._set_seed(self._seed)
        over = itertools.chain(itertools.repeat(False, self._iterations), itertools.repeat(True))
        information = self._space(allowed, over)
        problem = self._base.ProblemDefinition(information)
        states = [information.allocState(), information.allocState()]
        for state, place in zip(states, (begin, end), strict=True):
            state[0], state[1] = place
        problem.setStartAndGoalStates(*states)
        planner = self._planner(information)
        planner.setProblemDefinition(problem)
        planner.setup()
        planner.solve(self._base.PlannerTerminationCondition(over.__next__))
        if not problem.hasExactSolution():
            return None
        return np.array([state[0:2] for state in problem.getSolutionPath().getStates()])

    def _space(self, allowed: BoolArray, over: Iterator[bool]) -> Any:
        space = self._base.RealVectorStateSpace(0)
        for cells in allowed.shape:
            space.addDimension(-0.5, cells - 0.5)
        information = self._base.SpaceInformation(space)
        motions = self._motions(information)
        motions.allowed = allowed
        information.setMotionValidator(motions)

        def sample_allowed(state: Any) -> bool:
            # A batch of BIT* in a crowded place draws many: without this it would count as one iteration.
            next(over)
            return _check_motion(motions, state, state)

        information.setStateValidityChecker(sample_allowed)
        information.setup()
        return information


def _check_motion(motions: Any, a: Any, b: Any) -> bool:
    """Called by OMPL for each motion between two of its states."""
    return _clear(motions.allowed, a[0], a[1], b[0], b[1])


def _cell(place: Array) -> Cell:
    return math.floor(place[0] + 0.5), math.floor(place[1] + 0.5)


def _shortened(path: Array, allowed: BoolArray) -> Array:
    """The shortest path (k, 2) by lines between places along a path (n, 2)."""
    lengths = np.hypot(*np.diff(path, axis=0).T)
    spacing = lengths.sum() / _SHORTENING_PLACES
    pieces = [
        a + np.arange(count)[:, None] / count * (b - a)
        for (a, b), count in zip(itertools.pairwise(path), np.ceil(lengths / spacing).astype(int), strict=True)
    ]
    places = np.vstack([*pieces, path[-1:]])
    return places[_kept(places, allowed)]


@compiled
def _clear(allowed: BoolArray, row: float, column: float, to_row: float, to_column: float) -> bool:
    """Whether all cells that a line touches are allowed (Amanatides and Woo 1987: from side to side)."""
    rows, columns = allowed.shape
    i, j = math.floor(row + 0.5), math.floor(column + 0.5)
    steps_i, steps_j = math.floor(to_row + 0.5) - i, math.floor(to_column + 0.5) - j
    dr, dc = abs(to_row - row), abs(to_column - column)
    di, dj = (1 if steps_i > 0 else -1), (1 if steps_j > 0 else -1)
    # Share of the line up to the next side, and from one side to the next.
    next_i = (0.5 + di * (i - row)) / dr if steps_i != 0 else math.inf
    next_j = (0.5 + dj * (j - column)) / dc if steps_j != 0 else math.inf
    for _ in range(abs(steps_i) + abs(steps_j) + 1):
        if not (0 <= i < rows and 0 <= j < columns) or not allowed[i, j]:
            return False
        if next_i < next_j:
            i += di
            next_i += 1.0 / dr
        else:
            j += dj
            next_j += 1.0 / dc
    return True


@compiled
def _way_out(allowed: BoolArray, outward: BoolArray, begin: Array, reach: int) -> tuple[int, int]:
    """The nearest allowed cell that a line through `outward` ones reaches; the place's own if there is none."""
    rows, columns = allowed.shape
    row, column = math.floor(begin[0] + 0.5), math.floor(begin[1] + 0.5)
    best, best_row, best_column = math.inf, row, column
    for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
        for j in range(max(column - reach, 0), min(column + reach + 1, columns)):
            square = (i - begin[0]) ** 2 + (j - begin[1]) ** 2
            if allowed[i, j] and square < best and _clear(outward, begin[0], begin[1], i, j):
                best, best_row, best_column = square, i, j
    return best_row, best_column


@compiled
def _border_cell(allowed: BoolArray, begin: Array, end: Array) -> tuple[int, int]:
    """The allowed cell of the border with the least sum of distances to two places; [0, 0] if none is."""
    rows, columns = allowed.shape
    best, best_row, best_column = math.inf, 0, 0
    for i in range(rows):
        for j in range(0, columns, 1 if i in (0, rows - 1) else columns - 1):
            length = math.hypot(i - begin[0], j - begin[1]) + math.hypot(i - end[0], j - end[1])
            if allowed[i, j] and length < best:
                best, best_row, best_column = length, i, j
    return best_row, best_column


@compiled
def _kept(places: Array, allowed: BoolArray) -> Integers:
    """Indices of the places (n, 2) that lines join to the shortest path from the first to the last; the line from each
    to the next must be allowed."""
    count = places.shape[0]
    cost, parent = np.full(count, math.inf), np.zeros(count, np.int64)
    cost[0] = 0.0
    for k in range(1, count):
        for h in range(k - 1, -1, -1):
            new = cost[h] + math.hypot(places[k, 0] - places[h, 0], places[k, 1] - places[h, 1])
            if new >= cost[k]:
                continue
            if h == k - 1 or _clear(allowed, places[h, 0], places[h, 1], places[k, 0], places[k, 1]):
                cost[k], parent[k] = new, h
    kept = np.empty(count, np.int64)
    at, first = count - 1, count - 1
    kept[first] = at
    while at > 0:
        at = parent[at]
        first -= 1
        kept[first] = at
    return kept[first:]
