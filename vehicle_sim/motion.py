"""The vehicle's motion at one instant, in plain numbers: what arrays are for compiled code, this is for the rest."""

import math
from typing import NamedTuple

from vehicle_sim.integrate import Feedback
from vehicle_sim.rigid_body import Array

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Motion(NamedTuple):
    time_ns: int
    position_ned: Vector
    velocity_ned: Vector
    attitude_ned_frd: Quaternion
    rates_frd: Vector
    rotor_speeds: Quaternion
    """Front, right, back, left (rad/s)."""
    touching: bool
    """A foot is on the ground."""
    impact_m_s: float
    """Speed at which the ground was touched in the last tick, or 0."""
    velocity_frd: Vector
    specific_force_frd: Vector
    """m/s2, what an accelerometer feels."""
    shaft_energy_j: float
    """What the rotors have taken since the start."""

    @classmethod
    def of(cls, time_ns: int, state: Array, feedback: Feedback) -> "Motion":
        """From a state (17,) and a tick's FEEDBACK."""
        x, y, z, vx, vy, vz, q0, q1, q2, q3, p, q, r, front, right, back, left = state.tolist()
        ((touching, impact, velocity, force, energy),) = feedback.tolist()
        return cls(
            time_ns,
            (x, y, z),
            (vx, vy, vz),
            (q0, q1, q2, q3),
            (p, q, r),
            (front, right, back, left),
            touching > 0.0,
            impact,
            tuple(velocity),
            tuple(force),
            energy,
        )

    @property
    def speed(self) -> float:
        return math.hypot(*self.velocity_ned)

    @property
    def yaw(self) -> float:
        """Heading (rad), clockwise from north."""
        q0, q1, q2, q3 = self.attitude_ned_frd
        return math.atan2(2.0 * (q0 * q3 + q1 * q2), 1.0 - 2.0 * (q2 * q2 + q3 * q3))

    @property
    def tilt(self) -> float:
        """Between the body's down axis and the world's (rad)."""
        _, q1, q2, _ = self.attitude_ned_frd
        return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q1 * q1 + q2 * q2))))
