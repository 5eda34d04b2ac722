"""VFH+ on the map: a direction to fly, for where no path can be planned.

Ulrich and Borenstein 1998. As published: the primary histogram m = c^2 (a - b d^2) with a - b d^2 = 0 at the edge of
the window; each cell enlarged by asin(radius / d); two thresholds with hysteresis; masking of directions that the
vehicle can't turn to without meeting an obstacle; openings, narrow ones through their middle, wide ones along their
borders or straight to the goal; the cost of three terms with weights 5, 2, 2.

Differences: the certainty c is 1 for each occupied cell, since the map holds probabilities already. Sectors of 5
degrees count from north. The sum of a sector is scaled by the area of a cell, so that the thresholds do not depend on
it. A vehicle nearer to an obstacle than the radius may fly any direction that leads away.
"""

import math

import numpy as np
from msgspec.structs import replace

from companion.avoidance.path import NO_PATH, Path
from companion.config_avoidance import Avoidance, AvoidanceVfh
from companion.perception.map_view import OCCUPIED, Bytes, MapView
from protocol.arrays import Array, BoolArray
from protocol.frames import wrap
from protocol.jit import compiled

SECTORS = 72
_SECTOR = 2.0 * math.pi / SECTORS
"""rad"""
_WIDE = 16
"""Sectors (80 degrees) from which on an opening is wide; the vehicle stays half of that inside its borders."""
_GOAL_WEIGHT, _HEADING_WEIGHT, _PREVIOUS_WEIGHT = 5.0, 2.0, 2.0
_MIN_SPEED = 0.3
"""m/s; a slower velocity has no heading."""


class VfhPlanner:
    """The method "vfh", and the fallback of the other mapped ones: a bearing without vertices."""

    def __init__(self, settings: Avoidance) -> None:
        self._vfh = Vfh(settings.vfh)

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path:
        """See `methods.PathPlanner`; without a bearing if all directions are blocked."""
        return replace(NO_PATH, bearing=self._vfh.choose(view, position, velocity, goal))


class Vfh:
    """Chooses at each view; remembers which sectors were blocked and which direction it chose."""

    def __init__(self, settings: AvoidanceVfh) -> None:
        self._settings = settings
        self._blocked = np.zeros(SECTORS, np.bool_)
        self._previous: float | None = None

    def choose(self, view: MapView, position_ned: Array, velocity_ned: Array, goal_ned: Array) -> float | None:
        """Direction to fly (rad, clockwise from north), None if all are blocked; m and m/s, (2,) or (3,) NED."""
        s = self._settings
        place = (
            float(position_ned[0]) - view.corner[0] * view.cell,
            float(position_ned[1]) - view.corner[1] * view.cell,
        )
        goal = math.atan2(goal_ned[1] - position_ned[1], goal_ned[0] - position_ned[0])
        speed = math.hypot(velocity_ned[0], velocity_ned[1])
        heading = math.atan2(velocity_ned[1], velocity_ned[0]) if speed > _MIN_SPEED else goal
        density = densities(view.states, view.cell, place, s.window, s.enlargement_radius)
        self._blocked = np.where(self._blocked, density > s.low_threshold, density > s.high_threshold)
        turn = heading, speed * speed / s.turning_acceleration
        masked = mask(self._blocked, view.states, view.cell, place, s.window, s.enlargement_radius, turn)
        previous = heading if self._previous is None else self._previous
        course = cheapest(masked, goal, heading, previous)
        if math.isnan(course):
            self._previous = None
            return None
        self._previous = course
        return course


@compiled
def densities(states: Bytes, cell: float, place: tuple[float, float], window: float, radius: float) -> Array:
    """The primary polar histogram (SECTORS,) (m2) around a place that counts from the map's corner (m).

    `states` (rows, columns); `cell`, `window` and `radius` in m.
    """
    north, east = place
    result = np.zeros(SECTORS)
    rows, columns = states.shape
    for i in range(max(math.floor((north - window) / cell), 0), min(math.ceil((north + window) / cell), rows)):
        dn = (i + 0.5) * cell - north
        for j in range(max(math.floor((east - window) / cell), 0), min(math.ceil((east + window) / cell), columns)):
            if states[i, j] != OCCUPIED:
                continue
            de = (j + 0.5) * cell - east
            distance = math.hypot(dn, de)
            if distance >= window:
                continue
            weight = cell * cell * (1.0 - (distance / window) ** 2)
            # Within the radius: the half-plane that leads towards it.
            half = math.asin(radius / distance) if distance > radius else 0.5 * math.pi
            bearing = math.atan2(de, dn)
            first, last = math.ceil((bearing - half) / _SECTOR), math.floor((bearing + half) / _SECTOR)
            for k in range(first, last + 1):
                result[k % SECTORS] += weight
    return result


