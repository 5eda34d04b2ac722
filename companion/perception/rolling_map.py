"""The rolling map: an occupancy grid of log-odds around the vehicle, unknown kept apart from free.

The map is flat: it stands for the layer around the height of flight. The cells are aligned with the world, and the
window moves with the vehicle (`companion.perception.occupancy_grid`). What a scan says of the cells is in
`companion.perception.inverse_sensor_model`, the distances of a view are in `companion.perception.distance_field`.
"""

import math
from typing import Any

import numpy as np

from companion.config_avoidance import AvoidanceMap
from companion.perception.distance_field import Floats, fill_distances_to_returns
from companion.perception.inverse_sensor_model import Beams, Layer, add_beams
from companion.perception.map_view import OCCUPIED, Bytes, Cell, MapView
from companion.perception.occupancy_grid import (
    CEILING,
    CERTAIN_M,
    FLOOR,
    Grid,
    classify,
    classify_coarse,
    move_memory,
    set_disc,
)
from companion.perception.scans import WIDE_SECTOR, sector_width
from companion.state import EVERY_HEIGHT, Scan
from protocol.arrays import Array, BoolArray

_CLOCK_NS = 4096 * 1_000_000_000
"""ns. Each map's clock starts at a multiple of this before its first scan: 32-bit floats resolve absolute time only to
two minutes."""
_LEAST_WIDTH = math.radians(5.0)
"""rad for which the blur of a return counts, however narrow its sector is: an error of the heading moves it, too."""
_COARSE_M, _COARSE_CELLS = 0.25, 512
"""Side (m) of the coarse cells of all that is remembered, where the map's are smaller, and how many there are along
each side at most."""

_WIDE_MARGIN_M = 0.3
"""m by which all obstacles are taken for larger where sectors are wide."""


