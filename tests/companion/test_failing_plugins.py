"""Laws and planners of other packages that fail while they fly."""

import re
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.outcomes import Outcome
from companion.plugins import PluginError
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.planning import PlannerProcess
from companion.runtime.rehearsal import rehearse
from companion.state import Output
from protocol.framing import Framer
from protocol.messages import decode, dialect
from protocol.vehicle_parameters import GRAVITY
from studies.joined import Joined
from tests.companion.broken_package import broken_package

SMALL_MAP = ("avoidance.map.cells=160", "avoidance.map.cell=0.25")
READY_S = 60.0


@pytest.fixture(scope="module", autouse=True)
def broken(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with broken_package(tmp_path_factory.mktemp("broken")):
        yield


def test_why_the_planners_process_ends_is_told_to_who_flies() -> None:
    settings = load_settings(None, ["avoidance.method=broken", *SMALL_MAP]).avoidance
    planner = PlannerProcess(msgspec.structs.replace(settings, options={"answer": "1 / 0"}))
    with closing(planner):
        assert planner.take(READY_S) is None and not planner.ready
        told = r'planner "broken" of broken 1: ZeroDivisionError\(.division by zero.\) at broken:\d+'
        assert planner.fault is not None and re.fullmatch(told, planner.fault)
    planner = PlannerProcess(msgspec.structs.replace(settings, options={"answer": "__import__('os')._exit(5)"}))
    with closing(planner):
        assert planner.take(READY_S) is None and not planner.ready
    assert planner.fault == 'the process of planner "broken" of broken 1 has ended by itself (exit code 5)'


@pytest.mark.parametrize("error", ["KeyboardInterrupt", "SystemExit", "BaseException"])
def test_what_is_no_exception_ends_the_planners_process_without_a_traceback(
    error: str, capfd: pytest.CaptureFixture[str]
) -> None:
    settings = load_settings(None, ["avoidance.method=broken", *SMALL_MAP]).avoidance
    code = f"(exec('def fail(): raise {error}', globals()), fail())"
    planner = PlannerProcess(msgspec.structs.replace(settings, options={"answer": code}))
    with closing(planner):
        assert planner.take(READY_S) is None and not planner.ready
    assert planner.fault is not None
    assert planner.fault.startswith(f'planner "broken" of broken 1: {error}() at broken:')
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("answer", ['"panic"', '"nan"', '"huge"'])
def test_a_law_that_fails_in_flight_is_named_and_the_vehicle_lands(answer: str) -> None:
    """By its own autopilot, which is asked to hold first."""
    asked = ("control.position.law=brittle", f"control.position.options.answer={answer}", "avoidance.method=none")
    joined = Joined(load_mission("hover")[0], overrides=asked).fly()
    verdict = joined.autopilot.supervisor.verdict
    assert verdict is not None and verdict.outcome is Outcome.LANDED_EARLY
    assert 'position law "brittle" of broken 1: ' in verdict.cause
    summary = joined.vehicle.summary()
    assert summary.outcome == "landed" and 10.0 < summary.flight_time_s < 20.0


@pytest.mark.parametrize("answer", ["[100.0, 0.0, 0.0]", "[0.0, 0.0, -100.0]", "-3.0 * error.position - 0.1"])
def test_a_law_that_runs_away_is_withdrawn_from(answer: str) -> None:
    """It flew the vehicle 3 km away, until its battery was low or the step overdue: each command was a valid one."""
    options = ("control.position.law=brittle", f'control.position.options.answer="{answer}"')
    joined = Joined(load_mission("hover")[0], overrides=(*options, "avoidance.method=none")).fly()
    verdict = joined.autopilot.supervisor.verdict
    assert verdict is not None and verdict.outcome is Outcome.LANDED_EARLY
    assert re.match(r"6\.\d m from its reference, and farther and farther", verdict.cause)
    assert joined.vehicle.summary().outcome == "landed"
    assert np.linalg.norm(joined.tracking_error(), axis=1).max() < 6.5


@pytest.mark.parametrize("before_s", [0.1, 0.0])
def test_before_the_vehicle_is_asked_to_hold_it_is_level_and_hovers(before_s: float) -> None:
    """A mode of ArduPilot begins with the vertical acceleration that it finds. Here the vehicle falls."""
    falls = "[0.0, 0.0, 5.0] if self.left > -0.1 else 1 / 0"
    options = ("control.position.options.after=6.0", f'control.position.options.answer="{falls}"')
    asked = ("control.position.law=brittle", *options, "avoidance.method=none", f"supervision.level_before={before_s}")
    joined = Joined(load_mission("hover")[0], Output.ATTITUDE, overrides=asked).fly()
    assert joined.vehicle.summary().outcome == "landed"
    framer = Framer()
    said: list[Any] = [(at, decode(frame)) for at, sent in enumerate(joined.sent) for frame in framer.datagram(sent)]
    setpoints = [(at, each) for at, each in said if each.get_msgId() == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET]
    modes = [at for at, each in said if getattr(each, "command", 0) == dialect.MAV_CMD_DO_SET_MODE]
    (_, before), (left, last) = setpoints[-2:]
    body = joined.autopilot.body
    hover = (body.mass_kg + body.parcel_mass_kg) * GRAVITY / body.max_thrust_n
    assert before.thrust < 0.6 * hover
    if before_s:
        assert last.thrust == pytest.approx(hover, rel=0.05) and last.q[1:3] == [0.0, 0.0] and left not in modes
    else:
        assert last.thrust < 0.6 * hover
    assert any(at > left for at in modes)


def test_a_law_that_fails_on_the_ground_begins_no_flight() -> None:
    asked = ("control.position.law=brittle", "control.position.options.after=0.0", "avoidance.method=none")
    joined = Joined(load_mission("hover")[0], overrides=asked).fly(limit_s=30.0)
    verdict = joined.autopilot.supervisor.verdict
    assert verdict is not None and verdict.outcome is Outcome.NOT_STARTED
    assert verdict.cause.startswith('position law "brittle" of broken 1: ZeroDivisionError')
    with pytest.raises(PluginError, match=r'^position law "brittle" of broken 1: ZeroDivisionError'):
        rehearse(load_settings(None, list(asked)), load_body("paper_quad"), load_mission("hover")[0], Output.RATES)
