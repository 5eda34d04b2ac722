"""Barriers: their rates are right, who flies past is let by, and what is found is the nearest that is allowed."""

import math

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from companion.avoidance.barriers import Barrier, closing_limit, half_planes, nearest_allowed
from protocol.arrays import Array

STILL = np.zeros(3)


def planes_of(points: Array, position: Array, velocity: Array, command: Array) -> Array:
    place, moves, asked = ((float(each[0]), float(each[1])) for each in (position, velocity, command))
    return half_planes(points, place, moves, asked, Barrier(braking=4.5, gain=4.0, closing_gain=2.0))


def random_planes(rng: np.random.Generator, count: int = 10, reach: float = 6.0) -> Array:
    points = np.column_stack(
        [rng.uniform(-reach, reach, (count, 2)), rng.uniform(-1.0, 1.0, (count, 2)), np.full(count, 0.7)]
    )
    velocity = rng.uniform(-4.0, 4.0, 2)
    return planes_of(points, STILL, velocity, rng.uniform(-4.0, 4.0, 2))


def test_the_barrier_rate_is_the_rate_of_the_barrier() -> None:
    """h of a moving point seen from an accelerated vehicle, differenced, against the half-plane: both kinds."""
    rng = np.random.default_rng(1)
    braked = passed = 0
    for _ in range(400):
        point = np.array([[*rng.uniform(-6.0, 6.0, 2), *rng.uniform(-2.0, 2.0, 2), 0.7]])
        position, velocity, acceleration = rng.uniform(-3.0, 3.0, (3, 2))
        if np.hypot(*(point[0, :2] - position)) < 0.8:
            continue

        def plane_at(
            t: float, point: Array = point, p: Array = position, v: Array = velocity, a: Array = acceleration
        ) -> Array:
            moved = point.copy()
            moved[0, :2] += t * point[0, 2:4]
            return np.asarray(planes_of(moved, p + t * v + 0.5 * t * t * a, v + t * a, a)[0])

        rate = (plane_at(1e-6)[3] - plane_at(-1e-6)[3]) / 2e-6
        plane = plane_at(0.0)
        assert np.hypot(plane[0], plane[1]) == pytest.approx(1.0)
        assert rate + 4.0 * plane[3] == pytest.approx(
            plane[4] * (plane[2] - acceleration @ plane[:2]), rel=1e-4, abs=1e-3
        )
        braked, passed = braked + (plane[4] == 1.0), passed + (plane[4] != 1.0)
    assert braked > 50 and passed > 20


def test_who_flies_past_is_not_slowed_down() -> None:
    """At 6 m/s between two pillars 3 m apart nothing is changed; towards either of them it is."""
    pillars = np.array([[4.0, -1.5, 0.0, 0.0, 0.7], [4.0, 1.5, 0.0, 0.0, 0.7]])
    ahead = planes_of(pillars, STILL, np.array([6.0, 0.0]), np.array([2.0, 0.0]))
    assert (ahead[:, :2] @ np.array([2.0, 0.0]) <= ahead[:, 2]).all() and (ahead[:, 3] > 0.0).all()
    for east in (-1.5, 1.5):
        velocity = 6.0 * np.array([4.0, east]) / math.hypot(4.0, east)
        planes = planes_of(pillars, STILL, velocity, np.zeros(2))
        assert (planes[:, 2] < 0.0).any()
    sideways = planes_of(pillars, STILL, np.array([6.0, 0.0]), np.array([0.0, 9.0]))
    assert (
        sideways[:, :2] @ np.array([0.0, 9.0]) > sideways[:, 2]
    ).any()  # the right one is in the way of a right turn


def test_closing_limit_brakes_in_time_and_is_smooth() -> None:
    distances = np.linspace(-1.0, 12.0, 4001)
    speeds = np.array([closing_limit(d, 4.5, 2.0) for d in distances])
    assert np.allclose(np.gradient(speeds[:, 0], distances)[1:-1], speeds[1:-1, 1], atol=5e-3)
    far = distances > 4.5 / 4.0
    assert np.allclose(speeds[far, 0] * speeds[far, 1], 4.5)  # v dv/ds: the deceleration along the limit
    assert (speeds[:, 0] * speeds[:, 1] <= 4.5 + 1e-9).all()


def test_projection_is_optimal() -> None:
    """The relaxation is the smallest (linear programme); the point is the nearest (its offset is a sum of outward
    normals of the edges that it touches, which is what optimality means here)."""
    rng = np.random.default_rng(2)
    feasible = empty = 0
    for k in range(200):
        planes = random_planes(rng, reach=6.0 if k % 2 else 1.5)
        normals, bounds = planes[:, :2], planes[:, 2]
        command = rng.uniform(-6.0, 6.0, 2)
        found = np.array(nearest_allowed(planes, command[0], command[1]))
        relaxed = max((normals @ found - bounds).max(), 0.0)
        lines = np.column_stack([normals, -np.ones(len(planes))])
        least = linprog([0.0, 0.0, 1.0], lines, bounds, bounds=[(None, None), (None, None), (0.0, None)]).fun
        assert relaxed == pytest.approx(least, abs=1e-5)
        touched = np.abs(normals @ found - bounds - relaxed) < 1e-5
        if touched.any():
            _, residual = nnls(normals[touched].T, command - found)
            assert residual < 1e-4
        else:
            assert np.array_equal(found, command)
        feasible += relaxed == 0.0 or least < 1e-9
        empty += least > 0.01
    assert feasible > 30 and empty > 10


def test_it_never_makes_it_worse() -> None:
    """A command that all barriers allow stays as it is, to the bit; otherwise the worst barrier's rate is better than
    before, and where all can be served each violated one is."""
    rng = np.random.default_rng(3)
    kept = changed = 0
    for _ in range(500):
        planes = random_planes(rng, int(rng.integers(1, 14)), rng.uniform(1.5, 6.0))
        command = rng.uniform(-5.0, 5.0, 2)
        found = np.array(nearest_allowed(planes, command[0], command[1]))
        before = planes[:, 2] - planes[:, :2] @ command
        after = planes[:, 2] - planes[:, :2] @ found
        if (before >= 0.0).all():
            assert np.array_equal(found, command)
            kept += 1
            continue
        changed += 1
        assert after.min() > before.min()
        if after.min() > -1e-6:
            assert (after[before < 0.0] > before[before < 0.0]).all()
    assert kept > 50 and changed > 100
