"""The sampling planners: what their ways touch, their length beside A*'s, and that they repeat to the bit."""

import hashlib
import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.avoidance.astar import AStar
from companion.avoidance.rrt import Rrt
from companion.avoidance.shortcut import shorten
from companion.config_avoidance import RRT_PLANNERS, AvoidancePlan, AvoidanceRrt
from companion.perception.distance_field import distance_to
from companion.perception.map_view import FREE, OCCUPIED, Bytes, MapView
from companion.runtime.files import load_settings
from protocol.arrays import Array
from protocol.toml_files import TomlFileError

ROOT = Path(__file__).resolve().parents[3]
CELL, CELLS = 0.25, 128
"""The window is 32 x 32 m; places in quarters of a metre are exact."""
INFLATION = 0.75
ITERATIONS = {"bit*": 2000, "informed-rrt*": 700}
both = pytest.mark.parametrize("planner", RRT_PLANNERS)


def rrt(planner: str, seed: int = 1) -> Rrt:
    return Rrt(AvoidanceRrt(planner, ITERATIONS[planner], seed), INFLATION)


def view_of(states: Bytes, corner: tuple[int, int] = (0, 0)) -> MapView:
    return MapView(states, distance_to(states == OCCUPIED, CELL), corner, CELL)


def open_field() -> Bytes:
    return np.full((CELLS, CELLS), FREE, np.uint8)


def forest(seed: int) -> Bytes:
    """Trees of 0.6 m, one on 25 m2, none around the two places of `ACROSS`."""
    rng = np.random.default_rng(seed)
    states = open_field()
    centres = (np.indices(states.shape).transpose(1, 2, 0) + 0.5) * CELL
    for tree in rng.uniform(0.0, CELLS * CELL, (rng.poisson((CELLS * CELL) ** 2 / 25.0), 2)):
        if min(math.dist(tree, place) for place in ACROSS) > 1.5:
            states[np.hypot(*(centres - tree).transpose(2, 0, 1)) < 0.3 + 0.5 * CELL] = OCCUPIED
    return states


def u_trap() -> Bytes:
    """Open to the south, 10 m wide and 8 m deep, between the two places of `ACROSS`."""
    states = open_field()
    states[80, 44:85] = states[48:81, 44] = states[48:81, 84] = OCCUPIED
    return states


def gap() -> Bytes:
    """A wall across with a gap of 2.25 m in the east: 0.75 m between the inflations."""
    states = open_field()
    states[64, :] = OCCUPIED
    states[64, 100:109] = FREE
    return states


ACROSS = np.array([[3.0, 16.0], [29.0, 16.0]])
IN_THE_TRAP = np.array([[15.0, 16.0], [29.0, 16.0]])
SCENES = [
    *((f"forest {seed}", forest(seed), ACROSS) for seed in range(4)),
    ("U-trap", u_trap(), IN_THE_TRAP),
    ("gap", gap(), ACROSS),
]


def length(way: Array) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def clearances(view: MapView, a: Array, b: Array) -> Array:
    """m, every 5 mm along a line."""
    places = a + np.linspace(0.0, 1.0, math.ceil(math.dist(a, b) / 0.005) + 2)[:, None] * (b - a)
    return np.array([view.to_occupied[view.cell_of(place)] for place in places])


def astar_length(view: MapView, start: Array, goal: Array) -> float:
    search = AStar(AvoidancePlan(INFLATION, proximity_radius=1.6, proximity_cost=0.0, unknown_cost=0.0), CELLS)
    costmap = search.costmap(view)
    path = search.plan(view, costmap, start, goal)
    assert path is not None
    return length(shorten(path, view, costmap, INFLATION))


@both
def test_a_way_touches_no_forbidden_cell_and_is_about_as_long_as_that_of_astar(planner: str) -> None:
    for name, states, (start, goal) in SCENES:
        view = view_of(states)
        way = rrt(planner).plan(view, start, goal)
        assert way is not None, name
        assert np.allclose(way[0], start) and np.allclose(way[-1], goal)
        for a, b in itertools.pairwise(way):
            assert clearances(view, a, b).min() >= INFLATION, name
        assert 0.92 < length(way) / astar_length(view, start, goal) < 1.04, name
        if not name.startswith("forest"):
            assert length(way) > 1.2 * math.dist(start, goal), name


@both
def test_in_the_open_the_way_is_the_line(planner: str) -> None:
    way = rrt(planner).plan(view_of(open_field()), np.array([3.0, 4.0, -2.0]), np.array([20.0, 30.0, -5.0]))
    assert way is not None and np.allclose(way, [[3.0, 4.0], [20.0, 30.0]])


