"""The search against Dijkstra by scipy, the room it keeps, and the shortened way with its corner speeds."""

import itertools
import math

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from companion.avoidance.astar import AStar, GridPath
from companion.avoidance.shortcut import line_cost, shorten, vertex_speeds
from companion.config_avoidance import AvoidancePlan
from companion.perception.distance_field import Floats, distance_to
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, MapView
from protocol.arrays import Array

SETTINGS = AvoidancePlan(inflation=0.6, proximity_radius=1.4, proximity_cost=2.0, unknown_cost=1.0)
CELL = 0.2


def view_of(states: Bytes, corner: tuple[int, int] = (0, 0)) -> MapView:
    return MapView(states, distance_to(states == OCCUPIED, CELL), corner, CELL)


def field(rng: np.random.Generator, cells: int = 40, density: float = 0.01) -> Bytes:
    states = np.where(rng.random((cells, cells)) < density, OCCUPIED, FREE).astype(np.uint8)
    unknown = rng.random((cells, cells)) < 0.2
    states[unknown & (states == FREE)] = UNKNOWN
    return states


def plan(view: MapView, start: Array, goal: Array) -> tuple[GridPath | None, Floats]:
    search = AStar(SETTINGS, view.states.shape[0])
    costmap = search.costmap(view)
    return search.plan(view, costmap, start, goal), costmap


def graph_of(view: MapView, costmap: Floats, inflation: float = SETTINGS.inflation) -> csr_array:
    rows, columns = costmap.shape
    edges: list[tuple[int, int, float]] = []
    clear = view.to_occupied
    for i in range(rows):
        for j in range(columns):
            for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)):
                a, b = i + dr, j + dc
                if not (0 <= a < rows and 0 <= b < columns) or clear[a, b] < min(inflation, clear[i, j]):
                    continue
                cost = CELL * math.hypot(dr, dc) * 0.5 * (costmap[i, j] + costmap[a, b])
                edges.append((i * columns + j, a * columns + b, cost))
    start, end, cost_of = np.array(edges).T
    size = rows * columns
    return csr_array((cost_of, (start.astype(int), end.astype(int))), shape=(size, size))


def test_cost_is_that_of_dijkstra() -> None:
    rng = np.random.default_rng(1)
    found = lost = 0
    for _ in range(12):
        view = view_of(field(rng, density=0.025))
        start, goal = rng.uniform(0.5, 7.5, (2, 2))
        path, costmap = plan(view, start, goal)
        if view.to_occupied[view.cell_of(goal)] < SETTINGS.inflation:
            continue
        s, g = view.cell_of(start), view.cell_of(goal)
        expected = dijkstra(graph_of(view, costmap), indices=s[0] * 40 + s[1])[g[0] * 40 + g[1]]
        if path is None:
            assert math.isinf(expected)
            lost += 1
        else:
            assert path.cost == pytest.approx(expected) and path.costs[-1] == pytest.approx(expected)
            assert tuple(path.cells[0]) == s and tuple(path.cells[-1]) == g
            found += 1
    assert found >= 3


def test_paths_between_dear_ends_are_the_cheapest_both_ways() -> None:
    """From within the inflation to where cells cost much, which the search does backwards, and from there back."""
    rng = np.random.default_rng(5)
    for _ in range(8):
        states = field(rng, density=0.0)
        states[18:23, 3] = states[18, 3:9] = states[22, 3:9] = OCCUPIED
        states[30, 33] = OCCUPIED
        view = view_of(states)
        alley, beside = np.array([4.1, 1.3]), np.array([6.1, 6.9])
        near = view.to_occupied[view.cell_of(alley)]
        assert near < SETTINGS.inflation and view.to_occupied[view.cell_of(beside)] < SETTINGS.inflation
        search = AStar(SETTINGS, 40)
        costmap = search.costmap(view)
        costmap[16:25, 3:9] += rng.uniform(20.0, 60.0)
        graph = graph_of(view, costmap, inflation=float(near))
        for start, goal in ((beside, alley), (alley, np.array([6.1, 5.1]))):
            path = search.plan(view, costmap, start, goal, inflation=float(near))
            assert path is not None
            s, g = view.cell_of(start), view.cell_of(goal)
            expected = dijkstra(graph, indices=s[0] * 40 + s[1])[g[0] * 40 + g[1]]
            assert path.cost == pytest.approx(expected) and path.costs[-1] == pytest.approx(expected)
            assert path.costs[0] == pytest.approx(0.0) and (np.diff(path.costs) > 0.0).all()
            assert tuple(path.cells[0]) == s and tuple(path.cells[-1]) == g


