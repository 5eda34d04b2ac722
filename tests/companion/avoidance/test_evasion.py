"""Evasion: what is counted in standard deviations, and that the vehicle gets out of the way of what it can't stop
for."""

import math

import numpy as np
import pytest

from companion.avoidance.clearance import ClearanceMap, KeepOut
from companion.avoidance.evasion import Agility, Push, evade, least_sigmas, sigmas
from companion.avoidance.guard import Guard
from companion.config_avoidance import AvoidanceGuard
from companion.perception.distance_field import distance_to
from companion.perception.free_space import MOVER_COLUMNS, FreeSpace, free_space
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, Bytes, MapView
from companion.state import Reason
from protocol.arrays import Array

CELL, CELLS = 0.2, 160
SETTINGS = AvoidanceGuard()
HULL, MOVER = 0.36, 0.3
STILL = np.zeros(3)


def mover(north: float, east: float, vn: float, ve: float, *, sigma: float = 0.0) -> Array:
    """(1, MOVER_COLUMNS), `sigma` (m/s) of each part of its velocity."""
    row = np.zeros((1, MOVER_COLUMNS))
    row[0, :5] = north, east, vn, ve, MOVER + SETTINGS.keep_out_moving
    row[0, 11] = row[0, 13] = sigma**2
    return row


def field() -> Bytes:
    return np.full((CELLS, CELLS), FREE, np.uint8)


def map_of(states: Bytes) -> MapView:
    return MapView(states, distance_to(states == OCCUPIED, CELL), (-CELLS // 2, -CELLS // 2), CELL)


def guard_on(states: Bytes, movers: Array, position: Array = STILL) -> Guard:
    guard = Guard(SETTINGS)
    guard.look(free_space(map_of(states), position, 0, SETTINGS, movers))
    return guard


def pushed(velocity: Array, movers: Array, states: Bytes | None = None) -> tuple[Reason, Array]:
    """What the guard makes of no acceleration."""
    verdict = guard_on(field() if states is None else states, movers).filter(STILL, velocity, np.zeros(3), 0)
    return verdict.reason, verdict.acceleration_ned


def turned(vector: Array, angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], *vector[2:]])


def test_sigmas_are_those_of_a_sample_of_movers() -> None:
    """The place of a mover after 0.6 s, drawn by its covariance: the distance at the nearest along the line to it, over
    its spread."""
    rng = np.random.default_rng(1)
    root = rng.normal(size=(4, 4)) * 0.3
    covariance = root @ root.T
    row = mover(3.0, 1.0, -2.0, 0.5)[0]
    for column, (i, j) in enumerate(((0, 0), (0, 1), (1, 1)), 5):
        row[column], row[column + 6] = covariance[i, j], covariance[i + 2, j + 2]
        row[column + 3] = covariance[i, j + 2] + covariance[j, i + 2]
    place, now = (1.0, -1.0, 0.0, 0.0), (0.6, 0.6)
    drawn = rng.multivariate_normal(row[:4], covariance, 200_000)
    there = drawn[:, :2] + 0.6 * drawn[:, 2:]
    offset = np.array(place[:2]) - there.mean(axis=0)
    distance = math.hypot(*offset)
    spread = (there @ offset / distance).std()
    assert sigmas(row, place, place, now, 9.0) == pytest.approx((distance - row[4]) / (spread + 0.05), rel=0.02)


def test_between_two_moments_the_nearest_counts() -> None:
    """The vehicle flies past at 1 m, 10 m in one step; what is not nearer than at first does not count."""
    row = mover(0.0, 1.0, 0.0, 0.0)[0]
    before, after = (-5.0, 0.0, 10.0, 0.0), (5.0, 0.0, 10.0, 0.0)
    assert sigmas(row, before, after, (0.0, 1.0), 6.0) == pytest.approx((1.0 - row[4]) / 0.05)
    assert sigmas(row, before, after, (0.0, 1.0), 0.9) > 100.0


