"""A path for fast flight: its corners become wide curves, within the room that the map shows, so that less speed is
lost at them.

The points of the path, evenly spaced, move to where a beam without forces would lie between their neighbours (the
fourth difference vanishes), one after the other, as long as that takes them no nearer to obstacles than allowed. The
path begins along the present velocity.
"""

import math

import numpy as np

from companion.perception.distance_field import Floats, between
from companion.perception.map_view import MapView
from protocol.arrays import Array
from protocol.jit import compiled

_SPACING_M = 1.0
_LENGTH_M = 30.0
"""m of path that are smoothed; what lies farther is planned anew before it is flown."""
_ROUNDS = 150
_SHARE = 0.8
"""Share of the way to the beam's place that a point moves in a round."""
_ASIDE_M = 3.0
"""m that a point may move from where it was."""
_MARGIN_M = 0.2
"""m of clearance beyond the inflation, where there was so much."""
_LEAST_SPEED = 1.0
"""m/s; a slower vehicle may begin in any direction."""
_LATERAL_SHARE = 0.8
"""Share of the acceleration that is for the curves; the rest corrects."""

Place = tuple[float, float]


def smoothed(
    vertices: Array, view: MapView, velocity: Array, inflation: float, limits: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Vertices (n, 2) (m, NED) of the smooth path and the speed (n,) (m/s) at each, for a path (k, 2) that keeps the
    `inflation` (m), with the vehicle's velocity (2,) or (3,) at its start.

    `limits`: speed (m/s), lateral acceleration and braking (m/s2).
    """
    points, count = _resampled(vertices)
    origin = view.corner[0] * view.cell, view.corner[1] * view.cell
    motion = float(velocity[0]), float(velocity[1])
    _smooth(points[:count], view.to_occupied, (*origin, view.cell), inflation + _MARGIN_M, motion)
    speed, acceleration, braking = limits
    return points, curve_speeds(points, speed, _LATERAL_SHARE * acceleration, braking)


@compiled
def _resampled(vertices: Array) -> tuple[Array, int]:
    """Points (n, 2) along a path (k, 2): so many of them evenly spaced, then the vertices that are left."""
    legs = np.empty(vertices.shape[0] - 1)
    for k in range(legs.shape[0]):
        legs[k] = math.hypot(vertices[k + 1, 0] - vertices[k, 0], vertices[k + 1, 1] - vertices[k, 1])
    length = min(legs.sum(), _LENGTH_M)
    count = max(math.ceil(length / _SPACING_M), 2) + 1
    points = np.empty((count + legs.shape[0], 2))
    k, passed = 0, 0.0
    for i in range(count):
        way = length * i / (count - 1)
        while k < legs.shape[0] - 1 and passed + legs[k] < way:
            passed += legs[k]
            k += 1
        points[i] = vertices[k] + min((way - passed) / max(legs[k], 1e-9), 1.0) * (vertices[k + 1] - vertices[k])
    rest = vertices[k + 1 :] if legs.sum() > _LENGTH_M else vertices[:0]
    points[count : count + rest.shape[0]] = rest
    return points[: count + rest.shape[0]], count


@compiled
def _clearance(near: Floats, corner: tuple[float, float, float], place: Place) -> float:
    """m to the nearest obstacle at a place (m, NED); `corner`: of the map (m, NED), and the side of a cell."""
    return between(near, (place[0] - corner[0]) / corner[2] - 0.5, (place[1] - corner[1]) / corner[2] - 0.5)


@compiled
def _keeps_clear(
    near: Floats, corner: tuple[float, float, float], least: float, places: tuple[Place, Place], other: Place
) -> bool:
    """Whether the leg to another point is no nearer to obstacles than `least` (m), or than before, once its end has
    moved from the first place to the second: there and half way."""
    old, new = places
    halfway_old = 0.5 * (old[0] + other[0]), 0.5 * (old[1] + other[1])
    halfway_new = 0.5 * (new[0] + other[0]), 0.5 * (new[1] + other[1])
    if _clearance(near, corner, new) < min(least, _clearance(near, corner, old)):
        return False
    return _clearance(near, corner, halfway_new) >= min(least, _clearance(near, corner, halfway_old))


@compiled
def _smooth(points: Array, near: Floats, corner: tuple[float, float, float], least: float, velocity: Place) -> None:
    """Move the points (n, 2) but for both ends; see the module."""
    last = points.shape[0] - 1
    given, speed = points.copy(), math.hypot(velocity[0], velocity[1])
    step = math.hypot(points[1, 0] - points[0, 0], points[1, 1] - points[0, 1])
    before, beyond = np.empty(2), np.empty(2)
    for _ in range(_ROUNDS):
        for axis in range(2):
            onward = points[1, axis] - points[0, axis]
            before[axis] = points[0, axis] - (step * velocity[axis] / speed if speed > _LEAST_SPEED else onward)
            beyond[axis] = 2.0 * points[last, axis] - points[last - 1, axis]
        for i in range(1, last):
            far_before = before if i == 1 else points[i - 2]
            far_beyond = beyond if i == last - 1 else points[i + 2]
            beam = (4.0 * (points[i - 1] + points[i + 1]) - far_before - far_beyond) / 6.0
            moved = points[i] + _SHARE * (beam - points[i])
            if math.hypot(moved[0] - given[i, 0], moved[1] - given[i, 1]) > _ASIDE_M:
                continue
            places = (points[i, 0], points[i, 1]), (moved[0], moved[1])
            ahead, back = (points[i + 1, 0], points[i + 1, 1]), (points[i - 1, 0], points[i - 1, 1])
            if _keeps_clear(near, corner, least, places, ahead) and _keeps_clear(near, corner, least, places, back):
                points[i] = moved


@compiled
def curvature(points: Array, i: int) -> float:
    """1/m, positive to the right, of a curve (n, 2) (m, NED) at one of its points: that of the circle through it and
    the points two before and two after; 0 where two of them are one."""
    a, b, c = points[max(i - 2, 0)], points[i], points[min(i + 2, points.shape[0] - 1)]
    sides = math.hypot(b[0] - a[0], b[1] - a[1]) * math.hypot(c[0] - b[0], c[1] - b[1])
    sides *= math.hypot(c[0] - a[0], c[1] - a[1])
    if sides < 1e-9:
        return 0.0
    turn: float = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    return 2.0 * turn / sides


@compiled
def curve_speeds(points: Array, speed: float, acceleration: float, braking: float) -> Array:
    """Speed (n,) (m/s) at each of the points (n, 2) (m) of a curve that ends at rest, at most `speed` (m/s): within the
    lateral `acceleration` (m/s2) and the `braking` (m/s2) to what comes."""
    last = points.shape[0] - 1
    speeds = np.full(last + 1, speed)
    speeds[last] = 0.0
    for i in range(1, last):
        speeds[i] = min(speed, math.sqrt(acceleration / max(abs(curvature(points, i)), 1e-9)))
    for i in range(last - 1, -1, -1):
        leg = math.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1])
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2.0 * braking * leg))
    return speeds
