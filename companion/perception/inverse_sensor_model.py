"""Inverse sensor model: what the beams of a scan say of the cells of the occupancy grid.

A beam covers a sector, 5 degrees wide as a rule, and reports the nearest return in it. So the whole wedge before that
return is free, and the return lies somewhere on an arc, 0.2 m long at a range of 2.3 m and 1.3 m long at 15 m.

- All cells of the arc are marked, for safety. An arc n times as long as 0.2 m raises each cell to 1/n of the ceiling at
  the most, however often it is seen from the same place. So the first free wedge from nearer by clears what was marked
  too wide. Within 6 m it is occupied until then.
- A wedge says of all its cells that they are free, an arc of one of its cells that it is not. So if one is occupied
  already, those that were seen free stay so: a gap that was seen through stays open when it is seen askew.
- A cell stores the place of its return. Distances close to it are measured to that place, not to the cell's centre.
- Cells with high log-odds are lowered only by beams that pass at about the sensor's height, not by beams that look over
  or under the obstacle.
- A beam counts only as far as it stays within the layer around the height of flight: a tilted beam leaves it soon.

Source: Moravec and Elfes 1985, with the log-odds of `companion.perception.occupancy_grid`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.perception.distance_field import Floats
from companion.perception.occupancy_grid import CEILING, FLOOR, FREE_BELOW, OCCUPIED_ABOVE, Grid, faded
from protocol.arrays import Array, BoolArray
from protocol.frames import to_world
from protocol.jit import compiled

FREE_STEP = 0.5
"""Log-odds by which a free wedge lowers a cell."""
_STRONG = 1.5
"""Log-odds above which only level beams lower a cell."""
_LEVEL_M = 0.5
"""m from the sensor's height up to which a beam counts as level."""
_STANDOFF_M = 0.08
"""m before a return that are not seen free, because of the range noise."""
_STANDOFF_CELLS = 0.64
"""The same in cells, where that is more: the centre of the return's own cell may be nearer than the return."""
_FULL_WEIGHT_M = 0.2
"""m of arc up to which a return may raise its cells to the ceiling."""
_NEAR_M, _NEAR_LOG_ODDS = 6.0, 0.5
"""m within which the whole arc of a return counts as occupied, however wide its sector, and by how much: less, and the
sectors of 45 degrees that ArduPilot reports would show nothing from farther than 2.5 m."""
_EDGE_LOG_ODDS = 1.0
"""Highest log-odds of the half sector beyond which the obstacle may have ended."""
_ADJACENT_WIDTHS = 2.5
"""Sector widths up to which two returns belong to one obstacle."""
_JOIN_LOG_ODDS = 0.8
"""Log-odds of the cells between two returns of one wall."""
_LEAST_TURN_COSINE = 0.9
"""Cosine of the largest turn between three returns of one wall."""
_LARGEST_STEP_RATIO = 3.0
"""Largest ratio of the two steps between three returns of one wall."""
_LAST_RETURN_WEIGHT = 0.5
"""Weight of the latest return in the place that its cell stores."""

Integers = NDArray[np.int64]


class Beams(NamedTuple):
    """The beams of a scan, each with the pose of its own time."""

    bearings_frd: Array
    """(n,) rad, clockwise from the nose."""
    ranges_m: Array
    """(n,) m."""
    hit: BoolArray
    """(n,) the range is that of a return; otherwise nothing was seen up to it."""
    known: BoolArray
    """(n,) the beam has measured."""
    positions_ned: Array
    """(n, 3) m."""
    attitudes_ned_frd: Array
    """(n, 4)"""
    width: float
    """rad of a beam's sector."""


class Layer(NamedTuple):
    """The heights that the map stands for."""

    down: float
    """m, NED: the middle."""
    half_height: float
    """m above and below the middle."""
    ground_down: float
    """m, NED: returns below are the ground."""
    slope: float = 0.0
    """By which it may rise away from the vehicle."""


class _Wedges(NamedTuple):
    """The cells that were seen free, in the window's order."""

    beams: NDArray[np.int16]
    """(size, size) index of the beam that saw the cell free, plus one; 0: none."""
    spans: Integers
    """(size, 2) of each row: the first column written to, and one past the last."""