def test_a_push_begins_after_the_lag_and_ends_in_a_stop() -> None:
    """From rest at 8 m/s2 for 0.32 s after 0.15 s, then to rest at 5.5 m/s2: it comes 0.41 + 0.6 m far; a mover whose
    room ends there is just touched."""
    push, agility = Push(8.0, 0.0, 0.32, True), Agility(8.0, 5.5, 0.15)
    way = 0.5 * 8.0 * 0.32**2 + (8.0 * 0.32) ** 2 / (2.0 * 5.5)
    for beyond, touched in ((0.15, False), (-0.15, True)):
        row = mover(way + MOVER + SETTINGS.keep_out_moving + beyond, 0.0, 0.0, 0.0)
        found = least_sigmas(row, row[:, 0], (0.0, 0.0, 0.0, 0.0), push, agility, (0.0, 3.0))
        assert (found < 0.0) == touched


@pytest.mark.parametrize("turn", np.radians([0.0, 70.0, 180.0, 250.0]))
@pytest.mark.parametrize("own", [0.0, 6.0])
def test_what_comes_ahead_on_is_evaded_sideways(turn: float, own: float) -> None:
    """At 4 m/s, 6 m away, the vehicle at rest or towards it: to the side; from rest it may run ahead of it."""
    away = 0.9 * (own + 4.0)
    reason, found = pushed(turned(np.array([own, 0.0, 0.0]), turn), turned_mover(mover(away, 0.0, -4.0, 0.0), turn))
    back = turned(found, -turn)
    assert reason is Reason.EVASION and math.hypot(*found[:2]) == pytest.approx(SETTINGS.evasion)
    assert abs(back[1]) > 0.35 * SETTINGS.evasion or (own == 0.0 and back[0] < -0.9 * SETTINGS.evasion)


def turned_mover(movers: Array, angle: float) -> Array:
    """With an isotropic covariance."""
    result = movers.copy()
    result[0, :2], result[0, 2:4] = turned(movers[0, :2], angle), turned(movers[0, 2:4], angle)
    return result


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_it_is_evaded_to_the_side_where_it_is_not(side: float) -> None:
    reason, found = pushed(np.array([6.0, 0.0, 0.0]), mover(6.0, 0.3 * side, -4.0, 0.0))
    assert reason is Reason.EVASION and found[1] * side < 0.0
    states = field()
    middle = CELLS // 2
    aside = math.floor(0.9 * side / CELL) + middle
    states[middle - 20 : middle + 50, aside] = OCCUPIED
    reason, found = pushed(np.array([6.0, 0.0, 0.0]), mover(6.0, -0.1 * side, -4.0, 0.0), states)
    assert reason is Reason.EVASION and found[1] * side < 0.0, "there is a wall on the other side"


def test_what_passes_or_goes_away_is_let_pass() -> None:
    still = np.zeros(3)
    for movers in (mover(4.0, 2.0, -4.0, 0.0), mover(2.0, 0.0, 4.0, 0.0), mover(8.0, 0.0, -1.0, 0.0)):
        assert pushed(still, movers)[0] is Reason.NONE


def test_the_less_is_known_the_wider_is_the_berth() -> None:
    """What would pass at 1.3 m is let pass if that is certain, and not with a velocity known to 0.6 m/s."""
    assert pushed(np.zeros(3), mover(4.0, 1.3, -4.0, 0.0))[0] is Reason.NONE
    assert pushed(np.zeros(3), mover(4.0, 1.3, -4.0, 0.0, sigma=0.6))[0] is Reason.EVASION


def test_it_keeps_to_the_side_on_which_it_began() -> None:
    """What comes seems to move to one side and to the other in turn; after a pause another side may be taken."""
    guard = guard_on(field(), mover(6.0, -0.1, -4.0, 0.0, sigma=0.5))
    velocity = np.array([4.0, 0.0, 0.0])
    first = guard.filter(STILL, velocity, np.zeros(3), 0).acceleration_ned[1]
    assert first > 0.0
    for k, east in enumerate((0.3, -0.3, 0.5, 0.2)):
        guard.look(guard_space(mover(6.0 - 0.5 * k, east, -4.0, 0.0, sigma=0.5)))
        assert guard.filter(STILL, velocity, np.zeros(3), (k + 1) * 60_000_000).acceleration_ned[1] > 0.0
    late = 2_000_000_000
    guard.look(guard_space(mover(4.5, 0.3, -4.0, 0.0, sigma=0.5), late))
    assert guard.filter(STILL, velocity, np.zeros(3), late).acceleration_ned[1] < 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("nearer", [-2.0, -1.0])
