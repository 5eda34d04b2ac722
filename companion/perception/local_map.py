"""What is known of the surroundings: scans -> tracks and map -> free space and clearance."""

import math

from companion.config import Avoidance, picked
from companion.perception.free_space import Empty, FreeSpace, empty_here, free_space
from companion.perception.rolling_map import FAR_M, GridSettings, MapView, OccupancyGrid
from companion.perception.tracks import Tracker, TrackSettings
from companion.state import Scan
from protocol.arrays import Array

_AROUND_MOVING = 0.3
"""m around what moves in which nothing else is held to stand."""


class LocalMap:
    """The map and what moves on it."""

    def __init__(self, settings: Avoidance, empty: Empty = empty_here) -> None:
        self._settings = settings
        self._guard = settings.guard
        self._empty = empty
        self._grid = OccupancyGrid(picked(GridSettings, settings.map, hull=settings.vehicle_radius))
        self._tracker = Tracker(picked(TrackSettings, settings.tracks))
        self.view: MapView | None = None
        """At the last look."""

    def add(self, scan: Scan, pose: tuple[Array, Array], ground_down: float, now_ns: int) -> None:
        """Take a ring in, with the pose (3,), (4,) of its own time."""
        moving = self._tracker.add(scan, *pose, ground_down)
        self._grid.add(scan, *pose, ground_down, moving)
        for track in self._tracker.moving:
            self._grid.forget(track["mean"][:2], track["radius"], track["radius"] + _AROUND_MOVING, now_ns)

    def look(self, now_ns: int) -> MapView:
        """At the map as it is now."""
        self.view = view = self._grid.view(now_ns)
        return view

    def free_space(self, here: Array, now_ns: int, *, tight: bool = False) -> FreeSpace:
        """For the guard, after a `look`."""
        assert self.view is not None
        moving = self._tracker.points(0.0, self._settings.guard.keep_out_moving)
        return free_space(self.view, here, now_ns, self._guard, moving, tight=tight, empty=self._empty)

    def clearance(self, here: Array) -> float:
        """m from the hull at a place to the nearest occupied cell's centre; inf if that is FAR_M away or more."""
        view = self.view
        if view is None or not view.contains(view.cell_of(here)):
            return math.inf
        distance = float(view.to_occupied[view.cell_of(here)])
        return distance - self._settings.vehicle_radius if distance < FAR_M else math.inf
