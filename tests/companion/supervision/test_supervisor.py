"""The table of transitions: every fault has its answer, nothing is a dead end, and the pilot is never fought."""

from typing import Any

import pytest
from msgspec.structs import replace

from companion.config import Settings, Supervision
from companion.outcomes import Outcome, Verdict
from companion.state import BatteryLevel, FlightMode, VehicleRequest, VehicleStatus
from companion.supervision.battery import BatteryVerdict
from companion.supervision.health import Health, Plight
from companion.supervision.limits import LimitsVerdict
from companion.supervision.states import FLYING, STREAMING, State
from companion.supervision.supervisor import Supervisor
from companion.supervision.transitions import TABLE
from tests.companion.supervision.test_watching import at

SETTINGS = Supervision()
SECOND = 1_000_000_000
WELL = Health(
    seen=True,
    missing=None,
    mode=FlightMode.EXTERNAL,
    current=True,
    armed=True,
    failsafe=False,
    mission_done=False,
    silence=0.0,
    telemetry_age=0.0,
    heartbeat_age=0.5,
    scan_age=0.05,
    refused_telemetry=None,
    unsound_output=None,
    overrun=0.0,
    exhausted=None,
    adopts=False,
    land_requested=False,
    landed=False,
    landed_for=0.0,
    airborne=False,
    overdue=0.0,
)
LOW = LimitsVerdict(BatteryVerdict(BatteryLevel.RETURN, "battery at 14 %"), returns=True)
EMPTY = LimitsVerdict(BatteryVerdict(BatteryLevel.LAND, "battery at 6 %"))
ADRIFT = Plight(position_lost=True)
IDLE = replace(WELL, armed=False, mode=FlightMode.HOLD)
ENGAGED = replace(WELL, armed=False)


def flying() -> tuple[Supervisor, int]:
    """A supervisor in FLY, and the time."""
    supervisor = Supervisor(Settings())
    now = 0
    for health in (IDLE, IDLE, IDLE, ENGAGED, WELL, WELL):
        supervisor.update(health, now)
        now += 2 * SECOND
    assert supervisor.state is State.FLY
    return supervisor, now


def state_of(supervisor: Supervisor) -> State:
    """Asked anew: once asserted, a type checker takes the attribute for unchanged."""
    return supervisor.state


def settle(supervisor: Supervisor, health: Health, now: int, seconds: float) -> int:
    """Update at 50 Hz for so long."""
    for _ in range(round(seconds * 50)):
        now += SECOND // 50
        supervisor.update(health, now)
    return now


def test_the_way_to_the_start() -> None:
    supervisor = Supervisor(Settings())
    seen = []
    for second, health in enumerate((IDLE, IDLE, IDLE, IDLE, ENGAGED, WELL)):
        supervisor.update(health, second * 2 * SECOND)
        seen.append(supervisor.state)
    assert seen == [State.CHECK, State.STREAM, State.ENGAGE, State.ENGAGE, State.ARM, State.FLY]
    assert supervisor.fault is None


def test_a_flight_without_faults_ends_without_one() -> None:
    supervisor, now = flying()
    supervisor.update(replace(WELL, mission_done=True), now)
    assert state_of(supervisor) is State.LAND
    now = settle(supervisor, replace(WELL, mode=FlightMode.LAND), now, 5.0)
    assert state_of(supervisor) is State.LAND
    supervisor.update(replace(WELL, mode=FlightMode.LAND, armed=False), now)
    assert state_of(supervisor) is State.ENDED and supervisor.fault is None


