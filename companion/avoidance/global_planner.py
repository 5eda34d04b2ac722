"""The way around what is larger than the map's window, by all that is remembered.

Within the window a planner takes what lies beyond it for open. So the far side of a large enclosure looks open again
from each place from which its near side is seen closed, and the vehicle goes to and fro.
"""

import math
from collections.abc import Callable

import numpy as np

from companion.avoidance.astar import AStar
from companion.avoidance.astar_planner import fill_along
from companion.config_avoidance import Avoidance
from companion.perception.map_view import MapView
from companion.perception.rolling_map import coarse_cells
from protocol.arrays import Array

EACH = 15
"""Scans between two searches."""
_BACK = 0.25
"""How much farther from the goal than ever before the vehicle is once the window does not suffice, as a share of half
of the window."""
_AHEAD, _RENEWED = 0.75, 0.5
"""The same share of the distance to the place on the way that is the planner's goal, and that below which the next
place is taken."""
_BESIDE_M = 2.0
"""m from the way of before; what is farther costs more. A place that is nearer stays the planner's goal, whose habits
begin anew with each one."""
_BESIDE_COST = 1.0
"""Share by which it costs more."""


class GlobalPlanner:
    """Gives the planner a goal on the way out, once the vehicle has had to go back by much of the window."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._reach = 0.5 * settings.map.cell * settings.map.cells
        self._search: AStar | None = None
        """Made when it is needed."""
        self._goal: Array | None = None
        """(3,) m, NED, of the flight."""
        self._nearest = math.inf
        """m to it, the least so far."""
        self._needed = False
        self._way = np.empty((0, 2))
        """(n, 2) m, NED"""
        self._place: Array | None = None
        """(3,) m, NED, on the way; None: the way is within the window, or there is none."""
        self._scans = 0
        self.detour = 0.0
        """m, the cost of the way beyond the least that was expected; 0 if there is none."""

    def local_goal(self, here: Array, goal: Array, look: Callable[[], MapView]) -> Array:
        """Where the planner is to lead to, from a place with the flight's goal, (3,) each, m, NED. `look` gives all
        that is remembered."""
        if self._goal is None or math.dist(self._goal[:2], goal[:2]) > self._settings.plan.proximity_radius:
            self._goal, self._nearest, self._needed = goal, math.inf, False
            self._way, self._place, self._scans, self.detour = np.empty((0, 2)), None, 0, 0.0
        away = math.dist(here[:2], goal[:2])
        self._nearest = min(self._nearest, away)
        self._needed = self._needed or away > self._nearest + _BACK * self._reach
        if not self._needed:
            return goal
        near = self._place is not None and math.dist(self._place[:2], here[:2]) < _RENEWED * self._reach
        if near or self._scans % EACH == 0:
            self._find_way(here, goal, look())
            self._place = self._next(here, goal)
        self._scans += 1
        return goal if self._place is None else self._place

    def _find_way(self, here: Array, goal: Array, view: MapView) -> None:
        if self._search is None:
            count, _ = coarse_cells(self._settings.map)
            self._search = AStar(self._settings.plan, count)
        costmap = self._search.costmap(view)
        if len(self._way):
            cells = np.floor(self._way / view.cell).astype(np.int64) - np.array(view.corner)
            beside = np.full(costmap.shape, 1.0 + _BESIDE_COST, np.float32)
            fill_along(beside, cells, math.ceil(_BESIDE_M / view.cell))
            costmap *= beside
        way = self._search.plan(view, costmap, here, goal, self._settings.plan.tight_inflation)
        self.detour = 0.0 if way is None else way.detour
        self._way = np.empty((0, 2)) if way is None else (way.cells + np.array(view.corner) + 0.5) * view.cell

    def _next(self, here: Array, goal: Array) -> Array | None:
        """The place on the way to lead to; None if the way is within the window, or there is none."""
        beyond = np.flatnonzero(np.abs(self._way - here[:2]).max(axis=1) > _AHEAD * self._reach)
        if not len(beyond):
            return None
        before = self._place
        if before is not None and math.dist(before[:2], here[:2]) > _RENEWED * self._reach:
            ahead = self._way[: beyond[0] + 1]
            if np.hypot(*(ahead - before[:2]).T).min() < _BESIDE_M:
                return before
        return np.array([*self._way[beyond[0]], goal[2]])
