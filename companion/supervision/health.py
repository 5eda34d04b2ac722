"""The health of a flight at one moment, as a function of what its parts report.

While the companion itself stood still, it heard nothing: that is no fault of the vehicle's. Silences count from the end
of such a gap on.
"""

import math
from typing import NamedTuple

import msgspec

from companion.outcomes import CRITICAL_STATE, crash_words
from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import FlightMode
from companion.supervision.limits import WITHIN, LimitsVerdict
from companion.supervision.operations import OwnReport
from companion.supervision.states import State
from companion.supervision.watching import UNWATCHED, Watched


class Plight(msgspec.Struct, frozen=True, gc=False):
    """What of the health says how the flight comes out, and why."""

    risen: bool = True
    """The companion has seen it leave the ground."""
    full_thrust: bool = False
    """All the thrust that there is was commanded on the ground."""
    allowed: float = 0.0
    """Time (s) that the present step of the mission may take."""
    reason: str = ""
    """What the vehicle said last that may explain a refusal, to stand behind a sentence."""
    emergency: str = ""
    """What the vehicle said of an emergency; empty if nothing."""
    crash: str = ""
    """How it crashed, as it says; empty if it did not."""
    position_lost: bool = False
    """Its estimator says so, whatever position it goes on to tell."""
    unseen: str = "no ring for"
    """Words before the age of the surroundings: what is that old."""
    strayed: float = 0.0
    """m from its reference, as it goes on away from it; 0: it does not."""
    rival: str | None = None
    """Another companion that flies the vehicle, in words."""
    rebooted: bool = False
    """The vehicle has rebooted, and was not armed since: nobody saw how it came down."""
    fell: bool = False
    """It was disarmed in the air."""
    undecided: bool = False
    """It was disarmed just now, and whether in the air or on the ground it has not said yet."""
    awake: float = math.inf
    """s since our own loop was too late last."""
    held: float = 0.0
    """s that it has held, gaps of our own in between counted; 0 while it does not."""

    @property
    def stuck(self) -> str:
        """How a vehicle that has not risen stays on the ground."""
        return "thrust at its limit: too heavy?" if self.full_thrust else "the vehicle does not rise"


UNHARMED = Plight()


class Health(msgspec.Struct, frozen=True, gc=False):
    """Everything that the table asks about, at one tick. Ages in s, infinite for what never came."""

    seen: bool
    missing: str | None
    """The first requirement for the flight that is not met."""
    mode: FlightMode
    current: bool
    """Mode, arming and failsafe are from after the mode was asked for, and after the latest gap of our own."""
    armed: bool
    failsafe: bool
    mission_done: bool
    silence: float
    telemetry_age: float
    heartbeat_age: float
    scan_age: float
    """0 where no ring is needed."""
    refused_telemetry: str | None
    """What was wrong with the telemetry that is being refused, can't be flown by, or comes too late."""
    unsound_output: str | None
    """What was wrong with a setpoint that the gate held back."""
    overrun: float
    """How late the loop was (s) if that was too late just now, else 0."""
    exhausted: str | None
    """The command that was sent as often as allowed, and its answer."""
    adopts: bool
    """A vehicle in flight is to be taken over."""
    land_requested: bool
    landed: bool
    """It stands on the ground, as it says."""
    landed_for: float
    airborne: bool
    """It is in the air, as it says."""
    overdue: float
    """By how much the present step of the mission takes longer than it may (s), else 0."""
    refusal: str | None = None
    """Why this vehicle is not flown, whatever one waits for."""
    plight: Plight = UNHARMED
    watched: Watched = UNWATCHED
    limits: LimitsVerdict = WITHIN

    @property
    def reason(self) -> str:
        """The plight's, for the sentences of the table."""
        return self.plight.reason

    @property
    def distress(self) -> str:
        """How the vehicle says that something is badly wrong with it; empty if it does not."""
        return self.plight.emergency or (CRITICAL_STATE if self.failsafe else "")


class Judged(NamedTuple):
    """What was judged by itself."""

    watched: Watched
    limits: LimitsVerdict = WITHIN
    held: float = 0.0


def health(
    state: State,
    link: LinkReport,
    sensing: SensingReport,
    mission: MissionReport,
    own: OwnReport,
    judged: Judged,
    now_ns: int,
) -> Health:
    """The health of a flight in a state."""
    watched, limits, held = judged
    awake = own.awake_for(now_ns)
    return Health(
        seen=link.found,
        missing=_missing(link, sensing, own, limits) if state < State.FLY else None,
        mode=link.status.mode,
        current=link.word.current,
        armed=link.status.armed,
        failsafe=link.status.failsafe,
        mission_done=mission.done,
        silence=min(link.silence, awake),
        telemetry_age=min(sensing.telemetry_age, awake),
        heartbeat_age=min(link.heartbeat_age, awake),
        scan_age=min(sensing.scan_age, awake),
        refused_telemetry=sensing.contradiction if link.refused is None else link.refused,
        unsound_output=own.unsound_output,
        overrun=own.overrun_ns * 1e-9,
        exhausted=link.exhausted,
        adopts=own.adoption is not None,
        land_requested=own.land_requested,
        landed=link.on_ground is True,
        landed_for=link.word.landed_for,
        airborne=link.word.airborne,
        overdue=mission.overdue if state is State.FLY else 0.0,
        refusal=link.refusal or _of_fence(mission) or own.planner_fault or own.plugin_fault,
        plight=Plight(
            risen=own.airborne,
            full_thrust=own.full_thrust,
            allowed=mission.allowed,
            reason=link.complaint,
            emergency=link.emergency,
            crash=crash_words(link.emergency, fallen=link.status.emergency and not link.status.armed),
            position_lost=link.position_lost,
            unseen=sensing.unseen,
            strayed=own.straying.strayed,
            rival=link.rival,
            rebooted=link.word.rebooted,
            fell=link.word.fell,
            undecided=link.word.undecided,
            awake=awake,
            held=held,
        ),
        watched=watched,
        limits=limits,
    )


def _of_fence(mission: MissionReport) -> str | None:
    return None if mission.outside is None else f"the mission leaves the fence: {mission.outside}"


def _missing(link: LinkReport, sensing: SensingReport, own: OwnReport, limits: LimitsVerdict) -> str | None:
    """The first requirement for the start that is not met."""
    if own.log_fault is not None:
        return f"the flight log fails ({own.log_fault})"
    if link.shortcoming is not None:
        return link.shortcoming
    if not sensing.has_state:
        return "no position and attitude"
    if own.plugin_fault is not None:
        return own.plugin_fault
    if own.planner_fault is not None or not own.planner_ready:
        return own.planner_fault or "the planner is not ready"
    if own.adoption is not None:
        return None if link.home_known else "the vehicle does not say where it took off (HOME_POSITION)"
    if link.on_ground is False:
        return "the vehicle does not say that it stands on the ground"
    if not link.prearm_ok:
        return f"the vehicle's own arming checks fail{link.failed_check}"
    return limits.battery.missing
