"""What the operator asks for and what fails around the autopilot."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ParamSpec, TypeVar

from companion.config import Supervision
from companion.plugins import PluginError
from companion.state import Adoption, Announcement, Setpoint, Severity
from companion.supervision.gate import unsound
from companion.supervision.straying import Straying

Asked = ParamSpec("Asked")
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class LandRequest:
    """The operator asks for a landing."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class LogFault:
    """The flight log can't be written."""

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class LogRecovered:
    """The flight log is written again."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class PlannerStarting:
    """The planner gets ready, and answers no request before it is."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class PlannerReady:
    """The planner answers requests from now on."""

    time_ns: int


@dataclass(frozen=True, slots=True)
class PlannerFault:
    """The planner will answer no more requests."""

    time_ns: int
    text: str


@dataclass(frozen=True, slots=True)
class OrderRequest:
    """Somebody orders what is flown next."""

    time_ns: int
    text: str
    """An `Order` of `companion.mission.orders` as JSON."""


Operation = LandRequest | LogFault | LogRecovered | PlannerStarting | PlannerReady | PlannerFault | OrderRequest


class OwnReport:
    """What the companion knows of itself and of its operator, from one look at the health to the next."""

    def __init__(self, settings: Supervision, adoption: Adoption | None = None, highest_thrust: float = 1.0) -> None:
        self.adoption = adoption
        """The operator's consent to take over a vehicle in flight, and what for."""
        self._overrun_ns = settings.overrun * 1e9
        self.unsound_output: str | None = None
        """What was wrong with the setpoint that the gate held back last."""
        self.overrun_ns = 0
        """How late the loop was, if that was too late."""
        self._awake_ns: int | None = None
        """The end of the latest overrun."""
        self.land_requested = False
        self.log_fault: str | None = None
        self.planner_ready = True
        self.planner_fault: str | None = None
        self.plugin_fault: str | None = None
        """What a law or an output of another package did wrong last."""
        self.airborne = adoption is not None
        """It flies the vehicle in the air."""
        self.straying = Straying(settings.stray_distance)
        """How it keeps to its reference while the companion flies it."""
        self.full_thrust = False
        """It asked for all the thrust that there is to leave the ground."""
        self._highest_thrust = highest_thrust

    def take(self, event: Operation) -> Announcement | None:
        """Take an event in; what is to be said of it."""
        match event:
            case LandRequest():
                self.land_requested = True
            case LogFault():
                first, self.log_fault = self.log_fault is None, event.text
                return Announcement(Severity.CRITICAL, f"the flight log fails: {event.text}") if first else None
            case LogRecovered():
                self.log_fault = None
                return Announcement(Severity.NOTICE, "the flight log is written again")
            case PlannerStarting() | PlannerReady():
                self.planner_ready = isinstance(event, PlannerReady)
            case PlannerFault():
                self.planner_fault = event.text
                return Announcement(Severity.CRITICAL, f"no map any more: {event.text}")
        return None

    def passes(self, setpoint: Setpoint, airborne: bool) -> bool:
        """The last gate: a setpoint that is not sound must stay here. `airborne`: it is for a vehicle in the air."""
        reason = unsound(setpoint)
        self.airborne = airborne
        self.full_thrust = self.full_thrust or (not airborne and setpoint.thrust >= self._highest_thrust)
        if reason is not None:
            self.unsound_output = reason
        return reason is None

    def sound(self, step: Callable[Asked, Made], *asked: Asked.args, **named: Asked.kwargs) -> Made | None:
        """What a step of control makes; nothing where a law or an output of another package fails in it, which counts
        as an unsound setpoint."""
        try:
            return step(*asked, **named)
        except PluginError as error:
            self.plugin_fault = self.unsound_output = str(error)
            return None

    def ticked(self, late_ns: int, now_ns: int) -> bool:
        """A tick of the loop was so late; whether that was too late."""
        if late_ns <= self._overrun_ns:
            return False
        self.overrun_ns, self._awake_ns = late_ns, now_ns
        return True

    def awake_for(self, now_ns: int) -> float:
        """s since the latest overrun; infinite before the first."""
        return math.inf if self._awake_ns is None else (now_ns - self._awake_ns) * 1e-9

    def begin(self) -> None:
        """The health was looked at: forget what concerned the time before."""
        self.unsound_output = None
        self.overrun_ns = 0
