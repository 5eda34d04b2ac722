"""The motion along a way, the way over a map, and the trail back."""

import dataclasses
import math

import numpy as np
import pytest

from companion.avoidance.astar import GridPath
from companion.avoidance.astar_planner import _up_to_unconfirmed
from companion.avoidance.path import NO_PATH, Path
from companion.avoidance.planner import Planner
from companion.avoidance.steering import Course, approached, limited, steer
from companion.config import Trajectory
from companion.config_avoidance import Avoidance, AvoidanceCourse, AvoidanceGuard, AvoidanceMap
from companion.mission.stall import Progress, Trail
from companion.perception.distance_field import FAR_M, distance_to
from companion.perception.map_view import FREE, OCCUPIED, MapView
from companion.state import Reference
from protocol.arrays import Array

SETTINGS = AvoidanceCourse()
ON_A_MAP = Avoidance(method="astar", map=AvoidanceMap(cell=0.2, cells=256))
TICK_NS = 4_000_000
BRAKING = 3.5
LAG_S = 0.15
FLOWN, AT_ONCE = (
    Avoidance(course=AvoidanceCourse(braking=BRAKING), guard=AvoidanceGuard(lag_s=lag_s)) for lag_s in (LAG_S, 0.0)
)
AHEAD = np.array([[0.0, 0.0], [30.0, 0.0]])


def at(course: Course, time_ns: int) -> Array:
    """(3, 2) position, velocity and acceleration."""
    rows = np.full((6, 3), np.nan)
    reference = course.put(time_ns, Reference(rows))
    assert reference.rows is rows and reference.tied
    assert not rows[3:5, :2].any() and np.isnan(rows[:, 2]).all() and np.isnan(rows[5]).all()
    motion: Array = rows[:3, :2]
    return motion


def flown(ticks: int, wanted: Array) -> list[Array]:
    """The course's motions; the vehicle follows without error."""
    course = Course(SETTINGS)
    course.start(0, np.zeros(3), np.zeros(3), np.zeros(3))
    motions = []
    for tick in range(1, ticks + 1):
        course.advance(tick * TICK_NS, wanted, np.zeros(2), at(course, (tick - 1) * TICK_NS)[0])
        motions.append(at(course, tick * TICK_NS))
    return motions


def test_a_course_takes_a_velocity_up_within_its_limits() -> None:
    wanted = np.array([4.0, -3.0])
    motions = np.array(flown(1000, wanted))
    acceleration = np.linalg.norm(motions[:, 2], axis=1)
    jerk = np.linalg.norm(np.diff(motions[:, 2], axis=0), axis=1) / 0.004
    assert acceleration.max() == pytest.approx(SETTINGS.acceleration)
    assert jerk.max() <= SETTINGS.jerk + 1e-6
    assert motions[-1, 1] == pytest.approx(wanted, abs=1e-2)
    assert np.diff(motions[:, 0], axis=0) / 0.004 == pytest.approx(motions[:-1, 1], abs=0.02)


def test_a_course_makes_no_leap_after_a_pause() -> None:
    course, velocity = Course(SETTINGS), np.array([4.0, 0.0])
    course.start(0, np.zeros(2), velocity, np.zeros(2))
    course.advance(1_000_000_000, np.zeros(2), np.zeros(2), np.zeros(2))
    after = at(course, 1_000_000_000)[1]
    assert 0.0 < velocity[0] - after[0] <= 0.05 * 0.05 * SETTINGS.jerk + 1e-9


@pytest.mark.parametrize(("end", "flies_to_end"), [(9.75, False), (9.3, True)])
def test_a_goal_is_flown_to_where_the_path_ends_beside_it(end: float, flies_to_end: bool) -> None:
    """One that is nearer to an obstacle than the inflation, but none that is in it."""
    path, goal = Path(np.array([[0.0, 0.0], [end, 0.0]]), np.zeros(2)), np.array([10.0, 0.0])
    reached = approached(path, np.array([9.1, 0.0]), goal, ON_A_MAP)
    assert reached.tolist() == ([end, 0.0] if flies_to_end else [10.0, 0.0])
    assert approached(path, np.array([8.9, 0.0]), goal, ON_A_MAP) is goal, "from farther away"


