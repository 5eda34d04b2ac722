"""A path flown by a law of time: everything about the reference at any time, exact up to snap."""

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from companion.config import Trajectory as TrajectorySettings
from companion.curves import Curve, Shape
from companion.trajectory.minimum_snap import Limits, plan
from companion.trajectory.shapes import shape_of
from companion.trajectory.timing import TimeLaw, compose, law_at
from protocol.arrays import Array
from protocol.jit import compiled

_STEEPEST = 35.0 / 16.0
"""Of the step from rest to the full rate, times its length."""


class Path(Protocol):
    """A curve in space that begins at 0, 0, 0 (m, NED)."""

    def at(self, parameter: float) -> Array:
        """(5, 3) position and its derivatives by the parameter."""


@compiled
def _heading(path: Array, law: Array) -> tuple[float, float, float]:
    """Of the horizontal tangent (rad), and its derivatives by time."""
    x1, y1, x2, y2, x3, y3 = path[1, 0], path[1, 1], path[2, 0], path[2, 1], path[3, 0], path[3, 1]
    square = x1 * x1 + y1 * y1
    if square == 0.0:
        return 0.0, 0.0, 0.0
    first = (x1 * y2 - y1 * x2) / square
    second = (x1 * y3 - y1 * x3 - 2.0 * first * (x1 * x2 + y1 * y2)) / square
    return math.atan2(y1, x1), first * law[1], second * law[1] ** 2 + first * law[2]


@compiled
def _motion(path: Array, law: Array, origin: Array) -> Array:
    """(6, 3) position to snap by time, and yaw, its rate and its acceleration."""
    out = np.empty((6, 3))
    out[:5] = compose(path, law)
    out[0] += origin
    out[5, 0], out[5, 1], out[5, 2] = _heading(path, law)
    return out


@dataclass(frozen=True, slots=True)
class Track:
    """A path at a place, and when it is where."""

    path: Path
    law: TimeLaw
    origin_ned: Array
    """Where the path's 0, 0, 0 lies."""
    along: bool
    """The heading is that of the motion; otherwise the track has none."""
    resume_s: float
    """From rest to the full rate if it is taken up again on the way."""

    def at(self, time_s: float) -> Array:
        """(6, 3) position, velocity, acceleration, jerk, snap; and yaw, its rate and its acceleration (rad). At rest
        after the end."""
        law = law_at(*self.law.phases, time_s)
        return _motion(self.path.at(law[0]), law, self.origin_ned)

    @property
    def duration_s(self) -> float:
        return self.law.duration_s

    @property
    def start_ned(self) -> Array:
        """Where it begins."""
        start: Array = self.at(0.0)[0]
        return start

    @property
    def start_yaw(self) -> float | None:
        """The heading to begin with, if it has one."""
        return float(self.at(0.0)[5, 0]) if self.along else None

    def moved(self, offset_ned: Array) -> "Track":
        """The same elsewhere."""
        return replace(self, origin_ned=self.origin_ned + offset_ned)

    def after(self, time_s: float) -> "Track":
        """What is left of it at that time, from rest."""
        reached = float(self.law.at(time_s)[0])
        return replace(self, law=self.law.resumed(reached, self.resume_s))


def track_of(curve: Curve, settings: TrajectorySettings, tilt: float) -> Track:
    """The track for what a mission asks for, beginning at 0, 0, 0; `tilt` (rad) is the vehicle's limit.

    Shapes are flown as they are asked for; the limits hold for routes."""
    if isinstance(curve, Shape):
        shape = shape_of(curve)
        law = TimeLaw(0.0, curve.laps * shape.lap, curve.speed / shape.peak_speed, curve.ramp_s, curve.ramp_s)
        return Track(shape, law, np.zeros(3), curve.heading == "along", curve.ramp_s)
    path = plan(curve.points_ned, Limits(curve.speed, settings.acceleration, tilt))
    ramp_s = _STEEPEST * curve.speed / settings.acceleration
    return Track(path, TimeLaw(0.0, path.duration_s, 1.0, 0.0, 0.0), np.zeros(3), False, ramp_s)
