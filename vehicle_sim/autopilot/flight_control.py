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
from vehicle_sim.autopilot.mission import Mission
from vehicle_sim.autopilot.modes import FAILSAFES, TRANSITIONS, Flies, LandedState, Mode, Result, Severity, Trigger
from vehicle_sim.autopilot.plan import Limits
from vehicle_sim.autopilot.setpoints import OffboardSetpoints
from vehicle_sim.autopilot.settings import SECOND_NS, Settings
from vehicle_sim.autopilot.sticks import StickFlight
from vehicle_sim.autopilot.watch import Watch
from vehicle_sim.physics.motion import Motion

BOOT_NS = 1 * SECOND_NS
"""Time after boot from which the vehicle can be armed."""

_LANDS = (Mode.LAND, Mode.DESCEND)
_ARMING_TILT = math.radians(30.0)


class FlightControl:
    """Modes and arming, advanced by `step` once a tick. `command` is what to fly, `texts` what to say."""

    def __init__(self, airframe: Airframe, motion: Motion) -> None:
        self.airframe = airframe
        self.settings = Settings.of(airframe)
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
        self.setpoints = OffboardSetpoints(airframe, self.settings)
        self.sticks = StickFlight(airframe, self.settings)
        self.guidance = Guidance(airframe, self.settings, motion.position_ned)
        self.mission = Mission(self.settings, self.guidance, motion)
        self.limits = Limits()
        self._land_detector = LandDetector(airframe.ground.foot_height_m)
        self._stopped: Command = np.zeros(1, COMMAND)
        self._stopped["attitude_ned_frd"] = (1.0, 0.0, 0.0, 0.0)
        self.watch = Watch(self.settings, self.announce)
        self._armed_since_ns = self._landed_since_ns = 0

    # --- what to fly ---

    @property
    def command(self) -> Command:
        """The command (1,) for the control laws in the next tick."""
        flies, phase = self.mode.flies, self.phase
        if not self.armed or flies is Flies.NOTHING:
            return self._stopped
        if flies is Flies.SETPOINTS:
            return self.setpoints.command
        if flies is Flies.STICKS:
            return self.sticks.command
        if (self.landed and phase is not Mode.TAKEOFF) or (phase in _LANDS and self.motion.touching):
            return self._stopped
        return self.guidance.flown

    @property
    def phase(self) -> Mode:
        """The mode, or what a mission flies at present: a take-off, a landing, or something between (HOLD)."""
        return self.mission.phase if self.mode is Mode.MISSION else self.mode

    @property
    def landed_state(self) -> LandedState:
        """As EXTENDED_SYS_STATE reports it."""
        if self.landed:
            return LandedState.ON_GROUND
        if self.phase is Mode.TAKEOFF:
            return LandedState.TAKEOFF
        return LandedState.LANDING if self.phase in _LANDS else LandedState.IN_AIR

    # --- commands ---

    def heartbeat(self) -> None:
        """A HEARTBEAT arrived."""
        self.watch.alive_ns = self.motion.time_ns

    def announce(self, severity: Severity, text: str) -> None:
        """Queue a STATUSTEXT."""
        self.texts.append((severity, text))

    def refuse(self, text: str, result: Result = Result.TEMPORARILY_REJECTED) -> Result:
        self.announce(Severity.CRITICAL, text)
        return result

    def set_mode(self, mode: Mode) -> Result:
        """Change the mode; with running motors what it flies by must be there, as for PX4."""
        problem = self._end or (self.missing(mode) if self.armed else None)
        if problem is not None:
            return self.refuse(f"{mode.label} rejected: {problem}")
        self.failsafe = False
        if mode is Mode.TAKEOFF:
            return self.take_off(None)
        self.enter(mode)
        return Result.ACCEPTED

    def take_off(self, height_m: float | None) -> Result:
        """Climb to a height above home (None: that of the vehicle file), once armed. In the air it never descends."""
        if self._end is not None:
            return self.refuse(f"Takeoff rejected: {self._end}")
        height = self.settings.auto.takeoff_height_m if height_m is None else height_m
        if not math.isfinite(height) or height <= 0.0:
            return self.refuse(f"Takeoff rejected: {height:.1f} m above home", Result.DENIED)
        self.failsafe = False
        north, east, down = self.motion.position_ned
        home_down = down if self.landed else self.home_ned[2]
        self.guidance.takeoff_ned = (north, east, min(down, home_down - height))
        self.enter(Mode.TAKEOFF)
        return Result.ACCEPTED

    @property
    def _end(self) -> str | None:
        """Why nothing can be flown any more, or None."""
        if self.crash is not None:
            return "crashed"
        return "terminated" if self.mode is Mode.TERMINATION else None

    def missing(self, mode: Mode) -> str | None:
        """What a mode flies by and is not there, or None."""
        lost = self.watch.navigation_problem(mode)
        if lost is not None and mode is not Mode.LAND:  # which becomes a descent, as with PX4
            return lost
        if mode.flies is Flies.SETPOINTS:
            return self.setpoints.problem(self.motion.time_ns)
        if mode.flies is Flies.STICKS:
            return self.sticks.problem(self.motion.time_ns)
        if mode.flies is Flies.MISSION:
            return self.mission.problem() or self.limits.objection(self.mission.items)
        return None

    def arming_problem(self) -> str | None:
        """Why the vehicle can't be armed now, or None."""
        if self._end is not None:
            return self._end
        if self._powerless:
            return "battery empty"
        if self.motion.time_ns < BOOT_NS:
            return "estimator is starting"
        if self.motion.tilt > _ARMING_TILT:
            return "not level"
        if not self.mode.arms:
            return f"mode {self.mode.name.lower()}"
        return self.watch.arming_problem(self.mode) or self.missing(self.mode)

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors. `force` skips all checks but that for a crash."""
        if self.armed:
            return Result.ACCEPTED
        problem = self.arming_problem()
        if problem is not None and (self.crash is not None or not force):
            return self.refuse(f"Arming denied: {problem}")
        self.armed = True
        self._armed_since_ns = self.motion.time_ns
        self.watch.arm(self.motion.time_ns)
        self.flown = self.limits.breached = False
        if self.landed:
            self.home_ned = self.motion.position_ned
        self.announce(Severity.INFO, "Armed")
        return Result.ACCEPTED

    def disarm(self, *, force: bool = False) -> Result:
        """Stop the motors; in the air only with `force`."""
        if self.armed and not self.landed and not force:
            return self.refuse("Disarming denied: not landed")
        if self.armed:
            self._disarm("Disarmed by command")
        return Result.ACCEPTED

    def _disarm(self, text: str) -> None:
        self.armed = False
        self.failsafe = False
        self.announce(Severity.INFO, text)
        self.mission.disarm()
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
        ground = self.airframe.ground
        tilt = math.radians(ground.crash_tilt_deg)
        if motion.touching and (motion.impact_m_s > ground.crash_speed_m_s or motion.tilt > tilt):
            self.collide("ground")
            return
        if self.armed:
            self._fly(motion)
            self._look_after(motion)
        beyond = self.settings.fence_breach
        if beyond and self.armed and not self.landed and self.limits.breaks_out(motion.position_ned):
            self._fire(beyond)
        if self.armed and self.landed:
            self._disarm_when_idle(motion.time_ns)

    def _look_after(self, motion: Motion) -> None:
        lost = self.mode.needs_position or (self.mode is Mode.OFFBOARD and self.setpoints.needs_position)
        acts = self.failsafe or self.mode is Mode.RETURN
        trigger = self.watch.update(motion, needs_position=lost, failsafe=acts)
        if trigger is Trigger.ATTITUDE_FAILED_EARLY:
            self._disarm("Disarmed: attitude failure")
        elif trigger is not None and not self.landed:
            self._fire(trigger)

    def _fly(self, motion: Motion) -> None:
        """Let the mode prepare the next tick, and see whether it has reached its end."""
        match self.mode.flies:
            case Flies.SETPOINTS:
                self._watch_setpoints(motion)
                self.setpoints.follow(motion, landed=self.landed)
            case Flies.STICKS:
                self.sticks.update(self.mode, motion, landed=self.landed)
                if self.sticks.problem(motion.time_ns) is not None:
                    self._fire(Trigger.STICKS_LOST)
            case Flies.MISSION:
                trigger = self.mission.update(motion, self.home_ned, landed=self.landed)
                if trigger is not None:
                    self._fire(trigger)
            case Flies.TARGET if self.mode is Mode.HOLD:
                trigger = self.watch.in_hold(motion.time_ns, failsafe=self.failsafe)
                if trigger is not None:
                    self._fire(trigger)
            case Flies.TARGET:
                arrival = self.guidance.update(self.mode, motion, self._haven, landed=self.landed)
                if arrival is not None:
                    self._fire(arrival.trigger)
                    self.guidance.aim(arrival.target_ned)

    @property
    def _haven(self) -> Vector:
        """Where a return leads (m)."""
        return self.limits.haven(self.home_ned, self.motion.position_ned)

    def _detect_landing(self, motion: Motion) -> None:
        was_landed = self.landed
        idle, lost = motion.touching and not was_landed and self._is_idle, self.watch.health.position_lost
        self.landed = self._land_detector.update(motion, landed=was_landed, idle=idle, lost=lost)
        if self.landed is not was_landed:
            self._landed_since_ns = motion.time_ns
            self.announce(Severity.INFO, "Landing detected" if self.landed else "Takeoff detected")

    @property
    def _is_idle(self) -> bool:
        """The commanded thrust is low."""
        return bool(self.command["thrust_n"][0] < 0.5 * self.mass_kg * GRAVITY)

    def _watch_setpoints(self, motion: Motion) -> None:
        if self.setpoints.is_lost(motion.time_ns):
            self._fire(Trigger.STREAM_LOST)
        elif self.setpoints.is_stale(motion.time_ns):
            stop_ned = self.guidance.stopping_point(motion, landed=self.landed)
            self.setpoints.brake(stop_ned, motion.yaw, landed=self.landed)
            self.announce(Severity.WARNING, "Offboard setpoint stale: braking")

    def _disarm_when_idle(self, now_ns: int) -> None:
        after_landing_ns, before_ns = self.settings.disarm_landed_ns, self.settings.disarm_preflight_ns
        if self.flown:
            amid_mission = self.mode is Mode.MISSION and not self.mission.finished  # it may take off again, as for PX4
            if amid_mission or self.phase is Mode.TAKEOFF or not self._is_idle:
                self._landed_since_ns = now_ns
            elif 0 < after_landing_ns <= now_ns - self._landed_since_ns:
                self._disarm("Disarmed by landing")
        elif 0 < before_ns <= now_ns - self._armed_since_ns:
            self._disarm(f"Disarmed: no takeoff within {before_ns * 1e-9:g} s")

    def _fire(self, trigger: Trigger) -> None:
        """Change the mode as TRANSITIONS says; a trigger without an entry for the mode changes nothing."""
        row = TRANSITIONS.get((self.mode, trigger))
        if row is None:
            return
        mode, severity, text = row
        if trigger in FAILSAFES and self.armed:
            self.failsafe = True
            self.watch.begin(trigger, self.motion.time_ns)
        self.announce(severity, text)
        self.enter(mode)

    def enter(self, mode: Mode) -> None:
        """Begin to fly in a mode."""
        goes_on = self.mode.flies in (Flies.TARGET, Flies.MISSION)
        self.mode = mode
        self.watch.alive_ns = self.motion.time_ns
        self.guidance.start(mode, self.motion, self._haven, landed=self.landed, goes_on=goes_on)
        if mode is Mode.MISSION:
            self.mission.start(self.motion, self.home_ned, landed=self.landed)
        elif mode.flies is Flies.STICKS:
            self.sticks.start(self.motion)
        elif mode is Mode.OFFBOARD:
            self.setpoints.start(self.motion)
