"""The health of a flight at one moment, as a function of what its parts report."""

import msgspec

from companion.reports import LinkReport, MissionReport, SensingReport
from companion.state import BatteryLevel, FlightMode
from companion.supervision.limits import WITHIN, LimitsVerdict
from companion.supervision.operations import OwnReport
from companion.supervision.states import State


class Health(msgspec.Struct, frozen=True, gc=False):
    """Everything that the table asks about, at one tick. Ages in s, infinite for what never came."""

    seen: bool
    missing: str | None
    """The first requirement for the flight that is not met."""
    mode: FlightMode
    armed: bool
    failsafe: bool
    mission_done: bool
    silence: float
    telemetry_age: float
    heartbeat_age: float
    scan_age: float
    """0 where no ring is needed."""
    refused_telemetry: str | None
    """What was wrong with the telemetry that is being refused."""
    unsound_output: str | None
    """What was wrong with a setpoint that the gate held back."""
    overrun: float
    """How late the loop was (s) if that was too late just now, else 0."""
    exhausted: str | None
    """The command that was sent as often as allowed, and its answer."""
    land_requested: bool
    taken_over: bool
    """The mode that was commanded had been reached, and was changed since."""
    landed: bool
    """It stands on the ground, as it says."""
    overdue: float
    """By how much the present step of the mission takes longer than it may (s), else 0."""
    reason: str
    """What the vehicle said last that may explain a refusal."""
    battery: BatteryLevel = BatteryLevel.FINE
    """What the battery calls for,"""
    battery_text: str = ""
    """and why."""
    homeward: bool = False
    """The mission leads to its landing place as directly as the way home would."""
    outside: str | None = None
    """The place of the mission that is beyond the fence."""
    beyond: str | None = None
    """How the vehicle is beyond the fence and does not come back."""


def health(
    state: State,
    link: LinkReport,
    sensing: SensingReport,
    mission: MissionReport,
    own: OwnReport,
    taken_over: bool,
    limits: LimitsVerdict = WITHIN,
) -> Health:
    """The health of a flight in a state; `taken_over`: others have changed the mode that was commanded."""
    return Health(
        seen=link.found,
        missing=_missing(link, sensing, own, limits) if state < State.FLY else None,
        mode=link.status.mode,
        armed=link.status.armed,
        failsafe=link.status.failsafe,
        mission_done=mission.done,
        silence=link.silence,
        telemetry_age=sensing.telemetry_age,
        heartbeat_age=link.heartbeat_age,
        scan_age=sensing.scan_age,
        refused_telemetry=link.refused,
        unsound_output=own.unsound_output,
        overrun=own.overrun_ns * 1e-9,
        exhausted=link.exhausted,
        land_requested=own.land_requested,
        taken_over=taken_over,
        landed=link.on_ground,
        overdue=mission.overdue if state is State.FLY else 0.0,
        reason=link.complaint,
        battery=limits.battery.level,
        battery_text=limits.battery.text,
        homeward=mission.homeward,
        outside=mission.outside,
        beyond=limits.beyond,
    )


def _missing(link: LinkReport, sensing: SensingReport, own: OwnReport, limits: LimitsVerdict) -> str | None:
    """The first requirement for the start that is not met."""
    if own.log_fault is not None:
        return f"the flight log fails ({own.log_fault})"
    if link.shortcoming is not None:
        return link.shortcoming
    if not sensing.has_state:
        return "no position and attitude"
    if not link.on_ground:
        return "the vehicle does not say that it stands on the ground"
    if not link.prearm_ok:
        return f"the vehicle's own arming checks fail{link.complaint}"
    return limits.battery.missing
