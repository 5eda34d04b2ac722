"""A row of the table of transitions, and what several rows ask."""

from collections.abc import Callable
from dataclasses import dataclass

from companion.config import Supervision
from companion.outcomes import Outcome
from companion.state import FlightMode, Severity
from companion.supervision.health import Health
from companion.supervision.states import State

Condition = Callable[[Health, Supervision, float], bool]
"""A condition on the health, the settings and the seconds in the state."""


@dataclass(frozen=True, slots=True)
class Row:
    """From any of `states`, when `condition` holds, to `to`, saying `text`."""

    states: frozenset[State]
    condition: Condition
    to: State
    severity: Severity
    text: str
    """Formatted with the health and the settings."""
    ends: Outcome | None = None
    """How the flight comes out, unless something worse follows; None: this does not decide it."""
    cause: str = ""
    """Why, formatted likewise; left out, in the words of `text`."""


def row(
    states: State | frozenset[State],
    condition: Condition,
    to: State,
    severity: Severity,
    text: str,
    *,
    ends: Outcome | None = None,
    cause: str = "",
) -> Row:
    """A row from one state or several."""
    states = states if isinstance(states, frozenset) else frozenset({states})
    return Row(states, condition, to, severity, text, ends, cause)


def left(h: Health) -> bool:
    """The vehicle has left external control."""
    return h.current and h.mode is not FlightMode.EXTERNAL


def elsewhere(h: Health, *expected: FlightMode) -> bool:
    """The vehicle is in none of the modes that may follow a command, and armed: the mode that it falls into when it is
    disarmed is nobody's choice."""
    return h.current and h.armed and (h.watched.taken_over or h.mode not in (FlightMode.EXTERNAL, *expected))


def disarmed(h: Health, s: Supervision) -> bool:
    """The vehicle says so, and has not fallen silent. Its word of the ground is waited for, and after a pause its
    telemetry, which shows whether it has rebooted; at most for as long as a vehicle may be silent."""
    waits = h.plight.undecided or s.telemetry_timeout < h.telemetry_age <= s.silence_timeout
    return h.current and h.heartbeat_age < s.heartbeat_timeout and not h.armed and not waits


INFO, NOTICE, WARNING, ERROR, CRITICAL = (
    Severity.INFO,
    Severity.NOTICE,
    Severity.WARNING,
    Severity.ERROR,
    Severity.CRITICAL,
)
