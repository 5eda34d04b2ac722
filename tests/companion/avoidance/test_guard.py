"""The guard: it leaves alone what is safe, improves what is not, stops within what was seen free, and has its sides
right."""

import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace

from companion.avoidance.braking import stopping_speed
from companion.avoidance.clearance import ClearanceMap, KeepOut
from companion.avoidance.guard import Guard
from companion.avoidance.stops import Braking, best_stop, stop_free_share
from companion.config_avoidance import AvoidanceGuard
from companion.perception.distance_field import distance_to
from companion.perception.free_space import MOVER_COLUMNS, free_space, nearest_points
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, MapView
from companion.state import Reason
from protocol.arrays import Array
from protocol.frames import from_euler

SETTINGS = AvoidanceGuard(
    keep_out=0.7,
    keep_out_unseen=0.45,
    keep_out_tight=0.4,
    keep_out_unseen_tight=0.38,
    tight_speed=1.0,
    braking=4.5,
    emergency_braking=6.8,
    evasion=6.5,
    barrier_gain=4.0,
    closing_gain=2.0,
    lag_s=0.15,
    horizon_s=0.1,
    obstacle_range=9.0,
    stale_s=0.3,
)
CELL = 0.2
CELLS = 128
MIDDLE = 12.8
STILL = np.zeros(3)


