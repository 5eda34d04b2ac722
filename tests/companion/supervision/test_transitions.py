"""The table of transitions, state by state: which condition leads where, and what no condition may lead to."""

import itertools
from typing import Any

import pytest
from msgspec.structs import replace

from companion.config import Supervision
from companion.outcomes import Outcome
from companion.state import FlightMode, Severity, VehicleRequest
from companion.supervision.health import Health, Plight
from companion.supervision.states import AWAY, COMMANDED, FLYING, FOLLOWING, REQUESTS, STREAMING, State
from companion.supervision.transitions import TABLE
from companion.supervision.watching import Watched
from tests.companion.supervision.test_supervisor import IDLE, WELL

S = Supervision()
HOLD, LAND, MANUAL, RETURN, EXTERNAL = (
    FlightMode.HOLD,
    FlightMode.LAND,
    FlightMode.MANUAL,
    FlightMode.RETURN,
    FlightMode.EXTERNAL,
)
FLOWN = replace(WELL, airborne=True)
OWN_FAILSAFE: dict[str, Any] = {"mode": MANUAL, "failsafe": True}
STUCK: dict[str, Any] = {"watched": Watched(taken_over=False, still=S.failsafe_still + 0.1)}
TAKEN_OVER: dict[str, Any] = {"watched": Watched(taken_over=True, still=0.0)}
FALLEN: dict[str, Any] = {"armed": False, "mode": HOLD, "plight": Plight(fell=True)}
UNDECIDED: dict[str, Any] = {"armed": False, "mode": HOLD, "plight": Plight(undecided=True)}
GROUNDED: dict[str, Any] = {"landed": True, "landed_for": S.disarm_after + 1.0, "airborne": False}


def follows(state: State, health: Health, seconds: float = 1.0) -> State:
    """The state after one look."""
    for row in TABLE:
        if state in row.states and row.condition(health, S, seconds):
            assert row.text.format(health=health, settings=S)
            return row.to
    return state


