"""Curves that a mission asks for: shapes, as a file's `[trajectory]` table, and routes flown as one smooth curve."""

from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec

from companion.config import NotNegative, Positive, Table
from protocol.arrays import Array

Offset = Annotated[float, msgspec.Meta(ge=-10_000, le=10_000)]


class Shape(Table, frozen=True):
    """A shape that starts over the place of take-off, or at `north`, `east`, `height` seen from there.

    circle, helix: northward and clockwise from above, the centre `radius` east of the start; the helix climbs `pitch`
    a lap.
    ellipse: as the circle, `radius` along north, `minor_radius` along east.
    lemniscate (of Gerono): north-eastward, an eight around the start, `radius` to north and south, half of that to the
    sides.
    square: northward, then east, south and west; edges of twice the `radius` at constant speed, and the velocity jumps
    at the corners.
    """

    shape: Literal["circle", "helix", "lemniscate", "ellipse", "square"]
    speed: Positive
    """Peak (m/s). The angle turns at a constant rate, so that ellipse and lemniscate are slower elsewhere."""
    radius: Positive | None = None
    acceleration: Positive | None = None
    """In place of `radius`: the peak (m/s2), for a radius of speed^2 / acceleration; circle and ellipse."""
    minor_radius: Positive | None = None
    """Of the ellipse; left out: half the radius."""
    pitch: NotNegative | None = None
    """Of the helix (m a lap); left out: 1."""
    laps: Positive = 1.0
    ramp_s: NotNegative = 3.0
    """From rest to speed, and from speed to rest at the end; 0: at once, a step of the reference's velocity.

    A way too short for both is flown more slowly."""
    heading: Literal["fixed", "along"] = "fixed"
    """"fixed": as it was at take-off; "along": into the direction of motion."""
    north: Offset = 0.0
    east: Offset = 0.0
    height: Positive | None = None
    """Of the start (m), seen from the take-off place; left out: above it at the mission's `takeoff_height`."""

    def __post_init__(self) -> None:
        if (self.radius is None) == (self.acceleration is None):
            raise ValueError("radius: give either it or acceleration")
        if self.acceleration is not None and self.shape not in ("circle", "ellipse"):
            raise ValueError(f"acceleration: a {self.shape} takes a radius")
        for key, value, shape in (("minor_radius", self.minor_radius, "ellipse"), ("pitch", self.pitch, "helix")):
            if value is not None and self.shape != shape:
                raise ValueError(f"{key}: only for shape {shape!r}")
        if self.minor_radius is not None and self.minor_radius > self.size:
            raise ValueError(f"minor_radius: {self.minor_radius:g} is more than the radius {self.size:g}")

    @property
    def size(self) -> float:
        """The radius (m), however it was given."""
        if self.radius is not None:
            return self.radius
        assert self.acceleration is not None
        return self.speed**2 / self.acceleration


@dataclass(frozen=True, slots=True)
class Route:
    """Points that are flown through as one curve from rest to rest."""

    points_ned: Array
    """(n, 3) m from the first, which is 0, 0, 0."""
    speed: float
    """Peak (m/s)."""


Curve = Shape | Route
