"""The trail on which the vehicle came, to fly back along it, and whether it still comes nearer to its goal."""

import math

from protocol.arrays import Array

_SPACING = 5.0
"""m between two places of the trail. A place nearer than that to an older one closes a loop, which is left out."""
_PROGRESS = 1.0
"""m by which the vehicle must come nearer to the goal than ever before."""


class Trail:
    """Places (3,) m, NED, along the path flown, without its loops."""

    def __init__(self) -> None:
        self._places: list[Array] = []

    def add(self, place: Array) -> None:
        """The vehicle is at a place (3,) m, NED, on the way to a goal of the route."""
        for index, old in enumerate(self._places):
            if math.dist(place.tolist(), old.tolist()) < _SPACING:
                del self._places[index + 1 :]
                return
        self._places.append(place)

    def back(self) -> list[Array]:
        """The places, the latest first."""
        return self._places[::-1]


class Progress:
    """Progress towards one goal after the other."""

    def __init__(self) -> None:
        self._goal: int | None = None
        self._nearest = math.inf
        self._since_ns = 0

    def stalled_s(self, goal: int, distance: float, now_ns: int) -> float:
        """Time (s) without progress towards the goal of that number, which is `distance` (m) away."""
        if goal != self._goal or distance < self._nearest - _PROGRESS:
            self._goal, self._nearest, self._since_ns = goal, distance, now_ns
        return (now_ns - self._since_ns) * 1e-9
