"""How much larger obstacles are taken for, since the vehicle is not quite where it believes to be.

The map is made of rings that were seen one after the other, each from where the vehicle believed to be. An error of the
estimated velocity moves the vehicle against what it saw, and along tight ways it has a hand's breadth to spare. So the
vehicle keeps away by that error, as the vehicle says it, times how long it counts; what is too narrow then it does not
enter.
"""

import math

from companion.state import Announcement, Severity
from protocol.arrays import Array

_MOST_M = 0.3
_ROOM_FOR = 0.03
"""m/s, standard deviation: an error that tight ways have room for as they are."""
_SHARE = 1 / 64
"""Weight of the latest ring: over some seconds, so that a way is not free at one ring and closed at the next."""
_TELLING_M = 0.05
"""A margin that is told: it closes ways that the vehicle is narrow enough for."""
_TOLD_AGAIN = 1.5
"""Growth after which it is told once more: on the ground the vehicle may be more certain than in the air."""


class DriftMargin:
    """The margin, followed from ring to ring."""

    def __init__(self, seconds: float) -> None:
        """`seconds`: `avoidance.velocity_error_s`."""
        self._seconds = seconds
        self._margin: float | None = None
        self._told = 0.0

    def follow(self, velocity_variance: Array) -> float:
        """The margin (m) at a ring, by the variances (3,) of the vehicle's velocity, m2/s2, NED."""
        beyond = max(math.sqrt(float(velocity_variance[:2].max())) - _ROOM_FOR, 0.0)
        now = min(self._seconds * beyond, _MOST_M)
        before = now if self._margin is None else self._margin
        self._margin = before + _SHARE * (now - before)
        return self._margin

    def news(self) -> Announcement | None:
        """That it is large, and each time that it has grown by much."""
        margin = self._margin or 0.0
        if margin < max(_TELLING_M, _TOLD_AGAIN * self._told):
            return None
        self._told = margin
        text = f"the vehicle's velocity is uncertain: obstacles are taken for {margin:.2f} m larger"
        return Announcement(Severity.INFO, text)
