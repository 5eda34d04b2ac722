"""The methods on the map, "astar" and "vfh", and what the guard looks at: ring -> tracks -> grid -> view -> way."""

import math
from typing import Any

import msgspec
import numpy as np

from companion.avoidance.astar import AStar, AStarSettings
from companion.avoidance.course import NO_WAY, Way
from companion.avoidance.grid import GridSettings, MapView, OccupancyGrid
from companion.avoidance.guard import Guard, GuardSettings
from companion.avoidance.shortcut import corner_speeds, line_cost, shorten
from companion.avoidance.tracks import Tracker, TrackSettings
from companion.avoidance.vfh import Vfh, VfhSettings
from companion.config import Avoidance
from companion.state import Scan
from protocol.frames import Array

_HULL_M = 0.6
"""From an occupied cell's centre to where a corner may be cut."""
_LEAST_ROOM, _MOST_ROOM = 0.15, 1.5
_UNKNOWN_ROOM = 0.5
"""m of room at a corner, beyond the window."""
_AROUND_MOVING = 0.3
"""m around what moves that its passing leaves unknown."""


def _values(table: msgspec.Struct, *names: str) -> dict[str, Any]:
    return {name: getattr(table, name) for name in names or table.__struct_fields__}


class Surroundings:
    """The map and what moves on it, and the guard that looks at both."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._grid = OccupancyGrid(GridSettings(**_values(settings.map), hull=settings.vehicle_radius))
        self._tracker = Tracker(TrackSettings(**_values(settings.tracks)))
        self.guard = Guard(GuardSettings(**_values(settings.guard, *GuardSettings.__dataclass_fields__)))
        self.view: MapView | None = None
        """As of the last ring."""

    def look(self, scan: Scan, pose: tuple[Array, Array], ground_down: float, here: Array, now_ns: int) -> MapView:
        """Take a ring in, with the pose of its own time; `here` (3,) is where the vehicle is now."""
        moving = self._tracker.add(scan, *pose, ground_down)
        self._grid.add(scan, *pose, ground_down, moving)
        for track in self._tracker.moving:
            self._grid.forget(track.mean[:2], track.radius + _AROUND_MOVING, now_ns)
        self.view = view = self._grid.view(now_ns)
        self.guard.look(view, here, now_ns, self._tracker.points(0.0, self._settings.guard.keep_out_moving))
        return view

    def clearance(self, here: Array) -> float:
        """m from the hull at a place to the nearest occupied cell's centre; inf if there is none."""
        view = self.view
        if view is None or not view.contains(view.cell_of(here)):
            return math.inf
        distance = float(view.to_occupied[view.cell_of(here)])
        return distance - self._settings.vehicle_radius if distance <= view.cell * len(view.states) else math.inf


class Planner:
    """A way at each view: A* with its corners and their speeds, else the direction that VFH+ chooses."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._astar = AStar(AStarSettings(**_values(settings.plan)), settings.map.cells)
        self._vfh = Vfh(VfhSettings(**_values(settings.vfh)))

    def way(self, view: MapView, here: Array, velocity: Array, goal: Array, speed: float) -> Way:
        """From a place (3,) with a velocity (3,) NED to a goal (3,), at most at `speed` (m/s)."""
        way = self._planned(view, here, goal, speed) if self._settings.method == "astar" else None
        if way is not None:
            return way
        bearing = self._vfh.choose(view, here, velocity, goal)
        return NO_WAY if bearing is None else Way(NO_WAY.corners, NO_WAY.speeds, bearing)

    def blocked(self, view: MapView, here: Array, goal: Array) -> bool:
        """The straight line to the goal comes too near to something."""
        inflation = self._settings.plan.inflation
        start, end = (place[:2] / view.cell - np.array(view.corner) - 0.5 for place in (here, goal))
        flat = np.ones_like(view.to_occupied)
        return line_cost(flat, view.to_occupied, inflation, view.cell, start[0], start[1], end) == math.inf

    def _planned(self, view: MapView, here: Array, goal: Array, speed: float) -> Way | None:
        prices = self._astar.prices(view)
        path = self._astar.plan(view, prices, here, goal)
        if path is None:
            return None
        inflation = self._settings.plan.inflation
        corners = shorten(path, view, prices, inflation)
        last = view.cell_of(goal)
        if not view.contains(last):
            corners = np.vstack([corners, goal[:2]])
        elif view.to_occupied[last] >= inflation:
            corners[-1] = goal[:2]
        corners[0] = here[:2]
        if len(corners) == 1:
            corners = np.vstack([corners, goal[:2]])
        room = np.array([_room(view, corner) for corner in corners])
        course = self._settings.course
        return Way(corners, corner_speeds(corners, room, speed, course.acceleration, course.braking))


def _room(view: MapView, place: Array) -> float:
    """m within which a corner may be cut."""
    cell = view.cell_of(place)
    if not view.contains(cell):
        return _UNKNOWN_ROOM
    return float(min(max(view.to_occupied[cell] - _HULL_M, _LEAST_ROOM), _MOST_ROOM))
