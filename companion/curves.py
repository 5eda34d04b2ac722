"""Curves of a mission: shapes, from a file's `[trajectory]` table, and routes flown as one smooth curve."""

import math
from dataclasses import dataclass
from typing import Literal

from companion.config_types import FARTHEST_M, LEAST, Height, Metres, NotNegative, Positive, Size, Speed, Table
from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY

_LEAST_AT_TOP = 1.5
"""Gravities of acceleration that a loop needs at its top."""


class Shape(Table, frozen=True):
    """A shape that starts over the place of take-off, or at `north`, `east`, `height` relative to it.

    circle, helix: northward and clockwise from above, with the centre `radius` east of the start; the helix climbs
    `pitch` each lap.
    ellipse: as the circle, with `radius` along north and `minor_radius` along east.
    lemniscate (of Gerono): north-eastward, an eight around the start, `radius` to north and south, half of that to east
    and west.
    loop: eastward, up and over, around the centre `radius` above the start. The vehicle heads north, and is inverted
    at the top: it needs `limits.tilt_deg` 180, and full speed on the first quarter of the lap.
    square: northward, then east, south and west, along edges of twice the `radius` at constant speed; the velocity
    jumps at the corners.
    """

    shape: Literal["circle", "helix", "lemniscate", "ellipse", "square", "loop"]
    speed: Speed
    """Peak speed (m/s). The angle turns at a constant rate, so ellipse and lemniscate are slower elsewhere."""
    radius: Size | None = None
    """m."""
    acceleration: Positive | None = None
    """Peak acceleration (m/s2) of circle or ellipse, in place of `radius`, which is then speed^2 / acceleration."""
    minor_radius: Size | None = None
    """m, of the ellipse; not set: half the radius."""
    pitch: NotNegative | None = None
    """m that the helix climbs each lap; not set: 1."""
    laps: Positive = 1.0
    ramp_s: NotNegative = 3.0
    """Time (s) from rest to speed, and from speed to rest at the end; 0: a step of the reference's velocity.

    A curve too short for both ramps is flown more slowly."""
    heading: Literal["fixed", "along"] = "fixed"
    """"fixed": as at take-off, of a loop north; "along": the direction of motion."""
    north: Metres = 0.0
    east: Metres = 0.0
    height: Height | None = None
    """Height (m) of the start above the take-off place; not set: the mission's `takeoff_height`."""

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.acceleration is None):
            raise ValueError("radius: give either it or acceleration")
        if self.acceleration is not None and self.shape not in ("circle", "ellipse", "loop"):
            raise ValueError(f"acceleration: a {self.shape} takes a radius")
        if not LEAST <= self.size <= FARTHEST_M:
            raise ValueError(f"acceleration: at {self.speed:g} m/s the radius is {self.size:g} m, up to {FARTHEST_M}")
        for key, value, shape in (("minor_radius", self.minor_radius, "ellipse"), ("pitch", self.pitch, "helix")):
            if value is not None and self.shape != shape:
                raise ValueError(f"{key}: only for shape {shape!r}")
        if self.shape == "loop":
            self._check_loop()
        if self.minor_radius is not None and self.minor_radius > self.size:
            raise ValueError(f"minor_radius: {self.minor_radius:g} is more than the radius {self.size:g}")

    def _check_loop(self) -> None:
        """At the top the thrust points down, and nowhere there is next to none of it."""
        least, longest_s = math.sqrt(_LEAST_AT_TOP * GRAVITY * self.size), math.pi * self.size / self.speed
        if self.speed < least:
            raise ValueError(f"speed: a loop of radius {self.size:g} needs {least:.1f} m/s")
        if self.ramp_s > longest_s:
            raise ValueError(f"ramp_s: at most {longest_s:.2f}, for full speed on a quarter of the loop")
        if self.laps != round(self.laps):
            raise ValueError("laps: a loop is flown whole")
        if self.heading == "along":
            raise ValueError('heading: a loop is flown with "fixed"')

    @property
    def size(self) -> float:
        """The radius (m), given as `radius` or by `acceleration`."""
        if self.radius is not None:
            return self.radius
        assert self.acceleration is not None
        return self.speed**2 / self.acceleration


@dataclass(frozen=True, slots=True)
class Route:
    """Points that are passed on one smooth curve from rest to rest."""

    points_ned: Array
    """(n, 3) m, relative to the first, which is 0, 0, 0."""
    speed: float
    """Peak speed (m/s)."""


Curve = Shape | Route
