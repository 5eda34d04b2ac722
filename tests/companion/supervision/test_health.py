"""Health is a function of the reports: what is missing, and everything that the table of transitions asks about."""

import math
from dataclasses import dataclass
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import Supervision
from companion.reports import LinkReport, MissionReport, SensingReport, StatusReport
from companion.state import FlightMode, VehicleStatus
from companion.supervision.health import Health, Judged, health
from companion.supervision.operations import LandRequest, LogFault, OwnReport, PlannerFault, PlannerStarting
from companion.supervision.states import State
from companion.supervision.watching import UNWATCHED, Watched

LINK = LinkReport(
    found=True,
    status=VehicleStatus(FlightMode.HOLD, False, False),
    on_ground=True,
    silence=0.0,
    heartbeat_age=0.5,
    refused=None,
    complaint="",
)
SENSING = SensingReport(telemetry_age=0.004, scan_age=0.05, has_state=True)
MISSION = MissionReport(done=False, overdue=0.0)
BEFORE_FLIGHT = [state for state in State if state < State.FLY]


@dataclass
class Reports:
    """All well, but for what a test changes."""

    state: State = State.CHECK
    link: LinkReport = LINK
    sensing: SensingReport = SENSING
    mission: MissionReport = MISSION
    log_fault: str | None = None
    planner_ready: bool = True
    planner_fault: str | None = None
    land_requested: bool = False
    overrun_ns: int = 0
    watched: Watched = UNWATCHED
    awake_ns: int = 10**18
    """Since the overrun, if there was one."""

    def health(self) -> Health:
        own = OwnReport(Supervision())
        if self.log_fault is not None:
            own.take(LogFault(0, self.log_fault))
        if not self.planner_ready:
            own.take(PlannerStarting(0))
        if self.planner_fault is not None:
            own.take(PlannerFault(0, self.planner_fault))
        if self.land_requested:
            own.take(LandRequest(0))
        own.ticked(self.overrun_ns, 0)
        return health(self.state, self.link, self.sensing, self.mission, own, Judged(self.watched), self.awake_ns)


def link(**changes: Any) -> LinkReport:
    return msgspec.structs.replace(LINK, **changes)


def test_nothing_is_missing_where_all_is_well() -> None:
    for state in State:
        assert Reports(state).health().missing is None


LACKS: list[tuple[dict[str, Any], str]] = [
    ({"log_fault": "disk full"}, "the flight log fails (disk full)"),
    ({"shortcoming": "telemetry too slow"}, "telemetry too slow"),
    ({"has_state": False}, "no position and attitude"),
    ({"planner_fault": "the planner has ended"}, "the planner has ended"),
    ({"planner_ready": False}, "the planner is not ready"),
    ({"on_ground": False}, "the vehicle does not say that it stands on the ground"),
    ({"prearm_ok": False, "failed_check": " (compass)"}, "the vehicle's own arming checks fail (compass)"),
]
"""What may be missing, the most important first."""


def lacking(*places: int) -> Reports:
    reports = Reports()
    for place in places:
        for name, value in LACKS[place][0].items():
            if name in ("log_fault", "planner_fault", "planner_ready"):
                setattr(reports, name, value)
            elif name == "has_state":
                reports.sensing = msgspec.structs.replace(reports.sensing, has_state=value)
            else:
                reports.link = msgspec.structs.replace(reports.link, **{name: value})
    return reports


@given(places=st.sets(st.integers(0, len(LACKS) - 1), min_size=1))
@settings(max_examples=30)
def test_the_first_thing_that_is_missing_is_named(places: set[int]) -> None:
    assert lacking(*places).health().missing == LACKS[min(places)][1]


def test_a_vehicle_that_says_nothing_of_the_ground_may_start() -> None:
    assert Reports(link=link(on_ground=None)).health().missing is None


@pytest.mark.parametrize("place", range(len(LACKS)))
def test_what_is_missing_is_asked_before_the_flight_alone(place: int) -> None:
    reports = lacking(place)
    for state in State:
        reports.state = state
        assert (reports.health().missing is not None) == (state in BEFORE_FLIGHT)


