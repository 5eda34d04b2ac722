"""A* over a costmap: the cheapest path, where proximity to obstacles and unknown cells cost extra.

Hart, Nilsson and Raphael 1968, on 8 neighbours. A step costs its length times the mean cost of its two cells: 1 in the
open, up to 1 + `proximity_cost` towards the edge of the inflation, and `unknown_cost` on top where nothing is known. A
cell nearer to an occupied one than the inflation is forbidden. From a start within the inflation steps may lead outward
only, so that the vehicle can leave it. A goal beyond the window is reached from any border cell by a straight line,
through unknown cells too.

The heuristic is the straight line and, beyond the known cell that lies farthest towards the goal, the cost of unknown
cells as well. The search opens an eighth of the cells that the straight line alone would open. It begins at the dearer
end of the path, and at a goal that is enclosed by what may not be there: one that begins at the other opens all that is
cheaper than the dear end, which may be the whole window.
"""

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.avoidance.bucket_queue import BUCKET_M, LAST_BUCKET, Nodes, Queue, clear, make_queue, pop, push
from companion.config_avoidance import AvoidancePlan
from companion.perception.distance_field import Floats, has
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, MapView
from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

Integers = NDArray[np.int64]
Frontier = tuple[float, float, float]
Memory = tuple[Array, Nodes, Nodes, Queue]
"""Cost, parent and mark of each cell and of what lies beyond the window, and the queue, by costs beyond the least that
is to be expected. A mark is that of the search where a cell has a cost, one more where its neighbours know of it, two
more where that is final, and less where the search has not been: so nothing but the buckets need be cleared before."""

_AROUND = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column)
"""Rows and columns to the neighbours of a cell."""
_MAX_ENCLOSED_CELLS = 12_000
"""A goal from which more cells than this can be reached does not count as enclosed."""
_MOST_CELLS = 15_000
"""Cells within a limited detour of which it is asked whether a path leads out: the search takes no longer for more."""
_LONG_M = 10.0
"""m of detour, and as much as the least cost to be expected, from which on it is asked whether the goal is enclosed by
what may not be there."""
_SQRT2 = math.sqrt(2.0)
_ROUNDING_M = 1e-6
"""m by which rounding may let the search take a path for longer than it is."""


class GridPath(msgspec.Struct, frozen=True):
    """Cells from the start to the goal or to the border of the window."""

    cells: Integers
    """(n, 2) rows and columns of the view."""
    costs: Array
    """(n,) cost (m) from the start to each cell."""
    cost: float
    """m, of the whole path, with the straight line beyond the window."""
    detour: float
    """m, the part of the cost that exceeds the heuristic at the start."""
    complete: bool = True
    """The path leads to the goal, or to the border cell from which a straight line leads there."""


