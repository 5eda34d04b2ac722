"""A* on the map: the cheapest way where nearness to obstacles and what is unknown cost more.

Hart, Nilsson and Raphael 1968, on 8 neighbours. A step costs its length times the mean of the two cells' prices: 1 in
the open, up to 1 + `closeness` towards the inflation's edge, and `unknown` on top of it where nothing is known. A cell
nearer to an occupied one than the inflation is forbidden; from a start within it steps may lead outward only, so that
the vehicle can leave. A goal beyond the window is reached from any cell of its border by a straight line, through what
is unknown, too.

What is left to go costs at least the straight line and, beyond the known cell that lies farthest towards the goal, all
of the unknown's price: an eighth of the cells is opened that the straight line alone would open.
"""

import math
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.perception.distance_field import Floats, has
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, Cell, MapView
from protocol.arrays import Array
from protocol.jit import compiled

Integers = NDArray[np.int64]
Nodes = NDArray[np.int32]

_STEPS = 8
_YARD = 12_000
"""Cells around a goal in which it is looked for being closed in."""
_LEFT_M = 0.5
"""A way that is so far away was left."""
_SQRT2 = math.sqrt(2.0)


@dataclass(frozen=True, slots=True)
class AStarSettings:
    """Of the search."""

    inflation: float
    """m from an occupied cell's centre that are forbidden."""
    comfort: float
    """m from an occupied cell's centre from which on nearness costs nothing."""
    closeness: float
    """What a metre at the inflation's edge costs on top of 1; it falls with the square to 0 at `comfort`."""
    unknown: float
    """What a metre of unknown costs on top."""


class GridPath(msgspec.Struct, frozen=True):
    """Cells from the start to the goal or to the window's border."""

    cells: Integers
    """(n, 2) rows and columns of the view."""
    costs: Array
    """(n,) cost (m) from the start to each cell."""
    cost: float
    """Of the whole way (m), with the straight line beyond the window."""
    detour: float
    """What of that (m) is more than was expected before anything in the way was looked at."""
    whole: bool = True
    """It leads to the goal, or to where the straight line to it begins."""


class AStar:
    """A search with its memory, taken once."""

    def __init__(self, settings: AStarSettings, cells: int) -> None:
        self.settings = settings
        count = cells * cells
        self._prices = np.empty((cells, cells), np.float32)
        self._cost = np.empty(count)
        self._parent = np.empty(count + 1, np.int32)
        self._reached = np.zeros(count + 1, np.int32)
        self._round = 0
        self._keys = np.empty(_STEPS * count + 2)
        self._nodes = np.empty(_STEPS * count + 2, np.int32)

    def prices(self, view: MapView) -> Floats:
        """(cells, cells) what a metre in each cell costs; the forbidden ones have one too. It holds until the next
        call. Raises ValueError for a view of another size than the search was made for."""
        self._check(view.states)
        s = self.settings
        _price(view.states, view.to_occupied, s.inflation, s.comfort, s.closeness, s.unknown, self._prices)
        return self._prices

    def plan(
        self,
        view: MapView,
        prices: Floats,
        start: Array,
        goal: Array,
        inflation: float | None = None,
        to_occupied: Floats | None = None,
    ) -> GridPath | None:
        """From a place in the window to a place anywhere (2,) NED; None if there is no way.

        A goal that is forbidden is replaced by the nearest cell that is not, as far as the comfort goes. Another
        inflation than that of the settings may be given, and other distances than the view's. Raises ValueError for
        another size than the search was made for.
        """
        self._check(prices)
        inflation = self.settings.inflation if inflation is None else inflation
        to_occupied = view.to_occupied if to_occupied is None else to_occupied
        first = view.cell_of(start)
        last = view.cell_of(goal)
        if not view.contains(first):
            return None
        if view.contains(last):
            reach = math.ceil(self.settings.comfort / view.cell) + 1
            last = _nearest_allowed(to_occupied, last[0], last[1], inflation, reach)
            if _closed_in(to_occupied, inflation, first, last):
                return None
        frontier = _frontier(view.states, first, last)
        self._round += 1
        found, cost = _search(
            prices,
            to_occupied,
            inflation,
            view.cell,
            self.settings.unknown,
            first,
            last,
            *frontier,
            self._cost,
            self._parent,
            self._reached,
            2 * self._round,
            self._keys,
            self._nodes,
        )
        if found < 0:
            return None
        cells, costs = _trace_back(found, self._parent, self._cost, view.states.shape[1])
        return GridPath(cells, costs, cost, self._detour(cost, view, first, last, frontier))

    def again(
        self,
        cells: Integers,
        view: MapView,
        prices: Floats,
        start: Array,
        goal: Array,
        inflation: float,
        to_occupied: Floats,
    ) -> GridPath | None:
        """An earlier way, cells (n, 2) of this view, with today's costs, from where it comes nearest to `start` on; see
        `plan` for the rest. None if it was left, can't be flown any more or does not lead to the goal: nobody has
        looked at what lies between its end and there."""
        first, last = view.cell_of(start), view.cell_of(goal)
        away = np.hypot(cells[:, 0] - first[0], cells[:, 1] - first[1])
        nearest = int(np.argmin(away))
        rest = cells[nearest:]
        if away[nearest] * view.cell > _LEFT_M or rest.min() < 0 or rest.max() >= len(prices):
            return None
        if view.cell * math.hypot(*(rest[-1] - last).tolist()) > self.settings.comfort:
            return None
        costs = _costs_along(rest, prices, to_occupied, inflation, view.cell)
        cost = float(costs[-1])
        if cost == math.inf:
            return None
        return GridPath(rest, costs, cost, self._detour(cost, view, first, last, _frontier(view.states, first, last)))

    def _detour(
        self, cost: float, view: MapView, first: Cell, last: Cell, frontier: tuple[float, float, float]
    ) -> float:
        return cost - view.cell * _to_go(*first, last, self.settings.unknown, *frontier)

    def _check(self, cells: NDArray[Any]) -> None:
        """The search's memory is written to without a look at its bounds."""
        if cells.shape != self._prices.shape:
            raise ValueError(f"a map of {cells.shape} cells, and a search made for {self._prices.shape}")


