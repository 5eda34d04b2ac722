"""The vehicle's own autopilot above its control laws: modes, arming, take-off, hold, return, landing, failsafes.

It behaves as PX4 does where a companion can tell (numbers of modes, results of commands, time limits). No I/O and no
clock: time comes with the motion. What it wants flown is `command`, what it has to say is in `texts`.
"""

import math
from collections.abc import Sequence
from enum import Enum, IntEnum

import numpy as np

from protocol.arrays import Quaternion, Vector
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import COMMAND, Command, Level
from vehicle_sim.physics.motion import Motion

SECOND_NS = 1_000_000_000

BOOT_NS = 1 * SECOND_NS
"""Until then it is not ready to arm."""
STREAM_GAP_NS = SECOND_NS // 2
"""Setpoints further apart than this (2 Hz) are no stream."""
STREAM_PROOF_NS = 1 * SECOND_NS
"""How long a stream must have run before OFFBOARD."""
STREAM_LOSS_NS = 1 * SECOND_NS
"""PX4's COM_OF_LOSS_T."""
STALE_NS = {Level.TORQUE: SECOND_NS // 10, Level.RATES: SECOND_NS // 4, Level.ATTITUDE: STREAM_GAP_NS}
"""A command that is older would tumble the vehicle or carry it into something before the loss is acted upon: it brakes
by itself until the next one or the loss (PX4 goes on with the old command)."""
FAILSAFE_HOLD_NS = 5 * SECOND_NS
"""PX4's COM_FAIL_ACT_T."""
LINK_LOSS_NS = 10 * SECOND_NS
"""PX4's COM_DL_LOSS_T. What PX4 does then is a setting (NAV_DLL_ACT), nothing at first; here it lands, as otherwise it
would hang in the air until its battery is empty if who had it hold is gone."""
LANDED_AFTER_NS = SECOND_NS // 2
DISARM_LANDED_NS = 2 * SECOND_NS
"""PX4's COM_DISARM_LAND."""
DISARM_PREFLIGHT_NS = 10 * SECOND_NS
"""PX4's COM_DISARM_PRFLT."""
FORCE = 21196
"""param2 of an arming command that is to be obeyed in any state."""

_QUIET_M_S = 0.3
_LIFTED_M = 0.05
_ARRIVED_M = 0.5
_ARMING_TILT = math.radians(30.0)
_BELOW_GROUND_M = 10.0
_FARTHEST_M = 10_000.0
"""From where it is to where it may be sent: beyond, the plane of its local axes is not the earth any more."""


class Mode(Enum):
    """Main and sub mode, as PX4 numbers them."""

    TAKEOFF = (4, 2)
    HOLD = (4, 3)
    RETURN = (4, 5)
    LAND = (4, 6)
    OFFBOARD = (6, 0)

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT's custom_mode."""
        main, sub = self.value
        return int(main << 16 | sub << 24)


class Trigger(Enum):
    STREAM_LOST = "no setpoint for 1 s"
    STILL_LOST = "5 s in hold without anybody taking over"
    LINK_LOST = "10 s without a heartbeat from anybody"
    CLIMBED = "at the take-off height"
    ABOVE_HOME = "over home"
    DISARMED = "motors off"


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    WARNING = 4
    INFO = 6


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


TRANSITIONS: dict[tuple[Mode, Trigger], tuple[Mode, Severity, str]] = {
    (Mode.OFFBOARD, Trigger.STREAM_LOST): (Mode.HOLD, Severity.CRITICAL, "Failsafe: offboard stream lost, holding"),
    (Mode.HOLD, Trigger.STILL_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: offboard stream lost, landing"),
    (Mode.HOLD, Trigger.LINK_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: no heartbeat for 10 s, landing"),
    (Mode.TAKEOFF, Trigger.CLIMBED): (Mode.HOLD, Severity.INFO, "Takeoff height reached, holding"),
    (Mode.RETURN, Trigger.ABOVE_HOME): (Mode.LAND, Severity.INFO, "Home reached, landing"),
    (Mode.TAKEOFF, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.RETURN, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.LAND, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
}
"""What changes the mode by itself. OFFBOARD is never entered from here."""


class SetpointStream:
    """When setpoints came: is this a stream, and is it still alive?"""

    def __init__(self) -> None:
        self._since_ns = 0
        self._last_ns: int | None = None

    def observe(self, now_ns: int) -> None:
        if self._last_ns is None or now_ns - self._last_ns > STREAM_GAP_NS:
            self._since_ns = now_ns
        self._last_ns = now_ns

    def problem(self, now_ns: int) -> str | None:
        """Why OFFBOARD can't be entered, or None."""
        if self._last_ns is None or now_ns - self._last_ns > STREAM_GAP_NS:
            return "no setpoint stream"
        if now_ns - self._since_ns < STREAM_PROOF_NS:
            return "setpoint stream under 1 s old"
        return None

    def age_ns(self, now_ns: int) -> int:
        """Of the latest setpoint; before the first one, as old as the vehicle."""
        return now_ns - (self._last_ns or 0)

    def lost(self, now_ns: int) -> bool:
        return self.age_ns(now_ns) > STREAM_LOSS_NS


class FlightControl:
    """Modes, arming and what is to be flown, advanced by `step` once a tick."""

    def __init__(self, airframe: Airframe, motion: Motion) -> None:
        self._auto = airframe.auto
        self._body = airframe.body
        self._foot_height_m = airframe.ground.foot_height_m
        self._crash_speed = airframe.ground.crash_speed_m_s
        self._crash_tilt = math.radians(airframe.ground.crash_tilt_deg)
        self._motion = motion
        self.mode = Mode.HOLD
        self.armed = False
        self.landed = True
        self.failsafe = False
        self.crash: str | None = None
        """What it hit."""
        self.mass_kg = airframe.takeoff_mass_kg
        self.home_ned: Vector = motion.position_ned
        self.airborne_ns = 0
        """Time in the air, over all flights."""
        self.stream = SetpointStream()
        self.texts: list[tuple[Severity, str]] = []
        self._stopped: Command = np.zeros(1, COMMAND)
        self._offboard: Command = np.zeros(1, COMMAND)
        self._guided: Command = np.zeros(1, COMMAND)
        self._guided["level"] = Level.POSITION
        self._takeoff_ned: Vector = motion.position_ned
        self._returning = False
        self._quiet_since_ns: int | None = motion.time_ns
        self._landed_since_ns = motion.time_ns
        self._failsafe_since_ns = 0
        self._alone_since_ns = 0
        self._armed_since_ns = 0
        self._flown = False
        for record in (self._stopped, self._offboard, self._guided):
            record["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)

    # --- what is to be flown ---

    @property
    def command(self) -> Command:
        """What the control laws shall do in the next tick."""
        if not self.armed:
            return self._stopped
        if self.mode is Mode.OFFBOARD:
            return self._offboard
        if self.landed and self.mode is not Mode.TAKEOFF:
            return self._stopped
        if self.mode is Mode.LAND and self._motion.touching:
            return self._stopped
        return self._guided

    @property
    def landed_state(self) -> LandedState:
        if self.landed:
            return LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.mode is Mode.LAND else LandedState.IN_AIR

    @property
    def flown(self) -> bool:
        """Has been in the air since it was armed."""
        return self._flown

    # --- setpoints; each is a proof of life, whatever the mode ---

    def attitude_setpoint(self, attitude_ned_frd: Quaternion, thrust: float) -> None:
        """Attitude, normalised here, and collective thrust 0..1; anything tiny or not finite is ignored."""
        norm = math.hypot(*attitude_ned_frd)
        if math.isfinite(norm) and norm > 0.1:
            attitude = tuple(value / norm for value in attitude_ned_frd)
            self._setpoint(Level.ATTITUDE, "attitude_ned_frd", attitude, thrust)

    def rates_setpoint(self, rates_frd: Vector, thrust: float) -> None:
        """Body rates (rad/s) and collective thrust 0..1."""
        self._setpoint(Level.RATES, "rates_frd", rates_frd, thrust)

    def torque_setpoint(self, controls: Sequence[float]) -> None:
        """Roll, pitch, yaw in -1..1 of `Body.full_torque_nm`, and collective thrust 0..1."""
        full = self._body.full_torque_nm
        torque = tuple(min(max(controls[i], -1.0), 1.0) * full[i] for i in range(3))
        self._setpoint(Level.TORQUE, "torque_frd", torque, controls[3])

    def _setpoint(self, level: Level, field: str, value: tuple[float, ...], thrust: float) -> None:
        """A thrust that is masked or NaN is no thrust at all, as in PX4."""
        if not all(map(math.isfinite, value)):
            return
        record = self._offboard[0]
        record["level"] = level
        record[field] = value
        record["thrust_n"] = min(max(thrust, 0.0), 1.0) * self._body.max_thrust_n if math.isfinite(thrust) else 0.0
        self.stream.observe(self._motion.time_ns)

    def _brake(self, motion: Motion) -> None:
        """Come to a stop by itself, still in OFFBOARD and open to the next setpoint; on the ground do nothing."""
        record = self._offboard[0]
        record["level"] = Level.STOPPED if self.landed else Level.POSITION
        record["position_ned"] = self._stopping_point()
        record["speed_limits"] = (self._auto.cruise_speed_m_s, self._auto.climb_speed_m_s, self._auto.descent_speed_m_s)
        record["yaw"] = motion.yaw
        self.say(Severity.WARNING, "Offboard setpoint stale: braking")

    def heartbeat(self) -> None:
        """Somebody is there."""
        self._alone_since_ns = self._motion.time_ns

    # --- commands ---

    def say(self, severity: Severity, text: str) -> None:
        self.texts.append((severity, text))

    def _refuse(self, text: str, result: Result = Result.TEMPORARILY_REJECTED) -> Result:
        self.say(Severity.CRITICAL, text)
        return result

    def set_mode(self, mode: Mode) -> Result:
        if self.crash is not None:
            return self._refuse("Mode change rejected: crashed")
        if mode is Mode.OFFBOARD:
            problem = self.stream.problem(self._motion.time_ns)
            if problem is not None:
                return self._refuse(f"Offboard rejected: {problem}")
        self.failsafe = False
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        self._enter(mode)
        return Result.ACCEPTED

    def take_off(self, height_m: float | None) -> Result:
        """Climb to a height above home (default: the vehicle's own); waits for arming. In the air it never descends."""
        if self.crash is not None:
            return self._refuse("Takeoff rejected: crashed")
        height = self._auto.takeoff_height_m if height_m is None else height_m
        if not math.isfinite(height) or height <= 0.0:
            return self._refuse(f"Takeoff rejected: {height:.1f} m above home", Result.DENIED)
        self.failsafe = False
        north, east, down = self._motion.position_ned
        home_down = down if self.landed else self.home_ned[2]
        self._takeoff_ned = (north, east, min(down, home_down - height))
        self._enter(Mode.TAKEOFF)
        return Result.ACCEPTED

    def reposition(self, target_ned: Vector, yaw: float | None, speed: float | None) -> Result:
        """Hold at another place: fly there at most at `speed` (m/s; default and most: its own), heading for `yaw`
        (rad; default: the present one). It looks out for nothing on its way."""
        if self.crash is not None or not self.armed or self.landed:
            return self._refuse("Reposition rejected: not in the air")
        distance = math.dist(target_ned, self._motion.position_ned)
        if not distance <= _FARTHEST_M:
            return self._refuse(f"Reposition rejected: {distance:.0f} m away", Result.DENIED)
        if target_ned[2] > -self._foot_height_m:
            return self._refuse("Reposition rejected: under the ground", Result.DENIED)
        self.failsafe = False
        self._enter(Mode.HOLD)
        self._aim(target_ned)
        auto = self._auto
        fastest = auto.cruise_speed_m_s if speed is None else min(speed, auto.cruise_speed_m_s)
        self._guided["speed_limits"] = (fastest, auto.climb_speed_m_s, auto.descent_speed_m_s)
        if yaw is not None:
            self._guided["yaw"] = yaw
        return Result.ACCEPTED

    def arming_problem(self) -> str | None:
        """Why it can't be armed now, or None."""
        now_ns = self._motion.time_ns
        if self.crash is not None:
            return "crashed"
        if now_ns < BOOT_NS:
            return "estimator is starting"
        if self._motion.tilt > _ARMING_TILT:
            return "not level"
        if self.mode in (Mode.LAND, Mode.RETURN):
            return f"mode {self.mode.name.lower()}"
        if self.mode is Mode.OFFBOARD:
            return self.stream.problem(now_ns)
        return None

    def arm(self, *, force: bool = False) -> Result:
        if self.armed:
            return Result.ACCEPTED
        problem = self.arming_problem()
        if problem is not None and (self.crash is not None or not force):
            return self._refuse(f"Arming denied: {problem}")
        self.armed = True
        self._armed_since_ns = self._landed_since_ns = self._motion.time_ns
        self._flown = False
        if self.landed:
            self.home_ned = self._motion.position_ned
        self.say(Severity.INFO, "Armed")
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        if self.armed and not self.landed and not force:
            return self._refuse("Disarming denied: not landed")
        if self.armed:
            self._disarm("Disarmed by command")
        return Result.ACCEPTED

    def _disarm(self, text: str) -> None:
        self.armed = False
        self.failsafe = False
        self.say(Severity.INFO, text)
        self._fire(Trigger.DISARMED)

    def hit(self, name: str) -> None:
        """It touched something: the motors stop for good."""
        if self.crash is None:
            self.crash = name
            self.armed = False
            self.say(Severity.EMERGENCY, f"crash: hit {name}")

    # --- one tick ---

    def step(self, motion: Motion) -> None:
        """Look at the motion after a tick, change modes, move the target."""
        elapsed_ns = motion.time_ns - self._motion.time_ns
        self._motion = motion
        if self.crash is not None:
            return
        self._detect_landing(motion)
        if not self.landed:
            self.airborne_ns += elapsed_ns
            self._flown = True
        if motion.touching and (motion.impact_m_s > self._crash_speed or motion.tilt > self._crash_tilt):
            self.hit("ground")
            return
        if self.mode is Mode.OFFBOARD:
            if self.stream.lost(motion.time_ns):
                self._fire(Trigger.STREAM_LOST)
            elif self.stream.age_ns(motion.time_ns) > STALE_NS.get(self._offboard["level"][0], STREAM_LOSS_NS):
                self._brake(motion)
        elif self.armed:
            self._guide(motion)
        if self.armed and self.landed:
            self._disarm_when_idle(motion.time_ns)

    def _detect_landing(self, motion: Motion) -> None:
        if not motion.touching:
            self._quiet_since_ns = None
            if self.landed and -motion.position_ned[2] > self._foot_height_m + _LIFTED_M:
                self.landed = False
            return
        if self.landed:
            return
        idle = self.command["thrust_n"][0] < 0.5 * self.mass_kg * GRAVITY
        if not idle or motion.speed > _QUIET_M_S:
            self._quiet_since_ns = None
        elif self._quiet_since_ns is None:
            self._quiet_since_ns = motion.time_ns
        elif motion.time_ns - self._quiet_since_ns >= LANDED_AFTER_NS:
            self.landed = True
            self._landed_since_ns = motion.time_ns
            self.say(Severity.INFO, "Landing detected")

    def _disarm_when_idle(self, now_ns: int) -> None:
        if self._flown:
            if self.mode not in (Mode.OFFBOARD, Mode.TAKEOFF) and now_ns - self._landed_since_ns >= DISARM_LANDED_NS:
                self._disarm("Disarmed by landing")
        elif now_ns - self._armed_since_ns >= DISARM_PREFLIGHT_NS:
            self._disarm("Disarmed: no takeoff within 10 s")

    def _fire(self, trigger: Trigger) -> None:
        """Follow the table; a trigger that a mode does not know changes nothing."""
        row = TRANSITIONS.get((self.mode, trigger))
        if row is None:
            return
        mode, severity, text = row
        if trigger in (Trigger.STREAM_LOST, Trigger.LINK_LOST) and self.armed:
            self.failsafe = True
            self._failsafe_since_ns = self._motion.time_ns
        self.say(severity, text)
        self._enter(mode)

    def _enter(self, mode: Mode) -> None:
        """Set the mode and where it starts from."""
        self.mode = mode
        self._alone_since_ns = self._motion.time_ns
        motion, auto = self._motion, self._auto
        target = self._stopping_point()
        if mode is Mode.TAKEOFF:
            target = self._takeoff_ned
        elif mode is Mode.RETURN:
            high = min(motion.position_ned[2], self.home_ned[2] - auto.return_height_m)
            target = (target[0], target[1], high)
            self._returning = False
        elif mode is Mode.LAND:
            target = (target[0], target[1], _BELOW_GROUND_M)
        self._aim(target)
        self._guided["yaw"] = motion.yaw
        self._guided["speed_limits"] = (auto.cruise_speed_m_s, auto.climb_speed_m_s, auto.descent_speed_m_s)

    def _aim(self, target_ned: Vector) -> None:
        self._guided["position_ned"] = target_ned

    def _stopping_point(self) -> Vector:
        """Where it can be at rest, braking from the present velocity."""
        position, velocity = self._motion.position_ned, self._motion.velocity_ned
        if self.landed:
            return position
        ahead = 0.3 + 0.5 * math.hypot(velocity[0], velocity[1]) / self._auto.acceleration_limit_m_s2
        return (
            position[0] + ahead * velocity[0],
            position[1] + ahead * velocity[1],
            min(position[2] + 0.3 * velocity[2], -self._foot_height_m),
        )

    def _guide(self, motion: Motion) -> None:
        north, east, down = motion.position_ned
        if self.mode is Mode.HOLD:
            if self.failsafe and motion.time_ns - self._failsafe_since_ns >= FAILSAFE_HOLD_NS:
                self._fire(Trigger.STILL_LOST)
            elif motion.time_ns - self._alone_since_ns >= LINK_LOSS_NS:
                self._fire(Trigger.LINK_LOST)
        elif self.mode is Mode.TAKEOFF:
            if not self.landed and abs(down - self._takeoff_ned[2]) < 0.5 * _ARRIVED_M:
                self._fire(Trigger.CLIMBED)
                self._aim(self._takeoff_ned)
        elif self.mode is Mode.LAND:
            height = -down - self._foot_height_m
            slow = min(self._auto.descent_speed_m_s, max(self._auto.land_speed_m_s, 0.35 * height))
            self._guided["speed_limits"] = (self._auto.cruise_speed_m_s, self._auto.climb_speed_m_s, slow)
        elif self.mode is Mode.RETURN:
            distance = math.hypot(north - self.home_ned[0], east - self.home_ned[1])
            high = float(self._guided["position_ned"][0][2])
            if not self._returning and (distance < _ARRIVED_M or abs(down - high) < _ARRIVED_M):
                self._returning = True
                self._aim((self.home_ned[0], self.home_ned[1], high))
            elif self._returning and distance < _ARRIVED_M and motion.speed < _QUIET_M_S:
                self._fire(Trigger.ABOVE_HOME)
                self._aim((self.home_ned[0], self.home_ned[1], _BELOW_GROUND_M))
