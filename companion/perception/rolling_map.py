"""One map of what the rings have shown: a rolling occupancy grid of log-odds around the vehicle, unknown kept apart
from free.

Cells are aligned with the world and live at their index modulo the grid's size, so nothing is copied when the vehicle
moves: rows and columns that leave the window are cleared and become those that enter it. The map is flat: the layer
around the height of flight. A beam counts only as far as it stays within the layer, and a tilted ring leaves it soon.

A sector of 5 degrees reports the nearest return in it. So the whole wedge before that return is free, and the return
stands somewhere on an arc, 0.2 m wide at 2.3 m and 1.3 m at 15 m. All cells of the arc are marked, for safety; but an
arc n times as long as 0.2 m can say no more than 1/n of what that can, however often it is seen from the same place, so
that the first free wedge from nearer by wipes off what was too wide. A cell remembers where in it the return was: what
is that near is measured to there, not to the cell's centre. What was hit at close range is wiped off only by beams that
pass at the height of flight, not by those that look over it or under it.

Source: Moravec and Elfes 1985; log-odds with clamping as in OctoMap (Hornung et al. 2013). The distance transform is
exact up to `FAR_M`: the first pass is that of Meijster, Roerdink and Hesselink 2000; the second looks at all columns
that near instead of building their lower envelope, which the processor does eight at a time.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.state import Scan
from protocol.arrays import Array, BoolArray
from protocol.frames import to_world
from protocol.jit import compiled

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""States of a cell in a `MapView`."""

CEILING = 4.0
"""Log-odds of a cell that was hit alone again and again."""
FLOOR = -1.0
"""Log-odds of a cell that was seen free again and again; shallow, so that what appears is believed at once."""
FREE_STEP = 0.5
"""Log-odds that a free wedge takes off a cell."""
OCCUPIED_ABOVE = 0.4
FREE_BELOW = -0.3
_STRONG = 1.5
"""Log-odds above which only a level beam wipes off."""
_LEVEL = 0.5
"""m from the height of the sensor up to which a beam is level."""
FAR_M = 3.0
"""What is farther away than this counts as so far: the map's distances end here."""
_NEAR_M = 0.8
"""Distances below are measured to the returns, not to the centres of their cells."""
_STANDOFF_M = 0.08
"""m before a return that are not seen free: noise."""
_MARK_M = 0.2
"""m of arc that one return can speak for with all its weight."""
_END = 1.0
"""Log-odds, at the most, of the half of a sector beyond which a thing does not go on."""
_NEXT = 2.5
"""Widths of a sector that two returns of one thing may be apart."""
_CERTAIN_M = 0.7
"""From so near a sector is narrow enough to show any gap that the vehicle fits through."""
_LINK = 0.8
"""Log-odds of what is taken to stand between two returns of one wall."""
_STRAIGHT, _LONGER = 0.9, 3.0
"""Cosine of the turn and ratio of the steps, at the most, between three returns of one wall."""
_CLOCK_NS = 4096 * 1_000_000_000
"""Each map's clock starts at a multiple of this before its first ring: in 32 bits a second of 2026 is two minutes."""
_NEW_PLACE = 0.5
"""How much a return moves the place that its cell remembers."""

Bytes = NDArray[np.uint8]
Marks = NDArray[np.int16]
Integers = NDArray[np.int64]
Floats = NDArray[np.float32]
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class GridSettings:
    """Of the map."""

    cell: float
    """m, from 0.025 on: sums of two squares of distances in cells are counted in 16 bits."""
    cells: int
    """Along each side of the window; an even number."""
    layer: float
    """m above and below the height of flight that the map stands for."""
    memory_s: float
    """How long a return at close range is remembered; weaker evidence fades in proportion."""
    hull: float
    """m around the vehicle that are free because it is there."""


