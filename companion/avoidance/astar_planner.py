"""The method "astar": the cheapest path over the map with room to spare, or a tight one where that is much shorter."""

import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from companion.avoidance.astar import AStar, GridPath, Integers
from companion.avoidance.moving import add_moving
from companion.avoidance.path import Path
from companion.avoidance.reach import add_turns
from companion.avoidance.shortcut import shorten, timed_path
from companion.avoidance.smoothing import smoothed
from companion.config_avoidance import Avoidance
from companion.perception.distance_field import Floats
from companion.perception.map_view import MapView, to_certain
from protocol.arrays import Array
from protocol.jit import compiled

_STANDOFF = 0.08
"""m of room beyond a tight passage's own: the stand-off from which the width of the passage can be seen."""
_LOOK_AHEAD = 0.5
"""m of path from where a part of a passage can be seen, inside of which there is no such room."""
_BESIDE_M = 0.5
"""m from the path from before; what is farther costs more."""
_AHEAD_M = 1.5
"""m of path after which one that turns away from the path from before is no longer beside it."""
_MOUTH_M = 0.5
"""m beyond the inflation within which a vehicle is at the mouth of the passage that it flies to."""
_MOST_GROWTH = 16.0
"""Growth of the cost of leaving a path, at most."""


class _Chosen(NamedTuple):
    """A path that was chosen, kept for the next choice."""

    cells: Integers
    """(n, 2) cells of the world."""
    goal: Array
    """(2,) or (3,) m, NED"""
    tight: bool


