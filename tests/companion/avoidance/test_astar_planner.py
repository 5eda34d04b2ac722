"""Which side of an obstacle, and which of two gaps, the method "astar" chooses, from one plan to the next."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from companion.avoidance.astar_planner import AStarPlanner
from companion.avoidance.steering import steer
from companion.config_avoidance import Avoidance
from companion.perception.distance_field import distance_to
from companion.perception.fence_band import with_fence
from companion.perception.free_space import MOVER_COLUMNS
from companion.perception.map_view import FREE, OCCUPIED, MapView
from protocol.arrays import Array

SETTINGS = Avoidance()
CELLS, CELL = SETTINGS.map.cells, SETTINGS.map.cell
MIDDLE = 0.5 * CELLS * CELL
STILL = np.zeros(3)
FAR_AWAY = np.full((1, MOVER_COLUMNS), 1e-3)
FAR_AWAY[0, :5] = MIDDLE - 0.4 * CELLS * CELL, MIDDLE - 0.4 * CELLS * CELL, -3.0, 0.0, 0.5
"""A mover that leaves, too far away to cost anything on the way."""


def view_of(moving: Array | None) -> MapView:
    """A wall of 4 m across the way north, its middle on the way."""
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    half, row = round(2.0 / CELL), CELLS // 2 + round(4.0 / CELL)
    states[row : row + 2, CELLS // 2 - half : CELLS // 2 + half] = OCCUPIED
    return MapView(states, distance_to(states == OCCUPIED, CELL), (0, 0), CELL, moving=moving)


def side(planner: AStarPlanner, moving: Array | None, east: float) -> float:
    """-1 or 1: west or east of the wall, for a vehicle that stands so far east of its middle (m)."""
    start, goal = np.array([MIDDLE, MIDDLE + east, -2.0]), np.array([MIDDLE + 8.0, MIDDLE, -2.0])
    path = planner.plan(view_of(moving), start, STILL, goal, 3.0)
    assert path is not None
    return float(np.sign(path.vertices[np.abs(path.vertices[:, 1] - MIDDLE).argmax(), 1] - MIDDLE))


@pytest.mark.parametrize("first", [-0.6, 0.6])
def test_the_shorter_side_is_taken_anew_each_time_while_nothing_moves(first: float) -> None:
    planner = AStarPlanner(SETTINGS)
    assert side(planner, None, first) == np.sign(first)
    assert side(planner, None, -first) == -np.sign(first)


@pytest.mark.parametrize("first", [-0.6, 0.6])
def test_while_something_moves_the_side_is_kept(first: float) -> None:
    """A side that changes with each ring is no side: the vehicle would stay before the wall."""
    planner = AStarPlanner(SETTINGS)
    assert side(planner, FAR_AWAY, first) == np.sign(first)
    assert side(planner, FAR_AWAY, -first) == np.sign(first)
    assert side(AStarPlanner(SETTINGS), FAR_AWAY, -first) == -np.sign(first), "it is the plan before that holds it"


def test_a_side_that_is_much_dearer_is_given_up() -> None:
    planner = AStarPlanner(SETTINGS)
    assert side(planner, FAR_AWAY, 0.6) == 1.0
    assert side(planner, FAR_AWAY, -6.0) == -1.0


def test_another_goal_has_no_side_yet() -> None:
    planner = AStarPlanner(SETTINGS)
    assert side(planner, FAR_AWAY, 0.6) == 1.0
    away = np.array([MIDDLE - 8.0, MIDDLE, -2.0])
    assert planner.plan(view_of(FAR_AWAY), np.array([MIDDLE, MIDDLE, -2.0]), STILL, away, 3.0) is not None
    assert side(planner, FAR_AWAY, -0.6) == -1.0


@pytest.mark.parametrize("into", [0.05, 0.2])
def test_a_goal_in_an_obstacle_is_flown_to_with_the_room_of_a_path(into: float) -> None:
    """It was flown to straight from 1 m on: the guard alone kept the hull from the obstacle, by a centimetre."""
    planner, view = AStarPlanner(SETTINGS), view_of(None)
    here, goal = (np.array([MIDDLE + north, MIDDLE, -2.0]) for north in (2.0, 4.0 + into))
    velocity = np.zeros(3)
    for _ in range(60):
        path = planner.plan(view, here, velocity, goal, 3.0)
        assert path is not None
        for _ in range(5):
            velocity[:2] = steer(path, here[:2], velocity[:2], goal[:2], 3.0, SETTINGS).velocity
            here += 0.02 * velocity
    assert np.hypot(*velocity[:2]) < 0.05
    assert 0.0 <= view.to_occupied[view.cell_of(here)] - SETTINGS.plan.inflation < 2.0 * CELL


@pytest.mark.parametrize("aside", [-0.6, 0.6])
def test_a_tight_path_keeps_to_the_middle_of_its_passage(aside: float) -> None:
    """The way along a side would be the shorter one, and is not forbidden."""
    settings = replace(SETTINGS, plan=replace(SETTINGS.plan, inflation=0.7))
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    row, half = CELLS // 2 + round(2.0 / CELL), 4
    states[row : row + round(4.0 / CELL)] = OCCUPIED
    states[:, CELLS // 2 - half : CELLS // 2 + half + 1] = FREE
    view = MapView(states, distance_to(states == OCCUPIED, CELL), (0, 0), CELL)
    middle = MIDDLE + 0.5 * CELL
    start, goal = (np.array([MIDDLE + north, middle + aside, -2.0]) for north in (0.0, 8.0))
    path = AStarPlanner(settings).plan(view, start, STILL, goal, 3.0)
    assert path is not None and path.tight
    east = np.interp(MIDDLE + np.linspace(2.5, 5.5, 7), path.vertices[:, 0], path.vertices[:, 1])
    assert np.abs(east - middle).max() < 0.5 * CELL


def gaps(doubted: float, blur: float = 1.0) -> MapView:
    """A wall across the whole map with two gaps of 0.9 m, 4 m west and east of the middle. In the one on the side
    `doubted` (-1 or 1) there may be something: a return that lies anywhere within `blur` (m)."""
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    row, gap = CELLS // 2 + round(4.0 / CELL), round(0.9 / CELL)
    states[row : row + 2] = OCCUPIED
    for side in (-1.0, 1.0):
        column = CELLS // 2 + round(side * 4.0 / CELL)
        states[row : row + 2, column - gap // 2 : column - gap // 2 + gap] = FREE
    plug = row, CELLS // 2 + round(doubted * 4.0 / CELL)
    states[plug] = OCCUPIED
    places = np.argwhere(states == OCCUPIED)
    hits = np.array((places + 0.5) * CELL, np.float64)
    blurs = np.where((places == plug).all(axis=1), blur, 0.0)
    return MapView(states, distance_to(states == OCCUPIED, CELL), (0, 0), CELL, hits=hits, blurs=blurs)


def choices(planner: AStarPlanner, doubts: list[float]) -> list[float]:
    """The gaps that are chosen by a vehicle before the wall, in whose middle it stays."""
    start, goal, found = np.array([MIDDLE, MIDDLE, -2.0]), np.array([MIDDLE + 8.0, MIDDLE, -2.0]), []
    for doubted in doubts:
        path = planner.plan(gaps(doubted), start, STILL, goal, 3.0)
        assert path is not None
        found.append(float(np.sign(path.vertices[1, 1] - MIDDLE)))
    return found


DOUBTS = [1.0, -1.0] * 10


@pytest.mark.parametrize(("turn_scans", "goes_on"), [(8, True), (1, False)])
def test_one_scan_that_errs_does_not_turn_a_vehicle_round_in_a_passage(turn_scans: int, goes_on: bool) -> None:
    planner = AStarPlanner(replace(SETTINGS, plan=replace(SETTINGS.plan, turn_scans=turn_scans)))
    mouth, goal = np.array([MIDDLE + 3.4, MIDDLE + 4.0, -2.0]), np.array([MIDDLE + 8.0, MIDDLE, -2.0])

    def turns(doubted: float, blur: float) -> bool:
        """To the gap west of the middle; the one that the vehicle is before is east of it."""
        path = planner.plan(gaps(doubted, blur), mouth, STILL, goal, 3.0)
        assert path is not None
        return bool(path.vertices[:, 1].min() < MIDDLE - 2.0)

    open_ahead, closed_ahead = (0.0, 0.0), (1.0, 0.0)
    assert not any(turns(*open_ahead) for _ in range(3))
    assert turns(*closed_ahead)
    assert turns(*open_ahead) is not goes_on
    assert all(turns(*closed_ahead) for _ in range(9))
    assert turns(*open_ahead), "closed for long: the other way is gone on with"


def test_of_two_gaps_that_are_doubted_in_turn_one_is_flown_to() -> None:
    """A price that changes with each scan turns the vehicle round a few times, and then no more."""
    found = choices(AStarPlanner(SETTINGS), DOUBTS)
    assert found[:2] == [-1.0, 1.0]
    assert len(set(found[-5:])) == 1


def test_without_growth_the_vehicle_turns_round_each_time() -> None:
    without = replace(SETTINGS, plan=replace(SETTINGS.plan, switch_growth=1.0))
    assert choices(AStarPlanner(without), DOUBTS) == [-doubted for doubted in DOUBTS]


@pytest.mark.parametrize(("growth", "stays"), [(8.0, True), (1.0, False)])
def test_a_passage_that_was_entered_is_not_left_for_a_doubt(growth: float, stays: bool) -> None:
    planner = AStarPlanner(replace(SETTINGS, plan=replace(SETTINGS.plan, switch_growth_tight=growth)))
    assert choices(planner, [1.0]) == [-1.0]
    mouth, goal = np.array([MIDDLE + 3.2, MIDDLE - 4.0, -2.0]), np.array([MIDDLE + 8.0, MIDDLE, -2.0])
    assert planner.plan(gaps(1.0), mouth, STILL, goal, 3.0) is not None
    path = planner.plan(gaps(-1.0), mouth, STILL, goal, 3.0)
    assert path is not None and path.tight and bool(path.vertices[:, 1].max() < MIDDLE) is stays


@pytest.mark.parametrize("north", [8.0, -8.0])
def test_another_goal_ends_the_growth(north: float) -> None:
    """Behind the wall, too, or behind the vehicle."""
    planner = AStarPlanner(SETTINGS)
    held = choices(planner, DOUBTS)[-1]
    start, goal = np.array([MIDDLE, MIDDLE, -2.0]), np.array([MIDDLE + north, MIDDLE + 3.0, -2.0])
    assert planner.plan(gaps(held), start, STILL, goal, 3.0) is not None
    assert choices(planner, [held, -held]) == [-held, held]


def test_an_open_way_ends_the_growth() -> None:
    planner = AStarPlanner(SETTINGS)
    held = choices(planner, DOUBTS)[-1]
    start, goal = np.array([MIDDLE, MIDDLE, -2.0]), np.array([MIDDLE + 8.0, MIDDLE, -2.0])
    assert planner.plan(view_of(None), start, STILL, goal, 3.0) is not None
    assert choices(planner, [held, -held]) == [-held, held]


def beside_the_fence(here: Array, gap: float) -> MapView:
    """A wall along the east, 8 m north, that ends so far (m) before the fence, beyond which east is positive."""
    corner = math.floor(here[0] / CELL) - CELLS // 2, math.floor(here[1] / CELL) - CELLS // 2
    states, east = np.full((CELLS, CELLS), FREE, np.uint8), (np.arange(CELLS) + corner[1] + 0.5) * CELL
    row = round(8.0 / CELL) - corner[0]
    if 0 <= row < CELLS:
        states[row, (east > -19.0) & (east < -gap)] = OCCUPIED
    hits = np.array((np.argwhere(states == OCCUPIED) + np.array(corner) + 0.5) * CELL, np.float64)
    view = MapView(states, distance_to(states == OCCUPIED, CELL), corner, CELL, hits=hits, blurs=np.zeros(len(hits)))
    return with_fence(view, (0.0, -6.0, -math.inf, math.inf, -math.inf, 0.0, math.inf), SETTINGS.plan)


@pytest.mark.parametrize("gap", [0.85, 0.9])
def test_it_flies_round_a_wall_that_leaves_too_little_room_before_the_fence(gap: float) -> None:
    """It does not stand where a passage would begin that is none."""
    planner, here, goal = AStarPlanner(SETTINGS), np.array([0.0, -6.0, -3.0]), np.array([16.0, -6.0, -3.0])
    for _ in range(300):
        path = planner.plan(beside_the_fence(here, gap), here, STILL, goal, 1.0)
        assert path is not None
        way = path.vertices[1] - here[:2]
        here = here + np.array((*(min(0.2 / max(math.hypot(*way), 1e-9), 1.0) * way), 0.0))
    assert math.dist(here.tolist(), goal.tolist()) < 0.3