FAULTS = {
    "telemetry": (replace(WELL, telemetry_age=0.6), State.WITHDRAW),
    "heartbeat": (replace(WELL, heartbeat_age=10.1), State.WITHDRAW),
    "refused": (replace(WELL, refused_telemetry="NaN"), State.WITHDRAW),
    "unsound": (replace(WELL, unsound_output="not finite"), State.WITHDRAW),
    "failsafe": (replace(WELL, failsafe=True), State.WITHDRAW),
    "astray": (replace(WELL, plight=Plight(strayed=6.1)), State.WITHDRAW),
    "ring": (replace(WELL, scan_age=0.6), State.HOLD),
    "overrun": (replace(WELL, overrun=0.3), State.HOLD),
    "pilot": (replace(WELL, mode=FlightMode.MANUAL), State.RELINQUISHED),
    "the vehicle itself": (replace(WELL, mode=FlightMode.HOLD, failsafe=True), State.WATCH),
    "gap": (replace(WELL, overrun=SETTINGS.gap + 0.1), State.GAP),
    "request": (replace(WELL, land_requested=True), State.LAND),
    "silence": (replace(WELL, silence=4.1, telemetry_age=4.1, heartbeat_age=4.1), State.ENDED),
    "disarmed": (replace(WELL, armed=False), State.ENDED),
    "overdue": (replace(WELL, overdue=1.0), State.LAND),
    "battery empty": (replace(WELL, limits=EMPTY), State.LAND),
    "position lost": (replace(WELL, plight=ADRIFT), State.LAND),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_has_its_answer_and_is_said(fault: str) -> None:
    health, expected = FAULTS[fault]
    supervisor, now = flying()
    said = supervisor.update(health, now)
    assert supervisor.state is expected
    assert said is not None and said.text and "{" not in said.text


@pytest.mark.parametrize(
    "fault",
    sorted(
        set(FAULTS)
        - {"silence", "disarmed", "pilot", "the vehicle itself", "gap"}
        - {"request", "overdue", "battery empty", "position lost"}
    ),
)
def test_a_lasting_fault_becomes_a_landing(fault: str) -> None:
    health, _ = FAULTS[fault]
    supervisor, now = flying()
    supervisor.update(health, now)
    if supervisor.state is State.WITHDRAW:
        health = replace(health, mode=FlightMode.HOLD)
    settle(supervisor, health, now, SETTINGS.land_after + 0.1)
    assert supervisor.state is State.LAND
    assert supervisor.fault is not None


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (replace(WELL, scan_age=0.6), "no ring for 0.60 s"),
        (replace(WELL, scan_age=0.6, plight=Plight(unseen="no map for")), "no map for 0.60 s"),
        (replace(WELL, overrun=0.3), "own loop"),
    ],
)
def test_a_hold_and_its_landing_name_what_is_missing(fault: Health, words: str) -> None:
    supervisor, now = flying()
    held = supervisor.update(fault, now)
    assert held is not None and held.text.startswith(words)
    settle(supervisor, fault, now, SETTINGS.land_after + 0.1)
    assert supervisor.fault is not None and words in supervisor.fault


def test_a_withdrawn_companion_does_not_come_back_by_itself() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["telemetry"][0], now)
    now = settle(supervisor, WELL, now, 4.0)
    assert state_of(supervisor) is State.WITHDRAW
    settle(supervisor, WELL, now, 2.0)
    assert state_of(supervisor) is State.LAND


def test_a_ring_that_comes_back_ends_the_hold() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["ring"][0], now)
    now = settle(supervisor, WELL, now, 0.5)
    assert state_of(supervisor) is State.HOLD
    settle(supervisor, WELL, now, 1.0)
    assert state_of(supervisor) is State.FLY and supervisor.fault is None


def test_a_loop_that_is_late_again_and_again_is_not_cured_between() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["overrun"][0], now)
    for look in range(round((SETTINGS.land_after - 0.2) * 50)):
        now += SECOND // 50
        supervisor.update(replace(WELL, plight=Plight(awake=0.02 * (look % 20))), now)
        assert state_of(supervisor) is State.HOLD
    now = settle(supervisor, replace(WELL, plight=Plight(awake=0.02)), now, 0.4)
    assert state_of(supervisor) is State.LAND
    assert supervisor.fault is not None and "own loop is late again and again" in supervisor.fault


