"""A vehicle that leaves its reference for good: a law that runs away, a wind that is too strong, a rotor that fails."""

import math

from protocol.arrays import Array

_JUMP = 1.0
"""m by which the distance changes from one control step to the next only as reference or estimate jump."""


class Straying:
    """The distance of a vehicle from its reference, and whether it goes on away from it."""

    def __init__(self, distance: float) -> None:
        """Up to `distance` (m) from its reference, a vehicle does not stray, nor beyond while it has gone away by no
        more than that since it was nearest: a step of the reference, or a steady error in wind."""
        self._distance = distance
        self._before = 0.0
        self._nearest = math.inf
        """m; the least distance since it was beyond."""
        self.strayed = 0.0
        """m from the reference, as it strays; 0: it does not."""

    def look(self, error: Array | None) -> None:
        """The error (3,) from the reference (m) at a control step; None: others fly, or it stands."""
        away = 0.0 if error is None else math.hypot(*error.tolist())
        jumps, self._before = abs(away - self._before) > _JUMP, away
        if away <= self._distance or jumps:
            self._nearest = math.inf
        if away > self._distance:
            self._nearest = min(self._nearest, away)
        self.strayed = away if away > self._nearest + self._distance else 0.0