def test_it_changes_its_side_where_the_first_one_would_hit(side: float, nearer: float) -> None:
    """What seemed to come straight on crosses, as is seen later, to the side to which the vehicle runs."""
    guard = guard_on(field(), mover(6.0, -0.3 * side, -4.0, 0.0))
    velocity = np.array([6.0, 0.0, 0.0])
    assert guard.filter(STILL, velocity, np.zeros(3), 0).acceleration_ned[1] * side > 1.0
    guard.look(guard_space(mover(3.0, -0.4 * side, nearer, 1.5 * side, sigma=0.2)))
    assert guard.filter(STILL, velocity, np.zeros(3), 60_000_000).acceleration_ned[1] * side < -1.0


def guard_space(movers: Array, now_ns: int = 0) -> FreeSpace:
    return free_space(map_of(field()), STILL, now_ns, SETTINGS, movers)


def test_an_evasion_goes_on_until_the_way_is_clear() -> None:
    """A mover would be there in a second and a half: a vehicle that evades already goes on, one that does not waits."""
    fresh, evading = guard_on(field(), mover(8.0, 0.0, -5.5, 0.0)), guard_on(field(), mover(5.0, 0.0, -5.5, 0.0))
    assert evading.filter(STILL, STILL, STILL, 0).reason is Reason.EVASION
    evading.look(guard_space(mover(8.0, 0.0, -5.5, 0.0)))
    assert evading.filter(STILL, STILL, STILL, 0).reason is Reason.EVASION
    assert fresh.filter(STILL, STILL, STILL, 0).reason is Reason.NONE


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.5])
@pytest.mark.parametrize("stops", [True, False])
def test_an_evasion_ends_with_a_stop_where_that_keeps_clear(bearing: float, stops: bool) -> None:
    """Out of the way of the first, 5 m before one who crosses: the vehicle brakes, in place of running from this one,
    too. One that has not evaded yet does so, and one that is not fast enough to meet anybody is not slowed down."""
    settings = AvoidanceGuard(evasion_stops=stops)
    guard, velocity = Guard(settings), turned(np.array([4.0, 0.0, 0.0]), bearing)
    guard.look(guard_space(turned_mover(mover(0.0, 4.0, 0.0, -5.0), bearing)))
    assert guard.filter(STILL, STILL, STILL, 0).reason is Reason.EVASION
    crossing = turned_mover(mover(5.0, 1.0, 0.0, -0.8, sigma=0.1), bearing)
    guard.look(guard_space(crossing))
    verdict = guard.filter(STILL, velocity, STILL, 1_000_000)
    assert verdict.reason is Reason.EVASION
    braked = -settings.braking * velocity / 4.0
    assert np.allclose(verdict.acceleration_ned, braked, atol=1e-9) == stops
    fresh = guard_on(field(), crossing).filter(STILL, velocity, STILL, 0)
    assert fresh.reason is Reason.EVASION and not np.allclose(fresh.acceleration_ned, braked, atol=1e-9)
    assert guard.filter(STILL, 0.1 * velocity, STILL, 2_000_000).reason is Reason.NONE