def test_a_loop_that_keeps_pace_for_a_second_is_cured() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["overrun"][0], now)
    now = settle(supervisor, replace(WELL, plight=Plight(awake=0.9)), now, 1.5)
    assert state_of(supervisor) is State.HOLD
    settle(supervisor, replace(WELL, plight=Plight(awake=1.1)), now, 0.1)
    assert state_of(supervisor) is State.FLY and supervisor.fault is None


def test_thresholds_are_where_the_settings_say() -> None:
    for field, limit in (("telemetry_age", 0.5), ("heartbeat_age", 10.0), ("scan_age", 0.5)):
        supervisor, now = flying()
        below: dict[str, Any] = {field: limit - 0.01}
        above: dict[str, Any] = {field: limit + 0.01}
        assert supervisor.update(replace(WELL, **below), now) is None
        assert supervisor.update(replace(WELL, **above), now) is not None


OTHERS = replace(WELL, mode=FlightMode.HOLD)


def relinquished() -> tuple[Supervisor, int]:
    """A supervisor whose vehicle others fly for the moment."""
    supervisor, now = flying()
    supervisor.update(OTHERS, now)
    assert supervisor.state is State.RELINQUISHED
    return supervisor, now


def test_the_pilot_keeps_the_vehicle() -> None:
    """From RELEASED no row leads anywhere but to the end, whatever the mode does, and nothing is streamed."""
    assert {row.to for row in TABLE if State.RELEASED in row.states} == {State.ENDED}
    assert State.RELEASED not in STREAMING
    supervisor, now = flying()
    supervisor.update(FAULTS["telemetry"][0], now)
    supervisor.update(replace(WELL, mode=FlightMode.MANUAL), now + SECOND // 10)
    settle(supervisor, WELL, now, 60.0)
    assert supervisor.state is State.RELEASED and supervisor.fault is not None


def test_only_who_gives_control_back_ends_the_waiting_for_it() -> None:
    """The one way back into flight is a mode of external control, and it leads through a hold: its own, or the
    vehicle's where its own would be blind."""
    ways = [row for row in TABLE if State.RELINQUISHED in row.states and row.to in FLYING]
    assert [row.to for row in ways] == [State.WITHDRAW, State.HOLD]
    others = set(FlightMode) - {FlightMode.EXTERNAL}
    for health in (WELL, FAULTS["telemetry"][0]):
        assert not any(way.condition(replace(health, mode=mode), SETTINGS, 1e6) for way in ways for mode in others)
    assert not ways[0].condition(WELL, SETTINGS, 1e6)
    supervisor, now = relinquished()
    now = settle(supervisor, OTHERS, now, 0.9 * SETTINGS.resume_within)
    assert state_of(supervisor) is State.RELINQUISHED
    now = settle(supervisor, WELL, now, 0.5)
    assert state_of(supervisor) is State.HOLD
    settle(supervisor, WELL, now, SETTINGS.least_hold)
    assert state_of(supervisor) is State.FLY and supervisor.fault is None


def test_a_vehicle_in_flight_is_asked_for_control_once_it_has_heard_setpoints_for_long_enough() -> None:
    supervisor, aloft = Supervisor(Settings()), replace(WELL, mode=FlightMode.HOLD, adopts=True, airborne=True)
    for second in range(2):
        supervisor.update(aloft, second * SECOND)
    now = SECOND
    assert state_of(supervisor) is State.ADOPT and supervisor.streams and supervisor.request is None
    now = settle(supervisor, aloft, now, SETTINGS.stream_before_engaging - 0.1)
    assert supervisor.request is None
    settle(supervisor, aloft, now, 0.2)
    assert state_of(supervisor) is State.ADOPT and supervisor.request is VehicleRequest.EXTERNAL_CONTROL


def test_a_flight_that_was_called_off_is_said_to_be_so_when_it_is_over() -> None:
    """What to do now is said then, and is not the outcome."""
    supervisor, now = flying()
    said = supervisor.update(FAULTS["request"][0], now)
    assert said is not None and said.text == "landing on request (interrupt again to abandon)"
    supervisor.update(replace(IDLE, land_requested=True), now + 10 * SECOND)
    assert state_of(supervisor) is State.ENDED and supervisor.fault == "called off in flight"


def test_a_landing_from_high_up_takes_its_time_and_one_that_comes_to_nothing_is_given_up() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["request"][0], now)
    height, end = 300.0, now + 2 * round(SETTINGS.landing_timeout) * SECOND
    while now < end and state_of(supervisor) is State.LAND:
        now, height = now + SECOND, max(height - 0.7, 150.0)
        watched = supervisor.watch(VehicleStatus(FlightMode.LAND, True, False), True, at(0.0, height), now)
        supervisor.update(replace(WELL, mode=FlightMode.LAND, watched=watched), now)
        assert height == 150.0 or state_of(supervisor) is State.LAND
    assert state_of(supervisor) is State.ENDED
    assert supervisor.verdict == Verdict(Outcome.LOST, "landing not confirmed within 120 s")


