"""The fence in the map: an occupied band along its outside, and nothing else changed."""

import math

import numpy as np
import pytest

from companion.perception.distance_field import FAR_M, fill_distances_to_returns
from companion.perception.fence_band import Flat, with_fence
from companion.perception.map_view import FREE, OCCUPIED, MapView

CELL = 0.25
CIRCLE: Flat = (1.0, -2.0, -math.inf, math.inf, -math.inf, math.inf, 8.0)
BOX: Flat = (0.0, 0.0, -6.0, 7.0, -5.0, 9.0, math.inf)


def view_with(*returns: tuple[float, float]) -> MapView:
    """A window of 30 m around (0, 0), all free but for the cells of these returns."""
    side = round(30.0 / CELL)
    states = np.full((side, side), FREE, np.uint8)
    corner = -side // 2, -side // 2
    hits = np.array(sorted(returns, key=lambda place: (math.floor(place[0] / CELL), math.floor(place[1] / CELL))))
    hits = hits.reshape(-1, 2)
    for place in hits:
        states[math.floor(place[0] / CELL) - corner[0], math.floor(place[1] / CELL) - corner[1]] = OCCUPIED
    distances = np.empty((side, side), np.float32)
    fill_distances_to_returns(distances, states == OCCUPIED, hits, corner, CELL)
    return MapView(states, distances, corner, CELL, hits, np.full(len(hits), 0.2))


def beyond(place: tuple[float, float], fence: Flat) -> float:
    north, east = place
    sides = (fence[2] - north, north - fence[3], fence[4] - east, east - fence[5])
    return max(math.hypot(north - fence[0], east - fence[1]) - fence[6], *sides)


@pytest.mark.parametrize("fence", [CIRCLE, BOX])
def test_a_band_is_occupied_along_the_outside_alone(fence: Flat) -> None:
    view = with_fence(view_with(), fence)
    for row in range(0, view.states.shape[0], 3):
        for column in range(0, view.states.shape[1], 3):
            north, east = view.centre_of((row, column)).tolist()
            out = beyond((north, east), fence)
            assert bool(view.states[row, column] == OCCUPIED) is (0.0 < out < 4.0 * CELL)


@pytest.mark.parametrize("fence", [CIRCLE, BOX])
def test_the_distances_are_those_to_the_fence(fence: Flat) -> None:
    view = with_fence(view_with(), fence)
    for place in [(0.0, 0.0), (3.0, 1.0), (-4.0, -3.0), (5.0, 2.0)]:
        room = -beyond(place, fence)
        found = view.distance_at(np.array(place))
        assert found is not None and found == pytest.approx(min(room, FAR_M), abs=1.5 * CELL)


def test_returns_inside_keep_their_places() -> None:
    returns = [(2.06, 1.03), (-3.2, -2.9), (4.9, 0.1)]
    view = with_fence(view_with(*returns), CIRCLE)
    assert view.hits is not None and view.blurs is not None
    assert len(view.hits) == len(view.blurs) == np.count_nonzero(view.states == OCCUPIED)
    assert (view.blurs > 0.0).sum() == len(returns), "the fence itself is where it is"
    for place in returns:
        assert np.abs(view.hits - np.array(place)).max(axis=1).min() < 1e-12
    centres = view.obstacle_centres()
    assert np.abs(view.hits - centres).max() <= 0.5 * CELL + 1e-9, "each is the one of its cell"


def test_far_from_the_fence_nothing_changes() -> None:
    view = view_with((2.0, 2.0))
    assert with_fence(view, (0.0, 0.0, *CIRCLE[2:6], 100.0)) is view