def test_a_limited_search_after_one_that_failed_finds_what_it_would_find_before() -> None:
    """That no path is so cheap is then looked for first. Goals in the window and beyond it."""
    rng = np.random.default_rng(6)
    outcomes = set()
    for _ in range(60):
        view = view_of(field(rng, density=0.03))
        start, goal = rng.uniform(0.5, 7.5, 2), rng.uniform(-1.0, 9.0, 2)
        search = AStar(SETTINGS, 40)
        costmap = search.costmap(view)
        whole = search.plan(view, costmap, start, goal)
        detour = 1.0 if whole is None else whole.detour * rng.choice((0.9, 1.1)) + 1e-3
        first = search.plan(view, costmap, start, goal, max_detour=detour)
        walled = view_of(np.where(np.abs(np.indices((40, 40)) - 20).max(axis=0) == 12, OCCUPIED, FREE).astype(np.uint8))
        assert search.plan(walled, search.costmap(walled), np.full(2, 4.1), np.full(2, 7.5), max_detour=1.0) is None
        costmap = search.costmap(view)
        again = search.plan(view, costmap, start, goal, max_detour=detour)
        assert (first is None) == (again is None) == (whole is None or whole.detour > detour)
        if first is not None and again is not None:
            assert first.cost == again.cost and np.array_equal(first.cells, again.cells)
        outcomes.add((whole is None, first is None, view.contains(view.cell_of(goal))))
    assert outcomes >= {(False, True, True), (False, False, True), (False, True, False), (False, False, False)}


def test_a_goal_behind_walls_that_may_not_be_there_does_not_open_the_window_again() -> None:
    """Its second search, which knows that the way is dear, begins at the goal. The walls are in doubt: the certain
    distances have none."""
    states = np.full((200, 200), FREE, np.uint8)
    states[140:171, 140] = states[140:171, 170] = states[140, 140:171] = states[170, 140:171] = OCCUPIED
    view, start, goal = view_of(states), np.array([4.1, 5.1]), np.array([31.1, 31.3])
    certain = np.full_like(view.to_occupied, 3.0)
    search, opened, found = AStar(SETTINGS, 200), [], []
    for number in (1, 2):
        costmap = search.costmap(view)
        costmap += 400.0 * np.maximum(1.0 - view.to_occupied / 0.4, 0.0) ** 2
        found.append(search.plan(view, costmap, start, goal, 0.4, certain))
        opened.append(np.count_nonzero(search._memory[2] >= 3 * number))
    first, second = found
    assert first is not None and second is not None and second.cost == pytest.approx(first.cost)
    assert second.cells[0].tolist() == first.cells[0].tolist() and second.cells[-1].tolist() == first.cells[-1].tolist()
    assert second.costs[0] == pytest.approx(0.0) and second.costs[-1] == pytest.approx(second.cost)
    assert opened[0] > 0.5 * states.size and opened[1] < 0.2 * opened[0]


def test_a_dear_goal_does_not_open_the_window() -> None:
    states = np.full((80, 80), FREE, np.uint8)
    states[36:45, 60] = states[36, 50:60] = states[44, 50:60] = OCCUPIED
    view = view_of(states)
    search = AStar(SETTINGS, 80)
    costmap = search.costmap(view)
    costmap[36:45, 50:60] += 50.0
    assert search.plan(view, costmap, np.array([8.1, 2.1]), np.array([8.1, 11.3])) is not None
    assert np.count_nonzero(search._memory[2]) < 0.2 * states.size


