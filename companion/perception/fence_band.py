"""The fence in the map: a band of occupied cells along its outside, through which no way leads."""

from dataclasses import replace

import numpy as np

from companion.config_avoidance import Avoidance, AvoidancePlan
from companion.fence import Fence
from companion.perception.distance_field import distance_to
from companion.perception.map_view import OCCUPIED, MapView
from protocol.arrays import Array

Flat = tuple[float, float, float, float, float, float, float]
"""Home's north and east, the least and the most north and east, and the radius (m, NED): `fence.Fence.flat`."""
_CELLS = 4.0
"""Width of the band, in cells: wider than any step of a planner."""
_ALONG_M = 0.1
"""m beyond the inflation of the map at which the fence stands in it."""
_NEAR_CELLS, _CLEAR_CELLS = 1.0, 2.0
"""Cells of the map between vehicle and walls below which these are left out of it, and from which on they are back:
nearer, the vehicle may be in one of their cells, where every command is one into an obstacle."""


class Walls:
    """The fence for the map: so far outside of what the reference keeps to that there is a way along its edge."""

    def __init__(self, kept: Fence, settings: Avoidance) -> None:
        """`kept`: what the reference keeps to."""
        away = settings.plan.inflation + _ALONG_M
        self._fence = kept.shrunk(-away)
        self._clear = min(_CLEAR_CELLS * settings.map.cell, away)
        self._near = self._clear * _NEAR_CELLS / _CLEAR_CELLS
        self._stands = True

    def around(self, place: Array) -> Flat | None:
        """The walls around the vehicle at a place (3,); None once it is out of them, until it is inside again: they
        would keep it outside, and the reference leads nowhere but inwards there."""
        self._stands = self._fence.flat_room(place) >= (self._near if self._stands else self._clear)
        return self._fence.flat if self._stands else None


def with_fence(view: MapView, fence: Flat, plan: AvoidancePlan) -> MapView:
    """The view with the band in it. The states and distances of `view` are overwritten; those to its obstacles stay as
    they are, with whatever margin they have.

    What is nearer to the band than the plan's inflation counts as nearer than that of tight paths, too: they would lead
    where the reference does not go, which then pulls the vehicle off the way, towards what it passes.
    """
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
    blurs = np.full(len(hits), plan.tight_inflation - plan.inflation)  # for certain no nearer than in doubt
    if view.hits is not None:
        hits[before[occupied]] = view.hits
    if view.blurs is not None:
        blurs[before[occupied]] = view.blurs
    away = distance_to(band, view.cell)
    away[away < plan.inflation] *= plan.tight_inflation / plan.inflation
    np.minimum(view.to_occupied, away, out=view.to_occupied)
    return replace(view, hits=hits, blurs=None if view.blurs is None else blurs)
