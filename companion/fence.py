"""The fence: the part of a circle and of a box, up to a height, in which may be flown. It is convex and holds the place
of the take-off, so the straight way between two places inside stays inside.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from companion.config_limits import Geofence
from companion.state import NO_FENCE, OwnFence
from protocol.arrays import Array

_ROUNDING_M = 0.01


@dataclass(frozen=True)
class Fence:
    """The fence of one flight, m, NED."""

    home: tuple[float, float, float]
    low: tuple[float, float, float]
    """The least north, east and down."""
    high: tuple[float, float, float]
    """The most; downwards there is none in flight."""
    radius: float
    braking: float
    """m/s2"""

    def shrunk(self, margin: float) -> "Fence":
        """What is left of it `margin` (m) inside."""
        low = tuple(value + margin for value in self.low)
        high = tuple(value - margin for value in self.high)
        return Fence(
            self.home, (low[0], low[1], low[2]), (high[0], high[1], high[2]), self.radius - margin, self.braking
        )

    def room(self, place: Array) -> float:
        """m from a place (3,) to the fence; negative outside. Near a corner it is less than the distance outside."""
        north, east, down = place.tolist()
        away = math.hypot(north - self.home[0], east - self.home[1])
        sides = (self.radius - away, north - self.low[0], self.high[0] - north, east - self.low[1], self.high[1] - east)
        return float(min(*sides, down - self.low[2], self.high[2] - down))

    def nearest(self, place: Array) -> Array:
        """A place (3,) inside that is near to another one; that one itself, if it is inside."""
        north, east, down = (
            min(max(value, low), high) for value, low, high in zip(place.tolist(), self.low, self.high, strict=True)
        )
        dn, de = north - self.home[0], east - self.home[1]
        away = math.hypot(dn, de)
        if away > self.radius:  # towards home no side of the box is crossed
            share = self.radius / away
            north, east = self.home[0] + share * dn, self.home[1] + share * de
        elif (north, east, down) == (place[0], place[1], place[2]):
            return place
        return np.array((north, east, down))

    def keep(self, rows: Array) -> None:
        """Keep a reference (`state.Reference.rows`, (6, 3)) inside: what leads out of it is taken from its motion."""
        north, east, down = rows[0].tolist()
        for axis, value in enumerate((north, east, down)):
            low, high = self.low[axis], self.high[axis]
            if low <= value <= high:
                continue
            inwards = np.maximum if value < low else np.minimum
            rows[0, axis] = low if value < low else high
            rows[1:5, axis] = inwards(rows[1:5, axis], 0.0)
        dn, de = rows[0, 0] - self.home[0], rows[0, 1] - self.home[1]
        away = math.hypot(dn, de)
        if away <= self.radius:
            return
        out = np.array((dn, de)) / away
        rows[0, :2] = np.array(self.home[:2]) + (1.0 - 1e-12) * self.radius * out
        rows[1:5, :2] -= np.outer(np.maximum(rows[1:5, :2] @ out, 0.0), out)

    def slowed(self, place: Array, velocity: Array) -> Array:
        """A wanted velocity (2,) (m/s) at a place (2,) or (3,), slowed towards the fence so that it can stop there."""
        wanted = velocity
        for out, room in self._sides(place):
            towards = float(wanted @ out)
            allowed = math.sqrt(2.0 * self.braking * max(room, 0.0))
            if towards > allowed:
                wanted = wanted - (towards - allowed) * out
        return wanted

    def _sides(self, place: Array) -> list[tuple[Array, float]]:
        """Direction (2,) out of each side, and the room (m) to it."""
        offset = place[:2] - np.array(self.home[:2])
        away = math.hypot(offset[0], offset[1])
        sides = [] if away < 1e-6 or self.radius == math.inf else [(offset / away, self.radius - away)]
        for axis in (0, 1):
            for sign, bound in ((-1.0, self.low[axis]), (1.0, self.high[axis])):
                if abs(bound) != math.inf:
                    sides.append((sign * _AXES[axis], sign * (bound - float(place[axis]))))
        return sides

    def flat_room(self, place: Array) -> float:
        """m from a place (2,) or (3,) to the sides, whatever the height; negative outside, inf without sides."""
        return min((room for _, room in self._sides(place)), default=math.inf)

    @cached_property
    def flat(self) -> tuple[float, float, float, float, float, float, float]:
        """Home's north and east, the least and the most of both, and the radius, for the map."""
        return (*self.home[:2], self.low[0], self.high[0], self.low[1], self.high[1], self.radius)


_AXES = np.eye(2)


def fence_of(settings: Geofence, home_ned: Array, own: OwnFence = NO_FENCE, *, floor: bool = False) -> Fence | None:
    """What is within the fence of the settings and the vehicle's own, around the place (3,) of the take-off; None
    without either. Where the vehicle wants more of a margin than the settings, its fence is nearer by the difference.
    `floor`: with the least height of its own, which does not hold on the way up and down."""
    if not settings.bounded and own == NO_FENCE:
        return None
    home: list[float] = home_ned.tolist()
    open_ended, nearer = (-math.inf, math.inf), max(own.margin - settings.margin, 0.0)
    (south, north), (west, east) = settings.north or open_ended, settings.east or open_ended
    ceiling = math.inf if settings.max_height is None else settings.max_height
    return Fence(
        (home[0], home[1], home[2]),
        (home[0] + south, home[1] + west, home[2] - min(ceiling, own.max_height - nearer)),
        (home[0] + north, home[1] + east, home[2] - own.min_height - nearer if floor else math.inf),
        min(math.inf if settings.radius is None else settings.radius, own.radius - nearer),
        settings.braking,
    )


def first_beyond(fence: Fence, places: Iterable[tuple[str, Array]]) -> str | None:
    """The first of places (what is done there; (3,) m, NED) that is beyond the fence, in words; None if all are
    inside."""
    for what, place in places:
        beyond = -fence.room(place)
        if beyond > _ROUNDING_M:
            north, east, down = place.tolist()
            return f"{what} at north {north:.1f}, east {east:.1f}, height {-down:.1f} is {beyond:.1f} m beyond"
    return None
