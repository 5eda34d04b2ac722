"""The cells of the occupancy grid: clamped log-odds that fade with time, in a window that moves with the vehicle.

A cell is stored at its world index modulo the memory's size, which is the window's or more: then what has left the
window is there when the vehicle comes back. When the window moves nothing is copied: the rows and columns that leave
the memory are cleared and become those that enter.

Source: Moravec and Elfes 1985; log-odds with clamping as in OctoMap (Hornung et al. 2013).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from companion.perception.distance_field import Floats, has
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes
from protocol.arrays import Array
from protocol.jit import compiled

CEILING = 4.0
"""Log-odds of a cell that returned again and again."""
FLOOR = -1.0
"""Log-odds of a cell that was seen free again and again; shallow, so that an obstacle that appears counts at once."""
OCCUPIED_ABOVE = 0.4
"""Log-odds above which a cell is occupied."""
FREE_BELOW = -0.3
"""Log-odds below which a cell is free."""
CERTAIN_M = 0.7
"""m of range below which a sector is so narrow that it shows any gap that the vehicle fits through."""


class Grid(NamedTuple):
    """The memory, the window's place in it and the time at which the cells are read or written.

    Functions that are called from Python take it as a plain tuple: numba needs 2 us to find the type of a named one.
    """

    log_odds: Floats
    """(memory, memory) as of `updated_s`."""
    updated_s: Floats
    """(memory, memory) s on the map's clock."""
    returns: Array
    """(memory, memory, 3) of the cell's return: north, east (m) and the shortest range (m) that it was seen from."""
    size: int
    """Cells along each side of the window, in the memory's middle."""
    corner_row: int
    """World index of the window's first row."""
    corner_column: int
    """World index of the window's first column."""
    cell: float
    """Size of a cell (m)."""
    now_s: float
    """s on the map's clock."""
    fading: float
    """Log-odds that a cell loses per second."""


@compiled
def faded(log_odds: float, age_s: float, fading: float) -> float:
    """Log-odds after `age_s` seconds: they approach 0, unknown, by `fading` a second."""
    left = abs(log_odds) - fading * age_s
    if left <= 0.0:
        return 0.0
    return left if log_odds > 0.0 else -left


@compiled
def move_memory(log_odds: Floats, from_row: int, from_column: int, to_row: int, to_column: int) -> None:
    """Clear the rows and columns that enter the memory when its corner moves."""
    size = log_odds.shape[0]
    for row in range(to_row, to_row + size):
        if row < from_row or row >= from_row + size:
            log_odds[row % size, :] = 0.0
    for column in range(to_column, to_column + size):
        if column < from_column or column >= from_column + size:
            log_odds[:, column % size] = 0.0


@compiled
def set_disc(
    cells: tuple[Any, ...], north: float, east: float, radius: float, value: float, occupied_only: bool
) -> None:
    """Set the log-odds of all cells (a Grid) whose centre lies within `radius` (m) of a place (m, NED), or only of
    those with positive log-odds. What is certain is not forgotten: a value of 0 leaves it."""
    grid = Grid(*cells)
    log_odds, updated_s, cell = grid.log_odds, grid.updated_s, grid.cell
    corner_row, corner_column, size, memory = grid.corner_row, grid.corner_column, grid.size, log_odds.shape[0]
    reach = math.ceil(radius / cell)
    middle_row, middle_column = math.floor(north / cell), math.floor(east / cell)
    for i in range(max(middle_row - reach, corner_row), min(middle_row + reach + 1, corner_row + size)):
        for j in range(max(middle_column - reach, corner_column), min(middle_column + reach + 1, corner_column + size)):
            dn, de = (i + 0.5) * cell - north, (j + 0.5) * cell - east
            row, column = i % memory, j % memory
            occupied = log_odds[row, column] > 0.0
            kept = value == 0.0 and occupied and grid.returns[row, column, 2] < CERTAIN_M
            if dn * dn + de * de <= radius * radius and (occupied or not occupied_only) and not kept:
                log_odds[row, column] = value
                updated_s[row, column] = grid.now_s