@compiled
def add_beams(cells: tuple[Any, ...], scan: tuple[Any, ...], heights: tuple[Any, ...], keeps_free: bool) -> None:
    """Add the Beams of a scan to a Grid; the heights are a Layer. For all three plain tuples do, and are faster.
    `keeps_free`: what was seen free stays so where something else explains a return.

    All free wedges come first, then all returns, so that no wedge clears what a neighbouring beam has just seen.
    """
    grid, beams, layer = Grid(*cells), Beams(*scan), Layer(*heights)
    edges, slopes = _directions(beams.bearings_frd, beams.attitudes_ned_frd, 0.5 * beams.width)
    arcs = _add_free(grid, beams, layer, edges, slopes)
    centres = _arc_centres(beams.positions_ned, edges, arcs)
    stays_below = FREE_BELOW if keeps_free else -math.inf
    _join_walls(grid, centres, arcs, stays_below)
    _add_returns(grid, beams, edges, centres, arcs, stays_below)


@compiled
def _directions(bearings: Array, attitudes: Array, half: float) -> tuple[Array, Array]:
    """North and east of each sector's left and right edge (n, 4), and the down component of its middle (n,)."""
    count = bearings.shape[0]
    edges, slopes = np.empty((count, 4)), np.empty(count)
    for k in range(count):
        forward, right = to_world(attitudes[k], (1.0, 0.0, 0.0)), to_world(attitudes[k], (0.0, 1.0, 0.0))
        for edge in range(2):
            bearing = bearings[k] - half if edge == 0 else bearings[k] + half
            cos, sin = math.cos(bearing), math.sin(bearing)
            edges[k, 2 * edge] = cos * forward[0] + sin * right[0]
            edges[k, 2 * edge + 1] = cos * forward[1] + sin * right[1]
        slopes[k] = math.cos(bearings[k]) * forward[2] + math.sin(bearings[k]) * right[2]
    return edges, slopes


@compiled
def range_within_layer(above: float, down: float, half_height: float) -> float:
    """m for which a beam with the down component `down` stays within the layer; it starts `above` (m, down positive)
    the layer's middle."""
    if abs(above) >= half_height:
        return 0.0
    if down > 1e-9:
        return (half_height - above) / down
    if down < -1e-9:
        return (-half_height - above) / down
    return math.inf


@compiled
def _add_free(grid: Grid, beams: Beams, layer: Layer, edges: Array, slopes: Array) -> Array:
    """Lower the cells before each return; (n,) the ranges (m) of the returns that count, -1 for the other beams."""
    cell, size = grid.cell, grid.size
    middle_n, middle_e = (grid.corner_row + 0.5 * size) * cell, (grid.corner_column + 0.5 * size) * cell
    ranges, hit, known, positions = beams.ranges_m, beams.hit, beams.known, beams.positions_ned
    count = ranges.shape[0]
    arcs, levels = np.empty(count), np.empty((count, 3))
    wedges = _Wedges(np.zeros((size, size), np.int16), np.empty((size, 2), np.int64))
    wedges.spans[:, 0], wedges.spans[:, 1] = size, 0
    standoff = max(_STANDOFF_M, _STANDOFF_CELLS * cell)
    for k in range(count):
        arcs[k] = -1.0
        if not known[k]:
            continue
        origin, down = positions[k], slopes[k]
        aside = max(abs(origin[0] - middle_n), abs(origin[1] - middle_e))
        in_layer = range_within_layer(origin[2] - layer.down, down, layer.half_height)
        reach = min(in_layer, 0.5 * size * cell - aside - 2.0 * cell)
        free = min(ranges[k], reach)
        if hit[k] and ranges[k] <= reach and origin[2] + ranges[k] * (down + layer.slope) < layer.ground_down:
            arcs[k] = ranges[k]
            free = ranges[k] - standoff
        if free > 0.0:
            level = range_within_layer(0.0, down, _LEVEL_M) / cell
            levels[k, 0], levels[k, 1] = origin[0] / cell, origin[1] / cell
            levels[k, 2] = level**2 * (edges[k, 0] * edges[k, 0] + edges[k, 1] * edges[k, 1])
            _mark_wedge(wedges, grid, k + 1, levels[k], edges[k], free)
    _lower(grid, wedges, levels)
    return arcs


