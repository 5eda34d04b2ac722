"""Circles about a place: the orbit, and the turns of a mission."""

import math
from dataclasses import dataclass

from protocol.arrays import Vector
from vehicle_sim.autopilot.tracking import Target, course
from vehicle_sim.physics.motion import Motion

MIN_RADIUS_M, MAX_RADIUS_M = 1.0, 1000.0
"""PX4's, for an orbit."""

_CENTRIPETAL_M_S2 = 2.0
"""Limits the speed on small circles, as PX4 does."""
_NEAR_M = 1.0
"""Distance to the circle within which the vehicle goes round at its speed; from twice of it on it does not."""
_APPROACH_1_S = 0.95
_APPROACH_M_S = 3.0

FACE_CENTER, KEEP_HEADING, UNCONTROLLED, ALONG = 0, 1, 2, 3
"""ORBIT_YAW_BEHAVIOUR."""


@dataclass(slots=True)
class Circle:
    """A circle to fly. A positive radius (m) is clockwise, seen from above. Speed in m/s."""

    center_ned: Vector
    radius_m: float = 2.0
    speed_m_s: float = 1.0
    yaw_behaviour: int = FACE_CENTER
    turned: float = 0.0
    """Angle (rad) that was flown on the circle."""
    angle: float | None = None
    """Direction (rad) from the centre to the vehicle at the latest tick on the circle."""

    def target(self, motion: Motion) -> Target:
        """What to follow in the next tick."""
        north, east = (motion.position_ned[i] - self.center_ned[i] for i in range(2))
        angle = math.atan2(east, north)
        distance, radius, sense = math.hypot(north, east), abs(self.radius_m), math.copysign(1.0, self.radius_m)
        off = radius - distance
        share = min(1.0, max(0.0, 2.0 - abs(off) / _NEAR_M))
        speed = sense * share * min(self.speed_m_s, math.sqrt(_CENTRIPETAL_M_S2 * radius))
        outward = min(max(_APPROACH_1_S * off, -_APPROACH_M_S), _APPROACH_M_S)
        self._count(angle, near=share > 0.0)
        c, s = math.cos(angle), math.sin(angle)
        inward = speed * speed / radius
        return Target(
            position_ned=(None, None, self.center_ned[2]),
            velocity_ned=(outward * c - speed * s, outward * s + speed * c, None),
            acceleration_ned=(-inward * c, -inward * s, None),
            yaw=self._yaw(motion, angle + sense * math.pi / 2.0),
        )

    def _count(self, angle: float, *, near: bool) -> None:
        if near and self.angle is not None:
            self.turned += abs(math.remainder(angle - self.angle, math.tau))
        self.angle = angle if near else None

    def _yaw(self, motion: Motion, along: float) -> float | None:
        if self.yaw_behaviour == FACE_CENTER:
            return course(motion.position_ned, self.center_ned)
        return along if self.yaw_behaviour == ALONG else None
