"""The fence that was uploaded: circles and polygons to stay in or to keep out of."""

import math
from typing import NamedTuple

from protocol.arrays import Vector


class Zone(NamedTuple):
    """A circle (one corner and a radius) or a polygon, in metres north and east of the local origin."""

    inclusion: bool
    corners: tuple[tuple[float, float], ...]
    radius_m: float = 0.0

    def contains(self, north: float, east: float) -> bool:
        if len(self.corners) == 1:
            return math.dist(self.corners[0], (north, east)) <= self.radius_m
        inside = False
        for (n0, e0), (n1, e1) in zip(self.corners, self.corners[1:] + self.corners[:1], strict=True):
            if (e0 > east) != (e1 > east) and north < n0 + (east - e0) / (e1 - e0) * (n1 - n0):
                inside = not inside
        return inside


def allows(zones: tuple[Zone, ...], place: Vector | tuple[float, float]) -> bool:
    """Whether a place (NED, m) is outside of all exclusions and, if there is one, in an inclusion, as for PX4."""
    north, east = place[0], place[1]
    inclusions = [zone for zone in zones if zone.inclusion]
    if inclusions and not any(zone.contains(north, east) for zone in inclusions):
        return False
    return not any(zone.contains(north, east) for zone in zones if not zone.inclusion)
