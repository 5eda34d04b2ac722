"""After a rehearsal nothing is left to be compiled in flight."""

import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.config_avoidance import Avoidance
from companion.mission.plan import Mission, Waypoint
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.planning import InProcessPlanner, PlannerBackend
from companion.runtime.rehearsal import OpenField, RehearsalError, rehearse
from companion.state import Output
from studies.joined import Joined, mission_of
from tests.companion.reference_flight import SMALL_MAP

ROOT = Path(__file__).resolve().parents[3]

COMPILED = """
import sys
from numba.core.dispatcher import Dispatcher

def compiled():
    return {
        (function.py_func.__module__, function.py_func.__name__, str(signature))
        for module in list(sys.modules.values())
        for function in list(getattr(module, "__dict__", {}).values()) if isinstance(function, Dispatcher)
        for signature in function.signatures
    }
"""
REPLAY = """
import pickle
from companion.runtime.files import load_mission
from companion.autopilot import Autopilot
from companion.runtime.files import load_body, load_settings
from companion.runtime.planning import InProcessPlanner
from companion.runtime.rehearsal import OpenField, rehearse
from companion.state import Output
from companion.trace import Thinning

flown = load_settings(None, {coarse!r}), load_body("paper_quad"), load_mission({mission!r})[0], Output({output!r})
rehearse(*flown, {planner})
before, modules = compiled(), set(sys.modules)
autopilot = Autopilot(*flown)
thinning = Thinning(flown[0].log.trace_rate)
for event in pickle.load(open({events!r}, "rb")):
    trace = autopilot.handle(event).trace
    if trace is not None:
        thinning.step(event.time_ns, trace)
assert autopilot.ended
print(sorted(compiled() - before), sorted(set(sys.modules) - modules))
"""


@pytest.mark.parametrize(
    ("mission", "output", "planner", "unheard_ns"),
    [
        ("errand", Output.RATES, "OpenField", 0),
        (str(ROOT / "tests" / "data" / "eight.toml"), Output.ATTITUDE, "InProcessPlanner", 500_000_000),
        (str(ROOT / "tests" / "data" / "hover.toml"), Output.ACTUATORS, "InProcessPlanner", 500_000_000),
    ],
    ids=["errand", "eight", "hover"],
)
def test_nothing_is_compiled_or_imported_in_flight(
    tmp_path: Path, mission: str, output: Output, planner: str, unheard_ns: int
) -> None:
    """A flight's events again, in a process that has only rehearsed: the simulator is not there to compile for it, nor,
    where the planner has a process of its own, the planner."""
    joined = Joined(mission_of(mission), output, overrides=SMALL_MAP)
    joined.meddle = lambda time_ns, data: data if time_ns > unheard_ns else b""  # from the middle of its telemetry on
    joined.fly()
    assert joined.autopilot.ended and joined.autopilot.supervisor.fault is None
    events = tmp_path / "events"
    events.write_bytes(pickle.dumps(joined.events))
    asked = {"mission": mission, "output": output.value, "planner": planner, "coarse": SMALL_MAP}
    script = COMPILED + REPLAY.format(events=str(events), **asked)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[] []"


FASTER = """
import numpy as np
from companion.avoidance.path import Path
from companion.avoidance.steering import steer
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.rehearsal import OpenField, rehearse
from companion.state import Output

settings, mission = load_settings(None, []), load_mission("errand")[0]
rehearse(settings, load_body("paper_quad"), mission, Output.RATES, OpenField)
before, here = compiled(), np.array((1.0, 0.0, -3.0))
curve = Path(np.array(((0.0, 0.0), (4.0, 1.0), (8.0, 4.0))), np.array((8.0, 6.0, 0.0)), smooth=True)
way = steer(curve, here[:2], here[:2], np.array((8.0, 4.0, -3.0))[:2], 8.0, settings.avoidance)
print(mission.speed < settings.avoidance.course.smooth_from, way.acceleration.any(), sorted(compiled() - before))
"""


