"""What the rings have shown lately: a tilted ring looks over and under things that it saw a moment before."""

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled

_ROOM = 2048


class RecentReturns:
    """Returns (n, 3) NED of the last `lifetime_s`, thinned out so that no two are nearer than `grain` (m)."""

    def __init__(self, lifetime_s: float, grain: float) -> None:
        self._lifetime_s = lifetime_s
        self._grain = grain
        self._points = np.empty((_ROOM, 3))
        self._seen_s = np.empty(_ROOM)
        self._count = 0

    def add(self, points_ned: Array, time_ns: int) -> Array:
        """Take a scan in; all that is remembered, in no order. With no room left the newest are not kept."""
        now_s = time_ns * 1e-9
        self._count = _merge(
            self._points, self._seen_s, self._count, points_ned, now_s, now_s - self._lifetime_s, self._grain
        )
        return self._points[: self._count].copy()


@compiled
def _merge(points: Array, seen_s: Array, count: int, new: Array, now_s: float, oldest_s: float, grain: float) -> int:
    """Drop the old, put the new in place of their neighbours or behind them; the new count."""
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
            if north * north + east * east + down * down < grain * grain:
                place = i
                break
        if place == points.shape[0]:
            break
        points[place] = new[j]
        seen_s[place] = now_s
        kept = max(kept, place + 1)
    return kept
