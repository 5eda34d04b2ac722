"""The motion at one instant: a tick's outputs for compiled code, and plain numbers for everything else."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, Quaternion, Vector

FEEDBACK = np.dtype(
    [
        ("touching", "f8"),  # 1: a foot is on the ground
        ("impact_m_s", "f8"),  # speed (m/s) at which the ground was touched in this tick, or 0
        ("velocity_frd", "f8", 3),
        ("specific_force_frd", "f8", 3),  # m/s2, as an accelerometer measures it
        ("shaft_energy_j", "f8"),  # all rotors, since the start
    ]
)
Feedback = NDArray[np.void]
"""(1,) of FEEDBACK: the outputs of a tick beside the state."""


class Motion(NamedTuple):
    """Position (m), velocity (m/s), attitude and rates (rad/s) at a time since boot."""

    time_ns: int
    position_ned: Vector
    velocity_ned: Vector
    attitude_ned_frd: Quaternion
    rates_frd: Vector
    rotor_speeds: tuple[float, float, float, float]
    """Front, right, back, left (rad/s)."""
    touching: bool
    """A foot is on the ground."""
    impact_m_s: float
    """Speed at which the ground was touched in the last tick, or 0."""
    velocity_frd: Vector
    specific_force_frd: Vector
    """m/s2, as an accelerometer measures it."""
    shaft_energy_j: float
    """Taken by the rotors since the start."""

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
    def roll_pitch(self) -> tuple[float, float]:
        """Euler's angles (rad)."""
        q0, q1, q2, q3 = self.attitude_ned_frd
        roll = math.atan2(2.0 * (q0 * q1 + q2 * q3), 1.0 - 2.0 * (q1 * q1 + q2 * q2))
        return roll, math.asin(min(1.0, max(-1.0, 2.0 * (q0 * q2 - q3 * q1))))

    @property
    def tilt(self) -> float:
        """Between the body's down axis and the world's (rad)."""
        _, q1, q2, _ = self.attitude_ned_frd
        return math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (q1 * q1 + q2 * q2))))
