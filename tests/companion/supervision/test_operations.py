"""What the companion knows of itself: faults of the log, overruns, setpoints that were held back."""

import math

import pytest

from companion.config import Supervision
from companion.state import Setpoint, Severity
from companion.supervision.operations import (
    LandRequest,
    LogFault,
    LogRecovered,
    OwnReport,
    PlannerFault,
    PlannerReady,
    PlannerStarting,
)

SETTINGS = Supervision()
SOUND = Setpoint((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, 0.5)
LATE_NS = round(SETTINGS.overrun * 1e9)


def setpoint_with(thrust: float) -> Setpoint:
    return Setpoint((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, (0.0,) * 3, thrust)


def test_a_fault_of_the_log_is_said_once_and_kept_in_its_latest_words() -> None:
    own = OwnReport(SETTINGS)
    said = own.take(LogFault(1, "disk full"))
    assert said is not None and said.severity is Severity.CRITICAL and "disk full" in said.text
    assert own.take(LogFault(2, "disk still full")) is None and own.log_fault == "disk still full"
    own.begin()
    assert own.log_fault == "disk still full", "it lasts until the log is written again"


def test_a_log_that_is_written_again_is_said_and_may_fail_again() -> None:
    own = OwnReport(SETTINGS)
    own.take(LogFault(1, "disk full"))
    said = own.take(LogRecovered(2))
    assert said is not None and said.severity is Severity.NOTICE
    assert own.log_fault is None
    said = own.take(LogFault(3, "disk full"))
    assert said is not None and own.log_fault == "disk full"


def test_a_fault_with_an_empty_text_is_a_fault() -> None:
    own = OwnReport(SETTINGS)
    assert own.take(LogFault(1, "")) is not None and own.take(LogFault(2, "")) is None
    assert own.log_fault == ""


def test_a_fault_of_the_planner_is_said_and_is_none_of_the_log() -> None:
    own = OwnReport(SETTINGS)
    said = own.take(PlannerFault(1, "it has ended"))
    assert said is not None and said.severity is Severity.CRITICAL and "it has ended" in said.text
    assert own.log_fault is None and own.planner_fault == "it has ended"


def test_a_planner_that_starts_is_not_ready_until_it_is() -> None:
    own = OwnReport(SETTINGS)
    assert own.planner_ready, "where nothing else is said"
    for event, ready in ((PlannerStarting(1), False), (PlannerReady(2), True)):
        assert own.take(event) is None and own.planner_ready is ready


def test_a_request_to_land_lasts_and_is_not_said_here() -> None:
    own = OwnReport(SETTINGS)
    assert not own.land_requested
    assert own.take(LandRequest(1)) is None
    own.begin()
    assert own.land_requested


@pytest.mark.parametrize(("late_ns", "counts"), [(0, False), (LATE_NS, False), (LATE_NS + 1, True)])
def test_an_overrun_is_a_tick_later_than_the_settings_say(late_ns: int, counts: bool) -> None:
    own = OwnReport(SETTINGS)
    own.ticked(late_ns, 0)
    assert own.overrun_ns == (late_ns if counts else 0)


def test_an_overrun_is_kept_until_the_health_was_looked_at() -> None:
    own = OwnReport(SETTINGS)
    own.ticked(2 * LATE_NS, 0)
    own.ticked(0, 0)
    assert own.overrun_ns == 2 * LATE_NS
    own.begin()
    assert own.overrun_ns == 0


def test_an_unsound_setpoint_stays_here_and_is_kept_until_the_health_was_looked_at() -> None:
    own = OwnReport(SETTINGS)
    assert own.passes(SOUND, True) and own.unsound_output is None
    assert not own.passes(setpoint_with(math.nan), True) and own.unsound_output == "not finite"
    assert own.passes(SOUND, True) and own.unsound_output == "not finite", "a sound one after it is no excuse"
    assert not own.passes(setpoint_with(2.0), True) and own.unsound_output == "thrust 2", "the latest"
    own.begin()
    assert own.unsound_output is None


@pytest.mark.parametrize(("thrust", "airborne", "full"), [(0.8, False, True), (0.79, False, False), (0.9, True, False)])
def test_all_the_thrust_that_there_is_counts_on_the_ground_alone_and_is_kept(
    thrust: float, airborne: bool, full: bool
) -> None:
    own = OwnReport(SETTINGS, highest_thrust=0.8)
    own.passes(setpoint_with(thrust), airborne)
    assert (own.full_thrust, own.airborne) == (full, airborne)
    own.passes(SOUND, True)
    assert (own.full_thrust, own.airborne) == (full, True)