CASES: list[tuple[State, Health, dict[str, Any], float, State]] = [
    # to the start
    (State.CHECK, IDLE, {"armed": True}, 1.0, State.ENDED),
    (State.CHECK, IDLE, {"airborne": True}, 1.0, State.ENDED),
    (State.CHECK, IDLE, {}, 1.0, State.STREAM),
    (State.STREAM, IDLE, {"armed": True}, 0.1, State.ENDED),
    (State.ENGAGE, IDLE, {"armed": True, "mode": EXTERNAL}, 0.1, State.ENDED),
    (State.ENGAGE, IDLE, {"mode": EXTERNAL}, 0.1, State.ARM),
    (State.ENGAGE, IDLE, {"exhausted": "control: denied"}, 3.0, State.ENDED),
    # whoever asked for arming disarms
    (State.ARM, IDLE, {"mode": MANUAL}, 0.1, State.DISARM),
    (State.ARM, IDLE, {"mode": MANUAL, "current": False}, 0.1, State.ARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "exhausted": "arming: denied"}, 3.0, State.DISARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "missing": "no ring"}, 0.1, State.DISARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "land_requested": True}, 0.1, State.DISARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "overrun": S.gap + 0.1}, 0.1, State.DISARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "overrun": S.gap - 0.1}, 0.1, State.ARM),
    (State.ARM, IDLE, {"mode": EXTERNAL, "armed": True}, 0.1, State.FLY),
    (State.DISARM, IDLE, {}, S.disarm_watch - 0.1, State.DISARM),
    (State.DISARM, IDLE, {}, S.disarm_watch + 0.1, State.ENDED),
    (State.DISARM, WELL, {"landed": True}, S.disarm_watch + 0.1, State.DISARM),
    (State.DISARM, WELL, {"landed": True, "exhausted": "disarming: denied"}, 3.5, State.ENDED),
    (State.DISARM, FLOWN, {}, 0.1, State.LAND),
    (State.DISARM, FLOWN, {"mode": MANUAL}, 0.1, State.RELEASED),
    (State.DISARM, IDLE, {"heartbeat_age": 3.5}, 3.6, State.DISARM),
    (State.DISARM, WELL, {"heartbeat_age": 9.0, "exhausted": "disarming: accepted"}, 3.5, State.ENDED),
    # a gap of our own
    (State.FLY, FLOWN, {"overrun": S.gap + 0.1}, 9.0, State.GAP),
    (State.HOLD, FLOWN, {"overrun": S.gap + 0.1}, 0.1, State.GAP),
    (State.FLY, FLOWN, {"overrun": S.gap - 0.1}, 9.0, State.HOLD),
    (State.GAP, FLOWN, {"current": False}, 1.0, State.GAP),
    (State.GAP, FLOWN, {"current": False, **OWN_FAILSAFE}, 1.0, State.GAP),
    (State.GAP, FLOWN, {"current": False, "armed": False}, 1.0, State.GAP),
    (State.GAP, FLOWN, {"current": False}, S.heartbeat_timeout + 0.1, State.WATCH),
    (State.GAP, FLOWN, {}, 0.1, State.HOLD),
    (State.GAP, FLOWN, {"telemetry_age": 0.6}, 0.1, State.GAP),
    (State.GAP, FLOWN, OWN_FAILSAFE, 0.1, State.WATCH),
    (State.GAP, FLOWN, {"mode": MANUAL}, 0.1, State.RELINQUISHED),
    (State.GAP, FLOWN, {"armed": False}, 0.1, State.ENDED),
    # the vehicle's own failsafe
    (State.FLY, FLOWN, OWN_FAILSAFE, 9.0, State.WATCH),
    (State.HOLD, FLOWN, OWN_FAILSAFE, 0.1, State.WATCH),
    (State.WITHDRAW, FLOWN, OWN_FAILSAFE, 0.5, State.WATCH),
    (State.WITHDRAW, FLOWN, {**OWN_FAILSAFE, "current": False}, 0.5, State.WITHDRAW),
    (State.WITHDRAW, FLOWN, {"mode": LAND, "failsafe": True}, 0.5, State.WATCH),
    (State.WITHDRAW, FLOWN, {"mode": HOLD, "failsafe": True}, 0.5, State.WITHDRAW),
    (State.WITHDRAW, FLOWN, {"mode": HOLD, "failsafe": True}, S.land_after + 0.1, State.LAND),
    (State.WITHDRAW, FLOWN, {"mode": HOLD, "land_requested": True}, 0.1, State.LAND),
    (State.WITHDRAW, FLOWN, {"mode": MANUAL, "land_requested": True}, 0.5, State.RELEASED),
    (State.WITHDRAW, FLOWN, {**OWN_FAILSAFE, "land_requested": True}, 0.5, State.WATCH),
    (State.LAND, FLOWN, {"mode": RETURN, "failsafe": True}, 9.0, State.WATCH),
    (State.LAND, FLOWN, {"mode": HOLD, "failsafe": True, **TAKEN_OVER}, 9.0, State.WATCH),
    (State.WATCH, FLOWN, OWN_FAILSAFE, 60.0, State.WATCH),
    (State.WATCH, FLOWN, {**OWN_FAILSAFE, "land_requested": True}, 1.0, State.WATCH),
    (State.WATCH, FLOWN, {**OWN_FAILSAFE, **STUCK}, 60.0, State.LAND),
    (State.WATCH, FLOWN, STUCK, 60.0, State.LAND),
    (State.WATCH, FLOWN, {**OWN_FAILSAFE, **GROUNDED, **STUCK}, 60.0, State.DISARM),
    (State.WATCH, FLOWN, {**OWN_FAILSAFE, **GROUNDED, "landed_for": S.disarm_after}, 60.0, State.WATCH),
    (State.WATCH, FLOWN, {**OWN_FAILSAFE, "landed": True, **STUCK, "landed_for": 1.0}, 60.0, State.WATCH),
    (State.WATCH, FLOWN, {"mode": MANUAL, **TAKEN_OVER}, 5.0, State.RELEASED),
    (State.WATCH, FLOWN, {"armed": False, "mode": HOLD}, 20.0, State.ENDED),
    (State.WATCH, FLOWN, {"armed": False, "current": False}, 20.0, State.WATCH),
    # others
    (State.FLY, FLOWN, {"mode": MANUAL}, 9.0, State.RELINQUISHED),
    (State.FLY, FLOWN, {"mode": RETURN}, 9.0, State.RELINQUISHED),
    (State.FLY, FLOWN, {"mode": MANUAL, "current": False}, 9.0, State.FLY),
    (State.WITHDRAW, FLOWN, {"mode": MANUAL}, 0.5, State.RELEASED),
    (State.WITHDRAW, FLOWN, {"mode": MANUAL, "current": False}, 0.5, State.WITHDRAW),
    (State.LAND, FLOWN, {"mode": MANUAL}, 5.0, State.RELEASED),
    (State.LAND, FLOWN, {"mode": MANUAL, "current": False}, 5.0, State.LAND),
    (State.LAND, FLOWN, {"armed": False, "mode": HOLD, "telemetry_age": 0.6}, 5.0, State.LAND),
    (State.WATCH, FLOWN, {"armed": False, "mode": HOLD, "telemetry_age": 0.6, **TAKEN_OVER}, 5.0, State.WATCH),
    (State.FLY, FLOWN, {"armed": False, "mode": HOLD}, 5.0, State.ENDED),
    (State.LAND, WELL, {"mode": LAND, **GROUNDED}, 60.0, State.DISARM),
    (State.LAND, WELL, {"mode": LAND, "landed": True, "landed_for": 1.0}, 60.0, State.LAND),
    (State.LAND, WELL, {"mode": LAND, **GROUNDED, "plight": Plight(risen=False)}, 1.1, State.DISARM),
    (State.LAND, WELL, {"mode": LAND, **GROUNDED}, 1.1, State.LAND),
    (State.LAND, FLOWN, {"mode": LAND, **STUCK}, S.landing_timeout + 0.1, State.ENDED),
    (State.LAND, FLOWN, {"mode": LAND, **STUCK}, S.landing_timeout - 0.1, State.LAND),
    (State.LAND, FLOWN, {"mode": LAND}, S.landing_timeout + 0.1, State.LAND),
    # taken over in flight
    (State.CHECK, FLOWN, {"adopts": True}, S.listen_before_adopting + 0.1, State.ADOPT),
    (State.CHECK, FLOWN, {"adopts": True, "mode": EXTERNAL}, S.listen_before_adopting - 0.1, State.CHECK),
    (State.CHECK, FLOWN, {"adopts": True, "mode": HOLD}, 0.1, State.ADOPT),
    (State.CHECK, FLOWN, {"adopts": True, **OWN_FAILSAFE}, 1.0, State.ADOPT),
    (State.CHECK, FLOWN, {"adopts": True, "missing": "no ring"}, 1.0, State.CHECK),
    (State.CHECK, WELL, {"adopts": True}, 1.0, State.CHECK),
    (State.CHECK, WELL, {"adopts": True, "landed": True}, 1.0, State.ENDED),
    (State.CHECK, IDLE, {"adopts": True}, 1.0, State.ENDED),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": EXTERNAL}, 0.1, State.HOLD),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": EXTERNAL, "current": False}, 0.1, State.ADOPT),
    (State.ADOPT, FLOWN, {"adopts": True, **OWN_FAILSAFE}, 1.0, State.ADOPT),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": HOLD, "exhausted": "control: denied"}, 4.0, State.ENDED),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": HOLD, "telemetry_age": 0.6}, 0.5, State.CHECK),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": EXTERNAL, "plight": Plight(rival="another")}, 0.5, State.CHECK),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": HOLD, "land_requested": True}, 0.5, State.ENDED),
    (State.ADOPT, FLOWN, {"adopts": True, "mode": HOLD, "land_requested": True, "current": False}, 1.3, State.ADOPT),
    (State.ADOPT, FLOWN, {"adopts": True, "land_requested": True}, 1.3, State.HOLD),
    (State.CHECK, FLOWN, {"adopts": True, "telemetry_age": 0.6}, 1.0, State.CHECK),
    (State.ADOPT, WELL, {"adopts": True, "landed": True}, 0.5, State.ENDED),
    (State.ADOPT, FLOWN, {"adopts": True, "armed": False}, 0.5, State.ENDED),
]


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0].name}-{case[4].name}")
def test_each_condition_leads_where_it_should(case: tuple[State, Health, dict[str, Any], float, State]) -> None:
    state, health, changes, seconds, expected = case
    assert follows(state, replace(health, **changes), seconds) is expected


