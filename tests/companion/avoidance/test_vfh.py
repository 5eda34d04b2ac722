"""VFH+: sides, thresholds, turning circles, openings and costs."""

import math

import numpy as np
import pytest

from companion.avoidance.vfh import SECTORS, Vfh, cheapest, densities, mask
from companion.config_avoidance import AvoidanceVfh
from companion.perception.distance_field import distance_to
from companion.perception.map_view import FREE, OCCUPIED, Bytes, MapView
from protocol.arrays import Array, BoolArray
from protocol.frames import wrap

SETTINGS = AvoidanceVfh(
    window=10.0, enlargement_radius=0.8, low_threshold=0.05, high_threshold=0.1, turning_acceleration=4.0
)
CELL, CELLS = 0.2, 129
HALF = 0.5 * CELL * CELLS
HERE, STILL = np.zeros(3), np.zeros(3)
AHEAD = np.array([50.0, 0.0, 0.0])
STEP = math.radians(5.0)


def view_of(places: Array) -> MapView:
    """Free but for the cells that hold these places (n, 2); the origin is the middle cell's centre."""
    states = np.full((CELLS, CELLS), FREE, np.uint8)
    rows = np.floor((places + HALF) / CELL).astype(int)
    states[tuple(rows.T)] = OCCUPIED
    return MapView(states, distance_to(states == OCCUPIED, CELL), (0, 0), CELL)


def choose(places: Array, goal: Array = AHEAD, velocity: Array = STILL, vfh: Vfh | None = None) -> float | None:
    middle = np.array([HALF, HALF, 0.0])
    return (vfh or Vfh(SETTINGS)).choose(view_of(places), HERE + middle, velocity, goal + middle)


def wall(north: float, east_from: float, east_to: float) -> Array:
    east = np.arange(east_from, east_to, 0.1)
    return np.column_stack([np.full(east.size, north), east])


def density_of(places: Array) -> Array:
    return densities(view_of(places).states, CELL, (HALF, HALF), SETTINGS.window, SETTINGS.enlargement_radius)


def blocked_at(*sectors: int) -> BoolArray:
    result = np.zeros(SECTORS, np.bool_)
    result[list(sectors)] = True
    return result


def test_free_field_leads_to_the_goal() -> None:
    for goal in (AHEAD, np.array([-3.0, 20.0, 0.0]), np.array([1.0, -30.0, 0.0])):
        assert choose(np.empty((0, 2)), goal) == pytest.approx(math.atan2(goal[1], goal[0]))


def test_histogram_of_one_cell_by_hand() -> None:
    """At (3, 3): bearing 45 degrees, enlarged by asin(0.8 / 4.24), weighted with the square of its nearness."""
    density = density_of(np.array([[3.0, 3.0]]))
    distance = math.hypot(3.0, 3.0)
    half = math.asin(0.8 / distance)
    for k in range(SECTORS):
        inside = abs(wrap(k * STEP - math.pi / 4)) <= half
        assert density[k] == pytest.approx(CELL**2 * (1.0 - (distance / 10.0) ** 2) if inside else 0.0)
    assert (density_of(np.array([[7.2, 7.2]])) == 0.0).all()


def test_wall_ahead_is_passed_on_its_shorter_side() -> None:
    left = choose(wall(6.0, -2.0, 5.0))
    right = choose(wall(6.0, -5.0, 2.0))
    assert left is not None and right is not None
    assert left < -math.atan2(2.0, 6.0) and right > math.atan2(2.0, 6.0)


def test_wall_on_the_right_only() -> None:
    """To the goal ahead it keeps off to the left, a goal on the left is free, one behind the wall is not."""
    east = np.arange(-8.0, 8.0, 0.1)
    beside = np.column_stack([east, np.full(east.size, 2.4)])
    ahead = choose(beside)
    assert ahead is not None and -0.8 < ahead < 0.0
    assert choose(beside, np.array([0.0, -30.0, 0.0])) == pytest.approx(-0.5 * math.pi)
    behind = choose(beside, np.array([0.0, 30.0, 0.0]))
    assert behind is not None and math.sin(behind) < math.sin(math.atan2(2.4, 8.0))


def test_closed_in_there_is_no_direction() -> None:
    angle = np.linspace(-math.pi, math.pi, 200)
    assert choose(3.0 * np.column_stack([np.cos(angle), np.sin(angle)])) is None


