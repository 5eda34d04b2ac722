"""The method "astar": the cheapest path over the map with room to spare, or a tight one where that is much shorter."""

import math

import numpy as np
from msgspec.structs import replace

from companion.avoidance.astar import AStar, GridPath, Integers
from companion.avoidance.path import Path
from companion.avoidance.shortcut import shorten, timed_path
from companion.config_avoidance import Avoidance
from companion.perception.distance_field import Floats
from companion.perception.map_view import MapView, to_certain
from protocol.arrays import Array

_STANDOFF = 0.08
"""m of room beyond a tight passage's own: the stand-off from which the width of the passage can be seen."""


class AStarPlanner:
    """Plans by `AStar`; remembers the tight path that it chose last."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._search = AStar(settings.plan, settings.map.cells)
        self._tight: Integers | None = None
        """(n, 2) cells of the world along the last path, if it was tight."""

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        """See `methods.PathPlanner`.

        The path keeps the inflation if that is no long detour. Otherwise it is a tight one, or leads to what may be
        a gap, if that costs less. A tight path is kept until there is room again or another one is much cheaper.
        """
        settings = self._settings.plan
        costmap = self._search.costmap(view)
        roomy = self._search.plan(view, costmap, position, goal)
        before, self._tight = self._tight, None
        cell = view.cell_of(position)
        in_tight = before is not None and view.contains(cell) and view.to_occupied[cell] < settings.inflation
        if roomy is not None and roomy.detour <= settings.max_detour and not in_tight:
            vertices = self._vertices(roomy, view, costmap, (position, goal), settings.inflation)
            return timed_path(vertices, view, speed, self._settings.course, roomy.detour)
        tight_costmap = self._tight_costmap(view, costmap)
        tight, cost = self._tight_path(view, tight_costmap, before, position, goal)
        if tight is not None and (roomy is None or cost < roomy.cost):
            self._tight = tight.cells + np.array(view.corner)
            tight = _up_to_unconfirmed(tight, view, settings.tight_inflation)
            vertices = self._vertices(tight, view, tight_costmap, (position, goal), settings.tight_inflation)
            return replace(timed_path(vertices, view, speed, self._settings.course, tight.detour), tight=True)
        if roomy is None:
            return None
        if in_tight:
            self._tight = roomy.cells + np.array(view.corner)
        vertices = self._vertices(roomy, view, costmap, (position, goal), settings.inflation)
        return replace(timed_path(vertices, view, speed, self._settings.course, roomy.detour), tight=in_tight)

    def _tight_costmap(self, view: MapView, costmap: Floats) -> Floats:
        """(cells, cells) with the extra costs within the inflation and within the tight inflation."""
        settings, near = self._settings.plan, view.to_occupied
        result: Floats = costmap + settings.tight_cost * np.maximum(1.0 - near / settings.inflation, 0.0) ** 2
        result += settings.unconfirmed_cost * np.maximum(1.0 - near / settings.tight_inflation, 0.0) ** 2
        return result

    def _tight_path(
        self, view: MapView, costmap: Floats, before: Integers | None, position: Array, goal: Array
    ) -> tuple[GridPath | None, float]:
        """The cheapest tight path, or the one from before if it is not much dearer; and what it counts as (m)."""
        settings = self._settings.plan
        certain = to_certain(view)
        path = self._search.plan(view, costmap, position, goal, settings.tight_inflation, certain)
        cost = math.inf if path is None else path.cost
        if before is not None:
            cells = before - np.array(view.corner)
            same = self._search.reevaluate(cells, view, costmap, position, goal, settings.tight_inflation, certain)
            if same is not None and same.cost < cost + settings.switch_cost:
                return same, same.cost - settings.switch_cost
        return path, cost

    def _vertices(
        self, path: GridPath, view: MapView, costmap: Floats, ends: tuple[Array, Array], inflation: float
    ) -> Array:
        """(k, 2) m, NED, at least two: the shortened path from the position to the goal, which are its `ends`."""
        position, goal = ends
        vertices = shorten(path, view, costmap, inflation)
        last = view.cell_of(goal)
        if path.complete:
            if not view.contains(last):
                vertices = np.concatenate((vertices, goal[None, :2]))
            elif view.to_occupied[last] >= inflation:
                vertices[-1] = goal[:2]
        vertices[0] = position[:2]
        if len(vertices) == 1:
            vertices = np.concatenate((vertices, (goal if path.complete else position)[None, :2]))
        return vertices


def _up_to_unconfirmed(path: GridPath, view: MapView, inflation: float) -> GridPath:
    """The part of a path up to the stand-off before the first obstacle that may not be there.

    That is the first cell nearer to an occupied one than the inflation (m), after the path has left such cells. The
    part holds the start at least, and ends right before that cell if there is no room for the stand-off.
    """
    near = view.to_occupied[path.cells[:, 0], path.cells[:, 1]]
    outside = np.flatnonzero(near >= inflation)
    first = int(outside[0]) if len(outside) else len(near)
    unconfirmed = first + np.flatnonzero(near[first:] < inflation)
    if not len(unconfirmed):
        return path
    with_standoff = np.flatnonzero(near[: unconfirmed[0]] >= inflation + _STANDOFF)
    end = int(with_standoff[-1]) + 1 if len(with_standoff) else max(int(unconfirmed[0]), 1)
    return replace(path, cells=path.cells[:end], costs=path.costs[:end], complete=False)