def test_what_ends_the_flight_before_its_start_is_refused() -> None:
    """A planner that has ended does not come back, one that is not ready does."""
    assert Reports(planner_fault="it has ended").health().refusal == "it has ended"
    assert lacking(4).health().refusal is None and Reports().health().refusal is None


def test_an_empty_text_of_a_log_fault_is_missing_all_the_same() -> None:
    reports = Reports(log_fault="")
    assert reports.health().missing == "the flight log fails ()"


@pytest.mark.parametrize("state", list(State))
def test_a_step_is_overdue_in_flight_alone(state: State) -> None:
    reports = Reports(state, mission=MissionReport(done=False, overdue=7.5))
    assert reports.health().overdue == (7.5 if state is State.FLY else 0.0)


AGES = st.floats(0.0, 1e6) | st.just(math.inf)


@settings(max_examples=60)
@given(
    state=st.sampled_from(State),
    ages=st.tuples(*[AGES] * 6),
    flags=st.tuples(*[st.booleans()] * 9),
    mode=st.sampled_from(FlightMode),
    texts=st.tuples(*[st.none() | st.text(max_size=5)] * 2),
)
def test_health_is_a_function_of_the_reports(
    state: State,
    ages: tuple[float, ...],
    flags: tuple[bool, ...],
    mode: FlightMode,
    texts: tuple[str | None, str | None],
) -> None:
    """Each report comes through under its own name, and the same reports give the same health."""
    silence, heartbeat_age, telemetry_age, scan_age, still, landed_for = ages
    seen, armed, failsafe, done, landed, land_requested, taken_over, current, airborne = flags
    refused, exhausted = texts
    reports = Reports(
        state,
        link(
            found=seen,
            status=VehicleStatus(mode, armed, failsafe),
            on_ground=landed,
            silence=silence,
            heartbeat_age=heartbeat_age,
            refused=refused,
            exhausted=exhausted,
            complaint=" (said)",
            word=StatusReport(current, airborne, landed_for),
        ),
        SensingReport(telemetry_age, scan_age, True),
        MissionReport(done, 0.0),
        land_requested=land_requested,
        overrun_ns=400_000_000,
        awake_ns=10**17,
        watched=Watched(taken_over, still),
    )
    found = reports.health()
    assert found == reports.health()
    found_ages = found.silence, found.heartbeat_age, found.telemetry_age, found.scan_age
    assert found_ages == tuple(min(age, 1e8) for age in ages[:4])
    assert (found.watched.still, found.landed_for) == ages[4:]
    assert (found.current, found.airborne) == (current, airborne)
    assert (found.seen, found.armed, found.failsafe) == (seen, armed, failsafe)
    assert (found.mission_done, found.landed) == (done, landed)
    assert (found.land_requested, found.watched.taken_over) == (land_requested, taken_over)
    assert (found.mode, found.refused_telemetry, found.exhausted) == (mode, refused, exhausted)
    assert found.overrun == pytest.approx(0.4)
    assert (found.reason, found.unsound_output) == (" (said)", None)


def test_a_gap_of_our_own_is_no_silence_of_the_vehicle() -> None:
    """All ages count from its end on."""
    late = Reports(
        State.LAND,
        link(silence=10.0, heartbeat_age=10.5),
        SensingReport(10.0, math.inf, True),
        overrun_ns=10**10,
        awake_ns=30_000_000,
    ).health()
    counted = [late.silence, late.telemetry_age, late.heartbeat_age, late.scan_age]
    assert counted == pytest.approx([0.03] * 4)
    longer = Reports(State.LAND, link(silence=0.2), overrun_ns=10**10, awake_ns=10**9).health()
    assert longer.silence == 0.2, "what is younger than the gap is as old as it is"


def test_looking_at_the_health_changes_no_report() -> None:
    own = OwnReport(Supervision())
    own.take(LogFault(0, "disk full"))
    own.ticked(10**9, 0)
    for _ in range(2):
        found = health(State.CHECK, LINK, SENSING, MISSION, own, Judged(UNWATCHED), 0)
        assert found.overrun == 1.0 and found.missing == "the flight log fails (disk full)"
