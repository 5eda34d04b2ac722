"""A pilot's sticks, and what each mode that is flown by hand makes of them."""

import math
from typing import NamedTuple

from protocol.frames import from_euler
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import Command, Level
from vehicle_sim.autopilot.guidance import STILL_M_S
from vehicle_sim.autopilot.modes import Mode
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.autopilot.tracking import Axes, Target, Tracker, in_heading
from vehicle_sim.physics.motion import Motion
from vehicle_sim.timing import TICK_S

_ACRO_RATE = math.radians(100.0)
"""PX4's MC_ACRO_R_MAX."""
_CENTRE = 0.1
"""Part of a stick's way below which it is let go, PX4's MPC_HOLD_DZ."""


class Sticks(NamedTuple):
    """Positions in -1..1: to the right, ahead, up, clockwise."""

    roll: float = 0.0
    pitch: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0


class StickFlight:
    """The modes flown by hand: how the sticks become a command."""

    def __init__(self, airframe: Airframe, settings: Settings) -> None:
        self._airframe = airframe
        self._settings = settings
        self._tracker = Tracker(airframe, settings)
        self.sticks = Sticks()
        self._time_ns: int | None = None
        self._place: Axes = (None, None, None)
        """Where the vehicle stays on the axes whose sticks were let go (m)."""
        self.followed: Target | None = None
        """What the sticks make of it; None in the modes that control no position."""

    @property
    def command(self) -> Command:
        return self._tracker.command

    def move(self, sticks: Sticks, now_ns: int) -> None:
        """The sticks are in a new position."""
        self.sticks, self._time_ns = sticks, now_ns

    def problem(self, now_ns: int) -> str | None:
        """Why nobody can fly by hand, or None."""
        if self._time_ns is None or now_ns - self._time_ns > self._settings.stick_loss_ns:
            return "no manual control"
        return None

    @property
    def _tilt(self) -> float:
        """The tilt (rad) that a stick at its end asks for."""
        return math.radians(self._settings.stick_tilt_deg)

    @property
    def _yaw_rate(self) -> float:
        """Wanted turn (rad/s)."""
        return self.sticks.yaw * math.radians(self._settings.stick_yaw_rate_deg_s)

    def start(self, motion: Motion) -> None:
        """Begin to fly by hand, at the present heading."""
        self._tracker.start(motion)
        self._place = (None, None, None)

    def update(self, mode: Mode, motion: Motion, *, landed: bool) -> None:
        """Make the command for the next tick."""
        self.followed = None
        if mode is Mode.ACRO:
            self._fly_rates()
        elif mode in (Mode.MANUAL, Mode.STABILIZED):
            self._fly_attitude()
        else:
            self.followed = self._altitude_target(motion) if mode is Mode.ALTITUDE else self._position_target(motion)
            self._tracker.follow(self.followed, motion, landed=landed)

    def _position_target(self, motion: Motion) -> Target:
        sticks, auto = self.sticks, self._airframe.auto
        north, east = in_heading(sticks.pitch, sticks.roll, motion.yaw)
        let_go = math.hypot(north, east) < _CENTRE
        if not let_go:
            self._place = (None, None, self._place[2])
        elif self._place[0] is None and math.hypot(*motion.velocity_ned[:2]) < STILL_M_S:
            self._place = (motion.position_ned[0], motion.position_ned[1], self._place[2])
        climb = self._climb(motion)
        speed = 0.0 if let_go else auto.cruise_speed_m_s
        return Target(self._place, (north * speed, east * speed, climb), yaw_rate=self._yaw_rate)

    def _altitude_target(self, motion: Motion) -> Target:
        """The sticks tilt the vehicle; its height is held."""
        sticks = self.sticks
        forward, right = (GRAVITY * math.tan(stick * self._tilt) for stick in (sticks.pitch, sticks.roll))
        climb = self._climb(motion)
        return Target(
            (None, None, self._place[2]),
            (None, None, climb),
            (*in_heading(forward, right, motion.yaw), None),
            yaw_rate=self._yaw_rate,
        )

    def _climb(self, motion: Motion) -> float:
        """Wanted speed down (m/s); the height is kept when the throttle is let go."""
        throttle, auto = self.sticks.throttle, self._airframe.auto
        if abs(throttle) >= _CENTRE:
            self._place = (*self._place[:2], None)
            return -throttle * (auto.climb_speed_m_s if throttle > 0.0 else auto.descent_speed_m_s)
        if self._place[2] is None and abs(motion.velocity_ned[2]) < STILL_M_S:
            self._place = (*self._place[:2], motion.position_ned[2])
        return 0.0

    def _fly_attitude(self) -> None:
        record, sticks = self.command[0], self.sticks
        record["yaw"] += self._yaw_rate * TICK_S
        attitude = from_euler(sticks.roll * self._tilt, -sticks.pitch * self._tilt, float(record["yaw"]))
        record["level"], record["attitude_ned_frd"] = Level.ATTITUDE, attitude
        self._set_thrust()

    def _fly_rates(self) -> None:
        record, sticks = self.command[0], self.sticks
        rates = (sticks.roll * _ACRO_RATE, -sticks.pitch * _ACRO_RATE, sticks.yaw * _ACRO_RATE)
        record["level"], record["rates_frd"] = Level.RATES, rates
        self._set_thrust()

    def _set_thrust(self) -> None:
        """The middle of the throttle's way hovers; its lower end is the least thrust."""
        body, throttle = self._airframe.body, self.sticks.throttle
        hover = body.hover_thrust
        share = hover + throttle * ((1.0 - hover) if throttle > 0.0 else (hover - self._settings.least_thrust))
        self.command[0]["thrust_n"] = share * body.max_thrust_n
