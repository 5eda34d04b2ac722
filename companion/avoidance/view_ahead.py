"""How far a level scanner sees the way ahead on a vehicle that leans: where its beams meet the ground, sight ends.

What stands was seen before, or is unknown and not flown into. But what moves can have come into what was seen free.
The lean against drag and wind counts. The lean of an acceleration passes: a vehicle that is slowed down for it takes
longer to reach its speed, and leans until then.
"""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import down_axis
from protocol.vehicle_parameters import GRAVITY


class ViewAhead:
    """Followed from ring to ring."""

    def __init__(self, seconds: float) -> None:
        """`seconds`: `avoidance.guard.sight_s`."""
        self._seconds = seconds
        self._fall = np.zeros(2)
        """By how much the scan's plane falls to the north and to the east, m/m, over these seconds, but for what
        accelerates the vehicle."""
        self._velocity = np.zeros(2)
        self._above = math.inf
        self._looked_ns: int | None = None

    def look(self, attitude_ned_frd: Array, velocity: Array, above: float, now_ns: int) -> None:
        """A ring was taken at an attitude (4,) and a velocity (2,) (m/s, north and east), so high (m) above what counts
        as the ground."""
        elapsed = 0.0 if self._looked_ns is None else (now_ns - self._looked_ns) * 1e-9
        north, east, down = down_axis(attitude_ned_frd)
        if elapsed > 0.0 and down > 0.0 and self._seconds > 0.0:
            gained = (velocity - self._velocity) / (GRAVITY * elapsed)
            fall = np.array((-north / down, -east / down)) - gained
            self._fall += min(elapsed / self._seconds, 1.0) * (fall - self._fall)
        self._looked_ns, self._above, self._velocity = now_ns, above, velocity.copy()

    def distance(self, way: Array) -> float:
        """m that are seen in the direction of a way (2,)."""
        length = math.hypot(way[0], way[1])
        fall = float(self._fall @ way) / length if length > 0.0 else 0.0
        return max(self._above, 0.0) / fall if fall > 0.0 else math.inf
