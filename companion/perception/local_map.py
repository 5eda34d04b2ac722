"""What is known of the surroundings: scans -> tracks and map -> free space and clearance."""

import math
from dataclasses import replace

import numpy as np

from companion.config_avoidance import Avoidance
from companion.perception.distance_field import FAR_M
from companion.perception.fence_band import Flat, with_fence
from companion.perception.free_space import Empty, FreeSpace, empty_here, free_space
from companion.perception.map_view import MapView
from companion.perception.rolling_map import RollingMap
from companion.perception.tracks import Tracker
from companion.state import EVERY_HEIGHT, Scan
from protocol.arrays import Array

_MOVING_MARGIN_M = 0.3
"""m around a moving obstacle in which occupied cells are taken to be its own."""


class LocalMap:
    """The map of what stands and the tracks of what moves."""

    def __init__(self, settings: Avoidance, empty: Empty = empty_here) -> None:
        """`empty` allocates the arrays of the free space."""
        self._settings = settings
        self._empty = empty
        self._map = RollingMap(settings.map, settings.vehicle_radius)
        self._tracker = Tracker(settings.tracks)
        self._moved: set[int] = set()
        """Numbers of the tracks that moved at the last scan."""
        self.margin = 0.0
        """m by which obstacles are taken for larger than they are seen, in views and free space."""
        self.view: MapView | None = None
        """As of the last `look`."""

    def add(
        self,
        scan: Scan,
        pose: tuple[Array, Array],
        ground_down: float,
        now_ns: int,
        in_the_way: tuple[float, float] = EVERY_HEIGHT,
    ) -> None:
        """Add a scan with the pose of its own time: position (3,) NED (m) and attitude (4,) NED to FRD.

        `ground_down` is the NED height (m) below which a return is the ground, which may rise with the settings' slope.
        `in_the_way`: m above and below the vehicle up to which returns count for the map.
        """
        self._map.in_the_way = in_the_way
        slope = self._settings.ground_slope
        moving = self._tracker.add(scan, *pose, ground_down, slope)
        self._map.add(scan, *pose, ground_down, moving, slope)
        for track in self._tracker.moving:
            here, radius = track["mean"][:2], float(track["radius"])
            if track["number"] not in self._moved:  # the way that it came while it seemed to stand
                self._forget_way(track["start"], here, radius, now_ns)
            self._map.forget(here, radius, radius + _MOVING_MARGIN_M, now_ns)
        self._moved = set(self._tracker.moving["number"].tolist())

    def _forget_way(self, start: Array, end: Array, radius: float, now_ns: int) -> None:
        """Forget the occupied cells along a straight way between two places (2,) NED (m)."""
        steps = math.ceil(math.dist(start, end) / radius)
        for share in np.linspace(0.0, 1.0, steps + 1).tolist():
            self._map.forget(start + share * (end - start), 0.0, radius + _MOVING_MARGIN_M, now_ns)

    def look(self, now_ns: int, fence: Flat | None = None) -> MapView:
        """The map at a time, with the fence in it if there is one."""
        moving = self._tracker.points(0.0, self._settings.guard.keep_out_moving + self.margin)
        view = replace(self._map.view(now_ns, self.margin), moving=moving if len(moving) else None)
        self.view = view = view if fence is None else with_fence(view, fence, self._settings.plan)
        return view

    def look_far(self, now_ns: int, fence: Flat | None = None) -> MapView:
        """All that is remembered, in coarse cells, at a time; the last `look` stays what it is."""
        view = self._map.whole(now_ns, self.margin)
        return view if fence is None else with_fence(view, fence, self._settings.plan)

    def free_space(self, here: Array, now_ns: int, *, tight: bool = False) -> FreeSpace:
        """Free space of the last `look` around a place (3,) NED (m), for the guard."""
        assert self.view is not None
        guard = self._settings.guard
        moving, margin = self.view.moving, self.margin
        return free_space(self.view, here, now_ns, guard, moving, tight=tight, margin=margin, empty=self._empty)

    def clearance(self, here: Array) -> float:
        """m from the hull at a place (3,) NED (m) to the nearest obstacle as it is seen; inf if that is FAR_M away or
        more."""
        view = self.view
        distance = None if view is None else view.distance_at(here)
        if view is None or distance is None or distance >= np.float32(FAR_M) - np.float32(view.margin):
            return math.inf
        return distance + view.margin - self._settings.vehicle_radius