def view_of(states: Bytes) -> MapView:
    return MapView(states, distance_to(states == OCCUPIED, CELL), (-CELLS // 2, -CELLS // 2), CELL)


def free_field() -> Bytes:
    return np.full((CELLS, CELLS), FREE, np.uint8)


def guard_on(states: Bytes, position: Array = STILL, settings: AvoidanceGuard = SETTINGS) -> Guard:
    guard = Guard(settings)
    guard.look(free_space(view_of(states), position, 0, settings))
    return guard


def mover(*columns: float) -> Array:
    """(1, MOVER_COLUMNS): its place, velocity and room are known for certain."""
    row = np.zeros((1, MOVER_COLUMNS))
    row[0, :5] = columns
    return row


def wall(states: Bytes, north: float, what: int = OCCUPIED) -> Bytes:
    """A copy with a wall across the way north, and all behind it unknown."""
    changed = states.copy()
    row = math.floor((north + MIDDLE) / CELL)
    changed[row + 1 :] = UNKNOWN
    changed[row] = what
    return changed


def test_in_the_open_nothing_is_changed() -> None:
    rng = np.random.default_rng(4)
    guard = guard_on(free_field())
    for _ in range(50):
        velocity = np.array([*rng.uniform(-4.0, 4.0, 2), 0.3])
        command = rng.uniform(-3.0, 3.0, 3)
        verdict = guard.filter(STILL, velocity, command, 0)
        assert verdict.reason is Reason.NONE and np.array_equal(verdict.acceleration_ned, command)


def test_a_wall_on_the_right_only() -> None:
    """To the right is taken away, to the left and along are left alone."""
    states = free_field()
    states[:, math.floor((1.5 + MIDDLE) / CELL) :] = OCCUPIED
    guard = guard_on(states)
    velocity = np.array([1.0, 0.5, 0.0])
    right = guard.filter(STILL, velocity, np.array([0.0, 4.0, -1.0]), 0)
    assert right.reason is not Reason.NONE and right.acceleration_ned[1] < 2.5
    assert right.acceleration_ned[2] == -1.0
    assert right.changed == pytest.approx(math.hypot(*(right.acceleration_ned[:2] - np.array([0.0, 4.0]))))
    for command in ([0.0, -4.0, 0.0], [2.0, -1.0, 0.0]):
        verdict = guard.filter(STILL, velocity, np.array(command), 0)
        assert verdict.reason is Reason.NONE and np.array_equal(verdict.acceleration_ned, command)
    assert guard.limit(STILL, STILL, np.array([[0.0, 5.0]]), 8.0).speed < 3.0
    assert guard.limit(STILL, STILL, np.array([[0.0, -5.0]]), 8.0).speed == 8.0
    assert guard.limit(STILL, STILL, np.array([[5.0, 0.0]]), 8.0).speed == 8.0


@pytest.mark.parametrize("what", [OCCUPIED, UNKNOWN])
def test_speed_limit_is_the_braking_distance_to_what_is_not_seen_free(what: int) -> None:
    guard = guard_on(wall(free_field(), 8.1, what))
    keep_out = SETTINGS.keep_out if what == OCCUPIED else SETTINGS.keep_out_unseen
    for velocity, way in (
        (np.array([3.0, 0.0, 0.0]), np.array([[0.0, 9.0]])),
        (STILL, np.array([[9.0, 0.0]])),
    ):
        limit = guard.limit(STILL, velocity, way, 20.0)
        assert limit.free == pytest.approx(8.1 - keep_out, abs=2.0 * CELL)
        assert limit.speed == pytest.approx(stopping_speed(limit.free, SETTINGS.braking, 0.25))
    assert guard.limit(STILL, STILL, np.array([[9.0, 0.0]]), 1.0).speed == 1.0
    diagonal = guard.limit(STILL, STILL, np.array([[11.0, 11.0]]), 20.0)
    assert diagonal.free == pytest.approx(math.sqrt(2.0) * (8.1 - keep_out), abs=2.0 * CELL)
    around = guard.limit(STILL, STILL, np.array([[0.0, -6.0], [12.0, -6.0]]), 20.0)
    assert around.free == pytest.approx(6.0 + 8.1 - keep_out, abs=2.0 * CELL)
    before = guard.limit(STILL, STILL, np.array([[0.0, -6.0], [5.0, -6.0]]), 20.0)
    assert before.free == math.inf and before.speed == 20.0


def test_the_vehicle_stops_within_what_it_sees_now() -> None:
    """With a scan that meets the ground 3 m north of the vehicle, whether it is flown there or about to be."""
    guard, ahead, aside = guard_on(free_field()), np.array([[9.0, 0.0]]), np.array([[0.0, 9.0]])
    for seconds in range(20):
        guard.view_ahead.look(from_euler(0.0, -math.atan(0.5), 0.0), np.zeros(2), 1.5, seconds * 10**9)
    for velocity, way in ((STILL, ahead), (np.array([5.0, 0.0, 0.0]), aside), (np.array([5.0, 0.0, 0.0]), ahead)):
        limit = guard.limit(STILL, velocity, way, 20.0)
        assert limit.free == pytest.approx(3.0)
        assert limit.speed == pytest.approx(stopping_speed(3.0, SETTINGS.braking, 0.25))
    assert guard.limit(STILL, STILL, aside, 20.0).speed == guard_on(free_field()).limit(STILL, STILL, aside, 20.0).speed


def test_over_a_late_link_and_with_slow_loops_the_speed_limit_counts_on_a_later_stop() -> None:
    guard, way = guard_on(wall(free_field(), 8.1)), np.array([[9.0, 0.0]])
    guard.follow(0.2, 0.5)
    limit = guard.limit(STILL, STILL, way, 20.0)
    reaction_s = SETTINGS.reaction_time + 0.2 + 2.0 * SETTINGS.lag_s - SETTINGS.lag_s
    assert limit.speed == pytest.approx(stopping_speed(limit.free, SETTINGS.braking, reaction_s))


def test_in_a_tight_passage_too_the_vehicle_can_stop_before_its_end() -> None:
    guard, view = Guard(SETTINGS), view_of(wall(free_field(), 0.7))
    guard.look(free_space(view, STILL, 0, SETTINGS, tight=True))
    limit = guard.limit(STILL, STILL, np.array([[9.0, 0.0]]), 20.0)
    assert 0.0 < limit.free < 0.4
    assert limit.speed == pytest.approx(stopping_speed(limit.free, SETTINGS.braking, SETTINGS.reaction_time))


@pytest.mark.parametrize("side", [1, -1])
def test_a_stop_is_straight_or_swerves_to_the_free_side(side: int) -> None:
    """6 m/s, a straight stop takes 4.9 m: before a block that covers the course and all to the left (or right) of it.

    Only what stops is looked at: no barriers."""
    here, velocity, command = np.array([0.0, 0.1, 0.0]), np.array([6.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0])

    def verdict_before(north: float, beyond: int) -> tuple[Reason, Array]:
        states = free_field()
        row, middle = math.floor((north + MIDDLE) / CELL), CELLS // 2
        if side > 0:
            states[row:, : middle + beyond] = OCCUPIED
        else:
            states[row:, middle + 1 - beyond :] = OCCUPIED
        verdict = guard_on(states, here, replace(SETTINGS, obstacle_range=0.5)).filter(here, velocity, command, 0)
        return verdict.reason, verdict.acceleration_ned[:2]

    reason, found = verdict_before(5.3, 3)
    assert reason is Reason.STOP and found[0] < -1.0 and found[1] * side > 1.0
    assert math.hypot(found[0], found[1]) == pytest.approx(SETTINGS.braking)
    stop, hardest = (Reason.STOP, SETTINGS.braking), (Reason.NO_STOP, SETTINGS.emergency_braking)
    for north, (expected, braking) in ((5.9, stop), (5.1, hardest), (3.3, hardest)):
        reason, found = verdict_before(north, 9)
        assert reason is expected and np.allclose(found, [-braking, 0.0])
    assert verdict_before(9.0, 9)[0] is Reason.NONE


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("speed", "swerves"), [(0.6, False), (2.0, True)])
def test_who_comes_to_rest_within_the_lag_stops_straight(speed: float, swerves: bool, side: int) -> None:
    """Less room ahead and more to one side: who is fast swerves to it."""
    north, east = np.mgrid[:CELLS, :CELLS] * CELL - MIDDLE + 0.5 * CELL
    braking = Braking(4.5, 0.15)
    free = speed * braking.lag + 0.25 * speed**2 / braking.deceleration
    near = (0.5 + 0.05 * (free - north) + 0.5 * side * east).astype(np.float32)
    clearances, keep_out = ClearanceMap(near, np.full_like(near, 2.0), CELL), KeepOut(0.5, 0.2)
    swerve, share = best_stop(clearances, (MIDDLE, MIDDLE), (speed, 0.0), keep_out, braking)
    assert swerve * side > 0.0 and share == 1.0 if swerves else swerve == 0.0 and share < 1.0


def test_without_a_view_or_with_an_old_one_it_stops() -> None:
    guard = Guard(SETTINGS)
    velocity, command = np.array([3.0, -2.0, 0.1]), np.array([2.0, 0.0, 0.5])
    assert guard.limit(STILL, velocity, np.array([[3.0, -2.0]]), 5.0).speed == 0.0
    aged = guard_on(free_field())
    assert aged.filter(STILL, velocity, command, 299_000_000).reason is Reason.NONE
    for verdict in (guard.filter(STILL, velocity, command, 0), aged.filter(STILL, velocity, command, 301_000_000)):
        assert verdict.reason is Reason.STALE
        assert np.allclose(verdict.acceleration_ned[:2] / SETTINGS.braking, -velocity[:2] / math.hypot(3.0, 2.0))
        assert verdict.acceleration_ned[2] == 0.5


def test_what_moves_goes_on_moving_while_the_view_of_it_ages() -> None:
    """0.2 s after the ring, or over a link that is so late, it is as if it had been seen where it is by now."""
    rng = np.random.default_rng(6)
    acted = 0
    for _ in range(50):
        walker = mover(*rng.uniform((2.0, -2.0), (5.0, 2.0)), *rng.uniform(-1.5, 1.5, 2), 1.0)
        by_now = walker.copy()
        by_now[:, :2] += 0.2 * walker[:, 2:4]
        velocity, command = np.array([*rng.uniform((2.0, -1.0), (4.0, 1.0)), 0.0]), np.array([2.0, 0.0, 0.0])
        verdicts = []
        for moving, now, late_s in ((walker, 200_000_000, 0.0), (by_now, 0, 0.0), (walker, 0, 0.2)):
            guard = Guard(SETTINGS)
            guard.follow(late_s, 1.0)
            guard.look(free_space(view_of(free_field()), STILL, 0, SETTINGS, moving))
            verdicts.append(guard.filter(STILL, velocity, command, now))
        for verdict in verdicts[1:]:
            assert verdict.reason is verdicts[0].reason
            assert verdict.acceleration_ned == pytest.approx(verdicts[0].acceleration_ned, abs=1e-9)
        acted += verdicts[0].reason is Reason.EVASION
    assert acted > 10


@pytest.mark.parametrize("swerve", [0.4, -0.8, 1.1])
@pytest.mark.parametrize("part", [0.5, 1.0])
def test_a_swerve_is_looked_at_where_it_leads(swerve: float, part: float) -> None:
    """Its accelerations, integrated twice: to rest, beside the straight stop. A pillar that stands there is met."""
    braking, lag, velocity = 4.5, 0.15, np.array([4.0, 3.0])
    speed = math.hypot(*velocity)
    onward = velocity / speed
    aside = np.array([-onward[1], onward[0]])
    duration = speed / (braking * math.cos(swerve))
    count = 4000
    times = np.arange(count) * (lag + duration) / count
    late = times - lag
    sides = np.where(late < 0.0, 0.0, np.where(late < 0.5 * duration, 1.0, -1.0))
    backs = np.where(late < 0.0, 0.0, 1.0)
    force = sides[:, None] * math.sin(swerve) * aside - backs[:, None] * math.cos(swerve) * onward
    step = times[1]
    moves = velocity + np.cumsum(braking * force, axis=0) * step
    path = np.cumsum(moves, axis=0) * step
    assert np.linalg.norm(moves[-1]) < 0.02 and abs(path[-1] @ aside) > 0.3

    def share(place: Array) -> float:
        rows, columns = np.mgrid[:CELLS, :CELLS]
        centres = (np.stack([rows, columns], axis=-1) + 0.5) * CELL - MIDDLE
        pillar = np.linalg.norm(centres - place, axis=-1).astype(np.float32)
        unseen = np.full_like(pillar, 2.0)
        clearances, (north, east) = ClearanceMap(pillar, unseen, CELL), velocity.tolist()
        keep_out, brakes = KeepOut(0.3, 0.2), Braking(braking, lag)
        return stop_free_share(clearances, (MIDDLE, MIDDLE), (north, east), swerve, keep_out, brakes)

    place = path[round(part * count) - 1]
    met = np.flatnonzero(np.linalg.norm(path - place, axis=1) < 0.3)[0] / count
    assert share(place) == pytest.approx(met, abs=0.1) and met < 1.0


def flown(
    states: Bytes,
    velocity: Array,
    wish: Array,
    seconds: float,
    moving: Array | None = None,
    tight: bool = False,
    settings: AvoidanceGuard = SETTINGS,
) -> tuple[Array, Array]:
    """A point mass whose acceleration follows the guard's with a lag of 0.1 s: positions and velocities (n, 2)."""
    guard = Guard(settings)
    view = view_of(states)
    position, acceleration, dt = np.zeros(3), np.zeros(3), 0.004
    velocity = velocity.copy()
    trail = []
    for k in range(round(seconds / dt)):
        now = round(k * dt * 1e9)
        if k % 16 == 0:
            around = None
            if moving is not None:
                around = moving.copy()
                around[:, :2] += k * dt * moving[:, 2:4]
            guard.look(free_space(view, position, now, settings, around, tight=tight))
        command = guard.filter(position, velocity, 2.5 * (wish - velocity), now).acceleration_ned
        command *= min(1.0, 6.8 / max(math.hypot(*command[:2]), 1e-9))
        acceleration += (command - acceleration) * dt / 0.1
        velocity += acceleration * dt
        position = position + velocity * dt
        trail.append([*position[:2], *velocity[:2]])
    path = np.array(trail)
    return path[:, :2], path[:, 2:]


@pytest.mark.parametrize("what", [OCCUPIED, UNKNOWN])
@pytest.mark.parametrize("speed", [2.0, 5.0, 7.0])
def test_who_flies_straight_at_a_wall_stops_before_it(what: int, speed: float) -> None:
    """Whatever is asked for: it comes to rest outside of the hull's radius, 0.36 m, and not far away from the wall; of
    what is unknown a little nearer to where the first unknown cell begins."""
    states = wall(free_field(), 10.1, what)
    position, velocity = flown(states, np.array([0.0, 0.0, 0.0]), np.array([speed, 0.0, 0.0]), 12.0)
    assert position[:, 0].max() < (10.0 - 0.36 if what == OCCUPIED else 10.1 - 0.45 + 0.01)
    assert position[-1, 0] > 10.0 - 1.4 and np.hypot(*velocity[-1]) < 0.05
    assert velocity[:, 0].max() > min(0.9 * speed, 5.0)


@pytest.mark.parametrize("speed", [4.0, 6.0])
def test_what_appears_too_near_is_braked_for_as_hard_as_can_be(speed: float) -> None:
    """A wall that stands where a stop at the usual braking would end in it, seen by nobody before."""
    velocity, nearest = np.array([speed, 0.0, 0.0]), []
    for hardest in (0.0, SETTINGS.emergency_braking):
        settings = replace(SETTINGS, emergency_braking=hardest, obstacle_range=0.1)
        usual = SETTINGS.lag_s * speed + 0.5 * speed * speed / SETTINGS.braking
        states = wall(free_field(), 0.85 * usual + settings.keep_out)
        position, _ = flown(states, velocity, velocity, 3.0, settings=settings)
        nearest.append((np.argwhere(states == OCCUPIED)[0, 0] + 0.5) * CELL - MIDDLE - position[:, 0].max())
    assert nearest[0] < settings.keep_out - 0.1 < settings.keep_out < nearest[1] + 0.05


@pytest.mark.parametrize(("emergency", "given"), [(0.0, SETTINGS.braking), (6.8, 6.8)])
def test_in_an_emergency_it_brakes_no_less_than_usually(emergency: float, given: float) -> None:
    guard = guard_on(wall(free_field(), 2.0), settings=replace(SETTINGS, emergency_braking=emergency))
    north, east, _ = guard.filter(STILL, np.array([6.0, 0.0, 0.0]), STILL, 0).acceleration_ned
    assert north < 0.0 and math.hypot(north, east) == pytest.approx(given)


def passage() -> Bytes:
    """Walls 1 m apart, by the centres of their cells, and 3 m long; all else free."""
    states = free_field()
    states[70:85, [61, 66]] = OCCUPIED
    return states


def test_the_hull_stops_before_glass_in_a_tight_passage() -> None:
    """Whose beams say nothing: the cells stay unknown. Without it the passage is flown."""
    states, wish = passage(), np.array([1.0, 0.0, 0.0])
    through, _ = flown(states, np.zeros(3), wish, 9.0, tight=True)
    assert through[-1, 0] > 6.0
    states[78:80, 62:66] = UNKNOWN
    position, velocity = flown(states, np.zeros(3), wish, 9.0, tight=True)
    assert 1.0 < position[:, 0].max() < (78 - 64) * CELL - 0.25 and np.hypot(*velocity[-1]) < 0.05
    centres = (np.argwhere(states == UNKNOWN) + 0.5 - 64) * CELL
    assert np.hypot(*(position[:, None] - centres).transpose(2, 0, 1)).min() > 0.36


def test_what_is_beside_a_wall_counts_to_it_on_a_tight_path() -> None:
    """The cell before a wall is not seen free, as the range noise leaves it; one that is before no wall is unseen."""
    states = np.full((40, 40), FREE, np.uint8)
    states[:, 24], states[:, 23], states[:, 15] = OCCUPIED, UNKNOWN, UNKNOWN
    view = MapView(states, distance_to(states == OCCUPIED, 0.125), (0, 0), 0.125)
    here = np.array([2.5, 2.5, 0.0])
    roomy, tight = (free_space(view, here, 0, SETTINGS, tight=each) for each in (False, True))
    row, column = 20 - tight.corner[0], 20 - tight.corner[1]
    assert roomy.to_unseen[row, column] == pytest.approx(3 * 0.125)
    assert tight.to_unseen[row, column] == pytest.approx(5 * 0.125)
    assert tight.to_occupied[row, column] == pytest.approx(4 * 0.125)
    unseen = tight.points[tight.points[:, 4] == np.float64(SETTINGS.keep_out_unseen_tight)]
    assert len(unseen) > 3 and (unseen[:, 1] < 2.5).all()


def test_pushed_through_a_random_field_it_touches_nothing() -> None:
    """A wish that knows nothing of what is there, from rest, in 12 fields of pillars."""
    rng = np.random.default_rng(6)
    for _ in range(12):
        states = free_field()
        rows = rng.integers(0, CELLS, (30, 2))
        away = np.hypot(*(rows - CELLS // 2).T) * CELL > 2.0
        states[tuple(rows[away].T)] = OCCUPIED
        angle = rng.uniform(-math.pi, math.pi)
        wish = 5.0 * np.array([math.cos(angle), math.sin(angle), 0.0])
        position, velocity = flown(states, np.zeros(3), wish, 5.0)
        pillars = (rows[away] - CELLS // 2 + 0.5) * CELL
        gaps = np.hypot(*(position[:, None, :] - pillars[None, :, :]).transpose(2, 0, 1))
        assert gaps.min() > 0.5
        assert np.abs(position).max() < MIDDLE and np.hypot(*velocity.T).max() > 1.0


@pytest.mark.parametrize("speed", [0.7, 1.4, 4.0])
def test_someone_who_comes_up_is_kept_off(speed: float) -> None:
    """From the right, seen from 5 m on; the vehicle, hovering, steps aside and stays there."""
    walker = mover(0.0, 5.0, 0.0, -speed, 0.9)
    position, velocity = flown(free_field(), np.zeros(3), np.zeros(3), 5.0 / speed + 4.0, walker)
    times = 0.004 * np.arange(1, len(position) + 1)
    gaps = np.hypot(position[:, 0], position[:, 1] - (5.0 - speed * times))
    assert gaps.min() > 0.85
    assert np.hypot(*position[-1]) < 5.0 and np.hypot(*velocity[-1]) < 0.3


def test_a_mirrored_scene_has_the_mirrored_verdict() -> None:
    """The vehicle stands on a cell's centre, so the map mirrors onto itself."""
    rng = np.random.default_rng(7)
    changed = 0
    for _ in range(40):
        states = free_field()
        rows = rng.integers(40, 88, (12, 2))
        states[tuple(rows.T)] = OCCUPIED
        velocity, command = rng.uniform(-3.0, 3.0, (2, 2))
        here = np.array([0.1, 0.1, 0.0])
        expected = guard_on(states, here).filter(here, np.append(velocity, 0.0), np.append(command, 0.0), 0)
        flipped = states.copy()
        flipped[:, 1:] = states[:, :0:-1]
        mirror = np.array([1.0, -1.0, 1.0])
        mirrored = guard_on(flipped, here).filter(
            here, np.append(velocity, 0.0) * mirror, np.append(command, 0.0) * mirror, 0
        )
        changed += expected.reason is Reason.BARRIER
        if Reason.STOP in (expected.reason, mirrored.reason) or Reason.NO_STOP in (expected.reason, mirrored.reason):
            continue  # of two swerves that serve as well, right is taken
        assert np.allclose(mirrored.acceleration_ned, expected.acceleration_ned * mirror, atol=1e-6)
    assert changed > 5


def test_nearest_points_are_those_a_search_finds() -> None:
    rng = np.random.default_rng(8)
    states = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.uint8), (60, 60), p=[0.9, 0.05, 0.05])
    standing = np.asarray((np.argwhere(states == OCCUPIED) + 0.5) * CELL, np.float64)
    points = nearest_points(states, CELL, (6.13, 5.77), standing, 4.0, (0.7, 0.45))
    for kind, keep_out in ((OCCUPIED, 0.7), (UNKNOWN, 0.45)):
        centres = (np.argwhere(states == kind) + 0.5) * CELL
        offsets = centres - [6.13, 5.77]
        mine = points[points[:, 4] == keep_out]
        found = mine[:, :2] - [6.13, 5.77]
        for quarter in itertools.product((False, True), repeat=2):
            all_there, found_there = (p[((p >= 0.0) == quarter).all(axis=1)] for p in (offsets, found))
            assert len(found_there) > 3
            assert np.hypot(*found_there.T).min() == pytest.approx(np.hypot(*all_there.T).min())
        known = {tuple(np.round(c, 6)) for c in centres}
        assert all(tuple(np.round(p, 6)) in known for p in mine[:, :2])
        assert (mine[:, 2:4] == 0.0).all() and 20 < len(mine) <= 36


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_walkers_who_cross_are_not_touched(side: float) -> None:
    """They come from the side at 1.5 m/s, so that without a guard some would be met in the middle, some before, some
    behind: hull (0.36 m) and walker (0.26 m) never touch, and mirrored the flight is mirrored."""
    least, passed = [], 0
    for late in np.arange(-0.6, 0.61, 0.1):
        walker = mover(9.0, side * 1.5 * (3.0 + late), 0.0, -side * 1.5, 0.26 + 0.5)
        position, _ = flown(free_field(), np.array([3.0, 0.0, 0.0]), np.array([3.0, 0.0, 0.0]), 7.0, walker)
        times = 0.004 * np.arange(1, len(position) + 1)
        there = walker[0, :2] + times[:, None] * walker[0, 2:4]
        least.append(np.hypot(*(position - there).T).min())
        passed += position[-1, 0] > 11.0
    assert min(least) > 0.36 + 0.26 and passed >= len(least) - 1
