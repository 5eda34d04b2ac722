"""Minimum snap: the curve is the programme's own solution, found by other means, and it keeps to its limits."""

import math

import numpy as np
import pytest

from companion.config import Trajectory
from companion.curves import Route
from companion.trajectory import track_of
from companion.trajectory.minimum_snap import (
    Limits,
    PiecewisePolynomial,
    optimal_shares,
    plan,
    rest_to_rest_durations,
    snap_integral,
    spline_through,
    subdivided,
)
from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY

LIMITS = Limits(speed=4.0, acceleration=3.0, tilt=math.radians(35.0))
ROUTE = np.array([[0.0, 0.0, 0.0], [10.0, 5.0, -1.0], [20.0, -5.0, 0.0], [22.0, 5.0, -2.0], [40.0, 0.0, 0.0]])


def derivative_row(order: int, x: float) -> Array:
    """(8,) by which the coefficients give the derivative at x."""
    return np.array([math.perm(k, order) * x ** max(k - order, 0) if k >= order else 0.0 for k in range(8)])


def programme(points: Array, durations: Array) -> tuple[Array, float]:
    """Coefficients (n, 8) and value for one axis: the quadratic programme with its constraints as they are stated
    (through the points, at rest at the ends, continuous up to snap alone), by the null space of the constraints."""
    n = len(durations)
    cost = np.zeros((8 * n, 8 * n))
    rows, values = [], []

    def constrain(entries: list[tuple[int, Array]], value: float) -> None:
        row = np.zeros(8 * n)
        for leg, entry in entries:
            row[8 * leg : 8 * leg + 8] = entry
        rows.append(row)
        values.append(value)

    for leg, duration in enumerate(durations.tolist()):
        for i in range(4, 8):
            for j in range(4, 8):
                weight = math.perm(i, 4) * math.perm(j, 4) / (i + j - 7)
                cost[8 * leg + i, 8 * leg + j] = weight * duration ** (i + j - 7)
        constrain([(leg, derivative_row(0, 0.0))], points[leg])
        constrain([(leg, derivative_row(0, duration))], points[leg + 1])
        for order in range(1, 5):
            if leg + 1 < n:
                constrain([(leg, derivative_row(order, duration)), (leg + 1, -derivative_row(order, 0.0))], 0.0)
    for order in (1, 2, 3):
        constrain([(0, derivative_row(order, 0.0))], 0.0)
        constrain([(n - 1, derivative_row(order, float(durations[-1])))], 0.0)
    A = np.array(rows)
    particular = np.linalg.lstsq(A, np.array(values), rcond=None)[0]
    free = np.linalg.svd(A)[2][np.linalg.matrix_rank(A) :].T
    solution = particular - free @ np.linalg.lstsq(free.T @ cost @ free, free.T @ cost @ particular, rcond=None)[0]
    return solution.reshape(n, 8), float(solution @ cost @ solution)


def test_it_solves_the_quadratic_programme() -> None:
    durations = np.array([2.0, 1.5, 1.8, 3.0])
    curve = spline_through(ROUTE, durations)
    total = 0.0
    for axis in range(3):
        coefficients, least = programme(ROUTE[:, axis], durations)
        assert np.allclose(curve.coefficients[:, :, axis], coefficients, rtol=1e-5, atol=1e-5)
        total += least
    assert snap_integral(curve) == pytest.approx(total, rel=1e-7)


def test_one_leg_is_the_known_polynomial() -> None:
    curve = spline_through(np.array([[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]]), np.array([2.0]))
    expected = np.zeros(8)
    expected[4:] = 8.0 * np.array([35.0, -84.0, 70.0, -20.0]) / 2.0 ** np.arange(4, 8)
    assert np.allclose(curve.coefficients[0, :, 0], expected)
    assert snap_integral(curve) == pytest.approx(100_800.0 * 8.0**2 / 2.0**7)


def sampled(curve: PiecewisePolynomial, count: int = 20_001) -> Array:
    return np.array([curve.at(t) for t in np.linspace(0.0, curve.duration_s, count).tolist()])


def test_derivatives_belong_to_the_position() -> None:
    curve = plan(ROUTE, LIMITS)
    for time in np.linspace(0.31, curve.duration_s - 0.3, 17).tolist():
        derivative = (8.0 * (curve.at(time + 1e-3) - curve.at(time - 1e-3))) / 12e-3
        derivative -= (curve.at(time + 2e-3) - curve.at(time - 2e-3)) / 12e-3
        assert np.allclose(derivative[:4], curve.at(time)[1:], atol=1e-6)


def test_joints_are_continuous_up_to_snap_and_the_ends_at_rest() -> None:
    curve = plan(ROUTE, LIMITS)
    for knot in curve.knots[1:-1].tolist():
        assert np.allclose(curve.at(knot - 1e-9), curve.at(knot), atol=1e-6)
    for end, point in ((0.0, ROUTE[0]), (curve.duration_s, ROUTE[-1])):
        assert np.allclose(curve.at(end)[0], point, atol=1e-9)
        assert np.allclose(curve.at(end)[1:4], 0.0, atol=1e-6)


