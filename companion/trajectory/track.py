"""A track: a path in space flown by a time law. It gives the reference at any time, exact up to snap."""

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.config import Trajectory as TrajectorySettings
from companion.curves import Curve, Shape
from companion.trajectory.minimum_snap import Limits, plan
from companion.trajectory.shapes import shape_of
from companion.trajectory.timing import Path, TimeLaw
from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY

_ROUNDING = 1e-9
_PEAK_SLOPE = 35.0 / 16.0
"""Greatest slope of the smooth step of `timing`, over unit height and length."""


@dataclass(frozen=True, slots=True)
class Track:
    """A path at a place, with its time law."""

    path: Path
    law: TimeLaw
    origin_ned: Array
    """(3,) m: where the path's 0, 0, 0 lies."""
    along: bool
    """The heading is that of the motion; otherwise the track does not define the heading."""
    resume_s: float
    """Time (s) from rest to the full rate when the track is resumed on the way."""
    faces: float | None = None
    """The heading (rad) that it is flown with, if that is fixed by the track."""
    resumed_each: float = 0.0
    """Parameter from one place where the track may be resumed to the next; 0: anywhere."""

    def at(self, time_s: float) -> Array:
        """(6, 3) position, velocity, acceleration, jerk and snap (m, s; NED), and yaw, its rate and its acceleration
        (rad, s). The track is at rest before 0 and after its end."""
        return self.path.flown(self.law.phases, time_s, self.origin_ned)

    @property
    def duration_s(self) -> float:
        return self.law.duration_s

    @property
    def start_ned(self) -> Array:
        """(3,) m: where the track begins."""
        start: Array = self.at(0.0)[0]
        return start

    @property
    def start_yaw(self) -> float | None:
        """The heading (rad) at the beginning; None if the track does not define the heading."""
        return float(self.at(0.0)[5, 0]) if self.along else self.faces

    def shifted(self, offset_ned: Array) -> "Track":
        """The same track at another place, by an offset (3,) in m."""
        return replace(self, origin_ned=self.origin_ned + offset_ned)

    def resumed_at(self, time_s: float) -> "Track":
        """The rest of the track from that time on, or from the last place before where it may be resumed, started from
        rest."""
        reached = float(self.law.at(time_s)[0])
        if self.resumed_each > 0.0:
            reached = self.resumed_each * math.floor(reached / self.resumed_each + _ROUNDING)
        return replace(self, law=self.law.resumed(reached, self.resume_s))


def track_of(curve: Curve, settings: TrajectorySettings, tilt: float) -> Track:
    """The track for a mission's curve, which begins at 0, 0, 0; `tilt` (rad) is the vehicle's limit.

    Shapes are flown as given; the limits of settings and tilt apply to routes."""
    if isinstance(curve, Shape):
        shape = shape_of(curve)
        law = TimeLaw(0.0, curve.laps * shape.lap, curve.speed / shape.peak_speed, curve.ramp_s, curve.ramp_s)
        if curve.shape == "loop":
            return Track(shape, law, np.zeros(3), False, curve.ramp_s, faces=0.0, resumed_each=shape.lap)
        return Track(shape, law, np.zeros(3), curve.heading == "along", curve.ramp_s)
    limits = Limits(curve.speed, settings.acceleration, tilt)
    path = plan(curve.points_ned, limits)
    ramp_s = _PEAK_SLOPE * curve.speed / min(settings.acceleration, GRAVITY * limits.slope)
    return Track(path, TimeLaw(0.0, path.duration_s, 1.0, 0.0, 0.0), np.zeros(3), False, ramp_s)
