"""The rows of the way to the start, and of the way back from arming."""

from companion.outcomes import Outcome
from companion.state import FlightMode
from companion.supervision.rows import CRITICAL, ERROR, INFO, NOTICE, WARNING, Row, disarmed, left, row
from companion.supervision.states import State

BEFORE = frozenset({State.CHECK, State.STREAM, State.ENGAGE, State.ARM})

BEFORE_FLIGHT: tuple[Row, ...] = (
    # the way to the start
    row(State.FIND, lambda h, s, t: h.seen, State.CHECK, INFO, "vehicle found"),
    row(
        State.FIND,
        lambda h, s, t: t > s.find_timeout,
        State.ENDED,
        ERROR,
        "no vehicle within {settings.find_timeout:g} s",
        ends=Outcome.NOT_STARTED,
    ),
    row(
        BEFORE - {State.ARM} | {State.FIND},
        lambda h, s, t: h.land_requested,
        State.ENDED,
        NOTICE,
        "called off before the start",
        ends=Outcome.CALLED_OFF,
    ),
    row(
        State.CHECK,
        lambda h, s, t: (h.armed or h.airborne) and not h.adopts,
        State.ENDED,
        ERROR,
        "the vehicle is armed already: not taken over (--adopt takes over a vehicle in flight)",
        ends=Outcome.NOT_STARTED,
        cause="the vehicle is armed already: not taken over",
    ),
    row(
        frozenset({State.CHECK, State.ADOPT}),
        lambda h, s, t: h.adopts and h.current and not h.armed,
        State.ENDED,
        ERROR,
        "the vehicle is not armed: there is nothing to take over",
        ends=Outcome.NOT_STARTED,
    ),
    row(
        State.CHECK,
        lambda h, s, t: h.refusal is not None,
        State.ENDED,
        ERROR,
        "not flown: {health.refusal}",
        ends=Outcome.NOT_STARTED,
        cause="{health.refusal}",
    ),
    row(
        frozenset({State.CHECK, State.ADOPT}),
        lambda h, s, t: h.adopts and h.landed,
        State.ENDED,
        ERROR,
        "the vehicle stands on the ground: not taken over",
        ends=Outcome.NOT_STARTED,
    ),
    row(
        State.CHECK,
        lambda h, s, t: (
            h.adopts
            and h.airborne
            and h.missing is None
            and h.telemetry_age <= s.telemetry_timeout
            and (h.mode is not FlightMode.EXTERNAL or t > s.listen_before_adopting)
        ),
        State.ADOPT,
        NOTICE,
        "taking the vehicle over in flight",
    ),
    row(State.CHECK, lambda h, s, t: not h.adopts and h.missing is None, State.STREAM, INFO, "ready"),
    # taken over in flight; once control was asked for it may be ours at any moment, and who has it lands
    row(
        State.ADOPT,
        lambda h, s, t: h.land_requested and h.current and h.mode is not FlightMode.EXTERNAL,
        State.ENDED,
        NOTICE,
        "called off before the vehicle was taken over",
        ends=Outcome.CALLED_OFF,
    ),
    row(
        State.ADOPT,
        lambda h, s, t: h.overrun > s.gap,
        State.CHECK,
        WARNING,
        "not taken over yet: own loop was {health.overrun:.2f} s late",
    ),
    row(
        State.ADOPT,
        lambda h, s, t: h.telemetry_age > s.telemetry_timeout,
        State.CHECK,
        WARNING,
        "not taken over yet: telemetry lost for {health.telemetry_age:.2f} s",
    ),
    row(
        State.ADOPT,
        lambda h, s, t: h.plight.rival is not None,
        State.CHECK,
        WARNING,
        "not taken over yet: {health.plight.rival}",
    ),
    row(
        State.ADOPT,
        lambda h, s, t: h.current and h.mode is FlightMode.EXTERNAL,
        State.HOLD,
        NOTICE,
        "taken over: holding",
    ),
    row(
        State.ADOPT,
        lambda h, s, t: h.exhausted is not None,
        State.ENDED,
        ERROR,
        "the vehicle refuses: {health.exhausted}{health.reason}",
        ends=Outcome.NOT_STARTED,
    ),
    # on the way to the start
    row(
        State.CHECK,
        lambda h, s, t: t > s.ready_timeout,
        State.ENDED,
        ERROR,
        "not ready: {health.missing}",
        ends=Outcome.NOT_STARTED,
    ),
    row(State.STREAM, lambda h, s, t: h.missing is not None, State.CHECK, WARNING, "not ready yet: {health.missing}"),
    row(
        frozenset({State.STREAM, State.ENGAGE}),
        lambda h, s, t: h.armed,
        State.ENDED,
        ERROR,
        "armed by others: not taken over",
        ends=Outcome.NOT_STARTED,
    ),
    row(State.STREAM, lambda h, s, t: t >= s.stream_before_engaging, State.ENGAGE, INFO, "asking for control"),
    row(State.ENGAGE, lambda h, s, t: h.mode is FlightMode.EXTERNAL, State.ARM, INFO, "in control, arming"),
    row(
        State.ARM,
        lambda h, s, t: left(h),
        State.DISARM,
        WARNING,
        "mode changed to {health.mode.value} while arming: disarming, and letting go{health.reason}",
        ends=Outcome.NOT_STARTED,
        cause="the pilot took over before arming",
    ),
    row(
        State.ARM,
        lambda h, s, t: h.land_requested,
        State.DISARM,
        NOTICE,
        "called off while arming: disarming",
        ends=Outcome.CALLED_OFF,
        cause="called off while arming",
    ),
    row(
        State.ARM,
        lambda h, s, t: h.overrun > s.gap,
        State.DISARM,
        ERROR,
        "own loop was {health.overrun:.2f} s late while arming: disarming",
        ends=Outcome.NOT_STARTED,
    ),
    row(State.ARM, lambda h, s, t: h.armed, State.FLY, NOTICE, "armed, taking off"),
    row(
        State.ENGAGE,
        lambda h, s, t: h.exhausted is not None,
        State.ENDED,
        ERROR,
        "the vehicle refuses: {health.exhausted}{health.reason}",
        ends=Outcome.NOT_STARTED,
    ),
    row(
        State.ENGAGE,
        lambda h, s, t: h.missing is not None,
        State.ENDED,
        ERROR,
        "no longer ready: {health.missing}",
        ends=Outcome.NOT_STARTED,
    ),
    row(
        State.ARM,
        lambda h, s, t: h.exhausted is not None,
        State.DISARM,
        ERROR,
        "the vehicle refuses: {health.exhausted}{health.reason}, disarming",
        ends=Outcome.NOT_STARTED,
        cause="the vehicle refuses: {health.exhausted}{health.reason}",
    ),
    row(
        State.ARM,
        lambda h, s, t: h.missing is not None,
        State.DISARM,
        ERROR,
        "no longer ready: {health.missing}, disarming",
        ends=Outcome.NOT_STARTED,
        cause="no longer ready: {health.missing}",
    ),
    # armed for nothing
    row(
        State.DISARM,
        lambda h, s, t: h.airborne and h.armed and not left(h),
        State.LAND,
        CRITICAL,
        "armed, and in the air: landing",
        ends=Outcome.LANDED_EARLY,
    ),
    row(
        State.DISARM,
        lambda h, s, t: h.airborne and h.armed,
        State.RELEASED,
        CRITICAL,
        "armed, and in the air in mode {health.mode.value}: letting go",
        ends=Outcome.OPERATOR,
    ),
    row(
        State.DISARM,
        lambda h, s, t: t > s.disarm_watch and disarmed(h, s),
        State.ENDED,
        NOTICE,
        "disarmed",
    ),
    row(
        State.DISARM,
        lambda h, s, t: t > s.disarm_watch and h.exhausted is not None and h.heartbeat_age > s.heartbeat_timeout,
        State.ENDED,
        CRITICAL,
        "no heartbeat for {health.heartbeat_age:.0f} s says whether the vehicle is disarmed; {health.exhausted}",
        ends=Outcome.LOST,
    ),
    row(
        State.DISARM,
        lambda h, s, t: t > s.disarm_watch and h.exhausted is not None,
        State.ENDED,
        CRITICAL,
        "the vehicle stays armed: {health.exhausted}{health.reason}",
        ends=Outcome.LEFT,
    ),
)
