"""Targets that are more than a place: position, velocity and acceleration per axis, flown by the position law."""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Vector
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import COMMAND, VELOCITY_INTEGRAL_1_S2, Command, Level
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.physics.motion import Motion
from vehicle_sim.timing import TICK_S

Axes = tuple[float | None, float | None, float | None]
"""North, east, down; None: free."""
FREE: Axes = (None, None, None)
STILL: Axes = (0.0, 0.0, 0.0)

_LIFT_OFF_M_S2 = 0.1
"""Upward acceleration from which a target means to leave the ground."""
_UNLIMITED = (1e6, 1e6, 1e6)


class Target(NamedTuple):
    """What to follow: m, m/s, m/s2, rad, rad/s. Velocity beside a position is its rate, acceleration is feedforward."""

    position_ned: Axes = FREE
    velocity_ned: Axes = FREE
    acceleration_ned: Axes = FREE
    yaw: float | None = None
    yaw_rate: float | None = None
    """Counts where there is no yaw."""

    @property
    def is_whole(self) -> bool:
        """Each axis has something to follow, north and east the same, as PX4 demands it."""
        kinds = self.position_ned, self.velocity_ned, self.acceleration_ned
        if any((kind[0] is None) != (kind[1] is None) for kind in kinds):
            return False
        return all(any(kind[axis] is not None for kind in kinds) for axis in range(3))


class Tracker:
    """Turns a target into a command for the control laws, once a tick.

    The position law does the work: it is given the place at which it asks for the wanted acceleration.
    """

    def __init__(self, airframe: Airframe, settings: Settings, command: Command | None = None) -> None:
        """`command` is written into if it is given."""
        self._settings = settings
        self._auto = airframe.auto
        self.command: Command = np.zeros(1, COMMAND) if command is None else command
        self.command["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        self._integral = [0.0, 0.0, 0.0]

    def start(self, motion: Motion) -> None:
        """Begin to follow targets, at the present heading."""
        self.command["yaw"] = motion.yaw
        self._integral = [0.0, 0.0, 0.0]

    def follow(self, target: Target, motion: Motion, *, landed: bool) -> None:
        """Make the command for the next tick. On the ground the motors stand still unless the target is above."""
        if not target.is_whole:
            target = Target(velocity_ned=STILL, yaw=target.yaw, yaw_rate=target.yaw_rate)  # PX4 brakes
        wanted = self._acceleration(target, motion)
        record = self.command[0]
        if target.yaw is not None:
            record["yaw"] = target.yaw
        elif target.yaw_rate is not None:
            record["yaw"] += target.yaw_rate * TICK_S
        if (landed or motion.touching) and wanted[2] > -_LIFT_OFF_M_S2:
            record["level"], record["thrust_n"] = Level.STOPPED, 0.0
            self._integral = [0.0, 0.0, 0.0]
            return
        record["level"], record["speed_limits"] = Level.POSITION, _UNLIMITED
        position, velocity, auto = motion.position_ned, motion.velocity_ned, self._auto
        for axis in range(3):
            speed = velocity[axis] + wanted[axis] / auto.velocity_gain_1_s
            record["position_ned"][axis] = position[axis] + speed / auto.position_gain_1_s

    def _acceleration(self, target: Target, motion: Motion) -> list[float]:
        """Wanted acceleration (m/s2, NED)."""
        auto = self._auto
        speeds = self._velocity(target, motion)
        wanted = [value or 0.0 for value in target.acceleration_ned]
        limits = auto.acceleration_limit_m_s2, auto.acceleration_limit_m_s2, auto.climb_acceleration_limit_m_s2
        for axis, speed in enumerate(speeds):
            if speed is None:
                self._integral[axis] = 0.0
                continue
            error = speed - motion.velocity_ned[axis]
            wanted[axis] += auto.velocity_gain_1_s * error + self._integral[axis]
            if abs(wanted[axis]) < limits[axis]:
                self._integral[axis] += VELOCITY_INTEGRAL_1_S2 * error * TICK_S
        return wanted

    def _velocity(self, target: Target, motion: Motion) -> list[float | None]:
        """Wanted velocity (m/s, NED) within the limits; None on an axis that has an acceleration alone."""
        auto, settings = self._auto, self._settings
        ways = [
            None if place is None else auto.position_gain_1_s * (place - here)
            for place, here in zip(target.position_ned, motion.position_ned, strict=True)
        ]
        ways[:2] = _within(ways[:2], auto.cruise_speed_m_s)
        speeds = [
            None if way is None and speed is None else (way or 0.0) + (speed or 0.0)
            for way, speed in zip(ways, target.velocity_ned, strict=True)
        ]
        speeds[:2] = _within(speeds[:2], settings.max_speed_m_s)
        if speeds[2] is not None:
            speeds[2] = min(max(speeds[2], -settings.max_climb_m_s), settings.max_sink_m_s)
        return speeds


def _within(values: list[float | None], limit: float) -> list[float | None]:
    """A horizontal vector at no more than a length; parts of it may be missing."""
    scale = min(1.0, limit / max(1e-9, math.hypot(*(value or 0.0 for value in values))))
    return [None if value is None else value * scale for value in values]


def in_heading(forward: float, right: float, yaw: float) -> tuple[float, float]:
    """North and east of a horizontal vector that is given ahead and to the right of a heading (rad)."""
    return forward * math.cos(yaw) - right * math.sin(yaw), forward * math.sin(yaw) + right * math.cos(yaw)


def turned(yaw: float, wanted: float, step: float) -> float:
    """A heading (rad) that turns towards another one, the short way round, by at most a step."""
    return yaw + min(max(math.remainder(wanted - yaw, math.tau), -step), step)


def course(here: Vector, there: Vector | tuple[float, float]) -> float:
    """Heading (rad) from one place to another."""
    return math.atan2(there[1] - here[1], there[0] - here[0])