def test_what_is_not_given_back_in_time_is_let_go() -> None:
    supervisor, now = relinquished()
    now = settle(supervisor, OTHERS, now, SETTINGS.resume_within + 0.1)
    assert state_of(supervisor) is State.RELEASED and "300 s" in (supervisor.fault or "")
    settle(supervisor, WELL, now, 60.0)
    assert state_of(supervisor) is State.RELEASED


def test_control_given_back_over_a_fault_is_answered_as_in_flight() -> None:
    """A ring that is lost stays a hold and becomes a landing; a state that is not known, the vehicle's own hold."""
    for fault, (first, last) in {
        "ring": (State.HOLD, State.LAND),
        "telemetry": (State.WITHDRAW, State.LAND),
        "unsound": (State.WITHDRAW, State.LAND),
    }.items():
        supervisor, now = relinquished()
        health, _ = FAULTS[fault]
        now = settle(supervisor, health, now, 0.1)
        assert state_of(supervisor) is first, fault
        settle(supervisor, health, now, SETTINGS.land_after)
        assert state_of(supervisor) is last, fault


def test_a_gap_while_others_fly_is_nothing_and_a_failsafe_is_the_end_of_waiting() -> None:
    """Setpoints would bring a vehicle that has left external control by itself back into it."""
    supervisor, now = relinquished()
    for fault in ("telemetry", "heartbeat", "ring", "overrun"):
        now = settle(supervisor, replace(FAULTS[fault][0], mode=FlightMode.HOLD), now, 2.0)
    assert state_of(supervisor) is State.RELINQUISHED
    said = supervisor.update(replace(OTHERS, failsafe=True), now + SECOND)
    assert state_of(supervisor) is State.RELEASED
    assert said is not None and supervisor.fault == f"landed early: {said.text}" and "{" not in said.text


def test_a_vehicle_that_others_landed_is_not_taken_off_again() -> None:
    for landed in (replace(OTHERS, landed=True), replace(WELL, landed=True)):
        supervisor, now = relinquished()
        supervisor.update(landed, now + SECOND)
        assert state_of(supervisor) is State.RELEASED and supervisor.fault is not None
        supervisor.update(replace(landed, armed=False), now + 2 * SECOND)
        assert state_of(supervisor) is State.ENDED
    supervisor, now = relinquished()
    supervisor.update(replace(OTHERS, armed=False), now + SECOND)
    assert state_of(supervisor) is State.ENDED and supervisor.fault is not None


