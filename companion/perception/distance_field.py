"""Distance field of a grid: from each cell's centre to the nearest marked cell.

The distance transform is exact up to `FAR_M`. The first pass is that of Meijster, Roerdink and Hesselink 2000, "A
general algorithm for computing distance transforms in linear time". The second pass compares all columns within reach
instead of building their lower envelope: without branches the processor handles eight at a time.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

FAR_M = 3.0
"""m at which the distances of a map saturate."""
_NEAR_M = 0.8
"""m below which distances are measured to the returns, not to the centres of their cells."""
_RUN = 16
"""Cells that a loop of a length known beforehand takes at once: the processor needs no tests for the last few."""

Floats = NDArray[np.float32]


def distance_to(marked: BoolArray, cell: float) -> Floats:
    """Distances (rows, columns) in m from each cell's centre to the nearest marked cell's centre, at most FAR_M.

    `marked` has shape (rows, columns); `cell` is the size of a cell in m.
    """
    distances = np.empty(marked.shape, np.float32)
    fill_distances(distances, marked, cell)
    return distances


def fill_distances(distances: Floats, marked: BoolArray, cell: float, far: float = FAR_M, least: float = 0.0) -> None:
    """Write the distances (m) to `distances`, clipped to the interval from `least` to `far` (m)."""
    reach = math.ceil(far / cell)
    _transform(marked, reach, _lengths(cell, reach, far, least), distances)


def fill_distances_to_returns(
    distances: Floats, marked: BoolArray, returns: Array, corner: tuple[int, int], cell: float
) -> None:
    """Write the distances (m) to the marked cells: near them to the returns (k, 2), NED (m), farther off to the cells'
    centres. `corner` is the world index of `distances[0, 0]`."""
    fill_distances(distances, marked, cell, least=_NEAR_M)
    _refine(distances, returns, corner[0], corner[1], cell, _NEAR_M)


@cache
def _lengths(cell: float, reach: int, far: float, least: float) -> Floats:
    """(reach * reach + 1,) m for each squared distance in cells."""
    return np.clip(cell * np.sqrt(np.arange(reach * reach + 1)), least, far).astype(np.float32)


@compiled
def between(distances: NDArray[np.floating[Any]], row: float, column: float) -> float:
    """Distance (m) at a place between cells by bilinear interpolation; 0 outside of the field.

    `row` and `column` count in cells; whole numbers are the centres of cells.
    """
    i, j = math.floor(row), math.floor(column)
    if min(i, j) < 0 or i + 1 >= distances.shape[0] or j + 1 >= distances.shape[1]:
        return 0.0
    a, b = row - i, column - j
    near = (1.0 - b) * distances[i, j] + b * distances[i, j + 1]
    far = (1.0 - b) * distances[i + 1, j] + b * distances[i + 1, j + 1]
    return float((1.0 - a) * near + a * far)


@compiled
def has(row: NDArray[Any], value: int) -> bool:
    """Whether an array (n,) contains a value. There is no early exit, so that the loop is vectorized."""
    found = False
    for j in range(row.shape[0]):
        found |= row[j] == value
    return found


@compiled
def _transform(marked: BoolArray, reach: int, lengths: Floats, result: Floats) -> None:
    """Write `lengths` (reach * reach + 1,) of the squared distances in cells to `result`.

    Squares are counted in 16 bits: 2 * reach * reach must be less than 2**15.
    """
    rows, columns = marked.shape
    none, one, zero = np.int16(reach), np.int16(1), np.int16(0)
    far = np.int16(reach * reach)
    top, bottom = _marked_rows(marked)
    if bottom < 0:
        result[:, :] = lengths[far]
        return
    top, bottom = max(top - reach, 0), min(bottom + reach + 1, rows)
    result[:top], result[bottom:] = lengths[far], lengths[far]
    up = np.empty((rows, columns), np.int16)
    for j in range(columns):
        up[top, j] = zero if marked[top, j] else none
    for i in range(top + 1, bottom):
        above, row, marks = up[i - 1], up[i], marked[i]
        for j in range(columns):
            more = np.int16(above[j] + one)
            row[j] = zero if marks[j] else (more if more < none else none)
    for i in range(bottom - 2, top - 1, -1):
        below, row = up[i + 1], up[i]
        for j in range(columns):
            more = np.int16(below[j] + one)
            row[j] = more if more < row[j] else row[j]
    squares = np.full(columns + 2 * reach, far, np.int16)
    near_row = np.empty(columns, np.int16)
    for i in range(top, bottom):
        first, last = _below(up[i], none)
        first, last = max(first - reach, 0), min(last + reach + 1, columns)
        result[i, :first], result[i, last:] = lengths[far], lengths[far]
        row, filled, nearest = up[i, first:last], result[i, first:last], near_row[first:last]
        size = last - first
        here = squares[reach : reach + size]
        for j in range(size):
            here[j] = np.int16(row[j] * row[j])
            nearest[j] = here[j]
        squares[reach + size : 2 * reach + size] = far
        for shift in range(1, reach):
            square = np.int16(shift * shift)
            left, right = squares[reach - shift : reach - shift + size], squares[reach + shift :]
            for j in range(size):
                near = left[j] if left[j] < right[j] else right[j]
                nearest[j] = min(nearest[j], np.int16(near + square))
        for j in range(size):
            filled[j] = lengths[nearest[j]]


@compiled
def _refine(distances: Floats, returns: Array, corner_row: int, corner_column: int, cell: float, near: float) -> None:
    """Replace the distances below `near` (m), which no cell's centre has, by those to the returns (k, 2).

    A row at a time, whose squares stay in the processor's nearest memory: the returns are put in the order of their
    rows first.
    """
    rows, columns = distances.shape
    count, reach = returns.shape[0], math.ceil(near / cell)
    begins = np.zeros(rows + 2 * reach + 2, np.int64)  # of the returns in each row, and in `reach` rows on either side
    places = np.empty(count, np.int64)
    for k in range(count):
        row = math.floor(returns[k, 0] / cell) - corner_row
        places[k] = min(max(row + reach, 0), rows + 2 * reach)
        begins[places[k] + 1] += 1
    for i in range(begins.size - 1):
        begins[i + 1] += begins[i]
    norths, asides, firsts = np.empty(count), np.empty(count, np.float32), np.empty(count, np.int64)
    filled = begins.copy()
    for k in range(count):
        east = returns[k, 1] / cell
        at = filled[places[k]]
        filled[places[k]] += 1
        norths[at] = returns[k, 0] / cell - corner_row - 0.5
        firsts[at] = min(max(math.floor(east) - corner_column - reach - 1, 0), columns)
        asides[at] = np.float32(firsts[at] - (east - corner_column - 0.5))
    size, far = np.float32(cell), np.float32(math.inf)
    farthest = np.float32((near / cell + 1e-4) ** 2)
    width = math.ceil((2 * reach + 2) / _RUN) * _RUN
    squares = np.full(columns + width, far)
    for i in range(rows):
        first, last = columns, 0
        for k in range(begins[i], begins[i + 2 * reach + 1]):
            along = np.float32((i - norths[k]) * (i - norths[k]))
            first, last = min(first, firsts[k]), max(last, firsts[k] + width)
            for run in range(0, width, _RUN):
                for j in range(_RUN):
                    at, away = firsts[k] + run + j, asides[k] + np.float32(run + j)
                    squares[at] = min(squares[at], along + away * away)
        end = min(last, columns)
        row_squares, row_distances = squares[first:end], distances[i, first:end]
        for j in range(end - first):
            square = row_squares[j]
            row_distances[j] = min(row_distances[j], size * np.sqrt(square) if square <= farthest else far)
        squares[first:last] = far


@compiled
def _marked_rows(marked: BoolArray) -> tuple[int, int]:
    """The first and the last row with a marked cell; the last is -1 if there is none."""
    first, last = marked.shape[0], -1
    for i in range(marked.shape[0]):
        if has(marked[i], True):
            first, last = min(first, i), i
    return first, last


@compiled
def _below(row: NDArray[np.int16], limit: np.int16) -> tuple[int, int]:
    """The indices of the first and the last value less than the limit; the last is -1 if there is none."""
    size = row.shape[0]
    first, last = 0, size - 1
    while first < size and row[first] >= limit:
        first += 1
    while last >= first and row[last] >= limit:
        last -= 1
    return first, last


@compiled
def lower_to_blurred(
    distances: Floats, returns: Array, blurs: Array, corner: tuple[int, int], cell: float, within: float
) -> None:
    """Lower the distances to those from the returns (k, 2), NED (m), plus their blurs (k,) (m), where that is less than
    `within` (m). `corner` is the world index of `distances[0, 0]`."""
    rows, columns = distances.shape
    for k in range(returns.shape[0]):
        reach = within - blurs[k]
        if reach <= 0.0:
            continue
        cells = reach / cell
        row, column = returns[k, 0] / cell - corner[0] - 0.5, returns[k, 1] / cell - corner[1] - 0.5
        first, last = max(math.ceil(column - cells), 0), min(math.floor(column + cells) + 1, columns)
        for i in range(max(math.ceil(row - cells), 0), min(math.floor(row + cells) + 1, rows)):
            for j in range(first, last):
                distance = cell * math.sqrt((i - row) ** 2 + (j - column) ** 2)
                if distance < reach:
                    distances[i, j] = min(distances[i, j], np.float32(distance + blurs[k]))
