"""A planner that goes straight, or around the first obstacle by one corner."""

import math
from itertools import pairwise

import numpy as np

from companion.avoidance.path import Path
from companion.avoidance.shortcut import timed_path
from companion.config_avoidance import Avoidance
from companion.perception.map_view import MapView
from protocol.arrays import Array

ANGLES = np.radians([15, -15, 30, -30, 45, -45, 60, -60])


class Detour:
    """The shortest of the paths with at most one corner that keep `room` (m) from everything seen."""

    def __init__(self, settings: Avoidance, room: float = 1.0, reach: float = 6.0) -> None:
        self.course, self.room, self.reach = settings.course, room, reach

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        here, end = position[:2], goal[:2]
        bearing = math.atan2(end[1] - here[1], end[0] - here[0])
        corners = [here + self.reach * np.array([math.cos(turn), math.sin(turn)]) for turn in bearing + ANGLES]
        paths = [np.array([here, end]), *(np.array([here, corner, end]) for corner in corners)]
        for path in sorted(paths, key=lambda path: float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())):
            if all(self.is_free(view, *leg) for leg in pairwise(path)):
                return timed_path(path, view, speed, self.course, 0.0)
        return None

    def is_free(self, view: MapView, start: Array, end: Array) -> bool:
        """Whether a line keeps the room. Beyond the map nothing is known, and all counts as free."""
        count = max(int(np.linalg.norm(end - start) / view.cell), 1)
        rooms = [view.distance_at(start + (end - start) * k / count) for k in range(count + 1)]
        return all(room is None or room >= self.room for room in rooms)
