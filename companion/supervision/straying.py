"""A vehicle that does not keep up with its reference, which waits for it; and one that leaves it for good: a law that
runs away, a wind that is too strong, a rotor that fails."""

import math

from companion.state import Announcement, Severity
from protocol.arrays import Array

_JUMP = 1.0
"""m by which the distance changes from one control step to the next only as reference or estimate jump."""
_WAITS_NS = 2_000_000_000
"""So long in a row the reference must wait for that to be said: a gust is over sooner."""


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
        self._keeps_up_ns: int | None = None
        """When it kept up last."""
        self._said = False

    def look(self, error: Array | None) -> float:
        """The error (3,) from the reference (m) at a control step; None: others fly, or it stands. Its length."""
        away = 0.0 if error is None else math.hypot(*error.tolist())
        jumps, self._before = abs(away - self._before) > _JUMP, away
        if away <= self._distance or jumps:
            self._nearest = math.inf
        if away > self._distance:
            self._nearest = min(self._nearest, away)
        self.strayed = away if away > self._nearest + self._distance else 0.0
        return away

    def news(self, share: float, now_ns: int) -> Announcement | None:
        """That the reference waits, once: it goes on with this share of its speed."""
        if share == 1.0 or self._keeps_up_ns is None:
            self._keeps_up_ns = now_ns
        if self._said or now_ns - self._keeps_up_ns < _WAITS_NS:
            return None
        self._said = True
        return Announcement(Severity.WARNING, "the vehicle does not keep up: it is flown slower than asked for")
