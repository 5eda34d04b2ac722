"""The time that a step of the mission takes and may take."""

import math

import numpy as np

from companion.config import Settings, Trajectory
from protocol.arrays import Array

_SLOWER = 3.0
"""Times that a way may take: wind, drag and what stands in the way slow the vehicle down."""


def way_s(way_ned: Array, speed: float, limits: Trajectory) -> float:
    """s for a way (3,) m, NED, across at a `speed` (m/s) and at the same time up or down as fast as the limits say."""
    way: list[float] = way_ned.tolist()
    north, east, down = way
    vertical_s = down / limits.descent_speed if down > 0.0 else -down / limits.climb_speed
    return max(math.hypot(north, east) / speed, vertical_s)


class StepTime:
    """The time of one step after the other."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._since_ns = 0
        self._paused_ns = 0
        self.way = np.zeros(3)
        """m, NED: to the present step from the one before it, or from the vehicle if that began farther away."""

    def begin(self, now_ns: int) -> None:
        """A step begins."""
        self._since_ns = now_ns

    def pause(self, now_ns: int) -> None:
        """From now on the time does not count."""
        self._paused_ns = now_ns

    def resume(self, now_ns: int) -> None:
        """The time since the pause has not counted."""
        self._since_ns += now_ns - self._paused_ns

    def way_s(self, speed: float) -> float:
        """s for the way at a `speed` (m/s), with nothing in it."""
        return way_s(self.way, speed, self._settings.trajectory)

    def allowed(self, hold_s: float, track_s: float | None, speed: float, explored: float) -> float:
        """Time (s) that a step may take at a `speed` (m/s) which stays somewhere for `hold_s` (s) or follows a track of
        `track_s` (s), if that is not None, after its way, or so much new ground (m), whichever is longer."""
        flown_s = max(self.way_s(speed), explored / speed)
        stays_s, flown_s = (hold_s, flown_s) if track_s is None else (0.0, flown_s + track_s)
        return self._settings.supervision.step_timeout + stays_s + _SLOWER * flown_s

    def overdue(self, allowed: float, now_ns: int) -> float:
        """s beyond the time allowed (s)."""
        return max((now_ns - self._since_ns) * 1e-9 - allowed, 0.0)