@compiled
def mask(
    blocked: BoolArray,
    states: Bytes,
    cell: float,
    place: tuple[float, float],
    window: float,
    radius: float,
    turn: tuple[float, float],
) -> BoolArray:
    """The masked histogram (SECTORS,): directions beyond an obstacle that the vehicle meets while it turns are blocked.

    `place` counts from the map's corner (m); `turn`: heading (rad) and radius of the turning circles (m). An enlarged
    obstacle that touches a turning circle blocks all directions from its own to straight back on that side.
    """
    north, east = place
    heading, turning = turn
    left, right = -math.pi, math.pi
    rows, columns = states.shape
    reach = min(window, 2.0 * turning + radius)
    ahead_n, ahead_e = math.cos(heading), math.sin(heading)
    for i in range(max(math.floor((north - reach) / cell), 0), min(math.ceil((north + reach) / cell), rows)):
        dn = (i + 0.5) * cell - north
        for j in range(max(math.floor((east - reach) / cell), 0), min(math.ceil((east + reach) / cell), columns)):
            if states[i, j] != OCCUPIED:
                continue
            de = (j + 0.5) * cell - east
            along, across = dn * ahead_n + de * ahead_e, de * ahead_n - dn * ahead_e
            if along * along + across * across <= radius * radius:
                continue  # too near already: the histogram leaves the directions away from it
            bearing = math.atan2(across, along)
            if across > 0.0 and bearing < right and math.hypot(along, across - turning) < turning + radius:
                right = bearing
            if across < 0.0 and bearing > left and math.hypot(along, across + turning) < turning + radius:
                left = bearing
    result = blocked.copy()
    for k in range(SECTORS):
        aside = wrap(k * _SECTOR - heading)
        if aside > right or aside < left:
            result[k] = True
    return result


@compiled
def _apart(a: float, b: float) -> float:
    return abs(wrap(a - b))


@compiled
def cheapest(blocked: BoolArray, goal: float, heading: float, previous: float) -> float:
    """The candidate direction (rad) of the lowest cost; NaN if all sectors (SECTORS,) are blocked."""
    candidates = _candidates(blocked, goal)
    best, best_cost = math.nan, math.inf
    for course in candidates:
        cost = _GOAL_WEIGHT * _apart(course, goal)
        cost += _HEADING_WEIGHT * _apart(course, heading) + _PREVIOUS_WEIGHT * _apart(course, previous)
        if cost < best_cost - 1e-9:
            best, best_cost = course, cost
    return best


@compiled
def _candidates(blocked: BoolArray, goal: float) -> Array:
    """Directions (n,) (rad) through the openings between blocked sectors (SECTORS,)."""
    result = np.empty(3 * SECTORS)
    if not blocked.any():
        result[0] = goal
        return result[:1]
    count = 0
    goal_sector = round(goal / _SECTOR) % SECTORS
    for first in range(SECTORS):
        if blocked[first] or not blocked[first - 1]:
            continue
        width = 1
        while not blocked[(first + width) % SECTORS]:
            width += 1
        last = first + width - 1
        if width < _WIDE:
            result[count] = wrap(0.5 * (first + last) * _SECTOR)
            count += 1
            continue
        result[count] = wrap((first + _WIDE / 2) * _SECTOR)
        result[count + 1] = wrap((last - _WIDE / 2) * _SECTOR)
        count += 2
        inside = (goal_sector - first) % SECTORS
        if _WIDE / 2 <= inside <= width - 1 - _WIDE / 2:
            result[count] = goal
            count += 1
    return result[:count]