def test_stretching_is_the_same_curve_at_another_time() -> None:
    curve = plan(ROUTE, LIMITS)
    slow = curve.stretched(2.0)
    assert np.allclose(slow.at(2.0 * 3.3), curve.at(3.3) / 2.0 ** np.arange(5)[:, np.newaxis])


@pytest.mark.parametrize(
    ("limits", "binding"),
    [
        (Limits(20.0, 3.0, math.radians(35.0)), "acceleration"),
        (Limits(1.0, 3.0, math.radians(35.0)), "speed"),
        (Limits(50.0, 50.0, math.radians(20.0)), "tilt"),
    ],
)
def test_it_reaches_one_limit_and_passes_none(limits: Limits, binding: str) -> None:
    motion = sampled(plan(ROUTE, limits))
    sideways = np.hypot(motion[:, 2, 0], motion[:, 2, 1])
    used = {
        "speed": np.linalg.norm(motion[:, 1], axis=1).max() / limits.speed,
        "acceleration": np.linalg.norm(motion[:, 2], axis=1).max() / limits.acceleration,
        "tilt": np.arctan2(sideways, GRAVITY - motion[:, 2, 2]).max() / (0.8 * limits.tilt),
    }
    assert max(used.values()) <= 1.0
    assert used[binding] > 0.995


def test_it_passes_through_all_points() -> None:
    points = subdivided(ROUTE, LIMITS)
    curve = plan(ROUTE, LIMITS)
    assert np.allclose([curve.at(t)[0] for t in curve.knots.tolist()], points, atol=1e-9)
    for point in ROUTE:
        assert (np.abs(points - point).max(axis=1) < 1e-12).any()


def test_the_allocation_saves_time() -> None:
    """Against legs as if each were flown on its own, and no change of the shares is better."""
    uneven = np.array([[0.0, 0, 0], [2, 0, 0], [20, 0, 0], [22, 2, 0], [20, 20, 0]])

    def time(durations: Array) -> float:
        curve = spline_through(uneven, durations)
        motion = sampled(curve, 4001)
        fast = float(np.linalg.norm(motion[:, 1], axis=1).max()) / LIMITS.speed
        hard = float(np.linalg.norm(motion[:, 2], axis=1).max()) / LIMITS.acceleration
        return curve.duration_s * max(fast, math.sqrt(hard))

    found = optimal_shares(uneven, LIMITS)
    assert time(found) < 0.8 * time(rest_to_rest_durations(uneven, LIMITS.speed, LIMITS.acceleration))
    rng = np.random.default_rng(1)
    others = [time(found * rng.uniform(0.9, 1.1, len(found))) for _ in range(30)]
    assert min(others) > 0.97 * time(found)


def test_a_long_straight_leg_is_flown_at_speed_for_most_of_it() -> None:
    curve = plan(np.array([[0.0, 0.0, 0.0], [120.0, 0.0, 0.0]]), LIMITS)
    motion = sampled(curve)
    assert np.allclose(motion[:, 0, 1:], 0.0, atol=1e-9)
    assert (motion[:, 1, 0] > -1e-9).all()
    assert curve.duration_s < 1.5 * 120.0 / 4.0


def test_a_route_as_a_track_and_what_is_left_of_it() -> None:
    track = track_of(Route(ROUTE, 4.0), Trajectory(), LIMITS.tilt)
    assert np.allclose(track.at(1e9)[0], ROUTE[-1]) and not track.at(1e9)[1:5].any()
    left = track.resumed_at(4.0)
    assert np.allclose(left.start_ned, track.at(4.0)[0]) and not left.at(0.0)[1:5].any()
    assert np.allclose(left.at(1e9)[0], ROUTE[-1])
    motion = np.array([left.at(t) for t in np.linspace(0.0, left.duration_s, 2001).tolist()])
    assert np.linalg.norm(motion[:, 1], axis=1).max() <= 4.0


@pytest.mark.parametrize("tilt_deg", [6.0, 20.0, 45.0])
def test_what_is_left_of_a_route_keeps_within_the_tilt(tilt_deg: float) -> None:
    tilt = math.radians(tilt_deg)
    track = track_of(Route(ROUTE, 4.0), Trajectory(), tilt)
    for reached in np.linspace(0.1, 0.9, 5).tolist():
        left = track.resumed_at(reached * track.duration_s)
        motion = np.array([left.at(t) for t in np.linspace(0.0, left.duration_s, 801).tolist()])
        level = np.hypot(motion[:, 2, 0], motion[:, 2, 1])
        assert np.arctan2(level, GRAVITY - motion[:, 2, 2]).max() <= tilt
