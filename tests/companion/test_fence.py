"""The fence: a convex region around home, and references that keep inside of it."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from companion.config_limits import Geofence
from companion.fence import Fence, fence_of
from companion.state import OwnFence
from protocol.arrays import Array

HOME = np.array([3.0, -4.0, 0.5])
SIZES = st.floats(5.0, 200.0)
OFFSETS = st.tuples(*[st.floats(-400.0, 400.0)] * 3).map(np.array)


@st.composite
def fences(draw: st.DrawFn) -> Fence:
    def sometimes(strategy: st.SearchStrategy[float]) -> float | None:
        return draw(st.none() | strategy)

    def bounds() -> tuple[float, float] | None:
        return draw(st.none() | st.tuples(SIZES.map(lambda size: -size), SIZES))

    settings = Geofence(
        radius=sometimes(SIZES), north=bounds(), east=bounds(), max_height=sometimes(st.floats(3.0, 100.0))
    )
    assume(settings.bounded)
    fence = fence_of(settings, HOME)
    assert fence is not None
    return fence


OWN = st.builds(
    OwnFence,
    radius=st.just(math.inf) | st.floats(1.0, 300.0),
    max_height=st.just(math.inf) | st.floats(1.0, 150.0),
    margin=st.floats(0.0, 5.0),
)


@given(OWN, OFFSETS, st.floats(5.0, 200.0) | st.none(), st.floats(0.5, 4.0))
def test_with_the_vehicle_s_own_fence_each_keeps_its_margin(
    own: OwnFence, offset: Array, radius: float | None, margin: float
) -> None:
    """What is left after the settings' margin is within both fences, each shrunk by the margin that it wants."""
    settings = Geofence(radius=radius, margin=margin)
    fence = fence_of(settings, HOME, own)
    if fence is None:
        assert radius is None and math.isinf(own.radius) and math.isinf(own.max_height)
        return
    place = HOME + offset
    wanted = max(margin, own.margin)
    away, height = math.hypot(*offset[:2]), -offset[2]
    inside = away <= own.radius - wanted and height <= own.max_height - wanted
    inside = inside and (radius is None or away <= radius - margin)
    room = fence.shrunk(margin).room(place)
    assert (room >= 0.0) == bool(inside) or abs(room) < 1e-9


@pytest.mark.parametrize("margin", [0.5, 3.0])
def test_at_the_vehicle_s_own_edges_the_wider_margin_counts(margin: float) -> None:
    """Places drawn at random are seldom within a margin of an edge."""
    fence = fence_of(Geofence(margin=margin), HOME, OwnFence(radius=30.0, max_height=20.0, margin=2.0))
    assert fence is not None
    left, wanted = fence.shrunk(margin), max(margin, 2.0)
    for offset in ((30.0 - wanted, 0.0, -5.0), (0.0, 5.0, wanted - 20.0)):
        assert left.room(HOME + offset) == pytest.approx(0.0, abs=1e-9)


def test_the_least_height_counts_where_it_is_asked_for() -> None:
    own = OwnFence(min_height=4.0, margin=2.0)
    for floor, rooms in ((False, (math.inf, math.inf)), (True, (-2.0, 5.0))):
        fence = fence_of(Geofence(margin=1.0), HOME, own, floor=floor)
        assert fence is not None
        found = [fence.shrunk(1.0).room(HOME - (0.0, 0.0, height)) for height in (4.0, 11.0)]
        assert found == pytest.approx(rooms)


def test_without_bounds_there_is_no_fence() -> None:
    assert fence_of(Geofence(), HOME) is None


@pytest.mark.parametrize(
    ("place", "room"),
    [
        ((0.0, 0.0, -2.0), 8.0),
        ((45.0, 0.0, -5.0), 5.0),
        ((52.0, 0.0, -5.0), -2.0),
        ((30.0, 20.0, -5.0), 5.0 - 1e-9),
        ((0.0, 26.0, -5.0), -1.0),
        ((0.0, 0.0, -11.5), -1.5),
    ],
)
def test_the_room_is_the_distance_to_the_nearest_side(place: tuple[float, float, float], room: float) -> None:
    fence = fence_of(Geofence(radius=50.0, east=(-25.0, 25.0), max_height=10.0), HOME)
    assert fence is not None and fence.room(HOME + np.array(place)) == pytest.approx(room, abs=1e-6)


