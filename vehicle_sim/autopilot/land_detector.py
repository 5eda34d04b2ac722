"""Whether the vehicle is on the ground."""

from vehicle_sim.autopilot.guidance import STILL_M_S
from vehicle_sim.physics.motion import Motion

LANDED_AFTER_NS = 500_000_000
"""The vehicle has landed when it has touched the ground for this long, at rest and without thrust."""

_LIFTED_M = 0.05
"""Height of the feet above the ground at which the vehicle is in the air."""


class LandDetector:
    """On the ground at the start."""

    def __init__(self, foot_height_m: float, now_ns: int) -> None:
        self._foot_height_m = foot_height_m
        self._still_since_ns: int | None = now_ns
        self.landed = True
        self.landed_since_ns = now_ns

    def update(self, motion: Motion, *, idle: bool) -> bool:
        """The motion after a tick, in which the commanded thrust was low (`idle`); True if it has landed just now."""
        if not motion.touching:
            self._still_since_ns = None
            if self.landed and -motion.position_ned[2] > self._foot_height_m + _LIFTED_M:
                self.landed = False
            return False
        if self.landed:
            return False
        if not idle or motion.speed > STILL_M_S:
            self._still_since_ns = None
        elif self._still_since_ns is None:
            self._still_since_ns = motion.time_ns
        elif motion.time_ns - self._still_since_ns >= LANDED_AFTER_NS:
            self.landed = True
            self.landed_since_ns = motion.time_ns
            return True
        return False