@both
def test_where_the_goal_is_walled_in_there_is_no_way(planner: str) -> None:
    states = open_field()
    states[20:100, 20] = states[20:100, 100] = states[20, 20:100] = states[100, 20:101] = OCCUPIED
    view = view_of(states)
    inside, outside = np.array([15.0, 15.0]), np.array([29.0, 15.0])
    assert rrt(planner).plan(view, inside, outside) is None
    assert rrt(planner).plan(view, outside, inside) is None
    assert rrt(planner).plan(view, inside, np.array([90.0, 15.0])) is None
    assert rrt(planner).plan(view, np.array([-1.0, 15.0]), outside) is None
    assert rrt(planner).plan(view_of(np.full((CELLS, CELLS), OCCUPIED, np.uint8)), inside, outside) is None


@both
def test_from_within_the_inflation_the_way_leads_out_on_its_own_side(planner: str) -> None:
    """The start is 0.5 m before a wall and 0.75 m from another: beyond either wall it would be out sooner."""
    states = open_field()
    states[64, 30:90] = states[59, 30:60] = OCCUPIED
    start, goal = np.array([15.625, 13.125]), np.array([25.0, 13.0])
    view = view_of(states)
    way = rrt(planner).plan(view, start, goal)
    assert way is not None and np.allclose(way[0], start) and way[1, 0] < 16.0
    assert clearances(view, way[0], way[1]).min() >= view.to_occupied[view.cell_of(start)]
    for a, b in itertools.pairwise(way[1:]):
        assert clearances(view, a, b).min() >= INFLATION
    assert way[1:, 1].max() > 22.5


@both
def test_a_forbidden_goal_is_approached_and_one_beyond_the_window_left_for_at_the_border(planner: str) -> None:
    states = open_field()
    states[64, 64] = OCCUPIED
    view = view_of(states)
    start, pillar = np.array([4.0, 16.0]), np.array([16.0, 16.25])
    way = rrt(planner).plan(view, start, pillar)
    assert way is not None and INFLATION <= view.to_occupied[view.cell_of(way[-1])] <= INFLATION + 2 * CELL
    assert math.dist(way[-1], pillar) <= INFLATION + 2 * CELL
    beyond = np.array([52.0, 28.0])  # the line leaves the window at 32 north, 23 east
    way = rrt(planner).plan(view, start, beyond)
    assert way is not None and np.abs(way[-1] - [32.0, 23.0]).max() < 1.5 * CELL
    states[120:, 80:104] = OCCUPIED  # there
    view = view_of(states)
    way = rrt(planner).plan(view, start, beyond)
    assert way is not None and view.to_occupied[view.cell_of(way[-1])] >= INFLATION
    assert 0 in (cell := view.cell_of(way[-1])) or CELLS - 1 in cell
    assert length(way) + math.dist(way[-1], beyond) < 1.05 * math.dist(start, beyond)


@both
def test_the_way_moves_with_the_window(planner: str) -> None:
    corner, shift = (-300, 40), np.array([-75.0, 10.0])
    states = forest(5)
    here = rrt(planner).plan(view_of(states), *ACROSS)
    there = rrt(planner).plan(view_of(states, corner), *(ACROSS + shift))
    assert here is not None and there is not None and np.allclose(here + shift, there)


def digest(order: list[int], planner: str) -> dict[str, str]:
    """A digest of the ways through some forests, planned in an order."""
    planning = rrt(planner)
    ways = {seed: planning.plan(view_of(forest(seed)), *ACROSS) for seed in order}
    return {str(seed): hashlib.sha256(b"" if way is None else way.tobytes()).hexdigest() for seed, way in ways.items()}


def test_ways_are_the_same_in_any_order_and_process() -> None:
    """The other planner's ways before, or the same one's, change nothing."""
    first = {planner: digest([6, 7, 8], planner) for planner in RRT_PLANNERS}
    program = """
import json, sys
from tests.companion.avoidance.test_rrt import RRT_PLANNERS, digest
assert "ompl" not in sys.modules
print(json.dumps({planner: digest([7, 8, 6], planner) for planner in reversed(RRT_PLANNERS)}))
"""
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert json.loads(found.stdout) == first and not found.stderr
    for planner, ways in first.items():
        assert len(set(ways.values())) == 3
        assert digest([8, 6, 7], planner) == ways


@both
def test_another_seed_is_another_way_of_about_the_length(planner: str) -> None:
    view = view_of(forest(6))
    ways = [rrt(planner, seed).plan(view, *ACROSS) for seed in (1, 2, 3)]
    lengths = [length(way) for way in ways if way is not None]
    assert len(set(lengths)) == 3 and max(lengths) < 1.05 * min(lengths)


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ('planner="rrt-connect"', "rrt-connect.*informed-rrt"),
        ("iterations=0", "iterations"),
        ("seed=0", "seed"),
    ],
)
def test_settings_without_a_meaning_are_named(override: str, named: str) -> None:
    with pytest.raises(TomlFileError, match=named):
        load_settings(None, [f"avoidance.rrt.{override}"])