class AStar:
    """A search over maps of one size. It keeps its memory from search to search."""

    def __init__(self, settings: AvoidancePlan, cells: int) -> None:
        """`cells`: along each side of the maps."""
        self._settings = settings
        count = cells * cells
        self._costmap = np.empty((cells, cells), np.float32)
        cost, parent, reached = np.empty(count + 1), np.empty(count + 1, np.int32), np.zeros(count + 1, np.int32)
        self._memory: Memory = (cost, parent, reached, make_queue(len(_AROUND) * count + 2))
        self._searches = 0
        self._failed = {True: False, False: False}
        """Whether the last search of a limited detour found none, and that of any detour."""
        self._detour = 0.0
        """m, of the last path whose detour was not limited."""

    def costmap(self, view: MapView) -> Floats:
        """(cells, cells) cost of a metre in each cell, forbidden ones included. It is valid until the next call.

        Raises ValueError for a view of another size than the search was made for.
        """
        self._check(view.states)
        s = self._settings
        radius, proximity_cost, unknown_cost = s.proximity_radius, s.proximity_cost, s.unknown_cost
        _fill_costmap(view.states, view.to_occupied, s.inflation, radius, proximity_cost, unknown_cost, self._costmap)
        return self._costmap

    def plan(
        self,
        view: MapView,
        costmap: Floats,
        start: Array,
        goal: Array,
        inflation: float | None = None,
        to_occupied: Floats | None = None,
        max_detour: float = math.inf,
    ) -> GridPath | None:
        """The cheapest path from a place in the window to a place anywhere, (2,) or (3,) m, NED; None if there is none
        whose detour is at most `max_detour` (m).

        A forbidden goal is replaced by the nearest cell of its room that is allowed, within the proximity radius; there
        is no path without one.
        `inflation` (m) and `to_occupied` (cells, cells) (m) replace the settings' and the view's. Raises ValueError for
        a costmap of another size than the search was made for.
        """
        self._check(costmap)
        inflation = self._settings.inflation if inflation is None else inflation
        to_occupied = view.to_occupied if to_occupied is None else to_occupied
        first = view.cell_of(start)
        last = view.cell_of(goal)
        if not view.contains(first):
            return None
        if view.contains(last):
            reach = math.ceil(self._settings.proximity_radius / view.cell) + 1
            last = nearest_allowed_cell(view.states, to_occupied, last, inflation, reach)
            if to_occupied[last] < inflation:
                return None
        frontier = _frontier(view.states, first, last)
        scales = inflation, view.cell, self._settings.unknown_cost
        expected = view.cell * _to_go(first[0], first[1], last, self._settings.unknown_cost, frontier)
        limited = max_detour < math.inf
        doubtful, self._failed[limited] = self._failed[limited], True
        if doubtful and (limited or view.contains(last)):
            flooded = (first, last, False) if limited else (last, first, True)
            most, most_cells = expected + max_detour + _ROUNDING_M, _MOST_CELLS if limited else _MAX_ENCLOSED_CELLS
            if _cut_off(to_occupied, scales, flooded, frontier, most, most_cells):
                return None
        self._searches += 1
        limits = 3 * self._searches, max_detour + _ROUNDING_M
        backwards = view.contains(last) and costmap[last] > costmap[first] + self._settings.unknown_cost
        if not limited and self._detour > max(expected, _LONG_M) and view.contains(last):
            goal_first = last, first, True
            backwards |= _cut_off(view.to_occupied, scales, goal_first, frontier, math.inf, _MAX_ENCLOSED_CELLS)
        ends = (last, first, True) if backwards else (first, last, False)
        found, cost = _search(costmap, to_occupied, scales, ends, frontier, self._memory, limits)
        if found < 0 or cost - expected > max_detour:
            return None
        self._failed[limited] = False
        if not limited:
            self._detour = cost - expected
        cells, costs = _trace_back(found, self._memory[1], self._memory[0], view.states.shape[1])
        if backwards:
            cells, costs = cells[::-1], cost - costs[::-1]
        return GridPath(cells, costs, cost, cost - expected)

    def _check(self, cells: NDArray[Any]) -> None:
        """Compiled code does not check the bounds of the search's memory."""
        if cells.shape != self._costmap.shape:
            raise ValueError(f"a map of {cells.shape} cells, and a search made for {self._costmap.shape}")


@compiled
def _fill_costmap(
    states: Bytes,
    to_occupied: Floats,
    inflation: float,
    proximity_radius: float,
    proximity_cost: float,
    unknown_cost: float,
    costmap: Floats,
) -> None:
    """In 32 bits throughout, so that the processor does eight cells at a time."""
    none, one = np.float32(0.0), np.float32(1.0)
    from_m, per_m = np.float32(proximity_radius), np.float32(1.0 / (proximity_radius - inflation))
    most, more = np.float32(proximity_cost), np.float32(unknown_cost)
    for i in range(states.shape[0]):
        state, distance, cost = states[i], to_occupied[i], costmap[i]
        for j in range(states.shape[1]):
            near = min(max((from_m - distance[j]) * per_m, none), one)
            cost[j] = one + most * near * near + (more if state[j] == UNKNOWN else none)


@compiled
def nearest_allowed_cell(
    states: Bytes, to_occupied: Floats, place: tuple[int, int], inflation: float, reach: int
) -> tuple[int, int]:
    """The nearest cell at least `inflation` (m) from an occupied one, within `reach` rows and columns of a place and in
    its room, which the occupied cells bound; the place itself if there is none. A place within an obstacle, on its
    surface or enclosed by it, has no room: then any cell will do."""
    if to_occupied[place] >= inflation:
        return place
    allowed, room = to_occupied >= inflation, np.zeros(states.shape, np.bool_)
    if states[place] != OCCUPIED and _fill_room(states, place, reach, room):
        allowed &= room
    best, nearest = reach * reach + 1, place
    for i in range(max(place[0] - reach, 0), min(place[0] + reach + 1, states.shape[0])):
        for j in range(max(place[1] - reach, 0), min(place[1] + reach + 1, states.shape[1])):
            square = (i - place[0]) ** 2 + (j - place[1]) ** 2
            if square < best and allowed[i, j]:
                best, nearest = square, (i, j)
    return nearest


