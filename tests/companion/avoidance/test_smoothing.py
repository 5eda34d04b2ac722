"""Smooth paths for fast flight: wide curves, begun along the velocity, that keep the room there was."""

import itertools
import math

import numpy as np
import pytest

from companion.avoidance.smoothing import curvature, curve_speeds, smoothed
from companion.perception.distance_field import distance_to
from companion.perception.map_view import FREE, OCCUPIED, MapView
from protocol.arrays import Array

CELL = 0.125
INFLATION = 0.6
LIMITS = 10.0, 6.0, 4.5
CORNER = np.array([[2.0, 10.0], [12.0, 10.0], [20.0, 16.0], [28.0, 16.0]])


def view_of(*obstacles: tuple[float, float]) -> MapView:
    """30 x 30 m, free but for these places."""
    states = np.full((240, 240), FREE, np.uint8)
    for north, east in obstacles:
        states[int(north / CELL), int(east / CELL)] = OCCUPIED
    return MapView(states, distance_to(states == OCCUPIED, CELL), (0, 0), CELL)


def clearance_along(view: MapView, points: Array) -> float:
    samples = [a + share * (b - a) for a, b in itertools.pairwise(points) for share in (0.0, 0.25, 0.5, 0.75)]
    return min(view.distance_at(place) or 0.0 for place in samples)


def turns(points: Array) -> Array:
    """rad at each point between two legs."""
    legs = np.diff(points, axis=0)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    return np.abs((np.diff(headings) + np.pi) % (2.0 * np.pi) - np.pi)


def test_corners_become_curves_that_are_flown_faster() -> None:
    points, speeds = smoothed(CORNER, view_of(), np.array([8.0, 0.0]), INFLATION, LIMITS)
    np.testing.assert_allclose(points[[0, -1]], CORNER[[0, -1]])
    assert turns(points).max() < 0.2 < turns(CORNER).min()
    assert speeds[:15].min() > 7.0 and speeds[-1] == 0.0
    assert np.abs(points - np.clip(points, CORNER.min(axis=0) - 3.0, CORNER.max(axis=0) + 3.0)).max() == 0.0


def test_the_path_begins_along_the_velocity() -> None:
    straight = np.array([[5.0, 10.0], [15.0, 10.0], [25.0, 10.0]])
    for east in (6.0, -6.0):
        points, _ = smoothed(straight, view_of(), np.array([6.0, east]), INFLATION, LIMITS)
        assert math.copysign(1.0, points[1, 1] - 10.0) == math.copysign(1.0, east)
    points, _ = smoothed(straight, view_of(), np.zeros(3), INFLATION, LIMITS)
    np.testing.assert_allclose(points[:, 1], 10.0, atol=1e-9)


def test_no_curve_comes_nearer_to_an_obstacle_than_the_corner_did_or_is_allowed() -> None:
    inside = view_of((13.5, 11.8), (18.5, 14.0))
    before = clearance_along(inside, CORNER)
    points, _ = smoothed(CORNER, inside, np.array([8.0, 0.0]), INFLATION, LIMITS)
    assert clearance_along(inside, points) >= min(before, INFLATION) - CELL
    free, _ = smoothed(CORNER, view_of(), np.array([8.0, 0.0]), INFLATION, LIMITS)
    assert clearance_along(inside, free) < clearance_along(inside, points), "they were in the way"


def test_what_lies_far_ahead_stays_as_it_was() -> None:
    far = np.array([[2.0, 2.0], [22.0, 2.0], [22.0, 25.0], [40.0, 25.0]])
    points, speeds = smoothed(far, view_of(), np.array([5.0, 0.0]), INFLATION, LIMITS)
    np.testing.assert_allclose(points[-2:], far[-2:])
    assert len(points) == len(speeds) and np.hypot(*np.diff(points[:31], axis=0).T).max() < 1.2


def test_the_curvature_is_that_of_the_circle_positive_to_the_right() -> None:
    angles = np.arange(0.0, 2.0, 0.1)
    right = 8.0 * np.column_stack((np.sin(angles), 1.0 - np.cos(angles)))
    for k in (0, 1, 9, len(angles) - 1):
        assert curvature(right, k) == pytest.approx(0.0 if k in (0, len(angles) - 1) else 1.0 / 8.0)
        assert curvature(right * [1.0, -1.0], k) == -curvature(right, k)


def test_the_speed_on_a_circle_is_that_of_its_lateral_acceleration() -> None:
    angles = np.arange(0.0, 3.0, 0.1)
    circle = 5.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    speeds = curve_speeds(circle, 10.0, 5.0, 1e6)
    np.testing.assert_allclose(speeds[2:-2], 5.0, rtol=1e-6)
    braked = curve_speeds(circle, 10.0, 5.0, 2.0)
    legs = np.hypot(*np.diff(circle, axis=0).T)
    assert (np.diff(braked**2) >= -2.0 * 2.0 * legs - 1e-9).all() and braked[-1] == 0.0


@pytest.mark.parametrize("turn", [0.7, 2.9])
def test_a_turned_path_is_the_same_path_turned(turn: float) -> None:
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    middle = np.array([15.0, 13.0])
    points, speeds = smoothed(CORNER, view_of(), np.array([8.0, 0.0]), INFLATION, LIMITS)
    turned = (CORNER - middle) @ rotation.T + middle
    others, same = smoothed(turned, view_of(), rotation @ np.array([8.0, 0.0]), INFLATION, LIMITS)
    np.testing.assert_allclose((points - middle) @ rotation.T + middle, others, atol=1e-6)
    np.testing.assert_allclose(speeds, same, atol=1e-6)
