"""Free space: the part of the map around the vehicle that the guard works with, as of one scan."""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from companion.config_avoidance import AvoidanceGuard
from companion.perception.distance_field import Floats, fill_distances, has
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, Cell, MapView
from protocol.arrays import Array
from protocol.jit import compiled

POINT_COLUMNS = 5
"""Columns of a point to keep away from: north, east (m), velocity north, east (m/s), keep-out from its centre (m)."""
MOVER_COLUMNS = POINT_COLUMNS + 9
"""Columns of a moving obstacle: those of a point; then the covariance of its place after t (s), as north-north,
north-east and east-east of what does not depend on t (m2), goes with t (m2/s), and with its square (m2/s2)."""
_SECTORS = 36
"""Sectors around the vehicle of which each has a nearest point."""
_FAR_UNSEEN_M = 2.0
"""m at which the distances to unseen cells saturate: more than any keep-out."""
_BESIDE_M = 0.2
"""m from a return up to which unknown cells are counted to it on a tight path: the stand-off before it and a cell."""
_HALF_SIDE_M = 16.0
"""m: half the side of the part of the map; nothing is free farther away than the LiDAR sees."""
Empty = Callable[[tuple[int, ...]], Floats]
"""Allocates an array of a shape without setting its values."""


class FreeSpace(msgspec.Struct, frozen=True):
    """A part of the map around the vehicle, as of one scan."""

    seen_ns: int
    """Arrival of the scan."""
    to_occupied: Floats
    """(rows, columns) m, as in `MapView`."""
    to_unseen: Floats
    """(rows, columns) m from a cell's centre to the nearest cell that is not known to be free, at most _FAR_UNSEEN_M;
    if it is `tight`, without obstacles and what is beside them. The border of this part counts as unseen."""
    corner: Cell
    """World index of [0, 0]."""
    cell: float
    """Size of a cell (m)."""
    points: Array
    """(k, POINT_COLUMNS) the nearest obstacles and unknown cells all around."""
    tight: bool
    """The only way leads nearer than `keep_out` to an obstacle."""
    movers: Array
    """(n, MOVER_COLUMNS) the moving obstacles."""


def empty_here(shape: tuple[int, ...]) -> Floats:
    """Allocates in the memory of this process."""
    return np.empty(shape, np.float32)


def free_space(
    view: MapView,
    position_ned: Array,
    seen_ns: int,
    settings: AvoidanceGuard,
    moving: Array | None = None,
    *,
    tight: bool = False,
    margin: float = 0.0,
    empty: Empty = empty_here,
) -> FreeSpace:
    """Free space of a view around a position (3,) NED (m).

    `moving` (n, MOVER_COLUMNS) are moving obstacles; `margin`: m by which the view takes obstacles for larger; `empty`
    allocates the two distance fields.
    """
    north, east = (float(position_ned[axis]) - view.corner[axis] * view.cell for axis in (0, 1))
    hits = view.obstacle_centres() if view.hits is None else view.hits
    keep_outs = (
        margin + (settings.keep_out_tight if tight else settings.keep_out),
        settings.keep_out_unseen_tight if tight else settings.keep_out_unseen,
    )
    corner_m = np.array(view.corner) * view.cell
    beside = np.float32(_BESIDE_M - margin)
    states = _counted_to_obstacles(view.states, view.to_occupied, beside) if tight else view.states
    points = nearest_points(states, view.cell, (north, east), hits - corner_m, settings.obstacle_range, keep_outs)
    points[:, :2] += corner_m
    rows, columns = (
        slice(max(math.floor((at - _HALF_SIDE_M) / view.cell), 0), max(math.ceil((at + _HALF_SIDE_M) / view.cell), 0))
        for at in (north, east)
    )
    seen = states[rows, columns]
    unseen = seen == UNKNOWN if tight else seen != FREE
    unseen[:1] = unseen[-1:] = unseen[:, :1] = unseen[:, -1:] = True
    to_unseen, to_occupied = empty(unseen.shape), empty(unseen.shape)
    fill_distances(to_unseen, unseen, view.cell, _FAR_UNSEEN_M)
    to_occupied[:] = view.to_occupied[rows, columns]
    corner = view.corner[0] + rows.start, view.corner[1] + columns.start
    movers = np.empty((0, MOVER_COLUMNS)) if moving is None else moving
    return FreeSpace(seen_ns, to_occupied, to_unseen, corner, view.cell, points, tight, movers)


