"""The fence in the map: an occupied band along its outside, and nothing else changed."""

import math

import msgspec
import numpy as np
import pytest

from companion.config_avoidance import Avoidance, AvoidancePlan
from companion.config_limits import Geofence
from companion.fence import fence_of
from companion.perception.distance_field import FAR_M, fill_distances_to_returns
from companion.perception.fence_band import Flat, Walls, with_fence
from companion.perception.map_view import FREE, OCCUPIED, MapView

CELL = 0.25
PLAN = AvoidancePlan()
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
    view = with_fence(view_with(), fence, PLAN)
    for row in range(0, view.states.shape[0], 3):
        for column in range(0, view.states.shape[1], 3):
            north, east = view.centre_of((row, column)).tolist()
            out = beyond((north, east), fence)
            assert bool(view.states[row, column] == OCCUPIED) is (0.0 < out < 4.0 * CELL)


@pytest.mark.parametrize("fence", [CIRCLE, BOX])
def test_the_distances_are_those_to_the_fence(fence: Flat) -> None:
    view = with_fence(view_with(), fence, PLAN)
    for place in [(0.0, 0.0), (3.0, 1.0), (-4.0, -3.0), (5.0, 2.0)]:
        room = -beyond(place, fence)
        found = view.distance_at(np.array(place))
        assert found is not None and found == pytest.approx(min(room, FAR_M), abs=1.5 * CELL)


@pytest.mark.parametrize("fence", [CIRCLE, BOX])
def test_no_tight_path_leads_where_the_others_do_not(fence: Flat) -> None:
    """The reference does not go there: it would pull the vehicle off the way, into what it passes."""
    to_fence = with_fence(view_with(), fence, PLAN).to_occupied
    assert ((to_fence > 0.0) & (to_fence < PLAN.tight_inflation)).any()
    assert not ((to_fence >= PLAN.tight_inflation) & (to_fence < PLAN.inflation)).any()


def test_returns_inside_keep_their_places() -> None:
    returns = [(2.06, 1.03), (-3.2, -2.9), (4.9, 0.1)]
    view = with_fence(view_with(*returns), CIRCLE, PLAN)
    assert view.hits is not None and view.blurs is not None
    assert len(view.hits) == len(view.blurs) == np.count_nonzero(view.states == OCCUPIED)
    assert (view.blurs > 0.0).sum() == len(returns), "the fence itself is where it is"
    for place in returns:
        assert np.abs(view.hits - np.array(place)).max(axis=1).min() < 1e-12
    centres = view.obstacle_centres()
    assert np.abs(view.hits - centres).max() <= 0.5 * CELL + 1e-9, "each is the one of its cell"


def test_far_from_the_fence_nothing_changes() -> None:
    view = view_with((2.0, 2.0))
    assert with_fence(view, (0.0, 0.0, *CIRCLE[2:6], 100.0), PLAN) is view


@pytest.mark.parametrize("fence", [CIRCLE, BOX])
def test_the_distances_to_obstacles_keep_their_margin(fence: Flat) -> None:
    """Obstacles that are taken for larger than their returns stay as large."""
    view, alone = view_with((2.06, 1.03), (-3.2, -2.9)), with_fence(view_with(), fence, PLAN).to_occupied.copy()
    view.to_occupied[:] = np.maximum(view.to_occupied - np.float32(0.3), 0.0)
    before = view.to_occupied.copy()
    after = with_fence(view, fence, PLAN).to_occupied
    assert np.array_equal(after, np.minimum(before, alone))
    assert (after < before).any() and (after < alone).any()


# -- where it stands in the map ----------------------------------------------------------------------------------------

AVOIDANCE = Avoidance()


def walls_of(**settings: object) -> Walls:
    fence = fence_of(Geofence(**settings), np.array([1.0, -2.0, 0.5]))  # type: ignore[arg-type]
    assert fence is not None
    return Walls(fence, AVOIDANCE)


@pytest.mark.parametrize("settings", [{"radius": 20.0}, {"north": (-20.0, 20.0)}, {"east": (-20.0, 20.0)}])
def test_the_walls_stand_until_the_vehicle_is_in_them_and_again_once_it_is_clear(settings: dict[str, object]) -> None:
    """They are the inflation and 0.1 m outside; between the two places nothing changes."""
    walls = walls_of(**settings)
    out = np.array((0.0, 1.0, 0.0) if "east" in settings else (1.0, 0.0, 0.0))
    for away, stands in (
        (0.0, True),
        (20.3, True),
        (20.55, True),
        (20.6, False),
        (20.5, False),
        (35.0, False),
        (20.46, False),
        (20.44, True),
        (20.55, True),
    ):
        flat = walls.around(np.array([1.0, -2.0, -3.0]) + away * out)
        assert (flat is not None) is stands, away
        assert flat is None or min(abs(value - 20.7) for value in (flat[6], flat[3] - 1.0, flat[5] + 2.0)) < 1e-9


def test_above_the_fence_its_walls_stand() -> None:
    for settings in ({"radius": 20.0, "max_height": 10.0}, {"max_height": 10.0}):
        assert walls_of(**settings).around(np.array([0.0, 0.0, -30.0])) is not None


def test_with_cells_larger_than_the_inflation_the_walls_come_back_at_the_fence() -> None:
    fence = fence_of(Geofence(radius=20.0), np.zeros(3))
    assert fence is not None
    coarse = msgspec.structs.replace(AVOIDANCE.map, cell=0.5)
    plan = msgspec.structs.replace(AVOIDANCE.plan, inflation=0.3, tight_inflation=0.3)
    walls = Walls(fence, msgspec.structs.replace(AVOIDANCE, map=coarse, plan=plan))
    for away, stands in ((19.0, True), (20.3, False), (20.01, False), (19.99, True), (20.1, True)):
        assert (walls.around(np.array([away, 0.0, -3.0])) is not None) is stands, away
