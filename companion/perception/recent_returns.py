"""The returns of the last scans: a tilted scan looks over and under obstacles that the scans before it saw."""

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled

_CAPACITY = 2048


class RecentReturns:
    """Returns of the last `lifetime_s`, thinned out so that no two are nearer to each other than `spacing` (m)."""

    def __init__(self, lifetime_s: float, spacing: float) -> None:
        self._lifetime_s = lifetime_s
        self._spacing = spacing
        self._points = np.empty((_CAPACITY, 3))
        self._seen_s = np.empty(_CAPACITY)
        self._count = 0

    def add(self, points_ned: Array, time_ns: int) -> Array:
        """Add the returns (n, 3) NED (m) of a scan; the result (k, 3) are all recent ones, in no order.

        When the capacity is used up the newest returns are dropped.
        """
        now_s = time_ns * 1e-9
        self._count = _merge(
            self._points, self._seen_s, self._count, points_ned, now_s, now_s - self._lifetime_s, self._spacing
        )
        return self._points[: self._count].copy()


@compiled
def _merge(points: Array, seen_s: Array, count: int, new: Array, now_s: float, oldest_s: float, spacing: float) -> int:
    """Drop the old returns; put each new one in place of a neighbour or at the end. Returns the new count."""
    kept = 0
    for i in range(count):
        if seen_s[i] >= oldest_s:
            points[kept] = points[i]
            seen_s[kept] = seen_s[i]
            kept += 1
    for j in range(new.shape[0]):
        place = kept
        for i in range(kept):
            north = points[i, 0] - new[j, 0]
            east = points[i, 1] - new[j, 1]
            down = points[i, 2] - new[j, 2]
            if north * north + east * east + down * down < spacing * spacing:
                place = i
                break
        if place == points.shape[0]:
            break
        points[place] = new[j]
        seen_s[place] = now_s
        kept = max(kept, place + 1)
    return kept