def coarse_cells(settings: AvoidanceMap) -> tuple[int, int]:
    """How many there are along each side of `RollingMap.whole`, and the map's cells along each side of one."""
    factor = max(1, math.floor(_COARSE_M / settings.cell + 1e-9))
    return min(settings.memory // factor - 1, _COARSE_CELLS), factor


class RollingMap:
    """Takes scans, each with the pose of its own time, and gives views of the window around the vehicle."""

    def __init__(self, settings: AvoidanceMap, hull_radius: float) -> None:
        """`hull_radius`: m around the vehicle that are free because the vehicle is there."""
        self._settings = settings
        self._hull_radius = hull_radius
        self._fading = CEILING / settings.memory_s
        memory, shape = (settings.memory, settings.memory), (settings.cells, settings.cells)
        self._log_odds = np.zeros(memory, np.float32)
        self._updated_s = np.zeros(memory, np.float32)
        self._returns = np.zeros((*memory, 3))
        # Allocating these anew for each view would cost more than filling them.
        self._states = np.empty(shape, np.uint8)
        self._to_occupied = np.empty(shape, np.float32)
        self._first_corner = -settings.cells // 2, -settings.cells // 2
        self._corner: Cell | None = None
        self._start_ns: int | None = None
        self._width = _LEAST_WIDTH
        """rad of a beam's sector."""
        self._height = 0.0
        """m, NED: down coordinate of the layer's middle."""
        self._ground = 0.0
        """m, NED: the ground's, with which the layer rises and falls."""
        self.in_the_way = EVERY_HEIGHT
        """m above and below the vehicle up to which its beams count, where that is less than the layer."""

    def add(
        self,
        scan: Scan,
        position_ned: Array,
        attitude_ned_frd: Array,
        ground_down: float,
        moving: BoolArray | None = None,
        slope: float = 0.0,
    ) -> None:
        """Add a scan that was taken at one pose, (3,) m and (4,).

        `ground_down` and `slope`: which returns are the ground, see `scans.obstacle_points`. Returns that are `moving`
        (n,) show the free space before them and mark no cell.
        """
        count = scan.bearings_frd.size
        positions, attitudes = np.empty((count, 3)), np.empty((count, 4))
        positions[:], attitudes[:] = position_ned, attitude_ned_frd
        hit = scan.hit if moving is None else scan.hit & ~moving
        beams = Beams(scan.bearings_frd, scan.ranges_m, hit, scan.known, positions, attitudes, sector_width(scan))
        self.add_beams(scan.time_ns, beams, ground_down, slope)

    def add_beams(self, time_ns: int, beams: Beams, ground_down: float, slope: float = 0.0) -> None:
        """Add beams that may have a pose each. The window follows the last position; a change of
        height above the ground by half the layer clears the map."""
        here = beams.positions_ned[-1]
        if self._start_ns is None:
            self._start_ns = time_ns - time_ns % _CLOCK_NS
        self._follow(here, ground_down)
        self._width = max(beams.width, _LEAST_WIDTH)
        grid = self._grid(time_ns)
        layer = Layer(*self._layer(float(here[2])), ground_down, slope)
        # The arcs of wide sectors cross something that stands nearly always.
        add_beams(grid, tuple(beams), tuple(layer), self._settings.keeps_free and self._width <= WIDE_SECTOR)
        set_disc(grid, float(here[0]), float(here[1]), self._hull_radius, FLOOR, False)

    def _layer(self, down: float) -> tuple[float, float]:
        """The middle (m, NED) of the heights that count with the vehicle at `down`, and half of how high they are."""
        middle, half = self._height, self._settings.layer
        if self.in_the_way == EVERY_HEIGHT:
            return middle, half
        above, below = self.in_the_way
        highest, lowest = max(middle - half, down - above), min(middle + half, down + below)
        return 0.5 * (highest + lowest), 0.5 * (lowest - highest)

    def forget(self, place: Array, radius: float, occupied_radius: float, time_ns: int) -> None:
        """Forget what was seen where a moving obstacle is now.

        Within `radius` (m) of a place (2,) NED (m) all cells become unknown, within `occupied_radius` (m) the occupied
        ones: they show where the obstacle was before. What was confirmed from close range stays.
        """
        if self._corner is not None:
            grid = self._grid(time_ns)
            north, east = float(place[0]), float(place[1])
            set_disc(grid, north, east, occupied_radius, 0.0, True)
            set_disc(grid, north, east, radius, 0.0, False)

    def view(self, time_ns: int, margin: float = 0.0) -> MapView:
        """The window at a time; all unknown before the first scan. The next view overwrites its arrays. Obstacles are
        taken for larger than they are seen by a `margin` (m)."""
        returns = classify(self._grid(time_ns), self._states)
        corner = self._corner or self._first_corner
        return self._viewed(self._states, self._to_occupied, returns, corner, self._settings.cell, margin)

    def whole(self, time_ns: int, margin: float = 0.0) -> MapView:
        """The same of all that is remembered, in coarse cells, up to `_COARSE_CELLS` along each side, the vehicle in
        their middle. It is many times as much work as a view of the window."""
        settings, (row, column) = self._settings, self._corner or self._first_corner
        (count, factor), aside = coarse_cells(settings), settings.cells // 2
        corner = ((row + aside) // factor - count // 2, (column + aside) // factor - count // 2)
        states, to_occupied = np.empty((count, count), np.uint8), np.empty((count, count), np.float32)
        returns = classify_coarse(self._grid(time_ns), factor, corner, states)
        return self._viewed(states, to_occupied, returns, corner, factor * settings.cell, margin)

    def _viewed(
        self, states: Bytes, to_occupied: Floats, returns: Array, corner: Cell, cell: float, margin: float
    ) -> MapView:
        """The view of cells whose distances are yet to be filled in; `returns` (k, 3) as of `classify`."""
        hits, ranges = np.ascontiguousarray(returns[:, :2]), returns[:, 2]
        fill_distances_to_returns(to_occupied, states == OCCUPIED, hits, corner, cell)
        larger = margin + (_WIDE_MARGIN_M if self._width > WIDE_SECTOR else 0.0)
        if larger:
            np.maximum(to_occupied - np.float32(larger), 0.0, out=to_occupied)
        blurs = np.where(ranges < CERTAIN_M, 0.0, self._width * ranges) - margin
        return MapView(states, to_occupied, corner, cell, hits, blurs, larger)

    def _grid(self, time_ns: int) -> tuple[Any, ...]:
        """A Grid to be read or written at a time, as a plain tuple."""
        row, column = self._corner or self._first_corner
        now_s = (time_ns - (self._start_ns or 0)) * 1e-9
        arrays = self._log_odds, self._updated_s, self._returns
        return tuple(Grid(*arrays, self._settings.cells, row, column, self._settings.cell, now_s, self._fading))

    def _follow(self, position_ned: Array, ground_down: float) -> None:
        """Centre the window on a position (3,) NED (m), and let the layer follow the ground (m, NED)."""
        settings = self._settings
        if math.isfinite(ground_down):
            self._height += ground_down - self._ground
            self._ground = ground_down
        half = settings.cells // 2
        corner = (
            math.floor(position_ned[0] / settings.cell) - half,
            math.floor(position_ned[1] / settings.cell) - half,
        )
        if self._corner is None or abs(position_ned[2] - self._height) > 0.5 * settings.layer:
            self._log_odds[:] = 0.0
            self._height = float(position_ned[2])
        else:
            aside = (settings.memory - settings.cells) // 2
            move_memory(self._log_odds, *(at - aside for at in (*self._corner, *corner)))
        self._corner = corner