class AStarPlanner:
    """Plans by `AStar`; remembers the path that it chose last."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._search = AStar(settings.plan, settings.map.cells)
        self._chosen: _Chosen | None = None
        self._growth = 1.0
        """By which it costs more to leave the chosen path, after turns away from earlier ones."""
        self._turned = 0
        """Plans in a row that turn away from the passage that the vehicle is in."""

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        """See `methods.PathPlanner`.

        The path keeps the inflation if that is no long detour. Otherwise it may be a tight one, or lead to what may be
        a gap, if that costs less. Then, and if something moves, it keeps to where the last one led, unless another is
        cheaper by a share, which grows with each turn away.
        """
        settings = self._settings.plan
        costmap = self._search.costmap(view)
        before, self._chosen = self._chosen, None
        if before is not None and math.dist(before.goal[:2], goal[:2]) > settings.proximity_radius:
            before, self._growth = None, 1.0
        cell = view.cell_of(position)
        near = view.to_occupied[cell] if before is not None and before.tight and view.contains(cell) else math.inf
        in_tight = near < settings.inflation
        beside = None if before is None or view.moving is None else self._beside(before, view, self._growth)
        here, motion = (position[0], position[1]), (velocity[0], velocity[1])
        if view.moving is not None:
            add_moving(costmap, view.moving, here, (math.hypot(*motion), speed), view.corner, view.cell)
        course, smooth = self._settings.course, speed > self._settings.course.smooth_from
        if smooth:
            limits = course.acceleration, course.braking, self._settings.guard.lag_s
            add_turns(costmap, here, motion, limits, view.corner, view.cell)
        roomy_costmap = costmap if beside is None else costmap * beside
        roomy = None
        if not in_tight:
            roomy = self._search.plan(view, roomy_costmap, position, goal, max_detour=settings.max_detour)
        if roomy is not None:
            self._growth, self._turned = 1.0, 0
            self._chosen = _Chosen(roomy.cells + np.array(view.corner), goal, False)
            vertices = self._vertices(roomy, view, roomy_costmap, (position, goal), settings.inflation)
            if smooth:
                fastest = speed, course.acceleration, course.braking
                curve = smoothed(vertices, view, velocity, settings.inflation, fastest)
                return Path(*curve, smooth=True, detour=roomy.detour)
            return timed_path(vertices, view, speed, course, roomy.detour)
        entered = False
        if before is not None and beside is None:
            at = np.array(cell) + np.array(view.corner)
            entered = near < settings.inflation + _MOUTH_M and _is_beside(at, before.cells, view.cell)
            growth = max(self._growth, settings.switch_growth_tight) if entered else self._growth
            beside = self._beside(before, view, growth)
        costmap = self._tight_costmap(view, costmap, beside)
        certain = to_certain(view, settings.tight_inflation)
        path = self._search.plan(view, costmap, position, goal, settings.tight_inflation, certain)
        path = path or self._search.plan(view, roomy_costmap, position, goal)
        if path is None:
            return None
        tight = bool(in_tight or view.to_occupied[tuple(path.cells.T)].min() < settings.inflation)
        self._keep(_Chosen(path.cells + np.array(view.corner), goal, tight), before, view.cell, entered=entered)
        if tight:
            path = _up_to_unconfirmed(path, view, settings.tight_inflation)
        inflation = settings.tight_inflation if tight else settings.inflation
        vertices = self._vertices(path, view, costmap, (position, goal), inflation)
        return replace(timed_path(vertices, view, speed, course, path.detour), tight=tight)

    def _keep(self, chosen: _Chosen, before: _Chosen | None, cell: float, *, entered: bool) -> None:
        """Keep a path for the next choice, or the one from before where that led through a passage that the vehicle has
        `entered`, until enough scans have turned away from it. `cell`: m, side of a cell."""
        settings = self._settings.plan
        turns = before is not None and _turns_away(chosen.cells, before.cells, cell)
        self._turned = self._turned + 1 if turns else 0
        waits = turns and entered and self._turned < settings.turn_scans
        self._chosen = before if waits else chosen
        if turns and not waits:
            self._growth = min(self._growth * settings.switch_growth, _MOST_GROWTH)

    def _beside(self, before: _Chosen, view: MapView, growth: float) -> Floats:
        """(cells, cells) factors of the cost: more beside the path from before."""
        beside = np.full(view.states.shape, 1.0 + growth * self._settings.plan.switch_cost, np.float32)
        fill_along(beside, before.cells - np.array(view.corner), math.ceil(_BESIDE_M / view.cell))
        return beside

    def _tight_costmap(self, view: MapView, costmap: Floats, beside: Floats | None) -> Floats:
        """(cells, cells) with the extra costs within the inflation and within the tight inflation, and `beside` the
        path from before."""
        settings = self._settings.plan
        tight = settings.tight_cost, settings.inflation
        unconfirmed = settings.unconfirmed_cost, settings.tight_inflation
        result = np.empty_like(costmap)
        _fill_tight_costmap(costmap, view.to_occupied, tight, unconfirmed, result)
        if beside is not None:
            result *= beside
        return result

    def _vertices(
        self, path: GridPath, view: MapView, costmap: Floats, ends: tuple[Array, Array], inflation: float
    ) -> Array:
        """(k, 2) m, NED, at least two: the shortened path from the position to the goal, which are its `ends`."""
        position, goal = ends
        vertices = shorten(path, view, costmap, inflation)
        end, last = vertices[-1].copy() if path.complete else position[:2], view.cell_of(goal)
        if path.complete:
            if not view.contains(last):
                vertices = np.concatenate((vertices, goal[None, :2]))
            elif view.to_occupied[last] >= inflation:
                vertices[-1] = end = goal[:2]
        vertices[0] = position[:2]
        if len(vertices) == 1:
            vertices = np.concatenate((vertices, end[None]))
        return vertices


@compiled
def _fill_tight_costmap(
    costmap: Floats, near: Floats, tight: tuple[float, float], unconfirmed: tuple[float, float], result: Floats
) -> None:
    """Write the costs plus those of cells `near` (m) an occupied one to `result`. `tight` and `unconfirmed`: the cost
    at the obstacle and the distance (m) at which it falls to 0. In 32 bits throughout, as `AStar.costmap`."""
    none, one = np.float32(0.0), np.float32(1.0)
    tight_cost, tight_m = np.float32(tight[0]), np.float32(tight[1])
    unconfirmed_cost, unconfirmed_m = np.float32(unconfirmed[0]), np.float32(unconfirmed[1])
    for i in range(costmap.shape[0]):
        cost, distance, row = costmap[i], near[i], result[i]
        for j in range(costmap.shape[1]):
            inner = max(one - distance[j] / tight_m, none)
            innermost = max(one - distance[j] / unconfirmed_m, none)
            row[j] = cost[j] + tight_cost * (inner * inner) + unconfirmed_cost * (innermost * innermost)


@compiled
def fill_along(factors: Floats, cells: Integers, reach: int) -> None:
    """Set the factors to 1 within `reach` rows and columns of cells (n, 2), which may lie outside."""
    for k in range(cells.shape[0]):
        top, left = max(cells[k, 0] - reach, 0), max(cells[k, 1] - reach, 0)
        factors[top : max(cells[k, 0] + reach + 1, 0), left : max(cells[k, 1] + reach + 1, 0)] = 1.0


def _turns_away(cells: Integers, before: Integers, cell: float) -> bool:
    """Whether a path soon leaves the one from before, (n, 2) cells of the world each, with a side of `cell` (m)."""
    beyond = np.flatnonzero(np.hypot(*(cells - cells[0]).T) * cell > _AHEAD_M)
    return not _is_beside(cells[beyond[0] if len(beyond) else -1], before, cell)


def _is_beside(place: Integers, cells: Integers, cell: float) -> bool:
    """Whether a place (2,) is beside a path (n, 2), both in cells of the world."""
    return bool(np.abs(cells - place).max(axis=1).min() * cell <= _BESIDE_M)


def _up_to_unconfirmed(path: GridPath, view: MapView, inflation: float) -> GridPath:
    """The part of a path up to the stand-off before the first obstacle that may not be there.

    That is the first cell nearer to an occupied one than the inflation (m), after the path has left such cells. The
    part holds the start at least; in a passage it ends `_LOOK_AHEAD` before that cell, where there is no room for the
    stand-off.
    """
    near = view.to_occupied[path.cells[:, 0], path.cells[:, 1]]
    outside = np.flatnonzero(near >= inflation)
    first = int(outside[0]) if len(outside) else len(near)
    unconfirmed = first + np.flatnonzero(near[first:] < inflation)
    if not len(unconfirmed):
        return path
    with_standoff = np.flatnonzero(near[: unconfirmed[0]] >= inflation + _STANDOFF)
    end = max(int(unconfirmed[0]) - round(_LOOK_AHEAD / view.cell), 1)
    if len(with_standoff):
        end = max(end, int(with_standoff[-1]) + 1)
    return replace(path, cells=path.cells[:end], costs=path.costs[:end], complete=False)