@pytest.mark.parametrize("state", [State.ENGAGE, State.ARM])
def test_refusals_end_before_the_start(state: State) -> None:
    supervisor = Supervisor(Settings())
    now = 0
    while supervisor.state is not state:
        supervisor.update(IDLE if supervisor.state is not State.ENGAGE else replace(WELL, armed=False), now)
        now += 2 * SECOND
    mode = FlightMode.HOLD if state is State.ENGAGE else FlightMode.EXTERNAL
    said = supervisor.update(replace(IDLE, mode=mode, exhausted="arming: denied", plight=Plight(reason=" (why)")), now)
    assert supervisor.state is (State.ENDED if state is State.ENGAGE else State.DISARM)
    assert said is not None and "denied" in said.text and "why" in said.text
    assert supervisor.fault == "not started: the vehicle refuses: arming: denied (why)"


def test_not_ready_names_what_is_missing() -> None:
    supervisor = Supervisor(Settings())
    supervisor.update(IDLE, 0)
    lacking = replace(IDLE, missing="no ring")
    settle(supervisor, lacking, 0, SETTINGS.ready_timeout + 1.0)
    assert supervisor.state is State.ENDED and "no ring" in (supervisor.fault or "")


def test_what_is_waited_for_is_known_while_it_lasts() -> None:
    supervisor = Supervisor(Settings())
    supervisor.update(replace(IDLE, missing="no ring"), 0)
    supervisor.update(replace(IDLE, missing="no ring"), SECOND)
    assert supervisor.waiting_for == "no ring" and supervisor.state is State.CHECK
    supervisor.update(replace(IDLE, missing=None), 2 * SECOND)
    assert supervisor.waiting_for is None and state_of(supervisor) is State.STREAM