@compiled
def _fill_room(states: Bytes, place: tuple[int, int], reach: int, room: BoolArray) -> bool:
    """Mark the cells that are joined to a place by sides of cells that are not occupied, within `reach` rows and
    columns; whether they go on beyond."""
    side = 2 * reach + 1
    found = np.empty((side * side, 2), np.int64)
    found[0, 0], found[0, 1] = place
    room[place] = True
    at, count, open_end = 0, 1, False
    while at < count:
        row, column = found[at, 0], found[at, 1]
        at += 1
        for i, j in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            inside = max(abs(i - place[0]), abs(j - place[1])) <= reach
            if not (inside and 0 <= i < states.shape[0] and 0 <= j < states.shape[1]):
                open_end = True
            elif not room[i, j] and states[i, j] != OCCUPIED:
                room[i, j] = True
                found[count, 0], found[count, 1] = i, j
                count += 1
    return open_end


@compiled
def _cut_off(
    to_occupied: Floats,
    scales: tuple[float, float, float],
    ends: tuple[tuple[int, int], tuple[int, int], bool],
    frontier: Frontier,
    most: float,
    most_cells: int,
) -> bool:
    """Whether no path of a cost up to `most` (m), as the heuristic has it, leads from the first cell to the last, or to
    the border if that lies beyond the window; False where `most_cells` don't tell. `scales` and `ends`: of `_search`.

    Then the search need not open all that is so cheap. The steps are the search's.
    """
    inflation, cell, unknown_cost = scales
    begin, end, backwards = ends
    first, last = (end, begin) if backwards else (begin, end)
    rows, columns = to_occupied.shape
    beyond = not (0 <= end[0] < rows and 0 <= end[1] < columns)
    seen = np.zeros((rows, columns), np.bool_)
    found = np.empty((most_cells + len(_AROUND), 2), np.int32)
    found[0, 0], found[0, 1] = begin
    seen[begin] = True
    at, count = 0, 1
    while at < count:
        row, column = found[at, 0], found[at, 1]
        at += 1
        at_border = row in (0, rows - 1) or column in (0, columns - 1)
        if (row == end[0] and column == end[1]) or (beyond and at_border) or count >= most_cells:
            return False
        room = to_occupied[row, column]
        for i in range(max(row - 1, 0), min(row + 2, rows)):
            for j in range(max(column - 1, 0), min(column + 2, columns)):
                if seen[i, j]:
                    continue
                from_m, to_m = (to_occupied[i, j], room) if backwards else (room, to_occupied[i, j])
                if to_m < min(inflation, from_m):
                    continue
                seen[i, j] = True
                down, aside = float(i - first[0]), float(j - first[1])
                straight = math.sqrt(down * down + aside * aside)
                if cell * (straight + _to_go(i, j, last, unknown_cost, frontier)) <= most:
                    found[count, 0], found[count, 1] = i, j
                    count += 1
    return True


@compiled
def _frontier(states: Bytes, first: tuple[int, int], last: tuple[int, int]) -> Frontier:
    """The unit vector (row, column) from one cell to another, and how far along it, in cells from [0, 0], the farthest
    known cell lies."""
    rows, columns = states.shape
    distance = max(math.hypot(last[0] - first[0], last[1] - first[1]), 1e-9)
    ahead_row, ahead_column = (last[0] - first[0]) / distance, (last[1] - first[1]) / distance
    farthest = -math.inf
    for i in range(rows):
        if not (has(states[i], FREE) or has(states[i], OCCUPIED)):
            continue
        for k in range(columns):
            j = columns - 1 - k if ahead_column > 0.0 else k
            if states[i, j] != UNKNOWN:  # no other cell of its row is farther
                farthest = max(farthest, ahead_row * i + ahead_column * j)
                break
    return ahead_row, ahead_column, farthest