def test_goal_beyond_the_window_is_reached_by_the_best_border_cell() -> None:
    """Also where all is unknown beyond some distance, as it is in flight: the search then expects no less than that."""
    rng = np.random.default_rng(2)
    rows, columns = np.indices((40, 40))
    for seen in (40, 40, 15, 11, 7, 9, 12):
        states = field(rng)
        states[np.hypot(rows - 20, columns - 20) > seen] = UNKNOWN
        view = view_of(states)
        goal = rng.uniform(-6.0, 14.0, 2)
        if view.contains(view.cell_of(goal)):
            goal[0] += 20.0
        path, costmap = plan(view, np.array([4.1, 4.1]), goal)
        assert path is not None
        distances = dijkstra(graph_of(view, costmap), indices=20 * 40 + 20).reshape(40, 40)
        border = (rows == 0) | (rows == 39) | (columns == 0) | (columns == 39)
        g = view.cell_of(goal)
        beyond = (1.0 + SETTINGS.unknown_cost) * CELL * np.hypot(rows - g[0], columns - g[1])
        assert path.cost == pytest.approx((distances + beyond)[border].min())


def test_no_cell_of_a_way_is_nearer_to_an_occupied_one_than_the_inflation() -> None:
    rng = np.random.default_rng(3)
    ways = 0
    for _ in range(40):
        view = view_of(field(rng, 64, 0.008))
        start = np.array([1.0, 1.0])
        path, costmap = plan(view, start, np.array([11.5, 11.5]))
        if path is None:
            continue
        ways += 1
        allowed = min(SETTINGS.inflation, view.to_occupied[view.cell_of(start)])
        assert view.to_occupied[tuple(path.cells.T)].min() >= allowed
        assert np.abs(np.diff(path.cells, axis=0)).max() == 1
        vertices = shorten(path, view, costmap, SETTINGS.inflation)
        for a, b in itertools.pairwise(vertices):
            for share in np.linspace(0.0, 1.0, 60):
                assert view.to_occupied[view.cell_of(a + share * (b - a))] >= allowed - 0.5 * CELL
    assert ways > 20


def test_from_within_the_inflation_the_way_leads_out() -> None:
    states = np.full((40, 40), FREE, np.uint8)
    states[20, 20] = OCCUPIED
    view = view_of(states)
    path, _ = plan(view, np.array([4.1, 4.3]), np.array([4.1, 1.0]))
    assert path is not None
    clear = view.to_occupied[tuple(path.cells.T)]
    inside = clear < SETTINGS.inflation
    assert inside[0] and (np.diff(clear)[inside[:-1]] >= 0.0).all() and not inside[inside.argmin() :].any()


def test_closed_in_there_is_no_way() -> None:
    states = np.full((40, 40), FREE, np.uint8)
    states[8:32, 8] = states[8:32, 32] = states[8, 8:32] = states[32, 8:33] = OCCUPIED
    assert plan(view_of(states), np.array([4.1, 4.1]), np.array([7.5, 7.5]))[0] is None
    assert plan(view_of(states), np.array([4.1, 4.1]), np.array([30.0, 4.1]))[0] is None


@pytest.mark.parametrize(("half", "closed"), [(6, True), (6, False), (62, True)])
def test_a_goal_that_is_closed_in_is_not_reached_from_anywhere(half: int, closed: bool) -> None:
    """A yard around the goal, with and without a door, and one with more cells than are looked at backwards; from
    within it there is a way."""
    states = np.full((200, 200), FREE, np.uint8)
    middle = 130
    for side in (-half, half):
        states[middle + side, middle - half : middle + half + 1] = OCCUPIED
        states[middle - half : middle + half + 1, middle + side] = OCCUPIED
    if not closed:
        states[middle - half, middle - half + 1 : middle + half] = FREE
    view = view_of(states)
    goal = CELL * np.array([middle + 0.5, middle + 0.5])
    assert (plan(view, np.array([2.0, 2.0]), goal)[0] is None) == closed
    assert plan(view, goal - [0.3, 0.3], goal)[0] is not None
    assert (plan(view, goal, np.array([2.0, 2.0]))[0] is None) == closed


