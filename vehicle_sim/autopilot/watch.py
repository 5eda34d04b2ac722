"""What makes the vehicle change its mode by itself because something is wrong, by PX4's parameters."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from protocol.arrays import Array
from vehicle_sim.autopilot.modes import Mode, Severity, Trigger
from vehicle_sim.autopilot.settings import SECOND_NS, Settings
from vehicle_sim.physics.motion import Motion

EARLY_NS = 4 * SECOND_NS
"""After arming an attitude failure disarms for this time: PX4's COM_SPOOLUP_TIME and 3 s."""
ATTITUDE_NS = 300_000_000
"""Time of too much tilt after which the attitude has failed: FD_FAIL_R_TTRI, FD_FAIL_P_TTRI."""
MOTOR_NS = 100_000_000
"""Time of a motor at rest that should turn after which it has failed: FD_ACT_MOT_TOUT."""
_TURNING = 0.2
"""Share of full thrust from which a motor should turn, FD_ACT_MOT_THR; and of full speed below which it does not."""

_LOW, _CRITICAL, _EMERGENCY = 1, 2, 3
_LOW_BATTERY = {
    (_CRITICAL, 1): Trigger.BATTERY_RETURNS,
    (_CRITICAL, 2): Trigger.BATTERY_LANDS,
    (_CRITICAL, 3): Trigger.BATTERY_RETURNS,
    (_EMERGENCY, 1): Trigger.BATTERY_RETURNS,
    (_EMERGENCY, 2): Trigger.BATTERY_LANDS,
    (_EMERGENCY, 3): Trigger.BATTERY_LANDS,
}
"""What follows a stage of the battery, by COM_LOW_BAT_ACT; nothing but the text otherwise."""
_STAGES = {_LOW: "Low battery level", _CRITICAL: "Critical battery level", _EMERGENCY: "Emergency battery level"}


@dataclass(slots=True)
class Health:
    """What the autopilot is told of the vehicle's parts."""

    position_lost: bool = False
    """The estimator has no position to fly by."""
    charge: float = 1.0
    """Share of a full battery."""
    drained: bool = False
    """The battery says that it is empty."""
    full_speed: float = 0.0
    """A rotor's highest speed (rad/s)."""
    commanded_speeds: Array = field(default_factory=lambda: np.zeros(4))
    """(4,) The speeds of the rotors (rad/s) that were commanded last."""


