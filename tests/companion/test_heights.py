"""The order in which heights are tried, and what they are left for."""

import math

from hypothesis import given
from hypothesis import strategies as st

from companion.avoidance.heights import Heights
from companion.config import AvoidanceHeights

SECOND = 1_000_000_000


def tried(settings: AvoidanceHeights, room_below: float = 10.0) -> list[float]:
    heights = Heights(settings)
    found = []
    while heights.next(room_below):
        found.append(heights.above)
    return found


def test_up_first_then_down_and_the_routes_own_in_the_end() -> None:
    assert tried(AvoidanceHeights(above=4.5, below=2.0, step=2.0)) == [2.0, 4.0, -2.0, 0.0]


def test_none_is_tried_unless_allowed() -> None:
    assert tried(AvoidanceHeights()) == []
    heights = Heights(AvoidanceHeights())
    assert not heights.next(10.0)
    assert not any(heights.too_dear(math.inf, k * SECOND) for k in range(10))


@given(above=st.floats(0.0, 20.0), below=st.floats(0.0, 20.0), step=st.floats(0.5, 5.0), room=st.floats(-5.0, 20.0))
def test_never_beyond_what_is_allowed_nor_too_low(above: float, below: float, step: float, room: float) -> None:
    settings = AvoidanceHeights(above=above, below=below, step=step)
    assert all(-min(below, max(room, 0.0)) - 1e-6 <= height <= above + 1e-6 for height in tried(settings, room))


def test_a_height_is_left_only_if_its_way_was_dear_for_a_while() -> None:
    settings = AvoidanceHeights(above=4.0, step=2.0, price=5.0, patience=1.0)
    heights = Heights(settings)
    assert not any(heights.too_dear(9.9, k * SECOND) for k in range(9))
    assert not heights.too_dear(10.1, 10 * SECOND)
    assert not heights.too_dear(3.0, 11 * SECOND)  # a look that was better
    assert not heights.too_dear(10.1, 12 * SECOND)
    assert heights.too_dear(math.inf, 13 * SECOND)


def test_nothing_is_judged_on_the_way_to_a_height() -> None:
    heights = Heights(AvoidanceHeights(above=2.0))
    assert heights.next(5.0) and heights.changing
    assert not any(heights.too_dear(math.inf, k * SECOND) for k in range(5))
    heights.arrived(0.5)
    assert heights.changing
    heights.arrived(-0.1)
    assert not heights.changing
    heights.begin()
    assert heights.above == 0.0 and heights.next(5.0)