AFTER_OWN = (State.WITHDRAW, State.LAND, State.RELINQUISHED, State.RELEASED, State.GAP, State.WATCH)


@pytest.mark.parametrize("state", AFTER_OWN)
def test_a_vehicle_that_is_disarmed_in_the_air_has_crashed_whoever_flew_it(state: State) -> None:
    assert follows(state, replace(FLOWN, **UNDECIDED), 1.0) is state, "its word of the ground is waited for"
    row = next(row for row in TABLE if state in row.states and row.condition(replace(FLOWN, **FALLEN), S, 5.0))
    assert (row.to, row.ends) == (State.ENDED, Outcome.CRASHED)


def test_a_heartbeat_that_is_not_current_gives_nobody_the_vehicle() -> None:
    """Neither a pilot nor the vehicle's own failsafe is read from one, in any state of a flight."""
    for state, mode, failsafe in itertools.product(FLYING - {State.RELINQUISHED}, FlightMode, (False, True)):
        health = replace(FLOWN, mode=mode, failsafe=failsafe, current=False, adopts=state is State.ADOPT)
        theirs = (State.RELINQUISHED, State.RELEASED, State.WATCH)
        assert state in theirs or follows(state, health) not in theirs, (state, mode)


def test_the_vehicles_own_failsafe_is_never_a_pilot() -> None:
    for state, mode in itertools.product(
        (State.FLY, State.HOLD, State.GAP, State.WITHDRAW, State.LAND), set(FlightMode) - {EXTERNAL}
    ):
        found = follows(state, replace(FLOWN, mode=mode, failsafe=True))
        assert found in (State.WATCH, state), (state, mode)
        assert found is State.WATCH or mode in (HOLD, LAND)