@dataclass(frozen=True, slots=True)
class MapView:
    """The window at one time, in the order of north and east. Its arrays are the map's own: they hold until its next
    view."""

    states: Bytes
    """(cells, cells) UNKNOWN, FREE or OCCUPIED."""
    to_occupied: Floats
    """(cells, cells) m from the centre to the nearest occupied cell's, or to what stands in it, at most FAR_M."""
    corner: Cell
    """World index of [0, 0]: that cell begins at corner * cell north and east."""
    cell: float
    hits: Array | None = None
    """(k, 2) m, NED: where in the occupied cells something stands; None: in their centres."""
    certain: BoolArray | None = None
    """(cells, cells) occupied, and seen from so near that there is no gap in it; None: all that are occupied."""

    def cell_of(self, place: Array) -> Cell:
        """Row and column of a place (2,) or (3,) NED; outside of the window if it lies there."""
        return (
            math.floor(place[0] / self.cell) - self.corner[0],
            math.floor(place[1] / self.cell) - self.corner[1],
        )

    def centre_of(self, cell: Cell) -> Array:
        """(2,) north and east (m) of a cell's centre."""
        centre: Array = (np.array(self.corner) + np.array(cell) + 0.5) * self.cell
        return centre

    def contains(self, cell: Cell) -> bool:
        rows, columns = self.states.shape
        return bool(0 <= cell[0] < rows and 0 <= cell[1] < columns)


