"""The trail on which the vehicle came, to fly back along it, and whether it still comes nearer to its goal."""

import math
from collections import defaultdict
from itertools import product

import numpy as np

from companion.config import Trajectory
from companion.mission.step_time import way_s
from protocol.arrays import Array

_SPACING = 5.0
"""m between two places of the trail. A place nearer than that to an older one closes a loop, which is left out."""
_STEP = 0.5
"""m between two looks at it."""
_WAITING = 0.5
"""m/s: what is slower than that waits, which the way back need not."""
_AT_FIRST = 5.0
"""s for which the vehicle counts as fast as it was asked to be: what it takes to set off tells little."""
_ASIDE = 1.0
"""m that a place may lie beside a straight stretch of the way back."""
_PROGRESS = 1.0
"""m by which the vehicle must come nearer to the goal than ever before."""
_SQUARE = 2.0
"""m, side of the squares of the plane, of which a new one counts."""


class Trail:
    """Places (3,) m, NED, along the path flown, without its loops; how slowly that was flown, and how long the way back
    takes."""

    def __init__(self, speed: float, limits: Trajectory) -> None:
        """`speed`: m/s of the way back."""
        self._speed, self._limits = speed, limits
        self._places: list[Array] = []
        self._seconds: list[float] = []
        """s back along the places from each to the first."""
        self._cubes: defaultdict[tuple[int, ...], list[int]] = defaultdict(list)
        """The numbers of the places in each cube of `_SPACING`, in their order."""
        self._seen: list[float] | None = None
        """The place that was looked at last."""
        self._seen_ns = 0
        self._took_s = self._least_s = _AT_FIRST
        """s that the way flown took but for waiting, less where it was asked to be slower than the way back; and that
        it takes at the speed of that."""

    def add(self, place: Array, speed: float, now_ns: int) -> None:
        """The vehicle is at a place (3,) m, NED, on the way to a goal of the route, asked to be so fast (m/s)."""
        here: list[float] = place.tolist()
        if self._seen is not None:
            moved = math.dist(here, self._seen)
            if moved < _STEP:
                return
            if moved < _SPACING:  # others did not fly meanwhile
                took_s = min(1e-9 * (now_ns - self._seen_ns), moved / _WAITING)
                way = place - np.array(self._seen)
                least_s, asked_s = (way_s(way, each, self._limits) for each in (self._speed, speed))
                self._took_s += took_s * min(least_s / asked_s, 1.0)
                self._least_s += least_s
        self._seen, self._seen_ns = here, now_ns
        around = product(*((at - 1, at, at + 1) for at in _cube(here)))
        near = (k for cube in around for k in self._cubes.get(cube, ()))
        first = min((k for k in near if math.dist(here, self._places[k].tolist()) < _SPACING), default=None)
        if first is None:
            self._seconds.append(self._seconds[-1] + self._way_s(place, self._places[-1]) if self._places else 0.0)
            self._cubes[_cube(here)].append(len(self._places))
            self._places.append(place)
        else:  # a loop ends
            for left_out in self._places[first + 1 :]:
                self._cubes[_cube(left_out.tolist())].pop()
            del self._places[first + 1 :], self._seconds[first + 1 :]

    def back_s(self, here: Array, home: Array) -> float:
        """s from a place back along the trail and on to `home`, both (3,) m, NED."""
        if not self._places:
            return self._way_s(here, home)
        return self._way_s(here, self._places[-1]) + self._seconds[-1] + self._way_s(self._places[0], home)

    def _way_s(self, start: Array, end: Array) -> float:
        return way_s(end - start, self._speed, self._limits)

    @property
    def slowness(self) -> float:
        """By how much longer the way flown took than it takes at the speed of the way back; at least 1."""
        return max(self._took_s / self._least_s, 1.0)

    def corners(self, here: Array, home: Array) -> list[Array]:
        """The places at which the way back from `here` along the trail to `home` turns, in that order."""
        return _corners(np.array([here, *self.back(), home]))

    def back(self) -> list[Array]:
        """The places, the latest first."""
        return self._places[::-1]


def _cube(place: list[float]) -> tuple[int, ...]:
    return tuple(math.floor(at / _SPACING) for at in place)


def _corners(way: Array) -> list[Array]:
    """The places between the ends of a way (n, 3) that it must keep so that it moves by `_ASIDE` at most (the
    algorithm of Douglas and Peucker)."""
    along = way[-1] - way[0]
    shares = np.clip((way - way[0]) @ along / max(float(along @ along), 1e-9), 0.0, 1.0)
    aside = np.linalg.norm(way - way[0] - shares[:, None] * along, axis=1)
    farthest = int(aside.argmax())
    if aside[farthest] <= _ASIDE:
        return []
    return [*_corners(way[: farthest + 1]), way[farthest], *_corners(way[farthest:])]


class Progress:
    """Progress towards one goal after the other: the vehicle comes nearer to it, or to where it has not been."""

    def __init__(self) -> None:
        self._goal: int | None = None
        self._nearest = math.inf
        self._visited: set[tuple[int, int]] = set()
        """Squares of `_SQUARE`."""
        self._since_ns = 0

    def stalled_s(self, goal: int, distance: float, here: Array, now_ns: int) -> float:
        """Time (s) without progress towards the goal of that number, which is `distance` (m) away from `here` (2,) or
        (3,) (m, NED)."""
        square = math.floor(here[0] / _SQUARE), math.floor(here[1] / _SQUARE)
        if goal != self._goal:
            self._goal, self._nearest = goal, math.inf
            self._visited.clear()
        if distance < self._nearest - _PROGRESS or square not in self._visited:
            self._nearest, self._since_ns = min(distance, self._nearest), now_ns
            self._visited.add(square)
        return (now_ns - self._since_ns) * 1e-9

    def explored(self, goal: int) -> float:
        """m of new ground, to the size of the squares, that the vehicle has flown over towards the goal of that number;
        0 where its progress was not looked at."""
        return _SQUARE * len(self._visited) if goal == self._goal else 0.0