@given(fences(), OFFSETS)
def test_the_nearest_place_is_inside_and_what_is_inside_stays(fence: Fence, offset: Array) -> None:
    place = HOME + offset
    nearest = fence.nearest(place)
    assert fence.room(nearest) >= -1e-9
    if fence.room(place) >= 0.0:
        assert nearest is place


@given(fences(), OFFSETS, OFFSETS, st.floats(0.0, 1.0))
def test_the_straight_way_between_two_places_inside_is_inside(
    fence: Fence, one: Array, other: Array, share: float
) -> None:
    start, end = fence.nearest(HOME + one), fence.nearest(HOME + other)
    assert fence.room(start + share * (end - start)) >= -1e-9


@given(fences(), OFFSETS, st.lists(st.floats(-20.0, 20.0), min_size=12, max_size=12))
def test_a_reference_is_kept_inside_and_does_not_push_out(fence: Fence, offset: Array, motion: list[float]) -> None:
    rows = np.zeros((6, 3))
    rows[0] = HOME + offset
    rows[1:5] = np.array(motion).reshape(4, 3)
    before = rows.copy()
    fence.keep(rows)
    assert fence.room(rows[0]) >= -1e-9
    if fence.room(before[0]) >= 0.0:
        assert np.array_equal(rows, before)
    else:
        assert fence.room(rows[0] + 1e-6 * rows[1]) >= -1e-9


@pytest.mark.parametrize("settings", [Geofence(radius=20.0), Geofence(north=(-20.0, 20.0))], ids=["circle", "box"])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("out", "kept"), [(-2.0, -2.0), (2.0, 0.0)])
def test_a_reference_beyond_the_fence_keeps_what_leads_back_and_along(
    settings: Geofence, side: float, out: float, kept: float
) -> None:
    fence, rows = fence_of(settings, HOME), np.zeros((6, 3))
    assert fence is not None
    rows[0], rows[1] = np.add(HOME, (25.0 * side, 0.0, 0.0)), (out * side, 1.5, 0.0)
    fence.keep(rows)
    assert rows[:2] == pytest.approx(np.array([np.add(HOME, (20.0 * side, 0.0, 0.0)), (kept * side, 1.5, 0.0)]))


@given(fences(), OFFSETS, st.floats(0.0, 2.0 * math.pi), st.floats(0.5, 15.0))
def test_a_slowed_velocity_can_stop_before_each_side(fence: Fence, offset: Array, bearing: float, speed: float) -> None:
    place = fence.nearest(HOME + offset)
    wanted = speed * np.array((math.cos(bearing), math.sin(bearing)))
    slowed = fence.slowed(place, wanted)
    for out, room in fence._sides(place):
        towards = float(slowed @ out)
        assert (
            towards <= max(float(wanted @ out), 0.0) + speed * 1e-9 or towards**2 <= 2.0 * fence.braking * room + 1e-6
        )
    middle = np.array((*HOME[:2], place[2]))
    assert np.array_equal(fence.slowed(middle, 1e-3 * wanted), 1e-3 * wanted), "far from it nothing is changed"


def test_what_is_shrunk_is_within() -> None:
    fence = fence_of(Geofence(radius=50.0, north=(-30.0, 60.0), max_height=10.0), HOME)
    assert fence is not None
    place = fence.shrunk(2.0).nearest(HOME + np.array((100.0, 50.0, -30.0)))
    assert fence.room(place) == pytest.approx(2.0)


@pytest.mark.parametrize(
    "bad", [{"radius": 0.5}, {"north": (5.0, 9.0)}, {"east": (-9.0, 0.5)}, {"max_height": 1.0}, {"north": (0.0, 9.0)}]
)
def test_a_fence_that_does_not_hold_the_take_off_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        Geofence(**bad)  # type: ignore[arg-type]
