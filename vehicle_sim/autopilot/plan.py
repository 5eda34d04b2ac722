"""What was uploaded to the vehicle: places, the items of a mission, the fence and the rally points."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from protocol.arrays import Vector
from protocol.messages import dialect
from vehicle_sim.autopilot import fence


class Place(NamedTuple):
    """Metres north and east of the local origin, and a height (m) above it, or above home."""

    north: float
    east: float
    height_m: float
    above_home: bool

    def ned(self, home_ned: Vector) -> Vector:
        """In local axes (m)."""
        base = home_ned[2] if self.above_home else 0.0
        return self.north, self.east, base - self.height_m


class Item(NamedTuple):
    """One item of a mission."""

    command: int
    """MAV_CMD."""
    params: tuple[float, float, float, float]
    place: Place | None = None
    """None for items that happen where the vehicle is."""
    autocontinue: bool = True

    @property
    def is_flown_to(self) -> bool:
        """Its place is one to fly to, and not one to look at."""
        return self.command < int(dialect.MAV_CMD_NAV_LAST)


@dataclass(slots=True)
class Limits:
    """The uploaded fence and rally points."""

    zones: tuple[fence.Zone, ...] = ()
    rally: tuple[Place, ...] = ()
    breached: bool = False

    def breaks_out(self, position_ned: Vector) -> bool:
        """True at the tick at which the fence is breached."""
        was, self.breached = self.breached, not fence.allows(self.zones, position_ned)
        return self.breached and not was

    def objection(self, items: tuple[Item, ...]) -> str | None:
        """Which item of a mission the fence does not allow, or None."""
        for number, item in enumerate(items):
            place = item.place if item.is_flown_to else None
            if place is not None and not math.isnan(place.north) and not fence.allows(self.zones, place[:2]):
                return f"item {number} is outside of the geofence"
        return None

    def haven(self, home_ned: Vector, position_ned: Vector) -> Vector:
        """Where a return leads: home or a rally point, whichever is nearest, at the height of home."""
        havens = [home_ned, *((place.north, place.east, home_ned[2]) for place in self.rally)]
        return min(havens, key=lambda haven: math.dist(haven[:2], position_ned[:2]))
