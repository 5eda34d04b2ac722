"""How far a level scanner sees the way ahead on a vehicle that leans: where its beams meet the ground, sight ends.

What stands was seen before, or is unknown and not flown into. But what moves can have come into what was seen free.
"""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import down_axis


class ViewAhead:
    """Followed from ring to ring."""

    def __init__(self, seconds: float) -> None:
        """`seconds`: `avoidance.guard.sight_s`."""
        self._seconds = seconds
        self._fall = np.zeros(2)
        """By how much the scan's plane falls to the north and to the east, m/m, over these seconds."""
        self._above = math.inf
        self._looked_ns: int | None = None

    def look(self, attitude_ned_frd: Array, above: float, now_ns: int) -> None:
        """A ring was taken at an attitude (4,), so high (m) above what counts as the ground."""
        elapsed = 0.0 if self._looked_ns is None else (now_ns - self._looked_ns) * 1e-9
        self._looked_ns, self._above = now_ns, above
        north, east, down = down_axis(attitude_ned_frd)
        if down > 0.0 and self._seconds > 0.0:
            falls = np.array((-north / down, -east / down))
            self._fall += min(elapsed / self._seconds, 1.0) * (falls - self._fall)

    def distance(self, way: Array) -> float:
        """m that are seen in the direction of a way (2,)."""
        length = math.hypot(way[0], way[1])
        fall = float(self._fall @ way) / length if length > 0.0 else 0.0
        return max(self._above, 0.0) / fall if fall > 0.0 else math.inf
