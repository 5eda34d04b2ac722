"""The ground below the vehicle, and how it goes on along the way, by a range finder that looks down."""

import math
from collections import deque

import numpy as np

from companion.reports import RangeBelow
from companion.state import Ground, Pose
from protocol.arrays import Array
from protocol.frames import down_axis

_STALE_NS = 1_000_000_000
_WINDOW_NS = 1_000_000_000
"""Over the readings of so long a plane is laid."""
_UPRIGHT = 0.7
"""Cosine of the tilt beyond which the beam says nothing of the ground here."""
_ABOVE_M = 1.0
"""A reading of so much shows that the beam meets nothing of the vehicle."""
_ALIKE_M = 0.4
"""Two readings that differ by less are of the same surface."""
_SPREAD_M = 0.5
"""How far the readings must lie apart for a slope to be believed; nearer ones are as if the ground were level."""
_AHEAD_S = 1.0


class GroundBelow:
    """Believed once it has shown the ground from above: a beam that meets a parcel or a leg never does."""

    def __init__(self) -> None:
        self._proven = False
        self._last_down = math.inf
        self._seen = deque[tuple[int, Array, Array]]()
        """When, what (3,) of the ground was met, and the vehicle's place (3,), m NED."""
        self._laid: tuple[int, Ground] | None = None
        """As of the last reading."""

    def take(self, report: RangeBelow, pose: Pose | None, now_ns: int) -> None:
        """Take a reading in, with the pose of its time."""
        if pose is None or not math.isfinite(report.distance_m):
            return
        place, attitude = pose
        beam = np.array(down_axis(attitude))
        if beam[2] < _UPRIGHT:
            return
        self._proven |= report.distance_m > _ABOVE_M
        met = place + report.distance_m * beam
        before, self._last_down = self._last_down, float(met[2])
        if abs(met[2] - before) > _ALIKE_M:  # something else: to be seen twice
            return
        if self._seen and abs(met[2] - self._seen[-1][1][2]) > _ALIKE_M:
            self._seen.clear()
        self._seen.append((now_ns, met, place))
        while now_ns - self._seen[0][0] > _WINDOW_NS:
            self._seen.popleft()

    def ground(self, now_ns: int) -> Ground | None:
        """The ground, or what stands on it there; None: it is not known."""
        if not self._proven or not self._seen or now_ns - self._seen[-1][0] > _STALE_NS:
            return None
        if self._laid is None or self._laid[0] != self._seen[-1][0]:
            self._laid = self._seen[-1][0], self._lay()
        return self._laid[1]

    def _lay(self) -> Ground:
        """By a plane through what was met: ridge regression of heights on places, about their means."""
        (first_ns, _, start), (last_ns, _, here) = self._seen[0], self._seen[-1]
        met = np.array([each for _, each, _ in self._seen])
        mean = met.mean(axis=0)
        about = met - mean
        spread = about[:, :2].T @ about[:, :2] + len(met) * _SPREAD_M**2 * np.eye(2)
        slope = np.linalg.solve(spread, about[:, :2].T @ about[:, 2])
        down = float(mean[2] + slope @ (here - mean)[:2])
        seconds = (last_ns - first_ns) * 1e-9
        rise = float(slope @ (here - start)[:2]) / seconds if seconds > 0.0 else 0.0
        return Ground(down, down + min(_AHEAD_S * rise, 0.0))