def test_nothing_is_sent_that_would_end_a_failsafe_or_move_what_others_fly() -> None:
    assert not STREAMING & {State.GAP, State.WATCH, State.DISARM, State.RELEASED, State.WITHDRAW, State.LAND}
    assert REQUESTS.get(State.WATCH) is REQUESTS.get(State.RELINQUISHED) is REQUESTS.get(State.RELEASED) is None
    assert REQUESTS[State.GAP] is VehicleRequest.STATUS and State.GAP not in COMMANDED
    assert FOLLOWING < STREAMING and FOLLOWING | {State.GAP} == AWAY


def test_arming_leads_into_flight_or_to_disarming() -> None:
    """But for a vehicle that is silent: there is nobody to disarm."""
    ways = {row.to for row in TABLE if State.ARM in row.states and row.ends is not Outcome.LOST}
    assert ways == {State.FLY, State.DISARM}
    assert {state for row in TABLE if row.to is State.ARM for state in row.states} == {State.ENGAGE}
    assert {row.to for row in TABLE if State.DISARM in row.states} == {State.ENDED, State.LAND, State.RELEASED}


def test_the_mode_of_a_vehicle_in_flight_is_asked_for_by_adoption_alone() -> None:
    into = [row for row in TABLE if row.to is State.ADOPT]
    assert [row.states for row in into] == [frozenset({State.CHECK})]
    for armed, airborne in itertools.product((False, True), repeat=2):
        assert not into[0].condition(replace(WELL, armed=armed, airborne=airborne), S, 1.0)
    assert follows(State.CHECK, replace(FLOWN, adopts=True, missing="no home")) is State.CHECK


def test_every_state_but_the_last_is_left_when_the_vehicle_falls_silent() -> None:
    for state in set(State) - {State.FIND, State.ENDED}:
        health = replace(FLOWN, silence=S.silence_timeout + 0.1, current=False)
        assert follows(state, health) is State.ENDED, state


def test_what_is_grave_or_ends_a_flight_before_its_mission_is_a_fault() -> None:
    """All but what may be cured in flight, and the end of a landing or of a disarming, which had its cause before."""
    for row in TABLE:
        if row.severity in (Severity.ERROR, Severity.CRITICAL) and row.to not in (State.HOLD, State.GAP):
            assert row.ends is not None, row.text
        if row.to in (State.ENDED, State.RELEASED) and not row.states <= {State.LAND, State.DISARM}:
            assert row.ends is not None, row.text
        if State.ARM in row.states and row.to is State.DISARM:
            assert row.ends is not None, row.text
