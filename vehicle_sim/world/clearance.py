"""The least distance between the vehicle and obstacles in a flight."""

import math

from protocol.arrays import Array
from vehicle_sim.physics.motion import Motion
from vehicle_sim.world.world import World


class ClearanceMonitor:
    """Measures only where the clearance may be below the least one so far: in a static world it can't fall faster than
    the vehicle moves."""

    def __init__(self, hull_radius_m: float) -> None:
        self._hull_radius_m = hull_radius_m
        self.least_m = math.inf
        """Hull to obstacle; inf before the first measurement."""
        self._spare_m = 0.0
        """Distance that the vehicle can move before the next measurement."""

    def invalidate(self) -> None:
        """The world has changed: measure at the next update."""
        self._spare_m = 0.0

    def move(self, before: Motion, now: Motion) -> None:
        """The vehicle has moved in a tick."""
        self._spare_m -= math.dist(before.position_ned, now.position_ned)

    def collision(self, world: World, position_ned: Array) -> str | None:
        """Measure at a position (3,) (m) in the air if it is necessary; the name of the obstacle hit, or None."""
        if self._spare_m > 0.0:
            return None
        clearance = world.clearance(position_ned) - self._hull_radius_m
        self.least_m = min(self.least_m, clearance)
        self._spare_m = clearance - self.least_m
        return (world.nearest(position_ned)[0] or "obstacle") if clearance <= 0.0 else None