@compiled
def classify(cells: tuple[Any, ...], states: Bytes) -> Array:
    """Fill `states` (size, size) of the cells (a Grid) in the window's order; the result (k, 3) are the returns in the
    occupied cells, row by row: north, east (m, NED) and the shortest range (m) that each was seen from."""
    grid = Grid(*cells)
    log_odds, updated_s, returns = grid.log_odds, grid.updated_s, grid.returns
    size, memory = grid.size, log_odds.shape[0]
    first = grid.corner_column % memory
    wrap = min(memory - first, size)  # the window's column that is the memory's first one
    now, rate = np.float32(grid.now_s), np.float32(grid.fading)
    counts = np.zeros(size, np.int64)
    for i in range(size):
        row, last = (grid.corner_row + i) % memory, first + wrap
        _classify_run(log_odds[row, first:last], updated_s[row, first:last], now, rate, states[i, :wrap])
        _classify_run(log_odds[row, : size - wrap], updated_s[row, : size - wrap], now, rate, states[i, wrap:])
        counts[i] = _occupied(states[i])
    hits, occupied = np.empty((counts.sum(), 3)), np.empty(size + 1, np.int32)
    count = 0
    for i in range(size):
        if counts[i] == 0:
            continue
        row, state = (grid.corner_row + i) % memory, states[i]
        found = 0
        for j in range(size):  # without a branch: each column is written, and kept if it counts
            occupied[found] = j
            found += int(state[j] == OCCUPIED)
        for k in range(found):
            column = (grid.corner_column + occupied[k]) % memory
            for axis in range(3):
                hits[count, axis] = returns[row, column, axis]
            count += 1
    return hits


@compiled
def classify_coarse(cells: tuple[Any, ...], factor: int, corner: tuple[int, int], states: Bytes) -> Array:
    """Fill `states` (n, n) of coarse cells, each of `factor` cells along each side of the memory of a Grid, the first
    at the coarse world index `corner`: occupied where one of them is, else free where one is. The result (k, 3) are
    the returns, as of `classify`, one in each occupied coarse cell."""
    grid = Grid(*cells)
    log_odds, updated_s, returns = grid.log_odds, grid.updated_s, grid.returns
    memory, count = log_odds.shape[0], states.shape[0]
    now, rate = np.float32(grid.now_s), np.float32(grid.fading)
    fine, highest = np.empty((factor, memory), np.uint8), np.empty(memory, np.uint8)
    hits, found = np.empty((count * count, 3)), 0
    for i in range(count):
        for k in range(factor):
            row = ((corner[0] + i) * factor + k) % memory
            _classify_run(log_odds[row], updated_s[row], now, rate, fine[k])
        highest[:] = fine[0]
        for k in range(1, factor):
            for j in range(memory):  # the states are in the order in which they count
                highest[j] = max(highest[j], fine[k, j])
        states[i] = UNKNOWN
        if not (has(highest, FREE) or has(highest, OCCUPIED)):
            continue
        column = (corner[1] * factor) % memory
        for j in range(count):
            for across in range(factor):
                at = column + across - (memory if column + across >= memory else 0)
                if highest[at] == OCCUPIED and states[i, j] != OCCUPIED:
                    k = 0
                    while fine[k, at] != OCCUPIED:
                        k += 1
                    hits[found] = returns[((corner[0] + i) * factor + k) % memory, at]
                    found += 1
                states[i, j] = max(states[i, j], highest[at])
            column += factor
            column -= memory if column >= memory else 0
    return hits[:found].copy()


@compiled
def _occupied(states: Bytes) -> int:
    """Number of occupied cells, counted in 32 bits, which takes half the time of 64."""
    count = np.int32(0)
    for j in range(states.size):
        count = np.int32(count + np.int32(states[j] == np.uint8(OCCUPIED)))
    return int(count)


@compiled
def _classify_run(log_odds: Floats, updated_s: Floats, now_s: np.float32, fading: np.float32, states: Bytes) -> None:
    """Classify adjacent cells (n,), all in 32 bits and without a branch: the processor handles eight at a time."""
    free_below, occupied_above = np.float32(-FREE_BELOW), np.float32(OCCUPIED_ABOVE)
    free, occupied, unknown = np.uint8(FREE), np.uint8(OCCUPIED), np.uint8(UNKNOWN)
    for j in range(states.shape[0]):
        value, faded_by = log_odds[j], fading * (now_s - updated_s[j])
        known = occupied if value - faded_by > occupied_above else unknown
        states[j] = free if -value - faded_by > free_below else known
