"""The setpoints of a companion: what OFFBOARD flies, and whether their stream is alive. Limits are PX4's."""

import math
from collections.abc import Sequence

import numpy as np

from protocol.arrays import Quaternion, Vector
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import COMMAND, Command, Level
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.autopilot.tracking import Target, Tracker
from vehicle_sim.physics.motion import Motion

STALE = {Level.TORQUE: 0.1, Level.RATES: 0.25, Level.ATTITUDE: 0.5}
"""Age, as a share of COM_OF_LOSS_T, at which the vehicle stops to follow a setpoint of each level and brakes, until the
next setpoint or the loss of the stream. PX4 goes on with the old setpoint, which could tumble the vehicle or drive it
into an obstacle."""


class SetpointStream:
    """The time at which the latest setpoint arrived."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    @property
    def has_begun(self) -> bool:
        return self._last_ns is not None

    def observe(self, now_ns: int) -> None:
        """A setpoint arrived."""
        self._last_ns = now_ns

    def age_ns(self, now_ns: int) -> int:
        """Age of the latest setpoint; before the first one, the vehicle's own age."""
        return now_ns - (self._last_ns or 0)


class OffboardSetpoints:
    """The latest setpoint as a command for the control laws. Every setpoint counts for the stream, in any mode.

    A setpoint with a value that is not finite is ignored, but a thrust that is not finite is no thrust, as for PX4.
    """

    def __init__(self, airframe: Airframe, settings: Settings) -> None:
        self._settings = settings
        self._body = airframe.body
        self._max_thrust_n = airframe.body.max_thrust_n
        self._speed_limits = airframe.auto.speed_limits_m_s
        self.stream = SetpointStream()
        self.command: Command = np.zeros(1, COMMAND)
        self.command["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        # Views: to find a field in a record takes longer than to write it, and a setpoint comes with each tick.
        self._level, self._thrust = self.command["level"], self.command["thrust_n"]
        self._tracker = Tracker(airframe, settings, self.command)
        self._target: Target | None = None
        """The latest setpoint, if it is one of position, velocity and acceleration."""
        self._values = {name: self.command[name][0] for name in ("attitude_ned_frd", "rates_frd", "torque_frd")}

    def attitude(self, attitude_ned_frd: Quaternion, thrust: float, now_ns: int) -> None:
        """Attitude, which is normalised here, and collective thrust 0..1. A norm below 0.1 is ignored."""
        norm = math.hypot(*attitude_ned_frd)
        if math.isfinite(norm) and norm > 0.1:
            attitude = tuple(value / norm for value in attitude_ned_frd)
            self._set(Level.ATTITUDE, "attitude_ned_frd", attitude, thrust, now_ns)

    def rates(self, rates_frd: Vector, thrust: float, now_ns: int) -> None:
        """Body rates (rad/s) and collective thrust 0..1."""
        self._set(Level.RATES, "rates_frd", rates_frd, thrust, now_ns)

    def torque(self, controls: Sequence[float], now_ns: int) -> None:
        """Roll, pitch and yaw torque in -1..1 of `VehicleParameters.full_torque_nm`, and collective thrust 0..1."""
        full = self._body.full_torque_nm
        torque = tuple(min(max(controls[i], -1.0), 1.0) * full[i] for i in range(3))
        self._set(Level.TORQUE, "torque_frd", torque, controls[3], now_ns)

    def _set(self, level: Level, field: str, value: tuple[float, ...], thrust: float, now_ns: int) -> None:
        if not all(map(math.isfinite, value)):
            return
        self._target = None
        self._level[0] = level
        self._values[field][:] = value
        self._thrust[0] = min(max(thrust, 0.0), 1.0) * self._max_thrust_n if math.isfinite(thrust) else 0.0
        self.stream.observe(now_ns)

    def target(self, target: Target, now_ns: int) -> None:
        """Position, velocity and acceleration per axis, heading and its rate. It must ask for something."""
        self._target = target
        self.stream.observe(now_ns)

    @property
    def followed(self) -> Target | None:
        """The latest setpoint, or where the vehicle brakes; None for one of attitude, rates or torque."""
        if self._target is not None or self._level[0] != Level.POSITION:
            return self._target
        north, east, down = self.command["position_ned"][0].tolist()
        return Target((north, east, down), yaw=float(self.command["yaw"][0]))

    @property
    def needs_position(self) -> bool:
        """The latest setpoint can't be followed without an estimate of the position."""
        return self._target is not None

    def start(self, motion: Motion) -> None:
        """OFFBOARD begins."""
        self._tracker.start(motion)

    def follow(self, motion: Motion, *, landed: bool) -> None:
        """Prepare the next tick, in OFFBOARD."""
        if self._target is not None:
            self._tracker.follow(self._target, motion, landed=landed)

    def problem(self, now_ns: int) -> str | None:
        """Why OFFBOARD can't be flown, or None: as for PX4, one setpoint that is young enough suffices."""
        return None if self.stream.has_begun and not self.is_lost(now_ns) else "no setpoint stream"

    def is_lost(self, now_ns: int) -> bool:
        """No setpoint for so long that OFFBOARD ends."""
        return self.stream.age_ns(now_ns) > self._settings.stream_loss_ns

    def is_stale(self, now_ns: int) -> bool:
        """The setpoint is too old to be followed, see STALE."""
        return self.stream.age_ns(now_ns) > STALE.get(self._level.item(), 1.0) * self._settings.stream_loss_ns

    def brake(self, stop_ned: Vector, yaw: float, *, landed: bool) -> None:
        """Until the next setpoint, stop at this position (m) with this heading (rad); on the ground stop the motors."""
        self._target = None
        record = self.command[0]
        record["level"] = Level.STOPPED if landed else Level.POSITION
        record["position_ned"] = stop_ned
        record["speed_limits"] = self._speed_limits
        record["yaw"] = yaw
