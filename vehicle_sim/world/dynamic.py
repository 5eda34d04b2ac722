"""Cylinders that move along a route or appear in the course of the flight."""

import bisect
import itertools
import math
from dataclasses import dataclass, field

from vehicle_sim.world.tables import CylinderTable, Place


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Places that are visited in order at one speed (m/s). After the last place the route continues from the second
    one, which the last place repeats."""

    places: tuple[Place, ...]
    speed: float
    _distances_m: tuple[float, ...] = field(init=False, repr=False)
    """Distance along the route to each place."""

    def __post_init__(self) -> None:
        legs = itertools.starmap(math.dist, itertools.pairwise(self.places))
        object.__setattr__(self, "_distances_m", tuple(itertools.accumulate(legs, initial=0.0)))

    def at(self, time_s: float) -> Place:
        """Position after this time on the route."""
        way, first, whole = self.speed * time_s, self._distances_m[1], self._distances_m[-1]
        if way > whole:
            way = first + (way - first) % (whole - first) if whole > first else whole
        leg = min(max(bisect.bisect_right(self._distances_m, way), 1), len(self._distances_m) - 1)
        begin, end = self._distances_m[leg - 1], self._distances_m[leg]
        share = (way - begin) / (end - begin) if end > begin else 1.0
        (north, east), (to_north, to_east) = self.places[leg - 1], self.places[leg]
        return north + share * (to_north - north), east + share * (to_east - east)


@dataclass(frozen=True, slots=True, eq=False)
class DynamicObstacle:
    """A cylinder that moves or appears late."""

    row: int
    """Its index among the world's cylinders."""
    route: Route | None
    appears_within: float | None
    """Distance (m) of the vehicle to its side at which it appears; None: it is there from the start."""

    @classmethod
    def of(cls, row: int, cylinder: CylinderTable) -> "DynamicObstacle":
        """From a table: first the leg from the centre to the route's first place, then the closed route repeatedly."""
        route = None
        if cylinder.route:
            route = Route((cylinder.center, *cylinder.route, cylinder.route[0]), cylinder.speed)
        return cls(row, route, cylinder.appears_within)