@compiled
def _mark_wedge(wedges: _Wedges, grid: Grid, number: int, origin: Array, edges: Array, reach: float) -> None:
    """Write a beam's number into the cells whose centre lies in the triangle from the sensor to both ends of the arc.

    `origin` is the sensor's place in cells, `edges` (4,) are north and east of the directions of the left and of the
    right edge, `reach` is the range in m. Neighbouring wedges share an edge: each cell belongs to one of them.
    """
    numbers, spans, cell = wedges.beams, wedges.spans, grid.cell
    y0, x0 = origin[0], origin[1]
    y1, x1 = y0 + reach * edges[0] / cell, x0 + reach * edges[1] / cell
    y2, x2 = y0 + reach * edges[2] / cell, x0 + reach * edges[3] / cell
    # No row crosses an edge that runs along it: its slope is not used.
    slope_01 = (x1 - x0) / (y1 - y0) if y1 != y0 else 0.0
    slope_12 = (x2 - x1) / (y2 - y1) if y2 != y1 else 0.0
    slope_02 = (x2 - x0) / (y2 - y0) if y2 != y0 else 0.0
    for i in range(math.ceil(min(y0, y1, y2) - 0.5), math.ceil(max(y0, y1, y2) - 0.5)):
        y = i + 0.5
        low, high = math.inf, -math.inf
        if (y0 <= y) != (y1 <= y):
            x = x0 + (y - y0) * slope_01
            low, high = min(low, x), max(high, x)
        if (y1 <= y) != (y2 <= y):
            x = x1 + (y - y1) * slope_12
            low, high = min(low, x), max(high, x)
        if (y0 <= y) != (y2 <= y):
            x = x0 + (y - y0) * slope_02
            low, high = min(low, x), max(high, x)
        if low > high:
            continue
        row = i - grid.corner_row
        first, last = math.ceil(low - 0.5) - grid.corner_column, math.ceil(high - 0.5) - grid.corner_column
        for j in range(first, last):
            numbers[row, j] = number
        if last > first:
            spans[row, 0], spans[row, 1] = min(spans[row, 0], first), max(spans[row, 1], last)


@compiled
def _lower(grid: Grid, wedges: _Wedges, levels: Array) -> None:
    """Lower all cells that were seen free; each row of the window is up to two runs in the memory.

    `levels` (n, 3) of each beam: its origin in cells and the square of the distance in cells up to which it is level.
    """
    log_odds, updated_s, numbers, spans = grid.log_odds, grid.updated_s, wedges.beams, wedges.spans
    corner_row, corner_column = grid.corner_row, grid.corner_column
    memory = log_odds.shape[0]
    wrap = memory - corner_column % memory  # the window's column that is the memory's first one
    for i in range(grid.size):
        row = (corner_row + i) % memory
        for first, last, shift in (
            (spans[i, 0], min(spans[i, 1], wrap), memory - wrap),
            (max(spans[i, 0], wrap), spans[i, 1], -wrap),
        ):
            if first >= last:
                continue
            values, times = log_odds[row, first + shift : last + shift], updated_s[row, first + shift : last + shift]
            seen_by = numbers[i, first:last]
            if _lower_weak(values, times, seen_by, grid.now_s, grid.fading):
                _lower_strong(values, times, seen_by, grid, levels, corner_row + i + 0.5, corner_column + first)


@compiled
def _lower_weak(log_odds: Floats, updated_s: Floats, seen_by: NDArray[np.int16], now_s: float, fading: float) -> bool:
    """Lower those of adjacent cells (n,) that a beam saw free and whose log-odds are not strong, without a branch;
    whether there are strong ones among the cells that were seen free."""
    strong = False
    for j in range(seen_by.size):
        value, age = float(log_odds[j]), now_s - updated_s[j]
        left = max(value - fading * age, 0.0) if value > 0.0 else min(value + fading * age, 0.0)
        seen, weak = seen_by[j] > 0, value <= _STRONG
        log_odds[j] = max(left - FREE_STEP, FLOOR) if seen & weak else value
        updated_s[j] = now_s if seen & weak else updated_s[j]
        strong |= seen & (not weak)
    return strong


