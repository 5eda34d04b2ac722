"""The table of methods: all that it lists can be chosen, named and flown, and a new entry makes a new method."""

from typing import get_args

import numpy as np
import pytest

from companion.avoidance.methods import goal_rule, path_planner
from companion.avoidance.none import NoAvoidance
from companion.avoidance.path import Path
from companion.avoidance.planner import Planner
from companion.avoidance_methods import FALLBACK, METHODS, Method, listed, methods_in_use
from companion.cli.flights import MethodName
from companion.config_avoidance import Avoidance, AvoidanceMap
from companion.perception.distance_field import distance_to
from companion.perception.map_view import FREE, MapView
from companion.runtime.files import load_settings
from protocol.arrays import Array
from protocol.toml_files import TomlFileError

CELLS = 64
HERE, STILL, GOAL = np.zeros(3), np.zeros(3), np.array([4.0, 0.0, 0.0])
MAPPED = [name for name, method in METHODS.items() if method.mapped]
RULES = [name for name in METHODS if name not in MAPPED]


def settings_of(method: str) -> Avoidance:
    return Avoidance(method=method, map=AvoidanceMap(cell=0.2, cells=CELLS))


def open_view() -> MapView:
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    return MapView(states, distance_to(states != FREE, 0.2), (-CELLS // 2, -CELLS // 2), 0.2)


@pytest.mark.parametrize("name", MAPPED)
def test_every_mapped_method_plans_straight_through_the_open(name: str) -> None:
    path = path_planner(name, settings_of(name)).plan(open_view(), HERE, STILL, GOAL, 3.0)
    assert path is not None and not path.tight and path.detour == pytest.approx(0.0, abs=0.2)
    if path.bearing is None:
        assert path.vertices[[0, -1]] == pytest.approx(np.array([HERE[:2], GOAL[:2]]))
    else:
        assert path.bearing == pytest.approx(0.0)


@pytest.mark.parametrize("name", RULES)
def test_every_rule_leaves_the_goal_alone_where_nothing_is_in_the_way(name: str) -> None:
    decision = goal_rule(settings_of(name)).decide(np.empty((0, 3)), HERE, STILL, GOAL, 3.0)
    assert np.array_equal(decision.target_ned, GOAL) and decision.speed_limit == 3.0 and not decision.blocked


@pytest.mark.parametrize("name", METHODS)
def test_the_settings_know_every_method(name: str) -> None:
    avoidance = load_settings(None, [f'avoidance.method="{name}"']).avoidance
    method = METHODS[name]
    assert method.name == name and method.summary
    assert (avoidance.mapped, avoidance.needs_scan) == (method.mapped, method.needs_scan)
    assert avoidance.guarded is avoidance.looks_around is method.mapped
    assert method.table is None or method.table in avoidance.__struct_fields__
    assert set(methods_in_use(name)) == ({name, FALLBACK} if method.mapped else {name})


def test_an_unknown_method_is_refused_with_the_names_of_all() -> None:
    with pytest.raises(TomlFileError) as refused:
        load_settings(None, ["avoidance.method=magic"])
    assert all(f'"{name}"' in str(refused.value) for name in METHODS)


def test_the_command_line_names_all() -> None:
    (option,) = get_args(MethodName)[1:]
    assert listed() in option.help and all(name in listed() for name in METHODS)
    assert listed(("a", "b", "c")) == "a, b or c" and listed(("a",)) == "a"


def test_a_rule_plans_no_paths_and_a_mapped_method_leaves_the_goal_to_the_planner() -> None:
    with pytest.raises(ValueError, match="paper"):
        path_planner("paper", settings_of("paper"))
    assert all(isinstance(goal_rule(settings_of(name)), NoAvoidance) for name in MAPPED)


class Sidestep:
    """A method of one's own: always by 1 m to the right, and no path to a goal that is lower."""

    def __init__(self, settings: Avoidance) -> None:
        self.radius = settings.vehicle_radius

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        if goal[2] > position[2]:
            return None
        return Path(np.array([position[:2], [0.0, 1.0], goal[:2]]), np.array([speed, speed, 0.0]))


def test_an_entry_makes_a_method(monkeypatch: pytest.MonkeyPatch) -> None:
    """And the fallback answers where it has no path."""
    entry = Method("sidestep", "to the right", f"{__name__}:Sidestep", mapped=True)
    monkeypatch.setitem(METHODS, entry.name, entry)
    planner = Planner(load_settings(None, ["avoidance.method=sidestep", "avoidance.map.cells=64"]).avoidance)
    assert planner.path(open_view(), HERE, STILL, GOAL, 2.0).vertices[1].tolist() == [0.0, 1.0]
    fallback = planner.path(open_view(), HERE, STILL, np.array([4.0, 0.0, 1.0]), 2.0)
    assert not len(fallback.vertices) and fallback.bearing == pytest.approx(0.0) and fallback.detour == np.inf