@pytest.mark.parametrize("what", [FREE, OCCUPIED, UNKNOWN])
def test_a_stop_into_a_wall_or_what_was_not_seen_ends_no_evasion(what: int) -> None:
    """It begins 1.6 m ahead; the stop from 4 m/s takes 2."""
    states = field()
    states[CELLS // 2 + round(1.6 / CELL) :] = what
    space = free_space(map_of(states), STILL, 0, SETTINGS)
    around = ClearanceMap(space.to_occupied, space.to_unseen, CELL), (space.corner[0] * CELL, space.corner[1] * CELL)
    keep_outs = KeepOut(SETTINGS.keep_out, SETTINGS.keep_out_unseen), SETTINGS.keep_out_tight
    wish, agility = ((0.0, 0.0), (SETTINGS.evasion, 0.0)), Agility(SETTINGS.evasion, SETTINGS.braking, SETTINGS.lag_s)
    crossing = mover(5.0, 1.0, 0.0, -0.8, sigma=0.1)
    evades, north, east = evade(crossing, 0.0, around, (0.0, 0.0, 4.0, 0.0), wish, keep_outs, agility)
    assert ((evades, north, east) == (True, -SETTINGS.braking, 0.0)) == (what == FREE)


def test_through_what_was_not_seen_rather_than_into_it_but_never_through_a_wall() -> None:
    """All but a lane is unknown: it is evaded all the same. All but a lane is wall: along the lane alone."""
    velocity, movers = np.array([6.0, 0.0, 0.0]), mover(8.0, 0.0, -4.0, 0.0)
    middle = CELLS // 2
    for what, aside in ((UNKNOWN, True), (OCCUPIED, False)):
        states = np.full((CELLS, CELLS), what, np.uint8)
        states[:, middle - 4 : middle + 5] = FREE
        reason, found = pushed(velocity, movers, states)
        assert reason is Reason.EVASION and (abs(found[1]) > 0.9 * abs(found[0])) == aside


@pytest.mark.parametrize("own", [0.0, 3.0, 6.0])
@pytest.mark.parametrize("speed", [2.0, 4.0, 7.0])
def test_a_vehicle_with_lag_is_not_touched(own: float, speed: float) -> None:
    """It follows the guard's acceleration with a lag of 0.1 s, looks around 15 times a second, and wants to fly on."""
    for aside in (-0.5, -0.2, 0.0, 0.3):
        position, acceleration, wish = np.zeros(3), np.zeros(3), np.array([own, 0.0, 0.0])
        velocity, start = wish.copy(), 0.9 * (own + speed)
        guard, dt, least = Guard(SETTINGS), 0.004, math.inf
        for k in range(500):
            north = start - speed * k * dt
            if k % 16 == 0:
                view_states = field()
                view = MapView(
                    view_states, distance_to(view_states == OCCUPIED, CELL), (-CELLS // 2, -CELLS // 2), CELL
                )
                guard.look(free_space(view, position, round(k * dt * 1e9), SETTINGS, mover(north, aside, -speed, 0.0)))
            command = guard.filter(position, velocity, 2.5 * (wish - velocity), round(k * dt * 1e9)).acceleration_ned
            acceleration = acceleration + (command - acceleration) * dt / 0.1
            velocity = velocity + acceleration * dt
            position = position + velocity * dt
            least = min(least, math.hypot(position[0] - north, position[1] - aside))
        assert least > HULL + MOVER, (aside, least)


@pytest.mark.parametrize("width", [2.4, 2.8, 3.2])
@pytest.mark.parametrize("speed", [0.7, 1.4])
@pytest.mark.parametrize("aside", [0.0, 0.2])
def test_in_a_dead_end_a_vehicle_steps_aside_of_who_walks_up_to_it(width: float, speed: float, aside: float) -> None:
    """It wants to stay where it is, 1 m before the end; a long burst would end in a wall."""
    places = (np.arange(CELLS) - CELLS // 2 + 0.5) * CELL
    states = np.where((abs(places[None]) > 0.5 * width) | (places[:, None] > 1.0), OCCUPIED, FREE).astype(np.uint8)
    view, guard, dt = map_of(states), Guard(SETTINGS), 0.02
    position, velocity, acceleration = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(round(5.5 / speed / dt)):
        north = speed * k * dt - 5.0
        if k % 3 == 0:
            walker = mover(north, aside, speed, 0.0, sigma=0.1)
            guard.look(free_space(view, position, round(k * dt * 1e9), SETTINGS, walker))
        wish = np.clip(-position - 1.5 * velocity, -3.0, 3.0)
        command = guard.filter(position, velocity, wish, round(k * dt * 1e9)).acceleration_ned
        acceleration = acceleration + (command - acceleration) * dt / 0.1
        velocity, position = velocity + acceleration * dt, position + velocity * dt
        assert math.hypot(position[0] - north, position[1] - aside) > HULL + MOVER
        distance = view.distance_at(position)
        assert distance is not None and distance > HULL