class OccupancyGrid:
    """Takes rings in, each with the pose of its own time, and shows the window around the vehicle."""

    def __init__(self, settings: GridSettings) -> None:
        if settings.cells < 2 or settings.cells % 2:
            raise ValueError(f"cells {settings.cells}: not an even number from 2 on")
        self._settings = settings
        shape = (settings.cells, settings.cells)
        self._log_odds = np.zeros(shape, np.float32)
        self._seen_s = np.zeros(shape, np.float32)
        self._places = np.zeros((*shape, 3))
        # A large array that is taken anew each time costs more than what is written into it.
        self._states = np.empty(shape, np.uint8)
        self._certain = np.empty(shape, np.bool_)
        self._to_occupied = np.empty(shape, np.float32)
        self._corner: Cell | None = None
        self._start_ns: int | None = None
        self._height = 0.0
        """Down (m) of the layer's middle."""

    def add(
        self,
        scan: Scan,
        position_ned: Array,
        attitude_ned_frd: Array,
        ground_down: float,
        moving: BoolArray | None = None,
    ) -> None:
        """A ring taken at one pose. `ground_down` is the NED height below which a return is the ground; returns that
        are `moving` (n,) show what is free before them and leave no mark."""
        count = scan.bearings_frd.size
        positions, attitudes = np.empty((count, 3)), np.empty((count, 4))
        positions[:], attitudes[:] = position_ned, attitude_ned_frd
        width = abs(scan.bearings_frd[1] - scan.bearings_frd[0]) if count > 1 else math.radians(5.0)
        hit = scan.hit if moving is None else scan.hit & ~moving
        self.add_beams(
            scan.time_ns, scan.bearings_frd, scan.ranges_m, hit, scan.known, positions, attitudes, width, ground_down
        )

    def add_beams(
        self,
        time_ns: int,
        bearings_frd: Array,
        ranges_m: Array,
        hit: BoolArray,
        known: BoolArray,
        positions_ned: Array,
        attitudes_ned_frd: Array,
        width: float,
        ground_down: float,
    ) -> None:
        """Beams (n,) with the pose (n, 3), (n, 4) of each one's own time, `width` rad wide; see `Scan` for the rest.

        The window follows the last position; a change of height by half the layer begins a new map.
        """
        settings = self._settings
        here = positions_ned[-1]
        if self._start_ns is None:
            self._start_ns = time_ns - time_ns % _CLOCK_NS
        self._follow(here)
        assert self._corner is not None
        _add_beams(
            self._log_odds,
            self._seen_s,
            self._places,
            self._corner[0],
            self._corner[1],
            settings.cell,
            self._height,
            settings.layer,
            CEILING / settings.memory_s,
            self._seconds(time_ns),
            bearings_frd,
            ranges_m,
            hit,
            known,
            positions_ned,
            attitudes_ned_frd,
            width,
            ground_down,
        )
        self._mark_disc(here, settings.hull, FLOOR, time_ns)

    def forget(self, place: Array, radius: float, around: float, time_ns: int) -> None:
        """All within `radius` (m) of a place (2,) becomes unknown: it is there, and moves. What stood within `around`
        has moved on; what was seen free there stays so."""
        if self._corner is not None:
            self._mark_disc(place, around, 0.0, time_ns, occupied_alone=True)
            self._mark_disc(place, radius, 0.0, time_ns)

    def view(self, time_ns: int) -> MapView:
        """The window as it is now; all unknown before the first ring."""
        settings = self._settings
        corner = self._corner or (-settings.cells // 2, -settings.cells // 2)
        fading = CEILING / settings.memory_s
        states, certain, to_occupied = self._states, self._certain, self._to_occupied
        now_s = self._seconds(time_ns)
        hits = _classify(
            self._log_odds, self._seen_s, self._places, corner[0], corner[1], now_s, fading, states, certain
        )
        _measure(to_occupied, states == OCCUPIED, hits, corner, settings.cell)
        return MapView(states, to_occupied, corner, settings.cell, hits, certain)

    def _seconds(self, time_ns: int) -> float:
        """On the map's clock."""
        return (time_ns - (self._start_ns or 0)) * 1e-9

    def _follow(self, position_ned: Array) -> None:
        settings = self._settings
        half = settings.cells // 2
        corner = (
            math.floor(position_ned[0] / settings.cell) - half,
            math.floor(position_ned[1] / settings.cell) - half,
        )
        if self._corner is None or abs(position_ned[2] - self._height) > 0.5 * settings.layer:
            self._log_odds[:] = 0.0
            self._height = float(position_ned[2])
        else:
            _clear_what_enters(self._log_odds, *self._corner, *corner)
        self._corner = corner

    def _mark_disc(
        self, place: Array, radius: float, log_odds: float, time_ns: int, *, occupied_alone: bool = False
    ) -> None:
        assert self._corner is not None
        settings = self._settings
        north, east = float(place[0]), float(place[1])
        _set_disc(
            self._log_odds,
            self._seen_s,
            *self._corner,
            settings.cell,
            north,
            east,
            radius,
            log_odds,
            self._seconds(time_ns),
            occupied_alone,
        )


def distance_to(marked: BoolArray, cell: float) -> Floats:
    """Distance (m) from each cell's centre to the nearest marked one's, exact below FAR_M and FAR_M beyond."""
    distances = np.empty(marked.shape, np.float32)
    fill_distances(distances, marked, cell)
    return distances


def fill_distances(distances: Floats, marked: BoolArray, cell: float, far: float = FAR_M, least: float = 0.0) -> None:
    """The same into `distances`, exact from `least` (m) to below `far` and that much on either side."""
    reach = math.ceil(far / cell)
    _distances(marked, reach, _lengths(cell, reach, far, least), distances)


@cache
def _lengths(cell: float, reach: int, far: float, least: float) -> Floats:
    """(reach * reach + 1,) m for each square of a distance in cells."""
    return np.clip(cell * np.sqrt(np.arange(reach * reach + 1)), least, far).astype(np.float32)


def to_certain(view: MapView) -> Floats:
    """(cells, cells) as `view.to_occupied`, with nothing there but the certain cells."""
    if view.certain is None:
        return view.to_occupied
    distances = np.empty_like(view.to_occupied)
    if view.hits is None:
        fill_distances(distances, view.certain, view.cell)
    else:
        hits = view.hits[view.certain[view.states == OCCUPIED]]
        _measure(distances, view.certain, hits, view.corner, view.cell)
    return distances


def _measure(distances: Floats, marked: BoolArray, hits: Array, corner: Cell, cell: float) -> None:
    """Distances to the marked cells, from near to the hits (k, 2) in them."""
    fill_distances(distances, marked, cell, least=_NEAR_M)
    _refine(distances, hits, corner[0], corner[1], cell, _NEAR_M)


@compiled
def _faded(log_odds: float, age_s: float, fading: float) -> float:
    """Log-odds go to 0, unknown, by `fading` a second."""
    left = abs(log_odds) - fading * age_s
    if left <= 0.0:
        return 0.0
    return left if log_odds > 0.0 else -left


@compiled
def _clear_what_enters(log_odds: Floats, from_row: int, from_column: int, to_row: int, to_column: int) -> None:
    """The window's corner moves: forget the rows and columns that were not in it before."""
    size = log_odds.shape[0]
    for row in range(to_row, to_row + size):
        if row < from_row or row >= from_row + size:
            log_odds[row % size, :] = 0.0
    for column in range(to_column, to_column + size):
        if column < from_column or column >= from_column + size:
            log_odds[:, column % size] = 0.0


@compiled
def _set_disc(
    log_odds: Floats,
    seen_s: Floats,
    corner_row: int,
    corner_column: int,
    cell: float,
    north: float,
    east: float,
    radius: float,
    value: float,
    now_s: float,
    occupied_alone: bool,
) -> None:
    """Cells of the window whose centre lies in a disc get a value; or those of them alone that may be occupied."""
    size = log_odds.shape[0]
    reach = math.ceil(radius / cell)
    row, column = math.floor(north / cell), math.floor(east / cell)
    for i in range(max(row - reach, corner_row), min(row + reach + 1, corner_row + size)):
        for j in range(max(column - reach, corner_column), min(column + reach + 1, corner_column + size)):
            dn, de = (i + 0.5) * cell - north, (j + 0.5) * cell - east
            if dn * dn + de * de <= radius * radius and (not occupied_alone or log_odds[i % size, j % size] > 0.0):
                log_odds[i % size, j % size] = value
                seen_s[i % size, j % size] = now_s


@compiled
def _within_layer(above: float, down: float, layer: float) -> float:
    """How far (m) a beam of slope `down` stays within the layer, from `above` (m, down positive) its middle."""
    if abs(above) >= layer:
        return 0.0
    if down > 1e-9:
        return (layer - above) / down
    if down < -1e-9:
        return (-layer - above) / down
    return math.inf


@compiled
def _add_beams(
    log_odds: Floats,
    seen_s: Floats,
    places: Array,
    corner_row: int,
    corner_column: int,
    cell: float,
    height: float,
    layer: float,
    fading: float,
    now_s: float,
    bearings: Array,
    ranges: Array,
    hit: BoolArray,
    known: BoolArray,
    positions: Array,
    attitudes: Array,
    width: float,
    ground_down: float,
) -> None:
    """First every free wedge, then every return, so that no wedge wipes off what a neighbour has just seen."""
    size = log_odds.shape[0]
    middle_n, middle_e = (corner_row + 0.5 * size) * cell, (corner_column + 0.5 * size) * cell
    count = bearings.shape[0]
    sides, slopes = _directions(bearings, attitudes, 0.5 * width)
    arc = np.empty(count)
    beams, spans = np.zeros((size, size), np.int16), np.empty((size, 2), np.int64)
    spans[:, 0], spans[:, 1] = size, 0
    origins, levels = np.empty((count, 2)), np.empty(count)
    for k in range(count):
        arc[k] = -1.0
        if not known[k]:
            continue
        origin, down = positions[k], slopes[k]
        aside = max(abs(origin[0] - middle_n), abs(origin[1] - middle_e))
        reach = min(_within_layer(origin[2] - height, down, layer), 0.5 * size * cell - aside - 2.0 * cell)
        free = min(ranges[k], reach)
        if hit[k] and ranges[k] <= reach and origin[2] + ranges[k] * down < ground_down:
            arc[k] = ranges[k]
            free = ranges[k] - _STANDOFF_M
        if free > 0.0:
            level = _within_layer(0.0, down, _LEVEL) / cell
            levels[k] = level**2 * (sides[k, 0] * sides[k, 0] + sides[k, 1] * sides[k, 1])
            origins[k, 0], origins[k, 1] = origin[0] / cell, origin[1] / cell
            _mark_wedge(beams, spans, corner_row, corner_column, k + 1, cell, origins[k], sides[k], free)
    _lower(log_odds, seen_s, beams, spans, corner_row, corner_column, fading, now_s, origins, levels)
    spots = _spots(positions, sides, arc)
    _link(log_odds, seen_s, places, cell, fading, now_s, spots, arc)
    for k in range(count):
        if arc[k] < 0.0:
            continue
        left, right = _goes_on(spots, arc, k, (k - 1) % count, width), _goes_on(spots, arc, k, (k + 1) % count, width)
        _hit_arc(
            log_odds,
            seen_s,
            places,
            cell,
            fading,
            now_s,
            positions[k, 0],
            positions[k, 1],
            sides[k],
            arc[k],
            arc[k] * width,
            right and not left,
            left and not right,
        )


@compiled
def _spots(positions: Array, sides: Array, arc: Array) -> Array:
    """(n, 2) the middle of each arc, north and east."""
    spots = np.empty((arc.shape[0], 2))
    for k in range(arc.shape[0]):
        for axis in range(2):
            middle = 0.5 * (sides[k, axis] + sides[k, 2 + axis])
            spots[k, axis] = positions[k, axis] + max(arc[k], 0.0) * middle
    return spots


@compiled
def _goes_on(spots: Array, arc: Array, k: int, neighbour: int, width: float) -> bool:
    """What stands in a sector stands in its neighbour, too."""
    if arc[neighbour] < 0.0:
        return False
    away = math.hypot(spots[k, 0] - spots[neighbour, 0], spots[k, 1] - spots[neighbour, 1])
    return bool(away < _NEXT * max(arc[k], arc[neighbour]) * width + _MARK_M)


@compiled
def _directions(bearings: Array, attitudes: Array, half: float) -> tuple[Array, Array]:
    """North and east of each beam's left and right edge (n, 4), and the down component of its middle (n,)."""
    count = bearings.shape[0]
    sides, slopes = np.empty((count, 4)), np.empty(count)
    for k in range(count):
        forward, right = to_world(attitudes[k], (1.0, 0.0, 0.0)), to_world(attitudes[k], (0.0, 1.0, 0.0))
        for edge in range(2):
            bearing = bearings[k] - half if edge == 0 else bearings[k] + half
            cos, sin = math.cos(bearing), math.sin(bearing)
            sides[k, 2 * edge] = cos * forward[0] + sin * right[0]
            sides[k, 2 * edge + 1] = cos * forward[1] + sin * right[1]
        slopes[k] = math.cos(bearings[k]) * forward[2] + math.sin(bearings[k]) * right[2]
    return sides, slopes


@compiled
def _mark_wedge(
    beams: Marks,
    spans: Integers,
    corner_row: int,
    corner_column: int,
    number: int,
    cell: float,
    origin: Array,
    sides: Array,
    reach: float,
) -> None:
    """Write a beam's number into the cells of the window whose centre lies in the triangle from the sensor to both ends
    of the arc, row by row; `spans` (rows, 2) holds the columns that are written to.

    `sides` (4,) are north and east of the left and of the right edge's direction. Neighbouring wedges share an edge:
    each cell belongs to one of them.
    """
    y0, x0 = origin[0], origin[1]
    y1, x1 = y0 + reach * sides[0] / cell, x0 + reach * sides[1] / cell
    y2, x2 = y0 + reach * sides[2] / cell, x0 + reach * sides[3] / cell
    # An edge along a row is crossed by none: its slope is not used.
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
        row, first, last = i - corner_row, math.ceil(low - 0.5) - corner_column, math.ceil(high - 0.5) - corner_column
        for j in range(first, last):
            beams[row, j] = number
        if last > first:
            spans[row, 0], spans[row, 1] = min(spans[row, 0], first), max(spans[row, 1], last)


@compiled
def _lower(
    log_odds: Floats,
    seen_s: Floats,
    beams: Marks,
    spans: Integers,
    corner_row: int,
    corner_column: int,
    fading: float,
    now_s: float,
    origins: Array,
    levels: Array,
) -> None:
    """All marked cells of the window; each of its rows is up to two runs in the memory."""
    size = beams.shape[0]
    wrap = size - corner_column % size  # the window's column that is the memory's first one
    for i in range(size):
        row = (corner_row + i) % size
        for first, last, shift in (
            (spans[i, 0], min(spans[i, 1], wrap), size - wrap),
            (max(spans[i, 0], wrap), spans[i, 1], -wrap),
        ):
            if first < last:
                _lower_run(
                    log_odds[row, first + shift : last + shift],
                    seen_s[row, first + shift : last + shift],
                    beams[i, first:last],
                    fading,
                    now_s,
                    corner_row + i + 0.5,
                    corner_column + first,
                    origins,
                    levels,
                )


@compiled
def _lower_run(
    log_odds: Floats,
    seen_s: Floats,
    beams: Marks,
    fading: float,
    now_s: float,
    row: float,
    column: int,
    origins: Array,
    levels: Array,
) -> None:
    """Neighbouring cells (n,) of a row, of which those with a beam's number were seen free.

    All but the strong marks in one go, without a branch; these give way if they have faded or lie no farther from the
    beam's origin (beams, 2) than its level (beams,), a square: in cells, whose middles lie at `row` and from half a
    cell after `column` on.
    """
    strong = False
    for j in range(beams.size):
        value, age = float(log_odds[j]), now_s - seen_s[j]
        faded = max(value - fading * age, 0.0) if value > 0.0 else min(value + fading * age, 0.0)
        seen, weak = beams[j] > 0, value <= _STRONG
        log_odds[j] = max(faded - FREE_STEP, FLOOR) if seen & weak else value
        seen_s[j] = now_s if seen & weak else seen_s[j]
        strong |= seen & (not weak)
    if not strong:
        return
    for j in range(beams.size):
        k = beams[j] - 1
        if k < 0 or log_odds[j] <= _STRONG:
            continue
        faded = _faded(log_odds[j], now_s - seen_s[j], fading)
        dn, de = row - origins[k, 0], column + j + 0.5 - origins[k, 1]
        if faded <= _STRONG or dn * dn + de * de <= levels[k]:
            log_odds[j], seen_s[j] = max(faded - FREE_STEP, FLOOR), now_s


@compiled
def _hit_arc(
    log_odds: Floats,
    seen_s: Floats,
    places: Array,
    cell: float,
    fading: float,
    now_s: float,
    north: float,
    east: float,
    sides: Array,
    distance: float,
    length: float,
    ends_left: bool,
    ends_right: bool,
) -> None:
    """Every cell along the arc, once, with its share of the evidence; on the side where a thing ends, which may be
    anywhere within the sector, little of it."""
    size = log_odds.shape[0]
    share = CEILING / max(1.0, length / max(_MARK_M, cell))
    samples = math.ceil(2.0 * length / cell) + 1
    before_row, before_column = -1, -1
    for s in range(samples):
        right = (s + 0.5) / samples
        dn = sides[0] + right * (sides[2] - sides[0])
        de = sides[1] + right * (sides[3] - sides[1])
        place_n, place_e = north + distance * dn, east + distance * de
        row, column = math.floor(place_n / cell) % size, math.floor(place_e / cell) % size
        if row == before_row and column == before_column:
            continue
        before_row, before_column = row, column
        ends = ends_left if right < 0.5 else ends_right
        most = min(share, _END) if ends else share
        value = _faded(log_odds[row, column], now_s - seen_s[row, column], fading)
        before_n, before_e = places[row, column, 0], places[row, column, 1]
        near = abs(before_n - place_n) < cell and abs(before_e - place_e) < cell
        kept = 1.0 - _NEW_PLACE if value > 0.0 and near else 0.0
        places[row, column, 2] = min(places[row, column, 2], distance) if kept > 0.0 else distance
        places[row, column, 0] = kept * before_n + (1.0 - kept) * place_n
        places[row, column, 1] = kept * before_e + (1.0 - kept) * place_e
        log_odds[row, column] = max(value, min(value + 0.5 * most, most))
        seen_s[row, column] = now_s


@compiled
def _link(
    log_odds: Floats,
    seen_s: Floats,
    places: Array,
    cell: float,
    fading: float,
    now_s: float,
    spots: Array,
    arc: Array,
) -> None:
    """A wall seen at a slant leaves steps between the arcs of its sectors: neighbours that a third return shows to
    stand in one line are joined by weak marks, so that no way leads between them until the place was seen."""
    count = arc.shape[0]
    size = log_odds.shape[0]
    for k in range(count):
        a, b = k, (k + 1) % count
        if arc[a] < 0.0 or arc[b] < 0.0:
            continue
        dn, de = spots[b, 0] - spots[a, 0], spots[b, 1] - spots[a, 1]
        length = math.hypot(dn, de)
        if length < cell or not (
            _in_line(spots, arc, (k - 1) % count, a, b) or _in_line(spots, arc, (k + 2) % count, b, a)
        ):
            continue
        samples = math.ceil(2.0 * length / cell)
        for s in range(1, samples):
            north, east = spots[a, 0] + s / samples * dn, spots[a, 1] + s / samples * de
            row, column = math.floor(north / cell) % size, math.floor(east / cell) % size
            value = _faded(log_odds[row, column], now_s - seen_s[row, column], fading)
            if value < _LINK:
                log_odds[row, column], seen_s[row, column] = _LINK, now_s
                places[row, column, 0], places[row, column, 1], places[row, column, 2] = north, east, math.inf


@compiled
def _in_line(spots: Array, arc: Array, before: int, first: int, second: int) -> bool:
    """The step from `before` to `first` goes on to `second`, as far as sectors can tell."""
    if arc[before] < 0.0:
        return False
    an, ae = spots[first, 0] - spots[before, 0], spots[first, 1] - spots[before, 1]
    bn, be = spots[second, 0] - spots[first, 0], spots[second, 1] - spots[first, 1]
    a, b = math.hypot(an, ae), math.hypot(bn, be)
    return an * bn + ae * be > _STRAIGHT * a * b and b < _LONGER * a and a < _LONGER * b


@compiled
def _classify(
    log_odds: Floats,
    seen_s: Floats,
    places: Array,
    corner_row: int,
    corner_column: int,
    now_s: float,
    fading: float,
    states: Bytes,
    certain: BoolArray,
) -> Array:
    """Fill `states` and `certain` in the window's order; (k, 2) NED of what stands in the occupied cells."""
    size = log_odds.shape[0]
    wrap = size - (corner_column % size)  # the window's column that is the memory's first one
    now, rate = np.float32(now_s), np.float32(fading)
    counts = np.zeros(size, np.int64)
    for i in range(size):
        row = (corner_row + i) % size
        _classify_run(log_odds[row, size - wrap :], seen_s[row, size - wrap :], now, rate, states[i, :wrap])
        _classify_run(log_odds[row, : size - wrap], seen_s[row, : size - wrap], now, rate, states[i, wrap:])
        counts[i] = _occupied(states[i])
    hits = np.empty((counts.sum(), 2))
    certain[:] = False
    count = 0
    for i in range(size):
        if counts[i] == 0:
            continue
        row = (corner_row + i) % size
        for j in range(size):
            if states[i, j] == OCCUPIED:
                column = (corner_column + j) % size
                certain[i, j] = places[row, column, 2] < _CERTAIN_M
                hits[count, 0], hits[count, 1] = places[row, column, 0], places[row, column, 1]
                count += 1
    return hits


@compiled
def _occupied(states: Bytes) -> int:
    """How many; in 32 bits, which is half the time of 64."""
    count = np.int32(0)
    for j in range(states.size):
        count = np.int32(count + np.int32(states[j] == np.uint8(OCCUPIED)))
    return int(count)


@compiled
def _classify_run(log_odds: Floats, seen_s: Floats, now_s: np.float32, fading: np.float32, states: Bytes) -> None:
    """Cells (n,) beside each other, all in 32 bits and without a branch: the processor does eight at a time."""
    free_below, occupied_above, zero = np.float32(-FREE_BELOW), np.float32(OCCUPIED_ABOVE), np.float32(0.0)
    for j in range(states.shape[0]):
        value = log_odds[j]
        left = abs(value) - fading * (now_s - seen_s[j])
        free = (value < zero) & (left > free_below)
        occupied = (value > zero) & (left > occupied_above)
        states[j] = np.uint8(FREE) * np.uint8(free) + np.uint8(OCCUPIED) * np.uint8(occupied)


@compiled
def _refine(to_occupied: Floats, hits: Array, corner_row: int, corner_column: int, cell: float, near: float) -> None:
    """Distances below `near` (m), which no other cell may have, become those to the hits.

    `squares` is set, and read, in each row from the first to the last cell that a hit is near to.
    """
    rows, columns = to_occupied.shape
    reach = math.ceil(near / cell) + 1
    farthest = np.float32((near / cell + 1e-4) ** 2)
    squares = np.empty((rows, columns), np.float32)
    first, last = np.full(rows, columns), np.zeros(rows, np.int64)
    for k in range(hits.shape[0]):  # which cells of each row are looked at
        row, column = math.floor(hits[k, 0] / cell) - corner_row, math.floor(hits[k, 1] / cell) - corner_column
        for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
            first[i] = min(first[i], max(column - reach, 0))
            last[i] = max(last[i], min(column + reach + 1, columns))
    for i in range(rows):
        squares[i, first[i] : last[i]] = np.float32(math.inf)
    for k in range(hits.shape[0]):
        north, east = hits[k, 0] / cell - corner_row - 0.5, hits[k, 1] / cell - corner_column - 0.5
        row, column = math.floor(hits[k, 0] / cell) - corner_row, math.floor(hits[k, 1] / cell) - corner_column
        left, right = max(column - reach, 0), min(column + reach + 1, columns)
        aside = np.float32(left - east)
        for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
            along = np.float32((i - north) * (i - north))
            beside = squares[i, left:right]
            for j in range(right - left):
                away = aside + np.float32(j)
                beside[j] = min(beside[j], along + away * away)
    size = np.float32(cell)
    for i in range(rows):
        near_row, row_squares = to_occupied[i, first[i] : last[i]], squares[i, first[i] : last[i]]
        for j in range(last[i] - first[i]):
            if row_squares[j] <= farthest:
                near_row[j] = min(near_row[j], size * np.sqrt(row_squares[j]))


@compiled
def between(distances: NDArray[np.floating[Any]], row: float, column: float) -> float:
    """A distance (m) between the centres of cells, which whole numbers mean; 0 outside of the map."""
    i, j = math.floor(row), math.floor(column)
    if min(i, j) < 0 or i + 1 >= distances.shape[0] or j + 1 >= distances.shape[1]:
        return 0.0
    a, b = row - i, column - j
    near = (1.0 - b) * distances[i, j] + b * distances[i, j + 1]
    far = (1.0 - b) * distances[i + 1, j] + b * distances[i + 1, j + 1]
    return float((1.0 - a) * near + a * far)


@compiled
def _distances(marked: BoolArray, reach: int, lengths: Floats, result: Floats) -> None:
    """Fill `result` with the `lengths` (reach * reach + 1,) of squares of distances in cells."""
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
    up[top] = np.where(marked[top], zero, none)
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
def has(row: NDArray[Any], value: int) -> bool:
    """Whether a value is among them; without a way out, so that the processor looks at many at a time."""
    found = False
    for j in range(row.shape[0]):
        found |= row[j] == value
    return found


@compiled
def _marked_rows(marked: BoolArray) -> tuple[int, int]:
    """The first and the last row with a mark; the last is -1 if there is none."""
    first, last = marked.shape[0], -1
    for i in range(marked.shape[0]):
        if has(marked[i], True):
            first, last = min(first, i), i
    return first, last


@compiled
def _below(row: NDArray[np.int16], limit: np.int16) -> tuple[int, int]:
    """The first and the last of a row's values that are less than the limit; beyond each other if none is."""
    size = row.shape[0]
    first, last = 0, size - 1
    while first < size and row[first] >= limit:
        first += 1
    while last >= first and row[last] >= limit:
        last -= 1
    return first, last