class Watch:
    """Looks at the vehicle once a tick while it is armed."""

    def __init__(self, settings: Settings, announce: Callable[[Severity, str], None]) -> None:
        self._settings = settings
        self._announce = announce
        self.health = Health()
        self._then: Trigger | None = None
        """What follows the hold that a failsafe has begun with."""
        self._held_ns = 0
        """Since when it holds."""
        self.alive_ns = 0
        """Time of the latest heartbeat, or change of mode."""
        self._armed_ns = 0
        self._stage = 0
        """Stage of the battery."""
        self._level_ns = 0
        """When the tilt was small last."""
        self._turning_ns = [0, 0, 0, 0]
        """When each motor turned, or did not have to, last."""
        self._told: set[str] = set()

    def arm(self, now_ns: int) -> None:
        """The motors start. A battery that is low already makes nothing happen, as in PX4, until it is lower."""
        self._armed_ns = self._level_ns = now_ns
        self._turning_ns = [now_ns] * 4
        self._stage = self.stage
        self._told.clear()

    @property
    def stage(self) -> int:
        """The battery's stage: 0 good, 1 low, 2 critical, 3 emergency."""
        s, charge = self._settings, 0.0 if self.health.drained else self.health.charge
        below = (charge < s.battery.low, charge < s.battery.critical, charge < s.battery.emergency)
        return max(stage * is_so for stage, is_so in zip((_LOW, _CRITICAL, _EMERGENCY), below, strict=True))

    def arming_problem(self, mode: Mode) -> str | None:
        """Why the vehicle can't be armed in a mode, or None; PX4's texts."""
        if self.stage >= _CRITICAL:
            return _STAGES[self.stage]
        return self.navigation_problem(mode)

    def navigation_problem(self, mode: Mode) -> str | None:
        """Why a mode can't be flown, or None."""
        if self.health.position_lost and mode.needs_position:
            return "Navigation error: No valid position estimate"
        return None

    def begin(self, failsafe: Trigger, now_ns: int) -> None:
        """A failsafe begins; if it is a hold, note what follows after COM_FAIL_ACT_T if nobody takes over."""
        self._held_ns = now_ns
        follows = {Trigger.STREAM_LOST: self._settings.stream_loss, Trigger.BATTERY_HOLDS: self._battery_action}
        self._then = follows.get(failsafe)

    def in_hold(self, now_ns: int, *, failsafe: bool) -> Trigger | None:
        """What ends a hold now, if anything: the next part of its failsafe, or a lost link."""
        s = self._settings
        if failsafe and self._then is not None and now_ns - self._held_ns >= s.failsafe_hold_ns:
            then, self._then = self._then, None
            return then
        return s.link_loss if now_ns - self.alive_ns >= s.link_loss_ns else None

    def update(self, motion: Motion, *, needs_position: bool, failsafe: bool) -> Trigger | None:
        """What has gone wrong by the end of a tick, if anything. `failsafe`: one is being flown already, or a return,
        so that nothing needs a hold before it."""
        if self.health.position_lost and needs_position:
            return Trigger.POSITION_LOST
        trigger = self._attitude(motion)
        if trigger is not None:
            return trigger
        self._motors(motion)
        return self._battery(failsafe=failsafe)

    @property
    def _battery_action(self) -> Trigger | None:
        return _LOW_BATTERY.get((self._stage, self._settings.battery.action))

    def _battery(self, *, failsafe: bool) -> Trigger | None:
        stage = self.stage
        if stage <= self._stage:
            return None
        self._stage = stage
        self._announce(Severity.CRITICAL if stage > _LOW else Severity.WARNING, _STAGES[stage])
        action = self._battery_action
        return action if action is None or failsafe else Trigger.BATTERY_HOLDS

    def _attitude(self, motion: Motion) -> Trigger | None:
        """Too much roll or pitch for some time: the motors stop early after arming, or where that is allowed."""
        s, now_ns = self._settings, motion.time_ns
        if not (s.roll_failure_deg or s.pitch_failure_deg):
            return None
        roll, pitch = (abs(math.degrees(angle)) for angle in motion.roll_pitch)
        if not (0 < s.roll_failure_deg < roll or 0 < s.pitch_failure_deg < pitch):
            self._level_ns = now_ns
        if now_ns - self._level_ns < ATTITUDE_NS:
            return None
        self._tell("Attitude failure detected")
        if now_ns - self._armed_ns < EARLY_NS:
            return Trigger.ATTITUDE_FAILED_EARLY
        return Trigger.ATTITUDE_FAILED if s.terminates else None

    def _motors(self, motion: Motion) -> None:
        """A motor that is commanded to turn and does not; one that the mixer holds still is not commanded."""
        full = self.health.full_speed
        if min(motion.rotor_speeds) > _TURNING * full:
            self._turning_ns = [motion.time_ns] * 4
            return
        commanded = self.health.commanded_speeds.tolist()
        for motor, (speed, wanted) in enumerate(zip(motion.rotor_speeds, commanded, strict=True)):
            if wanted * wanted < _TURNING * full * full or speed > _TURNING * full:
                self._turning_ns[motor] = motion.time_ns
            elif motion.time_ns - self._turning_ns[motor] >= MOTOR_NS:
                self._tell("Motor failure detected")

    def _tell(self, text: str) -> None:
        """Once a flight."""
        if text not in self._told:
            self._told.add(text)
            self._announce(Severity.CRITICAL, text)
