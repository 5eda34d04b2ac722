"""A view of the map: for each cell of the window its state and the distance to the nearest obstacle.

Consumers ask by position (m, NED) where they can; rows and columns belong to the planar grid.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.perception.distance_field import FAR_M, Floats, lower_to_blurred
from protocol.arrays import Array

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""States of a cell in a `MapView`."""

Bytes = NDArray[np.uint8]
Cell = tuple[int, int]


@dataclass(frozen=True, slots=True)
class MapView:
    """The window at one time; rows run north, columns east. The arrays are the map's own: its next view overwrites
    them."""

    states: Bytes
    """(rows, columns) UNKNOWN, FREE or OCCUPIED."""
    to_occupied: Floats
    """(rows, columns) m from the cell's centre to the nearest occupied cell's centre, or to the return in it; at most
    FAR_M."""
    corner: Cell
    """World index of [0, 0]: that cell begins at corner * cell north and east."""
    cell: float
    """Size of a cell (m)."""
    hits: Array | None = None
    """(k, 2) m, NED: the return in each occupied cell, in the cells' order; None: the cells' centres stand for them."""
    blurs: Array | None = None
    """(k,) m along the arc in which each of `hits` lies, as of the nearest look at it: the obstacle is no farther from
    it; inf where nothing says so; less by the margin by which obstacles are taken for larger. None: all are where they
    seem to be."""
    margin: float = 0.0
    """m by which obstacles are taken for larger than they are seen."""
    moving: Array | None = None
    """(m, MOVER_COLUMNS) moving obstacles, which mark no cell, as in `perception.free_space`; None: none."""

    def cell_of(self, place: Array) -> Cell:
        """Row and column of a place (2,) or (3,) NED (m); outside of the window if the place is."""
        return (
            math.floor(place[0] / self.cell) - self.corner[0],
            math.floor(place[1] / self.cell) - self.corner[1],
        )

    def centre_of(self, cell: Cell) -> Array:
        """(2,) north and east (m) of a cell's centre."""
        centre: Array = (np.array(self.corner) + np.array(cell) + 0.5) * self.cell
        return centre

    def contains(self, cell: Cell) -> bool:
        """Whether a row and column are in the window."""
        rows, columns = self.states.shape
        return bool(0 <= cell[0] < rows and 0 <= cell[1] < columns)

    def state_at(self, place: Array) -> int:
        """State of the cell at a place (2,) or (3,) NED (m); UNKNOWN outside of the window."""
        cell = self.cell_of(place)
        return int(self.states[cell]) if self.contains(cell) else UNKNOWN

    def distance_at(self, place: Array) -> float | None:
        """Distance (m) to the nearest obstacle from the cell at a place (2,) or (3,) NED (m); None outside of the
        window."""
        cell = self.cell_of(place)
        return float(self.to_occupied[cell]) if self.contains(cell) else None

    def obstacle_centres(self) -> Array:
        """(k, 2) north and east (m) of the centres of the occupied cells."""
        centres: Array = (np.argwhere(self.states == OCCUPIED) + np.array(self.corner) + 0.5) * self.cell
        return centres


def to_certain(view: MapView, within: float) -> Floats:
    """(rows, columns) m within which there is an obstacle for certain: the distance from a return and its blur. FAR_M
    where that is more than `within` (m)."""
    if view.blurs is None:
        return view.to_occupied
    distances = np.full_like(view.to_occupied, FAR_M)
    hits = view.obstacle_centres() if view.hits is None else view.hits
    lower_to_blurred(distances, hits, view.blurs, view.corner, view.cell, within)
    return distances
