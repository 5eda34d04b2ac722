"""Free space: what the guard needs of the map around the vehicle, as one scan left it."""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from companion.config import AvoidanceGuard
from companion.perception.rolling_map import FREE, OCCUPIED, UNKNOWN, Bytes, Cell, Floats, MapView, fill_distances, has
from protocol.arrays import Array
from protocol.jit import compiled

POINT = 5
"""Columns of a point to keep away from: north, east, its velocity north and east, keep-out (m from its centre)."""
_BINS = 36
_FAR_UNSEEN_M = 2.0
"""What is not seen free counts as so far, at the most: more than any keep-out."""
_KEPT_M = 16.0
"""Half the side of what is kept of the map: farther than the LiDAR sees there is nothing free."""
Empty = Callable[[tuple[int, ...]], Floats]
"""Gives an array whose values are not set yet."""


class FreeSpace(msgspec.Struct, frozen=True):
    """What a guard needs of the map around the vehicle, as one ring left it."""

    seen_ns: int
    """When the ring arrived."""
    to_occupied: Floats
    """(n, m) m, as in `MapView`; from a part of its window."""
    to_unseen: Floats
    """(n, m) m to the nearest cell that is not free, unknown or occupied or beyond this part, at most _FAR_UNSEEN_M."""
    corner: Cell
    """World index of [0, 0]."""
    cell: float
    points: Array
    """(k, POINT) north, east (m, NED) and so on: the nearest ones all around, and what moves."""
    tight: bool
    """There is no other way than one nearer than `keep_out` to something."""


def empty_here(shape: tuple[int, ...]) -> Floats:
    """In this process's own memory."""
    return np.empty(shape, np.float32)


def free_space(
    view: MapView,
    position_ned: Array,
    seen_ns: int,
    settings: AvoidanceGuard,
    moving: Array | None = None,
    *,
    tight: bool = False,
    empty: Empty = empty_here,
) -> FreeSpace:
    """Of a view, around a place. `moving` (n, POINT): tracked things; `empty`: where the maps are to lie."""
    north, east = (float(position_ned[axis]) - view.corner[axis] * view.cell for axis in (0, 1))
    hits = view.hits
    if hits is None:
        hits = (np.argwhere(view.states == OCCUPIED) + np.array(view.corner) + 0.5) * view.cell
    keep_out = settings.keep_out_tight if tight else settings.keep_out
    unseen = settings.keep_out_unseen_tight if tight else settings.keep_out_unseen
    corner_m = np.array(view.corner) * view.cell
    points = nearest_points(
        view.states, view.cell, north, east, hits - corner_m, settings.obstacle_range, keep_out, unseen
    )
    points[:, :2] += corner_m
    if moving is not None and len(moving):
        points = np.concatenate((points, moving))
    rows, columns = (
        slice(max(math.floor((at - _KEPT_M) / view.cell), 0), max(math.ceil((at + _KEPT_M) / view.cell), 0))
        for at in (north, east)
    )
    unseen_cells = view.states[rows, columns] != FREE
    unseen_cells[:1] = unseen_cells[-1:] = unseen_cells[:, :1] = unseen_cells[:, -1:] = True
    to_unseen, to_occupied = empty(unseen_cells.shape), empty(unseen_cells.shape)
    fill_distances(to_unseen, unseen_cells, view.cell, _FAR_UNSEEN_M)
    to_occupied[:] = view.to_occupied[rows, columns]
    corner = view.corner[0] + rows.start, view.corner[1] + columns.start
    return FreeSpace(seen_ns, to_occupied, to_unseen, corner, view.cell, points, tight)


def space_bytes(cells: int, cell: float) -> int:
    """Of the two maps of a FreeSpace, at the most."""
    side = min(cells, math.ceil(2.0 * _KEPT_M / cell) + 1)
    return 2 * np.dtype(np.float32).itemsize * side * side


@compiled
def nearest_points(
    states: Bytes, cell: float, north: float, east: float, hits: Array, reach: float, occupied: float, unseen: float
) -> Array:
    """POINTs (n, 5): the nearest of the hits (k, 2) and the nearest unknown cell in each tenth of a right angle or so.

    All places count from the window's corner (m); `occupied` and `unseen` are the keep-outs.
    """
    rows, columns = states.shape
    points = np.zeros((2 * _BINS, POINT))
    _take_nearest(points[:_BINS], hits[:, 0] - north, hits[:, 1] - east, north, east, reach, occupied)
    first_row, last_row = max(math.floor((north - reach) / cell), 0), min(math.ceil((north + reach) / cell), rows)
    first, last = max(math.floor((east - reach) / cell), 0), min(math.ceil((east + reach) / cell), columns)
    size = max(last_row - first_row, 0) * max(last - first, 0)
    dn, de = np.empty(size), np.empty(size)
    count = 0
    for i in range(first_row, last_row):
        if not has(states[i, first:last], UNKNOWN):
            continue
        for j in range(first, last):  # each is written, and stays if it counts: no branch
            dn[count], de[count] = (i + 0.5) * cell - north, (j + 0.5) * cell - east
            count += int(states[i, j] == UNKNOWN)
    _take_nearest(points[_BINS:], dn[:count], de[:count], north, east, reach, unseen)
    return points[points[:, 4] > 0.0]


@compiled
def _sector(north: float, east: float) -> int:
    """0 to _BINS - 1 with the angle, from south over west: exact at each quarter, and cheaper than an arcus in
    between."""
    size = abs(north) + abs(east)
    share = east / size if size > 0.0 else 0.0
    quarters = 2.0 + share if north >= 0.0 else (-share if east < 0.0 else 4.0 - share)
    sector = int(quarters * _BINS / 4.0)
    return sector if sector < _BINS else 0


@compiled
def _take_nearest(
    points: Array, dn: Array, de: Array, north: float, east: float, reach: float, keep_out: float
) -> None:
    """Write the nearest within `reach` of each sector to `points` (_BINS, POINT); `dn`, `de` (n,) are how far they are
    away from `north` and `east`."""
    count = dn.size
    nearest = np.full(_BINS, reach * reach)
    squares, sectors = np.empty(count), np.empty(count, np.int32)
    for k in range(count):  # without a branch: the processor does some at a time
        squares[k] = dn[k] * dn[k] + de[k] * de[k]
        sectors[k] = np.int32(_sector(dn[k], de[k]))
    for k in range(count):
        sector = sectors[k]
        if squares[k] < nearest[sector]:
            nearest[sector] = squares[k]
            points[sector, 0], points[sector, 1], points[sector, 4] = north + dn[k], east + de[k], keep_out
