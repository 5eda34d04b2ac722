"""The table of transitions: from which states, on which condition, to which state, and what is said.

A fault ends in the safest state that can still be reached: HOLD keeps flying our own setpoints at a standstill (the
state is known); WITHDRAW asks the vehicle's own autopilot to hold (the state is not known, or our output can't be
trusted); both become LAND.

The vehicle's own failsafe is never a pilot. Where it has the vehicle, nothing is commanded that would end it: WATCH
sends no setpoint, since PX4 returns to external control as soon as it hears one, and looks on until the vehicle is
landed and disarmed. Only a vehicle that does not come down is asked to land. After a gap of our own (GAP) no setpoint
leaves before a heartbeat from after the gap says whose the vehicle is. Mode and arming are judged by heartbeats that
are newer than what was asked for (`Health.current`).

Whoever asked for arming disarms before leaving, on the ground (DISARM).

A change of mode that was not commanded is the pilot, who is never fought: nothing is commanded from then on. In the
middle of a mission that is RELINQUISHED: for a time, setpoints to stay wherever the vehicle is go on being sent, which
no vehicle obeys outside of external control and none enters it without. Whoever puts the vehicle into external control
again gives it back, and the mission goes on. In every other case it is RELEASED, and nothing leads back from there.
"""

from companion.outcomes import Outcome
from companion.supervision.rows import CRITICAL, Row, row
from companion.supervision.rows_before_flight import BEFORE, BEFORE_FLIGHT
from companion.supervision.rows_in_flight import IN_FLIGHT
from companion.supervision.states import FLYING, State

_SILENT = "the vehicle is silent for {health.silence:.1f} s: given up"

TABLE: tuple[Row, ...] = (
    # the end of everything
    row(
        BEFORE - {State.ARM},
        lambda h, s, t: h.silence > s.silence_timeout and not h.armed,
        State.ENDED,
        CRITICAL,
        _SILENT,
        ends=Outcome.NOT_STARTED,
    ),
    row(
        BEFORE | FLYING | {State.RELEASED, State.DISARM},
        lambda h, s, t: h.silence > s.silence_timeout,
        State.ENDED,
        CRITICAL,
        _SILENT,
        ends=Outcome.LOST,
    ),
    row(
        FLYING | {State.RELEASED},
        lambda h, s, t: h.plight.crash != "" and not h.armed,
        State.ENDED,
        CRITICAL,
        "crashed: {health.plight.crash}",
        ends=Outcome.CRASHED,
        cause="{health.plight.crash}",
    ),
    row(
        FLYING | {State.RELEASED, State.DISARM},
        lambda h, s, t: h.plight.fell and not h.armed,
        State.ENDED,
        CRITICAL,
        "disarmed in the air{health.reason}",
        ends=Outcome.CRASHED,
    ),
    row(
        FLYING | {State.RELEASED},
        lambda h, s, t: h.plight.rebooted and not h.armed,
        State.ENDED,
        CRITICAL,
        "the vehicle rebooted while it was armed: how it came down is not known",
        ends=Outcome.LOST,
        cause="the vehicle rebooted while it was armed",
    ),
    *BEFORE_FLIGHT,
    *IN_FLIGHT,
)