@compiled
def _to_go(row: int, column: int, last: tuple[int, int], unknown_cost: float, frontier: Frontier) -> float:
    """The heuristic: the least cost from a cell to the last one, in cells."""
    ahead_row, ahead_column, farthest = frontier
    # sqrt is exact to the bit on every machine; hypot is not, and is slower.
    down, aside = float(row - last[0]), float(column - last[1])
    straight = math.sqrt(down * down + aside * aside)
    at, end = ahead_row * row + ahead_column * column, ahead_row * last[0] + ahead_column * last[1]
    return straight + unknown_cost * max(max(at, end) - max(farthest + 1.0, min(at, end)), 0.0)


@compiled
def _search(
    costmap: Floats,
    to_occupied: Floats,
    scales: tuple[float, float, float],
    ends: tuple[tuple[int, int], tuple[int, int], bool],
    frontier: Frontier,
    memory: Memory,
    limits: tuple[int, float],
) -> tuple[int, float]:
    """The last cell of the path (row * columns + column; -1: there is no path) and the cost of the path (m).

    `scales`: inflation (m), side of a cell (m), cost of unknown; `ends`: first and last cell, and whether the search
    goes backwards, from the last one of the path to its first. `limits`: a mark, see `Memory`, and a key beyond which
    no path is looked for. A bucket is emptied to its end, and a cell that has become cheaper is looked at again: so the
    path is the cheapest. In the last bucket, whose cells may differ by much, that would take too long.
    """
    inflation, cell, unknown_cost = scales
    first, last, backwards = ends
    opened, most = limits
    final = opened + 2
    cost, parent, reached, queue = memory
    rows, columns = costmap.shape
    costs, near = costmap.reshape(-1), to_occupied.reshape(-1)
    start, beyond = first[0] * columns + first[1], rows * columns
    end = last[0] * columns + last[1] if 0 <= last[0] < rows and 0 <= last[1] < columns else beyond
    cost[start], parent[start], reached[start] = 0.0, -1, opened
    cost[beyond], found = math.inf, False
    least = cell * _to_go(first[0], first[1], last, unknown_cost, frontier)
    node, state = pop(queue, push(queue, clear(queue), 0.0, start))
    while node >= 0 and state[0] * BUCKET_M <= most:
        if node == end:
            found, most = True, min(most, state[0] * BUCKET_M)
        elif reached[node] == opened:
            reached[node] = final if state[0] == LAST_BUCKET else opened + 1
            row, column = node // columns, node % columns
            at_border = row in (0, rows - 1) or column in (0, columns - 1)
            if at_border and end == beyond:
                whole = cost[node] + cell * (1.0 + unknown_cost) * math.hypot(row - last[0], column - last[1])
                if whole < cost[beyond]:
                    cost[beyond], parent[beyond] = whole, node
                    state = push(queue, state, whole - least, beyond)
            spent, price, room, half = cost[node], costs[node], near[node], 0.5 * cell
            for down, aside in _AROUND:
                i, j = row + down, column + aside
                if at_border and not (0 <= i < rows and 0 <= j < columns):
                    continue
                other = node + down * columns + aside
                new = spent + half * (1.0 if down == 0 or aside == 0 else _SQRT2) * (price + costs[other])
                if reached[other] >= opened and (new >= cost[other] or reached[other] == final):
                    continue
                from_m, to_m = (near[other], room) if backwards else (room, near[other])
                if to_m >= min(inflation, from_m):
                    cost[other], parent[other], reached[other] = new, node, opened
                    beyond_least = new + cell * _to_go(i, j, last, unknown_cost, frontier) - least
                    if beyond_least <= most + BUCKET_M:  # none is looked at that costs more
                        state = push(queue, state, beyond_least, other)
        node, state = pop(queue, state)
    if not found:
        return -1, math.inf
    return end if end < beyond else parent[beyond], cost[end]


@compiled
def _trace_back(node: int, parent: Nodes, cost: Array, columns: int) -> tuple[Integers, Array]:
    """Cells (n, 2) of the path that ends at a node, and the cost (n,) of each."""
    count = 0
    at = node
    while at >= 0:
        count += 1
        at = parent[at]
    cells = np.empty((count, 2), np.int64)
    costs = np.empty(count)
    at = node
    for k in range(count - 1, -1, -1):
        cells[k, 0], cells[k, 1] = at // columns, at % columns
        costs[k] = cost[at]
        at = parent[at]
    return cells, costs
