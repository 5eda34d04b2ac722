"""The fence in the map: a band of occupied cells along its outside, through which no way leads."""

from dataclasses import replace

import numpy as np

from companion.perception.distance_field import fill_distances_to_returns
from companion.perception.map_view import OCCUPIED, MapView

Flat = tuple[float, float, float, float, float, float, float]
"""Home's north and east, the least and the most north and east, and the radius (m, NED): `fence.Fence.flat`."""
_CELLS = 4.0
"""Width of the band, in cells: wider than any step of a planner."""


def with_fence(view: MapView, fence: Flat) -> MapView:
    """The view with the band in it. The states and distances of `view` are overwritten."""
    home_north, home_east, south, north, west, east, radius = fence
    rows, columns = view.states.shape
    at_north = ((np.arange(rows) + view.corner[0] + 0.5) * view.cell)[:, None]
    at_east = ((np.arange(columns) + view.corner[1] + 0.5) * view.cell)[None, :]
    beyond = np.hypot(at_north - home_north, at_east - home_east) - radius
    for sides in (south - at_north, at_north - north, west - at_east, at_east - east):
        np.maximum(beyond, sides, out=beyond)
    band = (beyond > 0.0) & (beyond < _CELLS * view.cell)
    if not band.any():
        return view
    before = view.states == OCCUPIED
    view.states[band] = OCCUPIED
    occupied = before | band
    cells = np.argwhere(occupied)
    hits = (cells + np.array(view.corner) + 0.5) * view.cell
    blurs = np.zeros(len(hits))
    if view.hits is not None:
        hits[before[occupied]] = view.hits
    if view.blurs is not None:
        blurs[before[occupied]] = view.blurs
    fill_distances_to_returns(view.to_occupied, occupied, hits, view.corner, view.cell)
    return replace(view, hits=hits, blurs=None if view.blurs is None else blurs)