def test_a_course_waits_for_the_vehicle_and_gives_in_to_the_guard() -> None:
    course = Course(SETTINGS)
    course.start(0, np.zeros(2), np.zeros(2), np.zeros(2))
    for tick in range(1, 500):
        course.advance(tick * TICK_NS, np.array([5.0, 0.0]), np.zeros(2), np.zeros(2))
    place, velocity, _ = at(course, 499 * TICK_NS)
    assert place == pytest.approx([SETTINGS.max_lead, 0.0]) and velocity[0] > 4.0
    for tick in range(500, 625):
        course.advance(tick * TICK_NS, np.zeros(2), np.zeros(2), np.zeros(2))
        course.yield_to(np.zeros(2), np.zeros(2), np.zeros(2))
    assert np.abs(at(course, 624 * TICK_NS)).max() < 0.05


def test_after_an_emergency_the_reference_does_not_go_on_backwards() -> None:
    """The guard asks for 30 m/s2 for 0.4 s, of which the reference takes over what it may; then it hovers."""
    course, backwards = Course(SETTINGS), []
    course.start(0, np.zeros(2), np.array([4.0, 0.0]), np.zeros(2))
    for tick in range(1, 400):
        speed = max(4.0 - 10.0 * tick * 0.004, 0.0)
        course.advance(tick * TICK_NS, np.zeros(2), np.zeros(2), np.zeros(2))
        if speed > 0.0:
            allowed = limited(np.array([-30.0, 0.0]), SETTINGS.max_yield)
            course.yield_to(np.zeros(2), np.array([speed, 0.0]), allowed)
        backwards.append(at(course, tick * TICK_NS)[1, 0])
    assert min(backwards) > -0.2 and abs(backwards[-1]) < 0.05


def test_a_wish_keeps_to_the_way_and_slows_down_before_a_corner() -> None:
    vertices = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 20.0]])
    path = Path(vertices, np.array([6.0, 2.0, 0.0]))
    velocity = np.zeros(2)
    far = steer(path, np.array([1.0, 0.5]), velocity, vertices[-1], 6.0, FLOWN)
    assert np.linalg.norm(far.velocity) == pytest.approx(6.0) and far.velocity[1] < 0.0  # back to the line
    near = steer(path, np.array([9.5, 0.0]), velocity, vertices[-1], 6.0, FLOWN)
    assert np.linalg.norm(near.velocity) == pytest.approx(math.sqrt(4.0 + 2.0 * BRAKING * 0.5))
    assert near.velocity[1] > 0.0  # looks round the corner
    assert far.path[-1] == pytest.approx(vertices[-1]) and len(far.path) == 3 and len(near.path) == 2
    onward = steer(path, np.array([7.0, 0.0]), np.array([5.0, 0.0]), vertices[-1], 6.0, FLOWN)
    left = 3.0 - 0.1 * 5.0  # it brakes a tenth of a second later
    assert np.linalg.norm(onward.velocity) == pytest.approx(math.sqrt(4.0 + 2.0 * BRAKING * left))
    beside = steer(path, np.array([10.0, 19.6]), velocity, vertices[-1], 6.0, FLOWN)
    assert beside.velocity == pytest.approx([0.0, 0.6])


def circle(radius: float, side: int) -> Path:
    """A quarter of one and more, a point each metre, to the right (1) or left (-1) from north; at 6 m/s."""
    angles = np.arange(0.0, 25.0) / radius
    points = radius * np.column_stack((np.sin(angles), side * (1.0 - np.cos(angles))))
    return Path(points, np.full(len(points), 6.0), smooth=True)


@pytest.mark.parametrize("side", [1, -1])
def test_on_a_curve_the_acceleration_is_the_centripetal_one_of_where_the_vehicle_will_be(side: int) -> None:
    radius, speed = 12.0, 6.0
    path, goal = circle(radius, side), np.array([100.0, 0.0])

    def at_angle(angle: float) -> tuple[Array, Array, Array]:
        """Place, tangent and the direction of the centre."""
        place = radius * np.array([math.sin(angle), side * (1.0 - math.cos(angle))])
        tangent = np.array([math.cos(angle), side * math.sin(angle)])
        return place, tangent, np.array([-math.sin(angle), side * math.cos(angle)])

    angle = 8.0 / radius
    place, tangent, inward = at_angle(angle)
    _, _, soon_inward = at_angle(angle + LAG_S * speed / radius)
    steered = steer(path, place, speed * tangent, goal, speed, FLOWN)
    assert steered.acceleration == pytest.approx(speed**2 / radius * soon_inward, abs=0.05)
    assert steered.velocity == pytest.approx(speed * tangent, abs=0.1)
    assert math.dist(steered.path[0], place) == pytest.approx(0.35 * speed, abs=0.05)
    outside = steer(path, place - 0.5 * inward, speed * tangent, goal, speed, FLOWN)
    assert outside.velocity @ inward == pytest.approx(speed * math.sin(math.atan(0.5 / (0.35 * speed))), abs=0.1)


