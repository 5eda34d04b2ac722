"""How far a vehicle wanders about its reference: what its estimator's noise leaves, and wind.

A vehicle that wanders 0.2 m can't be told to be within 0.1 m of a place. Whether it has arrived is judged against what
was seen of it over the last seconds. What lifts off is still finding its thrust: that is no wander.
"""

import math

from protocol.arrays import Array

_SHARE = 1.0 / 1000.0
"""Weight of a control step in the mean squares: a window of 4 s at 250 Hz."""
_LIFTING_OFF = 750
"""Control steps in the air that do not count yet: 3 s at 250 Hz."""
_SIGMAS = 2.5
_MOST = 5.0
"""A bound grows to so many times itself, at most."""


class Wander:
    """Mean squares of the errors."""

    def __init__(self) -> None:
        self._position = 0.0
        """m2."""
        self._rate = 0.0
        """m2/s2."""
        self._left = _LIFTING_OFF

    def add(self, errors: Array) -> None:
        """The errors (6,) of a step in the air: of the position (m), and of the virtual rate (m/s)."""
        if self._left:
            self._left -= 1
            return
        x, y, z, u, v, w = errors.tolist()
        self._position += _SHARE * (x * x + y * y + z * z - self._position)
        self._rate += _SHARE * (u * u + v * v + w * w - self._rate)

    def distance(self, settled: float) -> float:
        """m; within this a vehicle has arrived that should come within `settled`."""
        return max(settled, min(_SIGMAS * math.sqrt(self._position), _MOST * settled))

    def speed(self, settled: float) -> float:
        """m/s; the same for the speed."""
        return max(settled, min(_SIGMAS * math.sqrt(self._rate), _MOST * settled))
