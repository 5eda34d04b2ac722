"""The noise of a LiDAR's ranges, as it shows while the vehicle rests or hovers."""

import math
from collections import deque

import numpy as np

from protocol.arrays import Array, BoolArray

_STILL_M, _STILL = 0.01, 0.004
"""m in the plane, and rad, that the vehicle may have moved from one ring to the next."""
_FEWEST_BEAMS = 8
_FEWEST_RINGS, _MOST_RINGS = 5, 15
_MEDIAN_DIFFERENCE = 0.6745 * math.sqrt(2.0)
"""Median size of the difference of two values over the standard deviation of one, for normal noise."""


class RangeNoise:
    """The standard deviation, by what changes from ring to ring though the vehicle doesn't move."""

    def __init__(self) -> None:
        self.sigma_m = 0.0
        """0 until enough rings were seen at rest."""
        self._before: tuple[Array, BoolArray, Array, Array] | None = None
        self._sigmas: deque[float] = deque(maxlen=_MOST_RINGS)

    def take(self, ranges: Array, usable: BoolArray, position_ned: Array, attitude_ned_frd: Array) -> None:
        """Take a ring's ranges (n,) m with which of them are returns of more than the ground, and its pose, (3,) m and
        (4,)."""
        before = self._before
        # Copies: a ring's memory is used again (`runtime.mailbox`).
        self._before = ranges.copy(), usable, position_ned.copy(), attitude_ned_frd.copy()
        if before is None or before[0].size != ranges.size:
            return
        moved = math.dist(position_ned[:2].tolist(), before[2][:2].tolist())
        turned = 2.0 * math.acos(min(abs(float(attitude_ned_frd @ before[3])), 1.0))
        both = usable & before[1]
        if moved > _STILL_M or turned > _STILL or both.sum() < _FEWEST_BEAMS:
            return
        self._sigmas.append(_median(np.abs(ranges - before[0])[both]) / _MEDIAN_DIFFERENCE)
        if len(self._sigmas) >= _FEWEST_RINGS:
            self.sigma_m = _median(np.array(self._sigmas))


def _median(values: Array) -> float:
    """The upper one of two; numpy's takes three times as long."""
    return float(np.sort(values)[values.size // 2])
