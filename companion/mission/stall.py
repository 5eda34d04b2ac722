"""Where the vehicle has come along, to go back there, and whether it still gets nearer to where it wants to be."""

import math

from protocol.arrays import Array

_SPACING = 5.0
"""m between two places of the trail; a place nearer than that to an older one closes a loop, which is left out."""
_PROGRESS = 1.0
"""m nearer to the goal than ever before."""


class Trail:
    """Places (3,) NED on the way flown, without its loops."""

    def __init__(self) -> None:
        self._places: list[Array] = []

    def add(self, place: Array) -> None:
        """The vehicle is there, while it flies to a goal of the route."""
        for index, old in enumerate(self._places):
            if math.dist(place.tolist(), old.tolist()) < _SPACING:
                del self._places[index + 1 :]
                return
        self._places.append(place)

    def back(self) -> list[Array]:
        """The latest first."""
        return self._places[::-1]


class Progress:
    """Towards one goal after the other."""

    def __init__(self) -> None:
        self._goal: int | None = None
        self._nearest = math.inf
        self._since_ns = 0

    def lacking_s(self, goal: int, distance: float, now_ns: int) -> float:
        """How long (s) there has been none towards the goal of that number, `distance` (m) away."""
        if goal != self._goal or distance < self._nearest - _PROGRESS:
            self._goal, self._nearest, self._since_ns = goal, distance, now_ns
        return (now_ns - self._since_ns) * 1e-9