def test_a_map_of_another_size_is_refused() -> None:
    """What would be written beside the search's memory."""
    view = view_of(np.full((40, 40), FREE, np.uint8))
    larger = view_of(np.full((64, 64), FREE, np.uint8))
    search = AStar(SETTINGS, 40)
    with pytest.raises(ValueError, match=r"64.*40"):
        search.costmap(larger)
    with pytest.raises(ValueError, match=r"64.*40"):
        search.plan(larger, np.ones((64, 64), np.float32), np.ones(2), np.full(2, 5.0))
    assert search.plan(view, search.costmap(view), np.ones(2), np.full(2, 5.0)) is not None


def test_a_path_with_a_longer_detour_is_not_looked_for() -> None:
    rng = np.random.default_rng(4)
    taken = left = 0
    for _ in range(12):
        view = view_of(field(rng, density=0.025))
        search = AStar(SETTINGS, view.states.shape[0])
        costmap = search.costmap(view)
        start, goal = 40 * CELL * rng.random((2, 2))
        best = search.plan(view, costmap, start, goal)
        if best is None:
            continue
        for bound in (0.9 * best.detour, best.detour, 1.1 * best.detour + 0.1):
            found = search.plan(view, costmap, start, goal, max_detour=bound)
            assert (found is not None) == (best.detour <= bound)
            if found is None:
                left += 1
            else:
                taken += 1
                assert np.array_equal(found.cells, best.cells) and found.cost == best.cost
    assert taken > 15 and left > 5


def test_a_gap_on_the_right_only_is_taken() -> None:
    """A wall across the way north with a gap in the east, and the mirror image."""
    states = np.full((64, 64), FREE, np.uint8)
    states[40, :50] = OCCUPIED
    for flipped, east in ((False, True), (True, False)):
        view = view_of(states[:, ::-1].copy() if flipped else states)
        path, costmap = plan(view, np.array([2.1, 6.5]), np.array([12.0, 6.5]))
        assert path is not None
        vertices = shorten(path, view, costmap, SETTINGS.inflation)
        crossing = vertices[np.abs(vertices[:, 0] - 8.1).argmin(), 1]
        assert (crossing > 10.0) if east else (crossing < 2.8)


def test_a_turned_or_mirrored_map_has_the_same_cost() -> None:
    rng = np.random.default_rng(4)
    for _ in range(6):
        states = field(rng, 41)
        states[20, 20] = states[32:39, 28:35] = FREE
        goal, centre = np.array([7.1, 6.3]), np.array([4.1, 4.1])
        path, _ = plan(view_of(states), centre, goal)
        aside = goal - centre
        turned, _ = plan(view_of(np.rot90(states, -1).copy()), centre, centre + np.array([aside[1], -aside[0]]))
        flipped, _ = plan(view_of(states[:, ::-1].copy()), centre, centre + aside * np.array([1.0, -1.0]))
        costs = [None if each is None else pytest.approx(each.cost) for each in (path, turned, flipped)]
        assert costs[0] == costs[1] == costs[2] or path is None


def test_unknown_is_gone_around_where_that_costs_less() -> None:
    states = np.full((40, 40), FREE, np.uint8)
    states[15:25, 14:28] = UNKNOWN
    path, _ = plan(view_of(states), np.array([0.5, 4.1]), np.array([7.5, 4.1]))
    assert path is not None and (states[tuple(path.cells.T)] == FREE).all()
    states[15:25, :] = UNKNOWN
    through, _ = plan(view_of(states), np.array([0.5, 4.1]), np.array([7.5, 4.1]))
    assert through is not None and through.cost == pytest.approx(7.0 + 2.0, abs=0.25)


def test_a_goal_that_is_forbidden_is_approached() -> None:
    states = np.full((40, 40), FREE, np.uint8)
    states[20, 20] = OCCUPIED
    view = view_of(states)
    path, _ = plan(view, np.array([1.0, 4.1]), np.array([4.0, 4.1]))
    assert path is not None
    assert SETTINGS.inflation <= view.to_occupied[tuple(path.cells[-1])] < SETTINGS.inflation + 2 * CELL


