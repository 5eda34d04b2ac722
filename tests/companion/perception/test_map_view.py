"""A view of the map by position: states, distances, and what of them is certain."""

import dataclasses

import numpy as np
import pytest

from companion.perception.distance_field import FAR_M, distance_to
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, MapView, to_certain

CELL, CORNER = 0.25, (-8, 20)


def view_with(*occupied: tuple[int, int]) -> MapView:
    states = np.full((16, 24), FREE, np.uint8)
    for cell in occupied:
        states[cell] = OCCUPIED
    return MapView(states, distance_to(states == OCCUPIED, CELL), CORNER, CELL)


def test_places_and_cells_belong_together() -> None:
    view = view_with((3, 5))
    for cell in ((0, 0), (3, 5), (15, 23)):
        assert view.cell_of(view.centre_of(cell)) == cell and view.contains(cell)
        assert view.state_at(view.centre_of(cell)) == view.states[cell]
        assert view.distance_at(view.centre_of(cell)) == view.to_occupied[cell]
    (centre,) = view.obstacle_centres()
    assert centre == pytest.approx(view.centre_of((3, 5)))
    assert centre == pytest.approx([(-8 + 3.5) * CELL, (20 + 5.5) * CELL])


def test_outside_of_the_window_nothing_is_known() -> None:
    """North and south, east and west of it; no index wraps."""
    view = view_with((0, 0), (15, 23))
    for place in ([-2.01, 6.0], [2.01, 6.0], [0.0, 4.99], [0.0, 11.01]):
        assert view.state_at(np.array(place)) == UNKNOWN and view.distance_at(np.array(place)) is None


def test_what_is_certain() -> None:
    """The disc around a return, less the blur, holds the obstacle wherever in the blur it is."""
    view = view_with((3, 5), (12, 20))
    assert to_certain(view, 0.8) is view.to_occupied, "without more knowledge all are where they seem to be"
    rows, columns = np.indices(view.states.shape)
    for blur in (0.0, 0.3, 0.8):
        certain = to_certain(dataclasses.replace(view, blurs=np.array([np.inf, blur])), 0.8)
        away = CELL * np.hypot(rows - 12, columns - 20) + blur
        assert certain == pytest.approx(np.where(away < 0.8, away, FAR_M), abs=1e-6)
    hits = np.array([view.centre_of((0, 23)), view.centre_of((12, 20)) + np.array([0.1, 0.0])])
    certain = to_certain(dataclasses.replace(view, hits=hits, blurs=np.zeros(2)), 0.8)
    assert certain[0, 23] == 0.0 and certain[12, 20] == pytest.approx(0.1) and certain[3, 5] == FAR_M
