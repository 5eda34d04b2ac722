"""Control barrier functions of points to keep away from: half-planes of accelerations, and the nearest acceleration in
their intersection.

Two barriers h hold a point off, and one of them must be served:

- The vehicle can stop before the point: h = s(d - keep-out) - c, with the distance d, the closing speed c and the
  highest closing speed s from which `braking` stops in time (the braking barrier of Borrmann et al. 2015).
- The vehicle flies past: h = y - keep-out, with the distance y by which a straight flight misses the point (Thontepu
  et al. 2022 bound the collision cone so).

h' >= -gain h is a half-plane of accelerations (Ames et al. 2019). The barrier that the command comes nearer to is
served; the second only if it holds already or nearly so, or the vehicle would steer past a wall instead of stopping at
it. The nearest acceleration in the intersection has a closed form in two dimensions: the command itself, its foot on
one edge, or the vertex of two edges. Where the intersection is empty, all half-planes are relaxed by the same, smallest
amount.
"""

import math
from typing import NamedTuple

import numpy as np

from companion.avoidance.clearance import MIN_SPEED, Place
from protocol.arrays import Array
from protocol.jit import compiled

_MAX_HALF_PLANES = 16
_TOLERANCE = 1e-9
_GRAZE = 0.1
"""m of keep-out that a flight past may lack to be steered farther out instead of braked."""
_BISECTIONS = 24


class Barrier(NamedTuple):
    """How a keep-out may be approached."""

    braking: float
    """m/s2"""
    gain: float
    """1/s: how fast h may fall by its own size, and rises where it is negative."""
    closing_gain: float
    """1/s: closing speed over distance, close to the keep-out."""


@compiled
def closing_limit(distance: float, braking: float, closing_gain: float) -> tuple[float, float]:
    """The highest closing speed (m/s) at a distance (m) from the keep-out, and its slope (1/s).

    It is the square root of the braking distance, continued by its tangent of slope `closing_gain`; negative within the
    keep-out.
    """
    linear_up_to = braking / (closing_gain * closing_gain)
    if distance <= linear_up_to:
        return closing_gain * distance, closing_gain
    speed = math.sqrt(2.0 * braking * (distance - 0.5 * linear_up_to))
    return speed, braking / speed


@compiled
def half_planes(points: Array, place: Place, velocity: Place, command: Place, barrier: Barrier) -> Array:
    """(n, 5) for points (n, 5) of `perception.free_space`: a unit vector, the bound of the acceleration along it
    (m/s2), h, and the scale of its rate: h' + gain h = scale (bound - acceleration along the vector).

    `place` (m, NED), `velocity` (m/s) and the commanded acceleration (m/s2) are the vehicle's.
    """
    planes = np.empty((points.shape[0], 5))
    for k in range(points.shape[0]):
        dn, de = points[k, 0] - place[0], points[k, 1] - place[1]
        distance = max(math.hypot(dn, de), 1e-3)
        un, ue = dn / distance, de / distance
        vn, ve = velocity[0] - points[k, 2], velocity[1] - points[k, 3]
        closing, across = vn * un + ve * ue, ve * un - vn * ue
        limit, slope = closing_limit(distance - points[k, 4], barrier.braking, barrier.closing_gain)
        h = limit - closing
        bound = barrier.gain * h - slope * closing + across * across / distance
        planes[k] = un, ue, bound, h, 1.0
        speed = math.hypot(vn, ve)
        if closing <= 0.0 or speed < MIN_SPEED or distance <= points[k, 4]:
            continue
        miss = distance * abs(across) / speed
        if miss < points[k, 4] - _GRAZE:
            continue
        side = 1.0 if across > 0.0 else -1.0
        gn = (-side * de - miss * vn / speed) / speed
        ge = (side * dn - miss * ve / speed) / speed
        scale = math.hypot(gn, ge)
        past = barrier.gain * (miss - points[k, 4]) / scale
        if past + (gn * command[0] + ge * command[1]) / scale > bound - un * command[0] - ue * command[1]:
            planes[k] = -gn / scale, -ge / scale, past, miss - points[k, 4], scale
    return planes


@compiled
def _feasible(planes: Array, relaxed: float, north: float, east: float) -> bool:
    for k in range(planes.shape[0]):
        if planes[k, 0] * north + planes[k, 1] * east > planes[k, 2] + relaxed + _TOLERANCE:
            return False
    return True


@compiled
def _project(planes: Array, relaxed: float, north: float, east: float) -> tuple[bool, float, float]:
    """The nearest point to a point in the intersection of half-planes; False if the intersection is empty."""
    if _feasible(planes, relaxed, north, east):
        return True, north, east
    best, best_n, best_e = math.inf, north, east
    count = planes.shape[0]
    for k in range(count):
        excess = planes[k, 0] * north + planes[k, 1] * east - planes[k, 2] - relaxed
        if excess <= 0.0:
            continue
        foot_n, foot_e = north - excess * planes[k, 0], east - excess * planes[k, 1]
        if excess < best and _feasible(planes, relaxed, foot_n, foot_e):
            best, best_n, best_e = excess, foot_n, foot_e
    if best < math.inf:
        return True, best_n, best_e
    for k in range(count):
        for m in range(k):
            cross = planes[k, 0] * planes[m, 1] - planes[k, 1] * planes[m, 0]
            if abs(cross) < 1e-6:
                continue
            b, c = planes[k, 2] + relaxed, planes[m, 2] + relaxed
            vertex_n = (b * planes[m, 1] - c * planes[k, 1]) / cross
            vertex_e = (c * planes[k, 0] - b * planes[m, 0]) / cross
            away = math.hypot(vertex_n - north, vertex_e - east)
            if away < best and _feasible(planes, relaxed, vertex_n, vertex_e):
                best, best_n, best_e = away, vertex_n, vertex_e
    return best < math.inf, best_n, best_e


@compiled
def nearest_allowed(planes: Array, north: float, east: float) -> Place:
    """The acceleration (m/s2) nearest to a commanded one that all half-planes (n, 5) allow; where there is none, they
    are relaxed by the smallest amount that lets one through."""
    found, n, e = _project(planes, 0.0, north, east)
    if found:
        return n, e
    low, high = 0.0, 0.0
    for k in range(planes.shape[0]):
        high = max(high, planes[k, 0] * north + planes[k, 1] * east - planes[k, 2])
    n, e = north, east
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        found, middle_n, middle_e = _project(planes, middle, north, east)
        if found:
            high, n, e = middle, middle_n, middle_e
        else:
            low = middle
    return n, e


@compiled
def tightest(planes: Array) -> Array:
    """The half-planes (n, 5) with the smallest bounds, at most `_MAX_HALF_PLANES`."""
    if planes.shape[0] <= _MAX_HALF_PLANES:
        return planes
    order = np.argsort(planes[:, 2], kind="mergesort")
    return planes[order[:_MAX_HALF_PLANES]]
