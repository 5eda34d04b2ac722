"""The vehicle's own autopilot above its control laws: modes, arming and failsafes.

It behaves as PX4 does where a companion can tell (numbers of modes, results of commands, time limits). It has no input
or output and no clock: time comes with the motion.
"""

import math

import numpy as np

from protocol.arrays import Vector
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.control_laws import COMMAND, Command
from vehicle_sim.autopilot.guidance import Guidance
from vehicle_sim.autopilot.land_detector import LandDetector
from vehicle_sim.autopilot.modes import TRANSITIONS, LandedState, Mode, Result, Severity, Trigger
from vehicle_sim.autopilot.setpoints import OffboardSetpoints
from vehicle_sim.autopilot.settings import SECOND_NS, Settings
from vehicle_sim.physics.motion import Motion

BOOT_NS = 1 * SECOND_NS
"""Time after boot from which the vehicle can be armed."""

_ARMING_TILT = math.radians(30.0)
_MAX_DISTANCE_M = 10_000.0
"""Distance to a commanded place up to which the plane of the local axes is close enough to the earth's surface."""


class FlightControl:
    """Modes and arming, advanced by `step` once a tick. `command` is what to fly, `texts` what to say."""

    def __init__(self, airframe: Airframe, motion: Motion) -> None:
        self._airframe = airframe
        self.settings = Settings.of(airframe)
        self._crash_tilt = math.radians(airframe.ground.crash_tilt_deg)
        self.motion = motion
        """At the end of the latest tick."""
        self.mode = Mode.HOLD
        self.armed = False
        self.landed = True
        self.failsafe = False
        self.crash: str | None = None
        """Name of what the vehicle hit."""
        self._powerless = False
        self.mass_kg = airframe.takeoff_mass_kg
        self.home_ned: Vector = motion.position_ned
        self.airborne_ns = 0
        """Time in the air, over all flights."""
        self.flown = False
        """The vehicle has been in the air since it was armed."""
        self.texts: list[tuple[Severity, str]] = []
        self.setpoints = OffboardSetpoints(airframe)
        self._guidance = Guidance(airframe, self.settings, motion.position_ned)
        self._land_detector = LandDetector(airframe.ground.foot_height_m)
        self._stopped: Command = np.zeros(1, COMMAND)
        self._stopped["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        self._failsafe_since_ns = 0
        self._link_alive_ns = 0
        """The latest of a heartbeat and a change of mode."""
        self._armed_since_ns = 0
        self._landed_since_ns = 0

    # --- what to fly ---

    @property
    def command(self) -> Command:
        """The command (1,) for the control laws in the next tick."""
        if not self.armed:
            return self._stopped
        if self.mode is Mode.OFFBOARD:
            return self.setpoints.command
        if self.landed and self.mode is not Mode.TAKEOFF:
            return self._stopped
        if self.mode is Mode.LAND and self.motion.touching:
            return self._stopped
        return self._guidance.command

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE reports it."""
        if self.landed:
            return LandedState.ON_GROUND
        if self.mode is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.mode is Mode.LAND else LandedState.IN_AIR

    # --- commands ---

    def heartbeat(self) -> None:
        """A HEARTBEAT arrived."""
        self._link_alive_ns = self.motion.time_ns

    def announce(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append((severity, text))

    def _refuse(self, text: str, result: Result = Result.TEMPORARILY_REJECTED) -> Result:
        self.announce(Severity.CRITICAL, text)
        return result

    def set_mode(self, mode: Mode) -> Result:
        """Change the mode; OFFBOARD needs a stream of setpoints."""
        if self.crash is not None:
            return self._refuse("Mode change rejected: crashed")
        if mode is Mode.OFFBOARD:
            problem = self.setpoints.stream.problem(self.motion.time_ns)
            if problem is not None:
                return self._refuse(f"Offboard rejected: {problem}")
        self.failsafe = False
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        self._enter(mode)
        return Result.ACCEPTED

    def take_off(self, height_m: float | None) -> Result:
        """Climb to a height above home (None: that of the vehicle file), once armed. In the air it never descends."""
        if self.crash is not None:
            return self._refuse("Takeoff rejected: crashed")
        height = self.settings.auto.takeoff_height_m if height_m is None else height_m
        if not math.isfinite(height) or height <= 0.0:
            return self._refuse(f"Takeoff rejected: {height:.1f} m above home", Result.DENIED)
        self.failsafe = False
        north, east, down = self.motion.position_ned
        home_down = down if self.landed else self.home_ned[2]
        self._guidance.takeoff_ned = (north, east, min(down, home_down - height))
        self._enter(Mode.TAKEOFF)
        return Result.ACCEPTED

    def reposition(self, target_ned: Vector, yaw: float | None, speed: float | None) -> Result:
        """Fly to another place (m) and hold there. No obstacle is avoided on the way.

        `yaw` (rad) is the heading, None the present one. `speed` (m/s) is limited to the vehicle's own cruise speed,
        which None stands for.
        """
        if self.crash is not None or not self.armed or self.landed:
            return self._refuse("Reposition rejected: not in the air")
        distance = math.dist(target_ned, self.motion.position_ned)
        if not distance <= _MAX_DISTANCE_M:
            return self._refuse(f"Reposition rejected: {distance:.0f} m away", Result.DENIED)
        if target_ned[2] > -self._airframe.ground.foot_height_m:
            return self._refuse("Reposition rejected: under the ground", Result.DENIED)
        self.failsafe = False
        self._enter(Mode.HOLD)
        self._guidance.aim(target_ned)
        if speed is not None:
            self._guidance.limit_horizontal_speed(speed)
        if yaw is not None:
            self._guidance.turn(yaw)
        return Result.ACCEPTED

    def arming_problem(self) -> str | None:
        """Why the vehicle can't be armed now, or None."""
        now_ns = self.motion.time_ns
        if self.crash is not None:
            return "crashed"
        if self._powerless:
            return "battery empty"
        if now_ns < BOOT_NS:
            return "estimator is starting"
        if self.motion.tilt > _ARMING_TILT:
            return "not level"
        if self.mode in (Mode.LAND, Mode.RETURN):
            return f"mode {self.mode.name.lower()}"
        if self.mode is Mode.OFFBOARD:
            return self.setpoints.stream.problem(now_ns)
        return None

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors. `force` skips all checks but that for a crash."""
        if self.armed:
            return Result.ACCEPTED
        problem = self.arming_problem()
        if problem is not None and (self.crash is not None or not force):
            return self._refuse(f"Arming denied: {problem}")
        self.armed = True
        self._armed_since_ns = self.motion.time_ns
        self.flown = False
        if self.landed:
            self.home_ned = self.motion.position_ned
        self.announce(Severity.INFO, "Armed")
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only with `force`."""
        if self.armed and not self.landed and not force:
            return self._refuse("Disarming denied: not landed")
        if self.armed:
            self._disarm("Disarmed by command")
        return Result.ACCEPTED

    def _disarm(self, text: str) -> None:
        self.armed = False
        self.failsafe = False
        self.announce(Severity.INFO, text)
        self._fire(Trigger.DISARMED)

    def lose_power(self) -> None:
        """The battery is empty: the motors stop for good."""
        self._powerless = True
        self.armed = False
        self.announce(Severity.EMERGENCY, "Battery empty: motors stop")

    def collide(self, name: str) -> None:
        """The vehicle hit something: the motors stop for good."""
        if self.crash is None:
            self.crash = name
            self.armed = False
            self.announce(Severity.EMERGENCY, f"crash: hit {name}")

    # --- one tick ---

    def step(self, motion: Motion) -> None:
        """Take the motion after a tick: detect take-off, landing and crash, change modes, move the target."""
        elapsed_ns = motion.time_ns - self.motion.time_ns
        self.motion = motion
        if self.crash is not None:
            return
        self._detect_landing(motion)
        if not self.landed:
            self.airborne_ns += elapsed_ns
            self.flown = True
        ground = self._airframe.ground
        if motion.touching and (motion.impact_m_s > ground.crash_speed_m_s or motion.tilt > self._crash_tilt):
            self.collide("ground")
            return
        if self.mode is Mode.OFFBOARD:
            self._watch_setpoints(motion)
        elif self.armed and self.mode is Mode.HOLD:
            self._watch_link(motion.time_ns)
        elif self.armed:
            arrival = self._guidance.update(self.mode, motion, self.home_ned, landed=self.landed)
            if arrival is not None:
                self._fire(arrival.trigger)
                self._guidance.aim(arrival.target_ned)
        if self.armed and self.landed:
            self._disarm_when_idle(motion.time_ns)

    def _detect_landing(self, motion: Motion) -> None:
        was_landed = self.landed
        idle = False
        if motion.touching and not was_landed:
            idle = self.command["thrust_n"][0] < 0.5 * self.mass_kg * GRAVITY
        self.landed = self._land_detector.update(motion, landed=was_landed, idle=idle)
        if self.landed and not was_landed:
            self._landed_since_ns = motion.time_ns
            self.announce(Severity.INFO, "Landing detected")

    def _watch_setpoints(self, motion: Motion) -> None:
        if self.setpoints.is_lost(motion.time_ns):
            self._fire(Trigger.STREAM_LOST)
        elif self.setpoints.is_stale(motion.time_ns):
            stop_ned = self._guidance.stopping_point(motion, landed=self.landed)
            self.setpoints.brake(stop_ned, motion.yaw, landed=self.landed)
            self.announce(Severity.WARNING, "Offboard setpoint stale: braking")

    def _watch_link(self, now_ns: int) -> None:
        settings = self.settings
        still, lost = settings.stream_loss, settings.link_loss
        if still and self.failsafe and now_ns - self._failsafe_since_ns >= settings.failsafe_hold_ns:
            self._fire(still)
        elif lost and now_ns - self._link_alive_ns >= settings.link_loss_ns:
            self._fire(lost)

    def _disarm_when_idle(self, now_ns: int) -> None:
        after_landing_ns, before_ns = self.settings.disarm_landed_ns, self.settings.disarm_preflight_ns
        if self.flown:
            landed_ns = now_ns - self._landed_since_ns
            if self.mode not in (Mode.OFFBOARD, Mode.TAKEOFF) and 0 < after_landing_ns <= landed_ns:
                self._disarm("Disarmed by landing")
        elif 0 < before_ns <= now_ns - self._armed_since_ns:
            self._disarm(f"Disarmed: no takeoff within {before_ns * 1e-9:g} s")

    def _fire(self, trigger: Trigger) -> None:
        """Change the mode as TRANSITIONS says; a trigger without an entry for the mode changes nothing."""
        row = TRANSITIONS.get((self.mode, trigger))
        if row is None:
            return
        mode, severity, text = row
        if trigger in (Trigger.STREAM_LOST, Trigger.LINK_LOST, Trigger.LINK_LOST_RETURN) and self.armed:
            self.failsafe = True
            self._failsafe_since_ns = self.motion.time_ns
        self.announce(severity, text)
        self._enter(mode)

    def _enter(self, mode: Mode) -> None:
        self.mode = mode
        self._link_alive_ns = self.motion.time_ns
        self._guidance.start(mode, self.motion, self.home_ned, landed=self.landed)