@pytest.mark.parametrize("beyond", [FREE, UNKNOWN])
def test_a_forbidden_goal_is_moved_within_its_room(beyond: int) -> None:
    """A wall of one cell, with a way round its end, and the goal 0.2 m behind it: the cells before the wall are nearer,
    and can be reached sooner."""
    states = np.full((60, 60), FREE, np.uint8)
    states[31:] = beyond
    states[30, 8:] = OCCUPIED
    view = view_of(states)
    goal = view.centre_of((31, 40))
    path, _ = plan(view, np.array([2.0, 8.0]), goal)
    assert path is not None and path.cells[-1][0] > 30
    assert SETTINGS.inflation <= view.to_occupied[tuple(path.cells[-1])] < SETTINGS.inflation + CELL
    assert math.dist(view.centre_of(tuple(path.cells[-1])), goal) < SETTINGS.inflation + CELL


def test_a_goal_within_an_obstacle_is_approached_from_any_side() -> None:
    """Where only the shell of a trunk is occupied, and its inside is unknown."""
    states = np.full((40, 40), FREE, np.uint8)
    states[18:23, 18:23], states[19:22, 19:22] = OCCUPIED, UNKNOWN
    view = view_of(states)
    path, _ = plan(view, np.array([1.0, 4.1]), view.centre_of((20, 20)))
    assert path is not None and view.to_occupied[tuple(path.cells[-1])] >= SETTINGS.inflation


def test_shortening_straightens_and_never_costs_more() -> None:
    """In the open one line is left; in a field the lines' cost is that of the cells' way at the most."""
    path, costmap = plan(view_of(np.full((40, 40), FREE, np.uint8)), np.array([0.5, 0.5]), np.array([7.5, 3.1]))
    assert path is not None
    open_view = view_of(np.full((40, 40), FREE, np.uint8))
    vertices = shorten(path, open_view, costmap, SETTINGS.inflation)
    assert len(vertices) == 2
    rng = np.random.default_rng(5)
    for _ in range(20):
        view = view_of(field(rng, 64, 0.006))
        path, costmap = plan(view, np.array([1.0, 1.0]), np.array([11.5, 8.5]))
        if path is None:
            continue
        vertices = shorten(path, view, costmap, SETTINGS.inflation)
        inside = [np.array(view.cell_of(vertex), float) for vertex in vertices]
        costs = [
            line_cost(costmap, view.to_occupied, SETTINGS.inflation, CELL, a[0], a[1], b)
            for a, b in itertools.pairwise(inside)
        ]
        assert sum(costs) <= 1.03 * path.cost + 1e-9 and len(vertices) <= len(path.cells)


def test_vertex_speeds() -> None:
    """A right angle with 0.5 m of room: the radius is 0.5 / (sqrt 2 - 1); straight on is not slowed down; the end is
    rest, and what comes before can brake for what follows."""
    vertices = np.array([[0.0, 0.0], [20.0, 0.0], [40.0, 0.0], [40.0, 30.0]])
    room = np.full(4, 0.5)
    speeds = vertex_speeds(vertices, room, 10.0, 4.0, 4.0)
    turn = math.sqrt(4.0 * 0.5 / (math.sqrt(2.0) - 1.0))
    assert speeds[2] == pytest.approx(turn) and speeds[3] == 0.0 and speeds[0] == 10.0
    assert speeds[1] == pytest.approx(min(10.0, math.sqrt(turn**2 + 2 * 4.0 * 20.0)))
    near = vertex_speeds(vertices * 0.05, room, 10.0, 4.0, 4.0)
    assert near[2] == pytest.approx(math.sqrt(4.0 * 0.5))  # half of the shorter leg, 0.5 m, on the arc
    assert near[1] == pytest.approx(math.sqrt(near[2] ** 2 + 8.0))
    sharp = np.array([[0.0, 0.0], [2.0, 0.0], [1.0, math.sqrt(3.0)]])  # a turn by 120 degrees, legs of 2 m
    assert vertex_speeds(sharp, np.full(3, 99.0), 10.0, 4.0, 4.0)[1] == pytest.approx(math.sqrt(4.0 / math.sqrt(3.0)))
    back = vertex_speeds(np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 0.0]]), np.full(3, 0.5), 10.0, 4.0, 4.0)
    assert back[1] == 0.0