def test_on_a_curve_that_slows_down_the_vehicle_brakes_once_it_is_about_as_fast() -> None:
    points, speeds = (
        np.column_stack((np.arange(21.0), np.zeros(21))),
        np.sqrt(2.0 * BRAKING * np.arange(20.0, -1.0, -1)),
    )
    path = Path(points, speeds, smooth=True)
    here, goal = np.array([5.0, 0.0]), points[-1]
    fast = math.sqrt(2.0 * BRAKING * 15.0)
    steered = steer(path, here, np.array([fast, 0.0]), goal, 20.0, AT_ONCE)
    assert steered.velocity == pytest.approx([fast, 0.0]) and steered.acceleration == pytest.approx([-BRAKING, 0.0])
    late = steer(path, here, np.array([fast, 0.0]), goal, 20.0, FLOWN)
    assert late.velocity == pytest.approx([fast, 0.0]), "of where it is"
    soon = steer(path, here - [1.0, 0.0], np.array([fast, 0.0]), goal, fast, FLOWN)
    below = math.sqrt(2.0 * BRAKING * 16.0) - fast
    assert soon.acceleration == pytest.approx([-BRAKING * (1.0 - below / 1.5), 0.0]), "of where it will be"
    assert not steer(path, here - [1.0, 0.0], np.array([fast, 0.0]), goal, fast, AT_ONCE).acceleration.any()
    slow = steer(path, here, np.array([fast - 0.75, 0.0]), goal, 20.0, AT_ONCE)
    assert slow.acceleration == pytest.approx([-0.5 * BRAKING, 0.0])
    assert not steer(path, here, np.array([2.0, 0.0]), goal, 20.0, AT_ONCE).acceleration.any()
    assert not steer(path, here, np.array([fast, 0.0]), goal, 5.0, AT_ONCE).acceleration.any(), "not its limit"


def test_a_vehicle_that_follows_late_keeps_to_a_curve_but_not_to_its_vertices() -> None:
    """5 m/s2 of lateral acceleration, taken up with a lag of 0.15 s: within 5 cm, where one that flies to vertices one
    after the other is let out by five times that."""
    radius, speed = 12.0, math.sqrt(60.0)

    def farthest_off(path: Path) -> float:
        course, place, velocity = Course(SETTINGS), np.zeros(2), np.array([speed, 0.0])
        acceleration = np.array([0.0, 5.0])
        course.start(0, place, velocity, acceleration)
        off, tick = 0.0, 0
        while place[1] < 9.0:
            tick += 1
            steered = steer(path, place, velocity, np.array([100.0, 0.0]), speed, FLOWN)
            course.advance(tick * TICK_NS, steered.velocity, steered.acceleration, place)
            wanted = at(course, tick * TICK_NS)
            asked = wanted[2] + 3.0 * (wanted[1] - velocity)
            acceleration = acceleration + 0.004 / LAG_S * (asked - acceleration)
            velocity = velocity + 0.004 * acceleration
            place = place + 0.004 * velocity
            off = max(off, abs(math.dist(place, (0.0, radius)) - radius))
        return off

    curve = circle(radius, 1)
    fast = Path(curve.vertices, np.full(len(curve.vertices), speed), smooth=True)
    assert farthest_off(fast) < 0.05
    assert farthest_off(Path(fast.vertices, fast.speeds)) > 0.25


def test_a_bearing_across_the_motion_is_taken_slowly_and_none_is_a_stop() -> None:
    east = Path(NO_PATH.vertices, NO_PATH.speeds, 0.5 * math.pi)
    goal = np.array([0.0, 50.0])
    straight = steer(east, np.zeros(2), np.array([0.0, 5.0]), goal, 5.0, FLOWN)
    across = steer(east, np.zeros(2), np.array([5.0, 0.0]), goal, 5.0, FLOWN)
    assert straight.velocity == pytest.approx([0.0, 5.0], abs=1e-9)
    assert across.velocity == pytest.approx([0.0, 1.0], abs=1e-9)
    aslant = steer(east, np.zeros(2), 5.0 * np.array([math.sin(1.0), math.cos(1.0)]), goal, 5.0, FLOWN)
    assert aslant.velocity == pytest.approx([0.0, 5.0 * math.cos(1.0) ** 2], abs=1e-9)
    assert not steer(NO_PATH, np.zeros(2), np.zeros(2), goal, 5.0, FLOWN).velocity.any()


