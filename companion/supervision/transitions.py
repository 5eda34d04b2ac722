"""The table of transitions: from which states, on which condition, to which state, and what is said.

A fault ends in the safest state that can still be reached: HOLD keeps flying our own setpoints at a standstill (the
state is known); WITHDRAW asks the vehicle's own autopilot to hold (the state is not known, or our output can't be
trusted); both become LAND.

A change of mode that was not commanded is the pilot, who is never fought: nothing is commanded from then on. In the
middle of a mission that is RELINQUISHED: for a time, setpoints to stay wherever the vehicle is go on being sent, which
no vehicle obeys outside of external control and none enters it without. Whoever puts the vehicle into external control
again gives it back, and the mission goes on. In every other case it is RELEASED, and nothing leads back from there.
"""

from collections.abc import Callable
from dataclasses import dataclass

from companion.config import Supervision
from companion.state import BatteryLevel, FlightMode, Severity
from companion.supervision.health import Health
from companion.supervision.states import FLYING, State


@dataclass(frozen=True, slots=True)
class Row:
    """From any of `states`, when `condition` holds (health, settings, seconds in the state), to `to`, saying `text`."""

    states: frozenset[State]
    condition: Callable[[Health, Supervision, float], bool]
    to: State
    severity: Severity
    text: str
    """Formatted with the health and the settings."""
    fault: bool = False
    """The flight has failed: the outcome says so,"""
    outcome: str = ""
    """in these words, formatted with the health; left out, in those of `text`."""


def _row(
    states: State | frozenset[State],
    condition: Callable[[Health, Supervision, float], bool],
    to: State,
    severity: Severity,
    text: str,
    *,
    fault: bool = False,
    outcome: str = "",
) -> Row:
    states = states if isinstance(states, frozenset) else frozenset({states})
    return Row(states, condition, to, severity, text, fault, outcome)


_OWN = frozenset({State.FLY, State.HOLD})
_BEFORE = frozenset({State.CHECK, State.STREAM, State.ENGAGE, State.ARM})
_I, _N, _W, _E, _C = Severity.INFO, Severity.NOTICE, Severity.WARNING, Severity.ERROR, Severity.CRITICAL