@compiled
def _price(
    states: Bytes,
    to_occupied: Floats,
    inflation: float,
    comfort: float,
    closeness: float,
    unknown: float,
    prices: Floats,
) -> None:
    """In 32 bits throughout, eight cells at a time."""
    none, one = np.float32(0.0), np.float32(1.0)
    from_m, per_m = np.float32(comfort), np.float32(1.0 / (comfort - inflation))
    most, more = np.float32(closeness), np.float32(unknown)
    for i in range(states.shape[0]):
        state, distance, price = states[i], to_occupied[i], prices[i]
        for j in range(states.shape[1]):
            near = min(max((from_m - distance[j]) * per_m, none), one)
            price[j] = one + most * near * near + (more if state[j] == UNKNOWN else none)


@compiled
def _nearest_allowed(to_occupied: Floats, row: int, column: int, inflation: float, reach: int) -> tuple[int, int]:
    """The nearest cell that is not forbidden, within `reach` cells; the cell itself if there is none."""
    rows, columns = to_occupied.shape
    best, best_row, best_column = reach * reach + 1, row, column
    for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
        for j in range(max(column - reach, 0), min(column + reach + 1, columns)):
            square = (i - row) * (i - row) + (j - column) * (j - column)
            if square < best and to_occupied[i, j] >= inflation:
                best, best_row, best_column = square, i, j
    return best_row, best_column


@compiled
def _closed_in(to_occupied: Floats, inflation: float, first: tuple[int, int], last: tuple[int, int]) -> bool:
    """Whether the last cell can be reached from a few cells only, the first not among them: then there is no way, and
    the whole window need not be searched to know it. The steps are the search's, backwards."""
    rows, columns = to_occupied.shape
    seen = np.zeros((rows, columns), np.bool_)
    found = np.empty((_YARD + 8, 2), np.int64)
    found[0, 0], found[0, 1] = last
    seen[last] = True
    at, count = 0, 1
    while at < count:
        row, column = found[at, 0], found[at, 1]
        at += 1
        if (row == first[0] and column == first[1]) or count >= _YARD:
            return False
        for i in range(max(row - 1, 0), min(row + 2, rows)):
            for j in range(max(column - 1, 0), min(column + 2, columns)):
                if not seen[i, j] and to_occupied[row, column] >= min(inflation, to_occupied[i, j]):
                    seen[i, j] = True
                    found[count, 0], found[count, 1] = i, j
                    count += 1
    return True


@compiled
def _push(keys: Array, nodes: Nodes, size: int, key: float, node: int) -> int:
    """Into the binary heap; its new size."""
    at = size
    while at > 0:
        above = (at - 1) // 2
        if keys[above] <= key:
            break
        keys[at], nodes[at] = keys[above], nodes[above]
        at = above
    keys[at], nodes[at] = key, node
    return size + 1


@compiled
def _pop(keys: Array, nodes: Nodes, size: int) -> int:
    """Take the first out of the heap; its new size."""
    size -= 1
    key, node = keys[size], nodes[size]
    keys[size] = math.inf  # is chosen from no pair, so that the choice needs no branch that the processor can't foresee
    at, below = 0, 1
    while below < size:
        below += int(keys[below + 1] < keys[below])
        if keys[below] >= key:
            break
        keys[at], nodes[at] = keys[below], nodes[below]
        at, below = below, 2 * below + 1
    keys[at], nodes[at] = key, node
    return size