def test_what_may_be_a_gap_is_looked_at_from_a_little_before_it() -> None:
    """A path down the middle of a funnel: it ends where there is still a little more than the room that is needed; in a
    passage without such room it ends half a metre before it is too narrow."""
    room = 0.38
    near = np.full((64, 64), np.float32(FAR_M))
    near[:, 32] = np.maximum(1.5 - 0.06 * np.arange(64), 0.0)
    view = MapView(np.full((64, 64), FREE, np.uint8), near, (0, 0), 0.2)
    cells = np.column_stack([np.arange(64), np.full(64, 32)])
    path = _up_to_unconfirmed(GridPath(cells, 0.2 * np.arange(64.0), 12.6, 0.0), view, room)
    rows = path.cells[:, 0]
    assert not path.complete and (rows == np.arange(len(rows))).all() and len(path.costs) == len(rows)
    assert near[rows[-1], 32] >= room + 0.08 > near[rows[-1] + 1, 32]
    near[:30, 32], near[30:, 32] = 0.42, 0.3
    path = _up_to_unconfirmed(GridPath(cells, 0.2 * np.arange(64.0), 12.6, 0.0), view, room)
    assert 0.2 * path.cells[-1, 0] == pytest.approx(0.2 * 30 - 0.5, abs=0.2)


def view_with(*walls: tuple[slice, slice]) -> MapView:
    """A free window of 51.2 m around the origin with walls (in cells of 0.2 m)."""
    states = np.full((256, 256), FREE, np.uint8)
    for rows, columns in walls:
        states[rows, columns] = OCCUPIED
    return MapView(states, distance_to(states == OCCUPIED, 0.2), (-128, -128), 0.2)