def test_what_nobody_can_wait_for_ends_the_flight_at_once() -> None:
    supervisor = Supervisor(Settings())
    refused = replace(IDLE, missing="no ring", refusal="GUID_OPTIONS is 0")
    supervisor.update(refused, 0)
    assert supervisor.state is State.CHECK
    said = supervisor.update(refused, SECOND // 50)
    assert state_of(supervisor) is State.ENDED and said is not None and "GUID_OPTIONS is 0" in said.text
    assert "GUID_OPTIONS is 0" in (supervisor.fault or "")


def test_no_vehicle() -> None:
    supervisor = Supervisor(Settings())
    settle(supervisor, replace(IDLE, seen=False), 0, SETTINGS.find_timeout - 0.1)
    assert state_of(supervisor) is State.FIND
    settle(supervisor, replace(IDLE, seen=False), round(SETTINGS.find_timeout * SECOND), 0.2)
    assert state_of(supervisor) is State.ENDED and "10 s" in (supervisor.fault or "")


def test_an_armed_vehicle_is_not_taken_over() -> None:
    supervisor = Supervisor(Settings())
    supervisor.update(WELL, 0)
    supervisor.update(WELL, SECOND)
    assert supervisor.state is State.ENDED


def test_every_state_but_the_end_has_a_way_out_for_a_silent_vehicle() -> None:
    for state in FLYING | {State.CHECK, State.STREAM, State.ENGAGE, State.ARM, State.RELEASED}:
        rows = [row for row in TABLE if state in row.states]
        silent = replace(WELL, silence=5.0)
        assert any(row.to is State.ENDED and row.condition(silent, SETTINGS, 0.0) for row in rows)


@pytest.mark.parametrize("state", [State.CHECK, State.STREAM, State.ENGAGE])
@pytest.mark.parametrize(("armed", "outcome"), [(False, "not started"), (True, "lost")])
def test_a_vehicle_that_falls_silent_before_it_is_armed_is_not_lost(state: State, armed: bool, outcome: str) -> None:
    """A reboot takes ArduPilot longer than `silence_timeout`."""
    supervisor, now = Supervisor(Settings()), 0
    while supervisor.state is not state:
        supervisor.update(IDLE, now)
        now += 2 * SECOND
    supervisor.update(replace(IDLE, silence=SETTINGS.silence_timeout + 0.1, armed=armed), now)
    assert state_of(supervisor) is State.ENDED and (supervisor.fault or "").startswith(f"{outcome}: the vehicle is")


def test_a_low_battery_returns_once_and_the_outcome_says_so() -> None:
    supervisor, now = flying()
    low = replace(WELL, limits=LOW)
    said = supervisor.update(low, now)
    assert said is not None and said.text == "battery at 14 %: returning"
    assert supervisor.state is State.FLY and supervisor.fault == "returned: battery at 14 %"
    home = replace(low, limits=replace(LOW, returns=False))
    assert supervisor.update(home, now + SECOND) is None
    assert supervisor.update(replace(home, mission_done=True), now + 2 * SECOND) is not None
    assert state_of(supervisor) is State.LAND and supervisor.fault == "returned: battery at 14 %"


def test_a_battery_that_gets_low_while_holding_returns_once_that_is_over() -> None:
    supervisor, now = flying()
    low = replace(WELL, limits=LOW)
    supervisor.update(replace(low, scan_age=1.0), now)
    assert state_of(supervisor) is State.HOLD
    settle(supervisor, low, now, SETTINGS.least_hold + 0.1)
    assert state_of(supervisor) is State.FLY and supervisor.fault == "returned: battery at 14 %"


def test_who_flies_by_hand_is_not_made_to_return() -> None:
    supervisor, now = flying()
    supervisor.update(FAULTS["pilot"][0], now)
    empty = replace(FAULTS["pilot"][0], limits=EMPTY)
    settle(supervisor, empty, now, 5.0)
    assert state_of(supervisor) is State.RELINQUISHED


def landing() -> tuple[Supervisor, int]:
    """A supervisor that has just begun to land."""
    supervisor, now = flying()
    supervisor.update(replace(WELL, mission_done=True), now)
    assert supervisor.state is State.LAND
    return supervisor, now


def test_setpoints_go_on_until_the_vehicle_has_taken_the_landing_up() -> None:
    supervisor, now = landing()
    now = settle(supervisor, WELL, now, 3.0)
    assert supervisor.streams
    now = settle(supervisor, replace(WELL, current=False, mode=FlightMode.LAND), now, 0.02)
    assert supervisor.streams, "the heartbeat is older than the command"
    settle(supervisor, replace(WELL, mode=FlightMode.LAND), now, 0.02)
    assert state_of(supervisor) is State.LAND and not supervisor.streams


@pytest.mark.parametrize(
    "trouble",
    [
        {"telemetry_age": 2.0},
        {"refused_telemetry": "position stuck"},
        {"unsound_output": "thrust"},
        {"failsafe": True},
        {"overrun": 2.0},
        {"armed": False},
        {"plight": ADRIFT},
    ],
    ids=lambda trouble: next(iter(trouble)),
)
def test_what_would_take_the_vehicle_out_of_our_hands_ends_the_setpoints_of_a_landing(trouble: dict[str, Any]) -> None:
    supervisor, now = landing()
    now = settle(supervisor, replace(WELL, **trouble), now, 0.02)
    assert not supervisor.streams
    settle(supervisor, WELL, now, 1.0)
    assert state_of(supervisor) is State.LAND and not supervisor.streams


def test_a_landing_without_a_position_sends_no_setpoints() -> None:
    supervisor, now = flying()
    supervisor.update(replace(WELL, plight=ADRIFT), now)
    assert supervisor.state is State.LAND and not supervisor.streams


def test_a_landing_after_withdrawing_sends_no_setpoints() -> None:
    supervisor, now = flying()
    supervisor.update(replace(WELL, telemetry_age=2.0), now)
    settle(supervisor, replace(WELL, mode=FlightMode.HOLD), now, SETTINGS.land_after + 0.1)
    assert state_of(supervisor) is State.LAND and not supervisor.streams