@compiled
def _frontier(states: Bytes, first: tuple[int, int], last: tuple[int, int]) -> tuple[float, float, float]:
    """The direction from one cell to another as a unit vector, and how far along it, in cells from [0, 0], something is
    known."""
    rows, columns = states.shape
    distance = max(math.hypot(last[0] - first[0], last[1] - first[1]), 1e-9)
    ahead_row, ahead_column = (last[0] - first[0]) / distance, (last[1] - first[1]) / distance
    farthest = -math.inf
    for i in range(rows):
        if not (has(states[i], FREE) or has(states[i], OCCUPIED)):
            continue
        for k in range(columns):
            j = columns - 1 - k if ahead_column > 0.0 else k
            if states[i, j] != UNKNOWN:  # none of its row is farther
                farthest = max(farthest, ahead_row * i + ahead_column * j)
                break
    return ahead_row, ahead_column, farthest


@compiled
def _to_go(
    row: int,
    column: int,
    last: tuple[int, int],
    unknown: float,
    ahead_row: float,
    ahead_column: float,
    farthest: float,
) -> float:
    """What the way from a cell to the last one costs at least, in cells."""
    # sqrt is exact to the bit on every machine, hypot is not, and slower.
    down, aside = float(row - last[0]), float(column - last[1])
    straight = math.sqrt(down * down + aside * aside)
    at, end = ahead_row * row + ahead_column * column, ahead_row * last[0] + ahead_column * last[1]
    return straight + unknown * max(end - max(farthest + 1.0, at), 0.0)


@compiled
def _search(
    prices: Floats,
    to_occupied: Floats,
    inflation: float,
    cell: float,
    unknown: float,
    first: tuple[int, int],
    last: tuple[int, int],
    ahead_row: float,
    ahead_column: float,
    farthest: float,
    cost: Array,
    parent: Nodes,
    reached: Nodes,
    opened: int,
    keys: Array,
    nodes: Nodes,
) -> tuple[int, float]:
    """The last cell of the way (row * columns + column; -1: there is none) and the whole way's cost (m).

    `reached` is `opened` where a cell has a cost, one more where that is final, and less where nothing was looked at
    yet: so nothing need be cleared before.
    """
    final = opened + 1
    rows, columns = prices.shape
    beyond = rows * columns
    inside = 0 <= last[0] < rows and 0 <= last[1] < columns
    beyond_cost = math.inf
    start = first[0] * columns + first[1]
    cost[start], parent[start], reached[start] = 0.0, -1, opened
    size = _push(keys, nodes, 0, 0.0, start)
    while size > 0:
        node = nodes[0]
        size = _pop(keys, nodes, size)
        if node == beyond:
            return parent[beyond], beyond_cost
        if reached[node] == final:
            continue
        reached[node] = final
        row, column = node // columns, node % columns
        if inside and row == last[0] and column == last[1]:
            return node, cost[node]
        if not inside and (row == 0 or column == 0 or row == rows - 1 or column == columns - 1):
            whole = cost[node] + cell * (1.0 + unknown) * math.hypot(row - last[0], column - last[1])
            if whole < beyond_cost:
                beyond_cost, parent[beyond] = whole, node
                size = _push(keys, nodes, size, whole, beyond)
        least = min(inflation, to_occupied[row, column])
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                i, j = row + dr, column + dc
                if (dr == 0 and dc == 0) or not (0 <= i < rows and 0 <= j < columns):
                    continue
                other = i * columns + j
                if reached[other] == final or to_occupied[i, j] < least:
                    continue
                length = cell * (_SQRT2 if dr != 0 and dc != 0 else 1.0)
                new = cost[node] + 0.5 * length * (prices[row, column] + prices[i, j])
                if reached[other] < opened or new < cost[other]:
                    cost[other], parent[other], reached[other] = new, node, opened
                    left = _to_go(i, j, last, unknown, ahead_row, ahead_column, farthest)
                    size = _push(keys, nodes, size, new + cell * left, other)
    return -1, math.inf


@compiled
def _costs_along(cells: Integers, prices: Floats, to_occupied: Floats, inflation: float, cell: float) -> Array:
    """(n,) as the search counts them; inf from where it would not go on."""
    costs = np.zeros(cells.shape[0])
    for k in range(1, cells.shape[0]):
        row, column, i, j = cells[k - 1, 0], cells[k - 1, 1], cells[k, 0], cells[k, 1]
        length = cell * (_SQRT2 if i != row and j != column else 1.0)
        allowed = to_occupied[i, j] >= min(inflation, to_occupied[row, column])
        costs[k] = costs[k - 1] + 0.5 * length * (prices[row, column] + prices[i, j]) if allowed else math.inf
    return costs


@compiled
def _trace_back(node: int, parent: Nodes, cost: Array, columns: int) -> tuple[Integers, Array]:
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
