"""Where the vehicle flies by itself: the position target of take-off, hold, return and landing, and circles."""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Vector
from vehicle_sim.airframe import Airframe, Auto
from vehicle_sim.autopilot.circle import Circle
from vehicle_sim.autopilot.control_laws import COMMAND, Command, Level
from vehicle_sim.autopilot.modes import Mode, Trigger
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.autopilot.tracking import Target, Tracker
from vehicle_sim.physics.motion import Motion

STILL_M_S = 0.3
"""Below this speed the vehicle counts as at rest."""

_ARRIVED_M = 0.5
_SETTLED_NS = 3_000_000_000
"""At rest near its target for so long, the vehicle comes no nearer: a downdraught that is too strong keeps it off."""
_BELOW_GROUND_M = 10.0
"""Depth of the target of a landing, which is never reached."""


class Arrival(NamedTuple):
    """A mode has reached its end."""

    trigger: Trigger
    target_ned: Vector
    """The position target (m) of the mode that follows."""


class Guidance:
    """The position target as a command for the control laws."""

    def __init__(self, airframe: Airframe, settings: Settings, start_ned: Vector) -> None:
        self._settings = settings
        self._foot_height_m = airframe.ground.foot_height_m
        self.command: Command = np.zeros(1, COMMAND)
        self.command["level"], self.command["integrates"] = Level.POSITION, True
        self.command["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        self.takeoff_ned = start_ned
        """Target (m) of a take-off."""
        self._above_climb = False
        """Returning: the climb is over, or was not needed."""
        self._moved_ns = 0
        """When it was not at rest near its target last."""
        self.circle: Circle | None = None
        """Flown instead of the position target."""
        self._tracker = Tracker(airframe, settings)
        self._tracks = False
        """More than a place: a circle, or a descent without any."""
        self._tracked = Target()
        """What it was then."""

    @property
    def flown(self) -> Command:
        """The command to fly."""
        return self._tracker.command if self._tracks else self.command

    @property
    def followed(self) -> Target:
        """What is flown to. A landing goes down at a speed, to no height."""
        if self._tracks:
            return self._tracked
        record = self.command[0]
        north, east, down = record["position_ned"].tolist()
        yaw = float(record["yaw"])
        if down == _BELOW_GROUND_M:
            return Target((north, east, None), (None, None, float(record["speed_limits"][2])), yaw=yaw)
        return Target((north, east, down), yaw=yaw)

    @property
    def _auto(self) -> Auto:
        return self._settings.auto

    def start(self, mode: Mode, motion: Motion, home_ned: Vector, *, landed: bool, goes_on: bool = True) -> None:
        """Enter a mode: set the target, the speed limits, and keep the present yaw. `goes_on`: the mode before was
        flown by this command, too, so what it has learned of the wind holds, unless the vehicle has landed."""
        if landed or not goes_on:
            self.command["integral"] = 0.0
        target = self.stopping_point(motion, landed=landed)
        self._moved_ns = motion.time_ns
        if mode is Mode.TAKEOFF:
            target = self.takeoff_ned
        elif mode is Mode.RETURN:
            high = min(motion.position_ned[2], home_ned[2] - self._auto.return_height_m)
            target = (target[0], target[1], high)
            self._above_climb = False
        elif mode is Mode.LAND:
            target = (target[0], target[1], _BELOW_GROUND_M)
        self.aim(target)
        self.command["yaw"] = motion.yaw
        self.command["speed_limits"] = self._auto.speed_limits_m_s
        if mode is Mode.ORBIT:
            self.go_round(Circle(target), motion)
        elif mode is Mode.DESCEND:
            self._track(motion)

    def go_round(self, circle: Circle, motion: Motion) -> None:
        """Fly a circle, until the next target."""
        self.circle = circle
        self._track(motion)

    def _track(self, motion: Motion) -> None:
        self._tracks = True
        self._tracker.start(motion)

    def aim(self, target_ned: Vector) -> None:
        """Set the position target (m)."""
        self.circle, self._tracks = None, False
        self.command["position_ned"] = target_ned

    def turn(self, yaw: float) -> None:
        """Set the heading (rad)."""
        self.command["yaw"] = yaw

    def limit_horizontal_speed(self, speed_m_s: float) -> None:
        """Fly at most this fast, and at most as fast as the vehicle file says."""
        cruise, climb, descent = self._auto.speed_limits_m_s
        self.command["speed_limits"] = (min(speed_m_s, cruise), climb, descent)

    def stopping_point(self, motion: Motion, *, landed: bool) -> Vector:
        """Where the vehicle comes to rest (m) if it brakes from its present velocity."""
        position, velocity = motion.position_ned, motion.velocity_ned
        if landed:
            return position
        ahead = 0.3 + 0.5 * math.hypot(velocity[0], velocity[1]) / self._auto.acceleration_limit_m_s2
        return (
            position[0] + ahead * velocity[0],
            position[1] + ahead * velocity[1],
            min(position[2] + 0.3 * velocity[2], -self._foot_height_m),
        )

    def update(self, mode: Mode, motion: Motion, home_ned: Vector, *, landed: bool) -> Arrival | None:
        """Move the target of a mode; tells when the mode has reached its end."""
        if self.circle is not None:
            self._follow(self.circle.target(motion), motion, landed=landed)
            return None
        if mode is Mode.DESCEND:
            descent = Target(velocity_ned=(None, None, self._auto.land_speed_m_s), acceleration_ned=(0.0, 0.0, None))
            self._follow(descent, motion, landed=landed)
        if mode is Mode.TAKEOFF:
            return self._update_takeoff(motion, landed=landed)
        if mode is Mode.RETURN:
            return self._update_return(motion, home_ned)
        if mode is Mode.LAND:
            height = -motion.position_ned[2] - self._foot_height_m
            slow = min(self._auto.descent_speed_m_s, max(self._auto.land_speed_m_s, 0.35 * height))
            self.command["speed_limits"] = (self._auto.cruise_speed_m_s, self._auto.climb_speed_m_s, slow)
        return None

    def _follow(self, target: Target, motion: Motion, *, landed: bool) -> None:
        self._tracked = target
        self._tracker.follow(target, motion, landed=landed)

    def _update_takeoff(self, motion: Motion, *, landed: bool) -> Arrival | None:
        off = math.inf if landed else abs(motion.position_ned[2] - self.takeoff_ned[2])
        settled = self._is_settled(motion, near=off < self._settings.height_acceptance_m)
        return Arrival(Trigger.CLIMBED, self.takeoff_ned) if off < 0.5 * _ARRIVED_M or settled else None

    def _update_return(self, motion: Motion, home_ned: Vector) -> Arrival | None:
        """First up, then home; near home without a climb."""
        north, east, down = motion.position_ned
        distance = math.hypot(north - home_ned[0], east - home_ned[1])
        high = float(self.command["position_ned"][0][2])
        if not self._above_climb and (distance < _ARRIVED_M or abs(down - high) < _ARRIVED_M):
            self._above_climb = True
            self.aim((home_ned[0], home_ned[1], high))
        elif self._above_climb and distance < _ARRIVED_M and motion.speed < STILL_M_S:
            return Arrival(Trigger.ABOVE_HOME, (home_ned[0], home_ned[1], _BELOW_GROUND_M))
        return None

    def _is_settled(self, motion: Motion, *, near: bool) -> bool:
        """It is at rest as `near` to its target as it comes."""
        if not near or motion.speed >= STILL_M_S:
            self._moved_ns = motion.time_ns
        return motion.time_ns - self._moved_ns >= _SETTLED_NS