def test_two_thresholds() -> None:
    """Between them a sector stays what it was."""
    one, few = np.array([[5.0, 0.0]]), wall(5.0, -0.5, 0.5)
    between = density_of(np.array([[5.0, 0.0], [5.2, 0.0]]))[0]
    assert (
        SETTINGS.low_threshold < between < SETTINGS.high_threshold < density_of(few)[0]
        and density_of(one)[0] < SETTINGS.low_threshold
    )
    middle = np.array([[5.0, 0.0], [5.2, 0.0]])
    vfh = Vfh(SETTINGS)
    assert choose(middle, vfh=vfh) == pytest.approx(0.0)
    assert choose(few, vfh=vfh) != pytest.approx(0.0)
    assert choose(middle, vfh=vfh) != pytest.approx(0.0)
    choose(one, vfh=vfh)
    assert abs(choose(middle, vfh=Vfh(SETTINGS)) or 0.0) < 1e-9


def test_turning_circles_mask_what_lies_behind() -> None:
    """Flying north, circles of 4 m: a post to the right, on the right one, blocks right and nothing else."""
    view = view_of(np.array([[4.0, 4.0]]))
    none = np.zeros(SECTORS, np.bool_)

    def masked(turning: float) -> BoolArray:
        return mask(none, view.states, CELL, (HALF, HALF), 10.0, 0.8, (0.0, turning))

    fast = masked(4.0)
    bearings = np.array([wrap(k * STEP) for k in range(SECTORS)])
    assert fast[(bearings > math.pi / 4 + 0.05) & (bearings < 3.1)].all()
    assert not fast[(bearings < math.pi / 4 - 0.05) & (bearings > -3.1)].any()
    assert not masked(0.5).any()


def test_openings() -> None:
    """A narrow one through its middle, a wide one 40 degrees inside its borders or straight at the goal."""
    narrow = ~blocked_at(4, 5, 6, 7, 8)
    assert cheapest(narrow, 0.0, 0.0, 0.0) == pytest.approx(6 * STEP)
    wide = ~blocked_at(*range(10, 41))
    assert cheapest(wide, 0.0, 0.0, 0.0) == pytest.approx(18 * STEP)
    assert cheapest(wide, 20.3 * STEP, 0.0, 0.0) == pytest.approx(20.3 * STEP)
    assert wrap(cheapest(wide, -10 * STEP, 0.0, 0.0) - 18 * STEP) == pytest.approx(0.0)
    across_north = ~blocked_at(70, 71, 0, 1, 2)
    assert cheapest(across_north, 1.0, 0.0, 0.0) == pytest.approx(0.0)
    assert math.isnan(cheapest(np.ones(SECTORS, np.bool_), 0.0, 0.0, 0.0))


def test_costs_weigh_goal_heading_and_previous_choice() -> None:
    """Two equal openings left and right of the goal: the previous choice decides, then the heading; the goal outweighs
    both together."""
    two = ~blocked_at(8, 9, 10, 62, 63, 64)
    assert cheapest(two, 0.0, 0.0, 0.2) == pytest.approx(9 * STEP)
    assert cheapest(two, 0.0, 0.0, -0.2) == pytest.approx(-9 * STEP)
    assert cheapest(two, 0.0, 0.2, 0.0) == pytest.approx(9 * STEP)
    assert cheapest(two, 0.3, -0.3, -0.3) == pytest.approx(9 * STEP)


def test_mirror_and_rotation() -> None:
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(60):
        places = (rng.integers(-40, 41, (14, 2)) * CELL).astype(np.float64)
        places = places[np.hypot(*places.T) > 1.2]
        goal, velocity = rng.uniform(-20.0, 20.0, 2), rng.uniform(-2.0, 2.0, 2)
        expected = choose(places, np.append(goal, 0.0), np.append(velocity, 0.0))
        flip = np.array([1.0, -1.0])
        mirrored = choose(places * flip, np.append(goal * flip, 0.0), np.append(velocity * flip, 0.0))

        def quarter(v: Array) -> Array:
            return np.stack([-v[..., 1], v[..., 0]], axis=-1)

        turned = choose(quarter(places), np.append(quarter(goal), 0.0), np.append(quarter(velocity), 0.0))
        if expected is None:
            assert mirrored is None and turned is None
            continue
        found += 1
        assert mirrored is not None and turned is not None
        assert abs(wrap(mirrored + expected)) < 1e-9 and abs(wrap(turned - expected - math.pi / 2)) < 1e-9
    assert found > 30


def test_from_within_the_radius_it_may_leave() -> None:
    course = choose(wall(0.5, -0.3, 0.3))
    assert course is not None and math.cos(course) <= 0.0


def test_states_are_left_as_they_are() -> None:
    view = view_of(wall(6.0, -2.0, 2.0))
    before: Bytes = view.states.copy()
    Vfh(SETTINGS).choose(view, np.array([HALF, HALF, 0.0]), STILL, AHEAD)
    assert np.array_equal(view.states, before)
