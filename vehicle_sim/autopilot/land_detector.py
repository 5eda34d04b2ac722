"""Whether the vehicle is on the ground."""

from vehicle_sim.autopilot.guidance import STILL_M_S
from vehicle_sim.physics.motion import Motion

LANDED_AFTER_NS = 500_000_000
"""The vehicle has landed when it has touched the ground for this long, at rest and without thrust."""

_LIFTED_M = 0.05
"""Height of the feet above the ground at which the vehicle is in the air."""


class LandDetector:
    """Decides from the motion after each tick."""

    def __init__(self, foot_height_m: float) -> None:
        self._stood_m = foot_height_m
        """Estimated height at which a foot touched the ground last: the estimate drifts while the vehicle stands."""
        self._still_since_ns: int | None = None

    def update(self, motion: Motion, *, landed: bool, idle: bool, lost: bool = False) -> bool:
        """Whether the vehicle is on the ground now. `landed`: it was before; `idle`: its commanded thrust is low;
        `lost`: its horizontal speed is not known."""
        speed = abs(motion.velocity_ned[2]) if lost else motion.speed
        if not motion.touching:
            self._still_since_ns = None
            return landed and -motion.position_ned[2] <= self._stood_m + _LIFTED_M
        self._stood_m = -motion.position_ned[2]
        if landed:
            return True
        if not idle or speed > STILL_M_S:
            self._still_since_ns = None
        elif self._still_since_ns is None:
            self._still_since_ns = motion.time_ns
        else:
            return motion.time_ns - self._still_since_ns >= LANDED_AFTER_NS
        return False