@pytest.mark.parametrize("side", [1, -1])
def test_the_way_leads_round_the_open_end_of_a_wall(side: int) -> None:
    """A wall 4 m ahead that reaches far to one side; mirrored, the way is mirrored."""
    columns = slice(0, 138) if side > 0 else slice(118, 256)
    view = view_with((slice(148, 150), columns))
    planner = Planner(ON_A_MAP)
    here, goal = np.array([0.0, 0.0, -3.0]), np.array([10.0, 0.0, -3.0])
    path = planner.path(view, here, np.zeros(3), goal, 5.0)
    assert path.bearing is None and planner.blocked(view, here, goal)
    assert path.vertices[0] == pytest.approx(here[:2]) and path.vertices[-1] == pytest.approx(goal[:2])
    assert (side * path.vertices[:, 1]).max() > 2.0 and path.speeds[-1] == 0.0
    for start, end in zip(path.vertices[:-1], path.vertices[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 200):
            place = start + share * (end - start)
            assert view.to_occupied[view.cell_of(place)] >= Avoidance().plan.inflation - 0.2


def test_vfh_steers_where_there_is_no_way() -> None:
    """A ring of wall at 6 m has no way out; both methods still answer, and only "astar" plans in the open."""
    open_view = view_with()
    here, goal = np.array([0.0, 0.0, -3.0]), np.array([20.0, 0.0, -3.0])
    assert Planner(Avoidance(method="vfh")).path(open_view, here, np.zeros(3), goal, 5.0).bearing == pytest.approx(0.0)
    straight = Planner(ON_A_MAP).path(open_view, here, np.zeros(3), goal, 5.0)
    assert straight.bearing is None and len(straight.vertices) == 2
    offset = np.hypot(*np.meshgrid(np.arange(256) - 128, np.arange(256) - 128))
    states = np.where(np.abs(offset - 48.0) < 2.0, OCCUPIED, FREE).astype(np.uint8)
    closed = MapView(states, distance_to(states == OCCUPIED, 0.2), (-128, -128), 0.2)
    assert not len(Planner(ON_A_MAP).path(closed, here, np.zeros(3), goal, 5.0).vertices)


def test_the_trail_leads_back_without_its_loops() -> None:
    trail = Trail(5.0, Trajectory())
    loop = [(0, 0), (10, 0), (20, 0), (20, 10), (10, 10), (10, 1), (10, -10)]
    for north, east in loop:
        trail.add(np.array([north, east, -3.0]), 5.0, 0)
    assert [place[:2].tolist() for place in trail.back()] == [[10, -10], [10, 0], [0, 0]]


def test_progress_is_a_metre_nearer_than_ever() -> None:
    progress, here, second = Progress(), np.array([1.0, 1.0, -3.0]), 1_000_000_000
    assert progress.stalled_s(1, 50.0, here, 0) == 0.0
    assert progress.stalled_s(1, 60.0, here, 10 * second) == 10.0
    assert progress.stalled_s(1, 49.5, here, 20 * second) == 20.0
    assert progress.stalled_s(1, 48.0, here, 30 * second) == 0.0
    assert progress.stalled_s(1, 48.0, here, 35 * second) == 5.0
    assert progress.stalled_s(2, 90.0, here, 40 * second) == 0.0


def test_a_new_place_is_progress_once() -> None:
    """A way round leads away from the goal; to and fro between two places leads nowhere."""
    progress, second = Progress(), 1_000_000_000
    for k in range(6):
        assert progress.stalled_s(1, 50.0 + k, np.array([1.0 - 2.0 * k, 1.0, -3.0]), 10 * k * second) == 0.0
    for k in range(6):
        assert progress.stalled_s(1, 55.0, np.array([1.0 - 2.0 * (k % 2), 1.0, -3.0]), (50 + k) * second) == float(k)


def gap_view(width_cells: int, *, certain: bool) -> MapView:
    """A wall across the whole window 4 m ahead with a gap of so many cells of 0.2 m, dead ahead."""
    half = width_cells // 2
    view = view_with((slice(148, 150), slice(0, 128 - half)), (slice(148, 150), slice(128 - half + width_cells, 256)))
    return (
        view if certain else dataclasses.replace(view, blurs=np.full(np.count_nonzero(view.states == OCCUPIED), np.inf))
    )


@pytest.mark.parametrize(("door_m", "tight"), [(3.0, False), (20.0, True)])
def test_a_tight_way_is_taken_instead_of_a_long_way_round(door_m: float, tight: bool) -> None:
    """A gap of 0.8 m dead ahead, and a door 2 m wide so far to the right."""
    here, goal = np.array([0.1, 0.1, -3.0]), np.array([10.0, 0.1, -3.0])
    door = 128 + round(door_m / 0.2)
    walls = [(slice(148, 150), slice(*span)) for span in ((0, 126), (130, door - 5), (door + 5, 256))]
    view = view_with(*walls)
    path = Planner(ON_A_MAP).path(view, here, np.zeros(3), goal, 5.0)
    assert path.tight == tight
    assert (max(path.vertices[:, 1]) > door_m - 1.0) == (not tight)


def test_a_tight_way_is_taken_where_there_is_no_other() -> None:
    here, goal = np.array([0.1, 0.1, -3.0]), np.array([10.0, 0.1, -3.0])
    planner = Planner(ON_A_MAP)
    wide = planner.path(gap_view(9, certain=True), here, np.zeros(3), goal, 5.0)
    assert not wide.tight and wide.vertices[-1] == pytest.approx(goal[:2])
    tight = planner.path(gap_view(4, certain=True), here, np.zeros(3), goal, 5.0)
    assert tight.tight and tight.vertices[-1] == pytest.approx(goal[:2])
    assert not len(planner.path(gap_view(2, certain=True), here, np.zeros(3), goal, 5.0).vertices)


def test_what_may_be_a_gap_is_gone_and_looked_at() -> None:
    """A wall that was seen from afar alone: the vehicle is sent before its thinnest place, and not into it."""
    here, goal = np.array([0.1, 0.1, -3.0]), np.array([10.0, 0.1, -3.0])
    view = gap_view(2, certain=False)
    path = Planner(ON_A_MAP).path(view, here, np.zeros(3), goal, 5.0)
    assert path.tight and path.speeds[-1] == 0.0
    end = path.vertices[-1]
    assert 3.0 < end[0] < 4.0 and abs(end[1] - 0.1) < 0.3
    assert all(view.to_occupied[view.cell_of(vertex)] >= 0.38 for vertex in path.vertices)


def crossing(path: Path, north: float) -> float:
    """East (m) where a way comes over a line across it."""
    return float(np.interp(north, path.vertices[:, 0], path.vertices[:, 1]))


@pytest.mark.parametrize("from_east", [-1.5, 0.1, 1.5])
def test_a_tight_way_leads_through_the_middle(from_east: float) -> None:
    """A gap of 0.9 m in cells of 5 cm: wherever it is come from, both sides are as far away as can be."""
    states = np.full((512, 512), FREE, np.uint8)
    states[336:338] = OCCUPIED
    states[336:338, 248:266] = FREE
    view = MapView(states, distance_to(states == OCCUPIED, 0.05), (-256, -256), 0.05)
    planner = Planner(Avoidance(method="astar", map=AvoidanceMap(cell=0.05, cells=512)))
    path = planner.path(view, np.array([0.0, from_east, -3.0]), np.zeros(3), np.array([10.0, from_east, -3.0]), 5.0)
    assert path.tight
    assert all(abs(crossing(path, north) - 0.05) < 0.04 for north in (4.0, 4.05, 4.1))


def test_a_tight_way_is_gone_on_with_unless_another_is_much_cheaper() -> None:
    """Two gaps in a wall 4 m ahead, 3 m to the left and to the right: which is the nearer one changes from ring to
    ring, and the first that was chosen is flown to."""
    spans = ((0, 111), (115, 141), (145, 256))
    view = view_with(*((slice(148, 150), slice(*span)) for span in spans))
    goal = np.array([10.0, 0.0, -3.0])
    for first in (1.0, -1.0):
        planner = Planner(ON_A_MAP)
        for k in range(6):
            here = np.array([0.1 * k, first * (-1) ** k * 0.15, -3.0])
            fresh = Planner(ON_A_MAP).path(view, here, np.zeros(3), goal, 5.0)
            path = planner.path(view, here, np.zeros(3), goal, 5.0)
            assert path.tight and fresh.tight
            assert np.sign(crossing(fresh, 4.1)) == np.sign(here[1])
            assert np.sign(crossing(path, 4.1)) == first
        far = np.array([3.9, -3.0 * first, -3.0])
        assert np.sign(crossing(planner.path(view, far, np.zeros(3), goal, 5.0), 4.1)) == -first, "it is in the other"


def test_an_earlier_tight_way_counts_for_its_own_goal_alone() -> None:
    """In a corridor 0.8 m wide, at the goal: the next one is 3 m aside, behind the wall, and the way to it leads around
    the corridor's end."""
    walls = [(slice(100, 160), slice(column, column + 1)) for column in (126, 131)]
    view = view_with(*walls)
    start, end, aside = (np.array([north, east, -3.0]) for north, east in ((2.0, 0.1), (4.1, 0.1), (4.1, 3.1)))
    planner = Planner(ON_A_MAP)
    assert planner.path(view, start, np.zeros(3), end, 5.0).tight
    assert planner.path(view, end, np.zeros(3), end, 5.0).tight
    around = planner.path(view, end, np.zeros(3), aside, 5.0)
    assert around.tight and len(around.vertices) > 2 and around.vertices[:, 0].max() > 6.4
    away = np.array([200.0, 0.0, -3.0])
    assert not len(planner.path(view, away, np.zeros(3), aside, 5.0).vertices), "outside of the window nothing is known"


def test_in_a_gap_the_way_stays_tight() -> None:
    """In the middle of it the way out leads away from both sides, with room: only who came in by a tight way knows
    that it is still in one, and that the guard may not push it back out."""
    view, goal = gap_view(4, certain=True), np.array([10.0, 0.1, -3.0])
    inside = np.array([4.1, 0.0, -3.0])
    planner = Planner(ON_A_MAP)
    assert planner.path(view, np.array([2.0, 0.1, -3.0]), np.zeros(3), goal, 5.0).tight
    assert planner.path(view, inside, np.zeros(3), goal, 5.0).tight
    assert not planner.path(view, np.array([6.0, 0.1, -3.0]), np.zeros(3), goal, 5.0).tight
    assert not Planner(ON_A_MAP).path(view, inside, np.zeros(3), goal, 5.0).tight


def test_at_a_doubt_without_space_before_it_the_vehicle_goes_on_to_it() -> None:
    """A corridor so narrow that nowhere there is room to spare, and at its end a wall that was seen from afar alone."""
    view = view_with((slice(0, 150), slice(0, 127)), (slice(0, 150), slice(131, 256)), (slice(150, 151), slice(0, 256)))
    blurs = np.where(np.argwhere(view.states == OCCUPIED)[:, 0] < 150, 0.0, np.inf)
    view = dataclasses.replace(view, blurs=blurs)
    path = Planner(ON_A_MAP).path(view, np.array([0.1, 0.1, -3.0]), np.zeros(3), np.array([10.0, 0.1, -3.0]), 5.0)
    assert path.tight and 3.4 < path.vertices[-1][0] < 4.0