def test_nothing_is_compiled_once_a_mission_is_flown_faster_than_it_asks_for() -> None:
    """By DO_CHANGE_SPEED: its paths become curves in flight, which no rehearsal of the mission has flown."""
    command = [sys.executable, "-c", COMPILED + FASTER]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "True True []"


PLANS = """
import numpy as np
from companion.avoidance.planner import PlanningPipeline, PlanRequest
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.runtime.planning import rehearse
from companion.state import Scan

settings = Avoidance(map=AvoidanceMap(cells=128))
rehearse(settings)
before, tight = compiled(), 0
bearings, level = np.radians(np.arange(0.0, 360.0, 5.0)), np.array([1.0, 0.0, 0.0, 0.0])
for gap in (1.6, 1.2, 1.0, 0.0):
    pipeline = PlanningPipeline(settings)
    for k in range(40):
        now, here = 66_000_000 * k, np.array([0.1 * k, 0.02 * k, -3.0])
        ahead, aside = np.maximum(np.cos(bearings), 1e-9), np.sin(bearings)
        ranges = np.where(np.cos(bearings) > 0.0, (6.0 - here[0]) / ahead, 15.0)
        ranges[np.abs(ranges * aside + here[1]) < 0.5 * gap] = 15.0
        ranges = np.minimum(ranges, np.minimum(5.0 / np.maximum(np.abs(aside), 1e-9), 15.0))
        scan = Scan(now, now // 1000, bearings, ranges, ranges < 15.0, np.full(72, True))
        ask = k + 1, now, scan, (here, level), -0.5, here, np.array([1.5, 0.0, 0.0]), np.array([20.0, 0.0, -3.0]), 3.0
        tight += pipeline.answer(PlanRequest(*ask)).path.tight
print(sorted(compiled() - before), tight > 10)
"""


def test_nothing_is_compiled_at_the_first_tight_way() -> None:
    """Once it was, for 2.7 s in flight: no map came meanwhile, and the vehicle landed."""
    command = [sys.executable, "-c", COMPILED + PLANS]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[] True"


@pytest.mark.parametrize(
    ("mission", "output"),
    [
        *((path.stem, Output.RATES) for path in sorted((ROOT / "missions").glob("*.toml"))),
        ("errand", Output.ATTITUDE),
        ("errand", Output.ACTUATORS),
        ("errand", None),
    ],
)
@pytest.mark.parametrize("planner", [InProcessPlanner, OpenField])
def test_every_mission_gets_through_its_rehearsal(
    mission: str, output: Output | None, planner: Callable[[Avoidance], PlannerBackend]
) -> None:
    """Also where it is to fly another system than the first alone, and where the planner has a process of its own, as
    in real time."""
    settings = load_settings(None, ["identity.vehicle=6", *SMALL_MAP])
    rehearse(settings, load_body("paper_quad"), load_mission(mission)[0], output, planner)


def test_a_rehearsal_that_does_not_end_is_an_error() -> None:
    """A companion that waits for a rate that nobody can send would wait in the air as well."""
    settings = load_settings(None, ["rates.attitude=100000.0"])
    with pytest.raises(RehearsalError, match="ATTITUDE_QUATERNION"):
        rehearse(settings, load_body("paper_quad"), load_mission("hover")[0], Output.RATES)


def test_a_survey_of_hundreds_of_waypoints_is_not_rehearsed_waypoint_by_waypoint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The start of 400 waypoints took 20 s, each time."""
    monkeypatch.setattr("companion.runtime.rehearsal._LONGEST_TICKS", 2500)
    row = [Waypoint(20.0 * (k // 20), 10.0 * abs(k % 20 - 19 * (k // 20 % 2)), 10.0) for k in range(400)]
    settings = load_settings(None, ["avoidance.method=none"])
    rehearse(settings, load_body("paper_quad"), Mission("survey", waypoints=row), Output.RATES)
