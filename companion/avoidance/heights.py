"""The height of a leg, where the settings allow another than the route's: over what stands in the way, or under it.

The map is flat and knows nothing of other heights: what there is at one is seen from there alone. So they are tried in
their order, up first, each a step farther, while the vehicle stays where it is. One is left for the next where the way
over the map has cost more for a while than the step would, or where nothing has come nearer to the goal for too long.
After the last one the route's own is flown again, whatever it costs. A height that was taken is kept over the legs that
are flown through, up to a goal that is stopped at: there the vehicle comes back to the route's height.
"""

import math

from companion.config import AvoidanceHeights

_THERE = 0.3
"""m from a new height, from which on the vehicle goes on."""


class Heights:
    """Of one leg after the other."""

    def __init__(self, settings: AvoidanceHeights) -> None:
        self._settings = settings
        self.above = 0.0
        """m above the route's height, or below it: to be flown at."""
        self.changing = False
        """The vehicle is on its way there."""
        self._left: list[float] | None = None
        """Those that were not tried yet; None: it is not known which there are."""
        self._dear_since_ns: int | None = None

    def begin(self) -> None:
        """At the route's height, with all others to be tried."""
        self.above, self._left, self._dear_since_ns = 0.0, None, None
        self.changing = False

    def slowed(self, speed: float) -> float:
        """As fast as may be flown at the present height, at most `speed` (m/s)."""
        return speed if self.above == 0.0 else min(speed, self._settings.speed)

    def too_dear(self, detour: float, now_ns: int) -> bool:
        """Whether a way that costs so much (m) more than was to be expected has been all there was for a while."""
        settings = self._settings
        if self.changing or self._left == [] or detour <= settings.price * settings.step:
            self._dear_since_ns = None
            return False
        if self._dear_since_ns is None:
            self._dear_since_ns = now_ns
        return now_ns - self._dear_since_ns >= settings.patience * 1e9

    def next(self, room_below: float) -> bool:
        """Take the next height, the route's own after the last; whether there was one. `room_below` (m): from the
        route's height to the lowest that may be flown."""
        if self._left is None:
            up, down = (self._steps(most) for most in (self._settings.above, min(self._settings.below, room_below)))
            self._left = [*up, *(-height for height in down)]
            if self._left:
                self._left.append(0.0)
        if not self._left:
            return False
        self.above, self.changing, self._dear_since_ns = self._left.pop(0), True, None
        return True

    def arrived(self, lacking: float) -> None:
        """The vehicle is so far (m) from the height to be flown at."""
        if abs(lacking) < _THERE:
            self.changing = False

    def _steps(self, most: float) -> list[float]:
        step = self._settings.step
        return [step * (k + 1) for k in range(math.floor(most / step + 1e-9))]