@compiled
def _lower_strong(
    log_odds: Floats,
    updated_s: Floats,
    seen_by: NDArray[np.int16],
    grid: Grid,
    levels: Array,
    row: float,
    column: int,
) -> None:
    """Lower those of adjacent cells (n,) with strong log-odds that have faded meanwhile or that a level beam saw free.

    `row` is the row of the cells' centres, `column` that of the first cell's edge, as world indices.
    """
    for j in range(seen_by.size):
        k = seen_by[j] - 1
        if k < 0 or log_odds[j] <= _STRONG:
            continue
        value = faded(log_odds[j], grid.now_s - updated_s[j], grid.fading)
        dn, de = row - levels[k, 0], column + j + 0.5 - levels[k, 1]
        if value <= _STRONG or dn * dn + de * de <= levels[k, 2]:
            log_odds[j], updated_s[j] = max(value - FREE_STEP, FLOOR), grid.now_s


@compiled
def _arc_centres(positions: Array, edges: Array, arcs: Array) -> Array:
    """(n, 2) north and east (m) of the middle of each arc."""
    centres = np.empty((arcs.shape[0], 2))
    for k in range(arcs.shape[0]):
        for axis in range(2):
            middle = 0.5 * (edges[k, axis] + edges[k, 2 + axis])
            centres[k, axis] = positions[k, axis] + max(arcs[k], 0.0) * middle
    return centres


@compiled
def _join_walls(grid: Grid, centres: Array, arcs: Array, stays_below: float) -> None:
    """Join neighbouring returns that lie in one line with a third one by weak marks; not over cells with log-odds below
    `stays_below`.

    A wall seen at a slant leaves steps between the arcs of its sectors. The marks keep a way from leading between them
    until the place was seen from near by.
    """
    log_odds, updated_s, returns, cell = grid.log_odds, grid.updated_s, grid.returns, grid.cell
    count, memory = arcs.shape[0], log_odds.shape[0]
    for k in range(count):
        a, b = k, (k + 1) % count
        if arcs[a] < 0.0 or arcs[b] < 0.0:
            continue
        dn, de = centres[b, 0] - centres[a, 0], centres[b, 1] - centres[a, 1]
        length = math.hypot(dn, de)
        if length < cell or not (
            _in_line(centres, arcs, (k - 1) % count, a, b) or _in_line(centres, arcs, (k + 2) % count, b, a)
        ):
            continue
        samples = math.ceil(2.0 * length / cell)
        for s in range(1, samples):
            north, east = centres[a, 0] + s / samples * dn, centres[a, 1] + s / samples * de
            row, column = math.floor(north / cell) % memory, math.floor(east / cell) % memory
            value = faded(log_odds[row, column], grid.now_s - updated_s[row, column], grid.fading)
            if stays_below <= value < _JOIN_LOG_ODDS:
                log_odds[row, column], updated_s[row, column] = _JOIN_LOG_ODDS, grid.now_s
                returns[row, column, 0], returns[row, column, 1], returns[row, column, 2] = north, east, math.inf


@compiled
def _in_line(centres: Array, arcs: Array, before: int, first: int, second: int) -> bool:
    """Whether the step from `first` to `second` continues that from `before` to `first`, as far as sectors can tell."""
    if arcs[before] < 0.0:
        return False
    an, ae = centres[first, 0] - centres[before, 0], centres[first, 1] - centres[before, 1]
    bn, be = centres[second, 0] - centres[first, 0], centres[second, 1] - centres[first, 1]
    a, b = math.hypot(an, ae), math.hypot(bn, be)
    straight = an * bn + ae * be > _LEAST_TURN_COSINE * a * b
    return straight and b < _LARGEST_STEP_RATIO * a and a < _LARGEST_STEP_RATIO * b


