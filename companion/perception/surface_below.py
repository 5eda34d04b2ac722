"""Where the nearest thing straight below the vehicle is, by a range finder that looks down."""

import math

from companion.reports import RangeBelow
from companion.state import Pose

_STALE_NS = 500_000_000
_UPRIGHT = 0.9
"""Cosine of the tilt beyond which the beam meets something beside the vehicle."""
_ALIKE_M = 0.3
"""Two readings that differ by less are of the same thing."""
_ABOVE_M = 1.0
"""Height from which on a reading of the ground shows that the beam meets nothing of the vehicle."""


class SurfaceBelow:
    """Believed once it has shown the ground from above: a beam that meets a parcel or a leg never does."""

    def __init__(self) -> None:
        self.lowest = math.nan
        """m, NED: what is lower is the ground; not a number before a flight."""
        self._proven = False
        self._last_down = math.inf
        self._down = math.inf
        """m, NED, as two readings one after another say."""
        self._read_ns = 0

    def begin(self) -> None:
        """A flight begins."""
        self.__init__()  # type: ignore[misc]

    def take(self, report: RangeBelow, pose: Pose | None, now_ns: int) -> None:
        """Take a reading in, with the pose of its time."""
        if pose is None:
            return
        position, attitude = pose
        _, x, y, _ = attitude.tolist()
        upright = 1.0 - 2.0 * (x * x + y * y)
        if upright < _UPRIGHT:
            return
        here, before = float(position[2]), self._last_down
        self._last_down = down = here + report.distance_m * upright
        if self.lowest < down < math.inf and self.lowest - here > _ABOVE_M:
            self._proven = True
        alike = down == before or abs(down - before) < _ALIKE_M
        self._down, self._read_ns = (max(down, before) if alike else math.inf), now_ns

    def standing(self, now_ns: int) -> float | None:
        """Height (m, NED) of what stands below the vehicle, higher than the ground; None: nothing is known of any."""
        known = self._proven and now_ns - self._read_ns <= _STALE_NS
        return self._down if known and self._down <= self.lowest else None
