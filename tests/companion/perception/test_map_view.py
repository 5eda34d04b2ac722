"""A view of the map by position: states, distances, and the certain cells."""

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


def test_distances_to_the_certain_cells_alone() -> None:
    view = view_with((3, 5), (12, 20))
    assert to_certain(view) is view.to_occupied, "without more knowledge all are certain"
    certain = np.zeros(view.states.shape, np.bool_)
    certain[12, 20] = True
    with_centres = MapView(view.states, view.to_occupied, CORNER, CELL, certain=certain)
    assert np.array_equal(to_certain(with_centres), distance_to(certain, CELL))
    hits = view.obstacle_centres()
    with_hits = MapView(view.states, view.to_occupied, CORNER, CELL, hits, certain)
    assert to_certain(with_hits)[12, 20] == 0.0 and to_certain(with_hits)[3, 5] == FAR_M
    assert to_certain(with_hits)[12, 21] == pytest.approx(CELL)