TABLE: tuple[Row, ...] = (
    # the end of everything
    _row(
        _BEFORE | FLYING | {State.RELEASED},
        lambda h, s, t: h.silence > s.silence_timeout,
        State.ENDED,
        _C,
        "the vehicle is silent for {health.silence:.1f} s: given up",
        fault=True,
    ),
    # the way to the start
    _row(State.FIND, lambda h, s, t: h.seen, State.CHECK, _I, "vehicle found"),
    _row(
        State.FIND,
        lambda h, s, t: h.land_requested or t > s.find_timeout,
        State.ENDED,
        _E,
        "no vehicle within {settings.find_timeout:g} s",
        fault=True,
    ),
    _row(
        _BEFORE - {State.ARM},
        lambda h, s, t: h.land_requested,
        State.ENDED,
        _N,
        "called off before the start",
        fault=True,
    ),
    _row(
        State.CHECK,
        lambda h, s, t: h.armed,
        State.ENDED,
        _E,
        "the vehicle is armed already: not taken over",
        fault=True,
    ),
    _row(
        State.CHECK,
        lambda h, s, t: h.outside is not None,
        State.ENDED,
        _E,
        "the mission leaves the fence: {health.outside}",
        fault=True,
    ),
    _row(State.CHECK, lambda h, s, t: h.missing is None, State.STREAM, _I, "ready"),
    _row(
        State.CHECK,
        lambda h, s, t: t > s.ready_timeout,
        State.ENDED,
        _E,
        "not ready: {health.missing}",
        fault=True,
    ),
    _row(State.STREAM, lambda h, s, t: h.missing is not None, State.CHECK, _W, "not ready yet: {health.missing}"),
    _row(State.STREAM, lambda h, s, t: t >= s.stream_before_engaging, State.ENGAGE, _I, "asking for control"),
    _row(State.ENGAGE, lambda h, s, t: h.mode is FlightMode.EXTERNAL, State.ARM, _I, "in control, arming"),
    _row(
        State.ARM,
        lambda h, s, t: h.mode is not FlightMode.EXTERNAL,
        State.RELEASED,
        _W,
        "the pilot took over before arming",
        fault=True,
    ),
    _row(State.ARM, lambda h, s, t: h.land_requested, State.LAND, _N, "called off while arming", fault=True),
    _row(State.ARM, lambda h, s, t: h.armed, State.FLY, _N, "armed, taking off"),
    _row(
        frozenset({State.ENGAGE, State.ARM}),
        lambda h, s, t: h.exhausted is not None,
        State.ENDED,
        _E,
        "the vehicle refuses: {health.exhausted}{health.reason}",
        fault=True,
    ),
    _row(
        frozenset({State.ENGAGE, State.ARM}),
        lambda h, s, t: h.missing is not None,
        State.ENDED,
        _E,
        "no longer ready: {health.missing}",
        fault=True,
    ),
    # faults in flight, the worst first
    _row(
        _OWN,
        lambda h, s, t: h.telemetry_age > s.telemetry_timeout,
        State.WITHDRAW,
        _C,
        "telemetry lost for {health.telemetry_age:.2f} s: the vehicle is asked to hold",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.heartbeat_age > s.heartbeat_timeout,
        State.WITHDRAW,
        _C,
        "no heartbeat for {health.heartbeat_age:.1f} s: the vehicle is asked to hold",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.mode is not FlightMode.EXTERNAL and h.failsafe,
        State.RELEASED,
        _W,
        "the vehicle changed to {health.mode.value} in failsafe: letting go{health.reason}",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.mode is not FlightMode.EXTERNAL,
        State.RELINQUISHED,
        _W,
        "mode changed to {health.mode.value} by others: theirs, until they give it back{health.reason}",
    ),
    _row(
        _OWN,
        lambda h, s, t: not h.armed,
        State.ENDED,
        _C,
        "disarmed in flight by others{health.reason}",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.refused_telemetry is not None,
        State.WITHDRAW,
        _C,
        "bad telemetry ({health.refused_telemetry}): the vehicle is asked to hold",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.unsound_output is not None,
        State.WITHDRAW,
        _C,
        "unsound setpoint held back ({health.unsound_output}): the vehicle is asked to hold",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.failsafe,
        State.WITHDRAW,
        _C,
        "the vehicle is in failsafe: it is asked to hold{health.reason}",
        fault=True,
    ),
    _row(
        _OWN,
        lambda h, s, t: h.land_requested,
        State.LAND,
        _N,
        "landing on request (interrupt again to abandon)",
        fault=True,
        outcome="called off in flight",
    ),
    _row(
        _OWN,
        lambda h, s, t: h.battery is BatteryLevel.LAND,
        State.LAND,
        _C,
        "{health.battery_text}: landing",
        fault=True,
        outcome="landed: {health.battery_text}",
    ),
    _row(
        _OWN,
        lambda h, s, t: h.beyond is not None,
        State.LAND,
        _C,
        "{health.beyond}: landing",
        fault=True,
        outcome="landed: {health.beyond}",
    ),
    _row(
        State.FLY,
        lambda h, s, t: h.overdue > 0.0,
        State.LAND,
        _E,
        "no progress: this step of the mission is {health.overdue:.0f} s overdue, landing",
        fault=True,
    ),
    _row(
        State.FLY,
        lambda h, s, t: h.overrun > 0.0,
        State.HOLD,
        _E,
        "own loop was {health.overrun:.2f} s late: holding",
    ),
    _row(
        State.FLY,
        lambda h, s, t: h.scan_age > s.scan_timeout,
        State.HOLD,
        _E,
        "no ring for {health.scan_age:.2f} s: holding",
    ),
    _row(
        State.FLY,
        lambda h, s, t: h.battery is BatteryLevel.RETURN and not h.homeward,
        State.FLY,
        _C,
        "{health.battery_text}: returning",
        fault=True,
        outcome="returned: {health.battery_text}",
    ),
    _row(
        State.HOLD,
        lambda h, s, t: t > s.land_after,
        State.LAND,
        _C,
        "holding for {settings.land_after:g} s without a cure: landing",
        fault=True,
    ),
    _row(
        State.HOLD,
        lambda h, s, t: t > s.least_hold and h.overrun == 0.0 and h.scan_age <= s.scan_timeout,
        State.FLY,
        _N,
        "cured: going on",
    ),
    _row(State.FLY, lambda h, s, t: h.mission_done, State.LAND, _N, "landing"),
    # others fly, and may give control back
    _row(
        State.RELINQUISHED,
        lambda h, s, t: h.land_requested,
        State.ENDED,
        _W,
        "leaving: others fly",
        fault=True,
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: not h.armed,
        State.ENDED,
        _N,
        "the vehicle is disarmed",
        fault=True,
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: h.landed,
        State.RELEASED,
        _W,
        "landed by others: letting go",
        fault=True,
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: h.mode is FlightMode.EXTERNAL and h.telemetry_age > s.telemetry_timeout,
        State.WITHDRAW,
        _C,
        "control is given back without telemetry for {health.telemetry_age:.2f} s: the vehicle is asked to hold",
        fault=True,
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: h.mode is FlightMode.EXTERNAL,
        State.HOLD,
        _N,
        "control is given back: holding, then going on",
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: h.failsafe,
        State.RELEASED,
        _W,
        "the vehicle is in failsafe: letting go{health.reason}",
        fault=True,
    ),
    _row(
        State.RELINQUISHED,
        lambda h, s, t: t > s.resume_within,
        State.RELEASED,
        _W,
        "not given back within {settings.resume_within:g} s: letting go",
        fault=True,
    ),
    # withdrawn, landing, released
    _row(
        State.WITHDRAW,
        lambda h, s, t: h.heartbeat_age < s.heartbeat_timeout and not h.armed,
        State.ENDED,
        _W,
        "the vehicle is disarmed",
        fault=True,
    ),
    _row(
        State.WITHDRAW,
        lambda h, s, t: h.taken_over or h.mode not in (FlightMode.EXTERNAL, FlightMode.HOLD),
        State.RELEASED,
        _W,
        "mode changed to {health.mode.value} by others: letting go{health.reason}",
        fault=True,
    ),
    _row(
        State.WITHDRAW,
        lambda h, s, t: t > s.land_after,
        State.LAND,
        _C,
        "held for {settings.land_after:g} s: landing",
        fault=True,
    ),
    _row(
        State.LAND,
        lambda h, s, t: t > s.least_hold and h.heartbeat_age < s.heartbeat_timeout and not h.armed,
        State.ENDED,
        _N,
        "landed and disarmed",
    ),
    _row(
        State.LAND,
        lambda h, s, t: h.taken_over or h.mode not in (FlightMode.EXTERNAL, FlightMode.HOLD, FlightMode.LAND),
        State.RELEASED,
        _W,
        "mode changed to {health.mode.value} by others: letting go{health.reason}",
        fault=True,
    ),
    _row(
        State.LAND,
        lambda h, s, t: t > s.landing_timeout,
        State.ENDED,
        _C,
        "landing not confirmed within {settings.landing_timeout:g} s",
        fault=True,
    ),
    _row(
        State.RELEASED,
        lambda h, s, t: h.land_requested,
        State.ENDED,
        _W,
        "leaving: others fly",
        fault=True,
    ),
    _row(State.RELEASED, lambda h, s, t: not h.armed, State.ENDED, _N, "the vehicle is disarmed", fault=True),
)