@compiled
def _counted_to_obstacles(states: Bytes, to_occupied: Floats, beside: np.float32) -> Bytes:
    """The states, where the unknown cells within `beside` (m) of a return are occupied. A way between walls a hand
    wider than the hull keeps clear of the walls, by the keep-out that these have, and could not keep clear of such
    cells."""
    counted = np.empty_like(states)
    for i in range(states.shape[0]):
        state, distance, row = states[i], to_occupied[i], counted[i]
        for j in range(states.shape[1]):
            row[j] = OCCUPIED if state[j] == UNKNOWN and distance[j] < beside else state[j]
    return counted


def space_bytes(cells: int, cell: float) -> int:
    """Size (bytes) at the most of both distance fields of a FreeSpace, from a map of `cells` each way of `cell` m."""
    side = min(cells, math.ceil(2.0 * _HALF_SIDE_M / cell) + 1)
    return 2 * np.dtype(np.float32).itemsize * side * side


@compiled
def nearest_points(
    states: Bytes,
    cell: float,
    position: tuple[float, float],
    hits: Array,
    reach: float,
    keep_outs: tuple[float, float],
) -> Array:
    """(n, POINT_COLUMNS) the nearest return and the nearest unknown cell within `reach` (m) in each sector.

    `position` and the returns `hits` (k, 2) are north and east (m) of the window's corner, and so are the results.
    `keep_outs` (m) are that from occupied and that from unknown cells.
    """
    north, east = position
    occupied, unseen = keep_outs
    rows, columns = states.shape
    points = np.zeros((2 * _SECTORS, POINT_COLUMNS))
    _take_nearest(points[:_SECTORS], hits[:, 0] - north, hits[:, 1] - east, north, east, reach, occupied)
    first_row, last_row = max(math.floor((north - reach) / cell), 0), min(math.ceil((north + reach) / cell), rows)
    first, last = max(math.floor((east - reach) / cell), 0), min(math.ceil((east + reach) / cell), columns)
    size = max(last_row - first_row, 0) * max(last - first, 0)
    dn, de = np.empty(size), np.empty(size)
    count = 0
    for i in range(first_row, last_row):
        if not has(states[i, first:last], UNKNOWN):
            continue
        for j in range(first, last):  # without a branch: each cell is written, and kept if it counts
            dn[count], de[count] = (i + 0.5) * cell - north, (j + 0.5) * cell - east
            count += int(states[i, j] == UNKNOWN)
    _take_nearest(points[_SECTORS:], dn[:count], de[:count], north, east, reach, unseen)
    return points[points[:, 4] > 0.0]


@compiled
def _sector(north: float, east: float) -> int:
    """Index of the sector of a direction, from 0 at south by way of west: exact at each quarter, and between them
    cheaper than an arctangent."""
    size = abs(north) + abs(east)
    share = east / size if size > 0.0 else 0.0
    quarters = 2.0 + share if north >= 0.0 else (-share if east < 0.0 else 4.0 - share)
    sector = int(quarters * _SECTORS / 4.0)
    return sector if sector < _SECTORS else 0


@compiled
def _take_nearest(
    points: Array, dn: Array, de: Array, north: float, east: float, reach: float, keep_out: float
) -> None:
    """Write the nearest place within `reach` (m) of each sector to `points` (_SECTORS, POINT_COLUMNS).

    `dn`, `de` (n,) are the offsets (m) of the places from `north` and `east`.
    """
    count = dn.size
    nearest = np.full(_SECTORS, reach * reach)
    squares, sectors = np.empty(count), np.empty(count, np.int32)
    for k in range(count):  # without a branch, so that the loop is vectorized
        squares[k] = dn[k] * dn[k] + de[k] * de[k]
        sectors[k] = np.int32(_sector(dn[k], de[k]))
    for k in range(count):
        sector = sectors[k]
        if squares[k] < nearest[sector]:
            nearest[sector] = squares[k]
            points[sector, 0], points[sector, 1], points[sector, 4] = north + dn[k], east + de[k], keep_out
