"""Laws and planners of other packages."""

import re
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import cast

import msgspec
import numpy as np
import pytest

from companion import plugins
from companion.avoidance.methods import path_planner
from companion.control.controller import Controller
from companion.logs.info import info
from companion.logs.recorded import open_flight
from companion.logs.replay import replay
from companion.outcomes import Outcome
from companion.perception.map_view import MapView
from companion.plugins import PluginError
from companion.reports import LinkDelay
from companion.runtime.files import load_body, load_mission, load_settings
from companion.runtime.flight import Plan, Result, fly
from companion.runtime.planning import PlannerProcess
from companion.state import Output, Reference, VehicleState
from protocol import toml_files
from protocol.toml_files import TomlFileError
from tests.companion.installed import EXAMPLE, installed
from tests.companion.runtime.hop import InMemory
from vehicle_sim.airframe import Airframe
from vehicle_sim.vehicle import Vehicle
from vehicle_sim.world import World

BOTH = ("control.position.law=saturated", "avoidance.method=detour")
SMALL_MAP = ("avoidance.map.cells=160", "avoidance.map.cell=0.25")
PACKAGE = "courier-example 0.1.0"


def flown(folder: Path, overrides: tuple[str, ...]) -> Result:
    """The errand with the vehicle in memory."""
    mission, file = load_mission("errand")
    files = {
        "mission": file,
        "vehicle": toml_files.find("vehicles", mission.vehicle),
        "world": toml_files.find("worlds", mission.world),
    }
    vehicle = Vehicle(Airframe.load(files["vehicle"]), World.load(files["world"]), seed=1, lockstep=True)
    settings = load_settings(None, [*overrides, *SMALL_MAP])
    plan = Plan(settings, load_body(mission.vehicle), mission, Output.RATES, "lockstep", files, overrides=overrides)
    return fly(plan, InMemory(vehicle), folder, console=False)


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed(EXAMPLE, tmp_path_factory.mktemp("site")):
        yield