@compiled
def _add_returns(grid: Grid, beams: Beams, edges: Array, centres: Array, arcs: Array, stays_below: float) -> None:
    """Raise the cells of the arcs; the sides on which an obstacle ends are raised less, and cells with log-odds below
    `stays_below` not at all where another one of a wide arc is occupied."""
    count, width = arcs.shape[0], beams.width
    for k in range(count):
        if arcs[k] < 0.0:
            continue
        left = _continues(centres, arcs, k, (k - 1) % count, width)
        right = _continues(centres, arcs, k, (k + 1) % count, width)
        origin, ends, length = beams.positions_ned[k], (right and not left, left and not right), arcs[k] * width
        explained = length > _FULL_WEIGHT_M and _is_occupied(grid, origin, edges[k], arcs[k], width)
        _raise_arc(grid, origin, edges[k], arcs[k], width, ends, stays_below if explained else -math.inf)


@compiled
def _continues(centres: Array, arcs: Array, k: int, neighbour: int, width: float) -> bool:
    """Whether the obstacle in a sector is also that in its neighbour."""
    if arcs[neighbour] < 0.0:
        return False
    away = math.hypot(centres[k, 0] - centres[neighbour, 0], centres[k, 1] - centres[neighbour, 1])
    return bool(away < _ADJACENT_WIDTHS * max(arcs[k], arcs[neighbour]) * width + _FULL_WEIGHT_M)


@compiled
def _samples(distance: float, width: float, cell: float) -> int:
    """The number of places along an arc that show each of its cells."""
    return math.ceil(2.0 * distance * width / cell) + 1


@compiled
def _on_arc(
    grid: Grid, origin: Array, edges: Array, distance: float, right: float
) -> tuple[float, float, int, int, float]:
    """A place on an arc, from 0 at its left end to 1 at its right one: north and east (m), row and column of its cell
    in the memory, and the log-odds of that."""
    dn = edges[0] + right * (edges[2] - edges[0])
    de = edges[1] + right * (edges[3] - edges[1])
    north, east, memory = origin[0] + distance * dn, origin[1] + distance * de, grid.log_odds.shape[0]
    row, column = math.floor(north / grid.cell) % memory, math.floor(east / grid.cell) % memory
    value = faded(grid.log_odds[row, column], grid.now_s - grid.updated_s[row, column], grid.fading)
    return north, east, row, column, value


@compiled
def _is_occupied(grid: Grid, origin: Array, edges: Array, distance: float, width: float) -> bool:
    """Whether a cell along an arc is."""
    samples, highest = _samples(distance, width, grid.cell), -math.inf
    for s in range(samples):
        highest = max(highest, _on_arc(grid, origin, edges, distance, (s + 0.5) / samples)[4])
    return highest > OCCUPIED_ABOVE


@compiled
def _raise_arc(
    grid: Grid, origin: Array, edges: Array, distance: float, width: float, ends: tuple[bool, bool], stays_below: float
) -> None:
    """Raise every cell along an arc once by its share of the evidence, but those with log-odds below `stays_below`.

    On the sides where the obstacle `ends`, left and right, which may be anywhere within the sector, the log-odds stay
    low.
    """
    log_odds, updated_s, returns, cell = grid.log_odds, grid.updated_s, grid.returns, grid.cell
    length = distance * width
    share = CEILING / max(1.0, length / max(_FULL_WEIGHT_M, cell))
    if distance < _NEAR_M:
        share = max(share, _NEAR_LOG_ODDS)
    samples = _samples(distance, width, cell)
    before_row, before_column = -1, -1
    for s in range(samples):
        right = (s + 0.5) / samples
        north, east, row, column, value = _on_arc(grid, origin, edges, distance, right)
        if value < stays_below or (row == before_row and column == before_column):
            continue
        before_row, before_column = row, column
        most = min(share, _EDGE_LOG_ODDS) if (ends[0] if right < 0.5 else ends[1]) else share
        before_n, before_e = returns[row, column, 0], returns[row, column, 1]
        near = abs(before_n - north) < cell and abs(before_e - east) < cell
        kept = 1.0 - _LAST_RETURN_WEIGHT if value > 0.0 and near else 0.0
        returns[row, column, 2] = min(returns[row, column, 2], distance) if kept > 0.0 else distance
        returns[row, column, 0] = kept * before_n + (1.0 - kept) * north
        returns[row, column, 1] = kept * before_e + (1.0 - kept) * east
        log_odds[row, column] = max(value, min(value + 0.5 * most, most))
        updated_s[row, column] = grid.now_s