@pytest.fixture(scope="module")
def errand(example: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a delivery by the example's law and planner."""
    result = flown(tmp_path_factory.mktemp("flight"), BOTH)
    assert result.verdict.outcome is Outcome.DELIVERED
    return result.log


def test_a_foreign_law_and_a_foreign_planner_deliver_and_fly_again_to_the_byte(errand: Path) -> None:
    again = replay(errand)
    assert again.differences == [] and again.datagrams > 1000 and again.notes == []
    flight = info(errand).flight
    assert flight["position law"] == f'"saturated" of {PACKAGE}' and flight["planner"] == f'"detour" of {PACKAGE}'


def test_a_replay_without_the_package_says_what_is_missing(errand: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugins.installed.cache_clear()
    monkeypatch.setattr(plugins, "entry_points", lambda group: ())
    with pytest.raises(TomlFileError) as refused:
        open_flight(errand)
    both = f'position law "saturated" of {PACKAGE} and the planner "detour" of {PACKAGE}'
    assert str(refused.value).endswith(f"; it was flown with the {both}")
    overrides = ["control.position.law=pid", "avoidance.method=none"]
    assert open_flight(errand, overrides=overrides).settings.plugins == ()
    plugins.installed.cache_clear()


def test_an_unknown_name_is_refused_with_what_is_installed(example: None) -> None:
    for override, names in (
        ("control.position.law=saturate", ("pid", "saturated")),
        ("avoidance.method=detours", ("astar", "detour")),
    ):
        with pytest.raises(TomlFileError) as refused:
            load_settings(None, [override])
        assert all(f'"{name}"' in str(refused.value) for name in names)


def test_options_are_the_factorys(example: None) -> None:
    far = np.zeros((6, 3))
    far[0, 0], far[2] = 100.0, (0.0, 0.5, 0.0)
    here = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    for limit in (2.0, 4.0):
        flies = controller("control.position.law=saturated", f"control.position.options.limit={limit}")
        command = flies.acceleration_command(here, 4_000_000, 0, Reference(far), 1.0, airborne=False)
        assert command == pytest.approx([limit, 0.5, 0.0]), "its own command, and nothing else's"
    with pytest.raises(PluginError, match=f'position law "saturated" of {PACKAGE}: .*gain'):
        controller("control.position.law=saturated", "control.position.options.gain=1")
    with pytest.raises(TomlFileError, match="options"):
        load_settings(None, ["control.position.options.gain=1"])


BROKEN = """
def law(control, **options):
    return Law(**options)

class Law:
    def __init__(self, answer=0.0):
        self.answer = answer

    def reset(self):
        pass

    def acceleration_command(self, error, reference_acceleration, dt):
        return 1 / 0 if self.answer == 0.0 else self.answer

class Planner:
    def __init__(self, settings, answer=""):
        self.answer = answer

    def plan(self, view, position, velocity, goal, speed):
        return eval(self.answer)
"""


@pytest.fixture
def broken(tmp_path: Path) -> Iterator[None]:
    package, site = tmp_path / "package", tmp_path / "site"
    package.mkdir()
    site.mkdir()
    (package / "broken.py").write_text(BROKEN)
    (package / "pyproject.toml").write_text(
        '[project]\nname = "broken"\nversion = "1"\n'
        '[project.entry-points."courier.position_laws"]\nbroken = "broken:law"\nnot_there = "broken:missing"\n'
        '[project.entry-points."courier.planners"]\nbroken = "broken:Planner"\n'
    )
    with installed(package, site):
        yield


def controller(*overrides: str) -> Controller:
    return Controller(load_settings(None, list(overrides)), load_body("paper_quad"), Output.RATES)


def test_a_broken_law_is_named_and_stops_no_flight_but_its_own(broken: None) -> None:
    for name, options, words in (
        ("not_there", "", "AttributeError"),
        ("broken", "", "ZeroDivisionError"),
        ("broken", "control.position.options.answer=1.0", r"shape \(\) in place of \(3,\)"),
    ):
        with pytest.raises(PluginError, match=f'^position law "{name}" of broken 1: .*{words}'):
            asked = [f"control.position.law={name}", *filter(None, [options])]
            controller(*asked).follow(LinkDelay(command=0.1))
    controller("control.position.law=pid").follow(LinkDelay(command=0.1))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("1 / 0", "ZeroDivisionError"),
        ("[1.0]", "list in place of a Path"),
        ("Path(np.zeros((2, 3)), np.zeros(2))", "vertices"),
        ("Path(np.zeros((2, 2)), np.zeros(3))", "vertices"),
        ("Path(np.full((2, 2), np.nan), np.zeros(2))", "not finite"),
        ("Path(np.zeros((0, 2)), np.zeros(0), math.inf)", "not finite"),
        ("Path(np.zeros((2, 2)), np.array([speed, 2 * speed]))", "from 0 to 2 m/s"),
        ("Path(np.zeros((2, 2)), np.array([speed, -0.1]))", "from 0 to 2 m/s"),
    ],
)
def test_a_path_that_can_not_be_flown_is_refused(answer: str, words: str, broken: None) -> None:
    lines = "import math, numpy as np; from companion.avoidance.path import Path"
    code = f"(exec({lines!r}, globals()), {answer})[1]"
    settings = load_settings(None, ["avoidance.method=broken"]).avoidance
    planner = path_planner("broken", msgspec.structs.replace(settings, options={"answer": code}))
    with pytest.raises(PluginError, match=f'^planner "broken" of broken 1: .*{words}'):
        planner.plan(cast(MapView, None), np.zeros(3), np.zeros(3), np.ones(3), 2.0)


def test_the_planners_process_has_it_too(example: None) -> None:
    planner = PlannerProcess(load_settings(None, ["avoidance.method=detour", *SMALL_MAP]).avoidance)
    with closing(planner):
        assert planner.fault is None


def test_the_page_shows_the_example_as_it_is_flown() -> None:
    page = (EXAMPLE.parents[1] / "docs" / "extend.md").read_text()
    blocks = re.findall(r"^```(?:toml|python)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    files = ("pyproject.toml", "courier_example/law.py", "courier_example/planner.py")
    assert blocks == [(EXAMPLE / file).read_text() for file in files]
