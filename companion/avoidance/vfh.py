"""VFH+ on the map: the direction to fly, when there is no way to be planned.

Ulrich and Borenstein 1998. What is kept: the primary histogram m = c^2 (a - b d^2) with a - b d^2 = 0 at the window's
edge, each cell enlarged by asin(radius / d); two thresholds with hysteresis; directions that the vehicle can't turn to
without meeting something masked; openings, narrow ones through their middle, wide ones along their borders or straight
to the goal; the three-term cost 5, 2, 2. Differences: the certainty c is 1 for every occupied cell of the map, which is
already a probability; sectors of 5 degrees count from north; a sector's sum is scaled by the cell's area, so that the
thresholds do not depend on the cell; who is nearer to something than the radius may go any way that leads off.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.perception.map_view import OCCUPIED, Bytes, MapView
from protocol.arrays import Array, BoolArray
from protocol.frames import wrap
from protocol.jit import compiled

SECTORS = 72
_SECTOR = 2.0 * math.pi / SECTORS
_WIDE = 16
"""Sectors, 80 degrees, from which on an opening is wide; half of it is kept from its borders."""
_GOAL_WEIGHT, _HEADING_WEIGHT, _PREVIOUS_WEIGHT = 5.0, 2.0, 2.0


@dataclass(frozen=True, slots=True)
class VfhSettings:
    """Of the histogram."""

    window: float
    """m around the vehicle that count."""
    radius: float
    """m by which obstacles are enlarged: the vehicle's and the room it wants."""
    low: float
    high: float
    """Density (m2, weighted by nearness) below which a sector becomes free and above which it becomes blocked."""
    turning_acceleration: float
    """m/s2 sideways, for the turning circles."""


class Vfh:
    """Decides at each view; remembers which sectors were blocked and where it went."""

    def __init__(self, settings: VfhSettings) -> None:
        self._settings = settings
        self._blocked = np.zeros(SECTORS, np.bool_)
        self._previous: float | None = None

    def choose(self, view: MapView, position_ned: Array, velocity_ned: Array, goal_ned: Array) -> float | None:
        """Course (rad, clockwise from north) to fly; None if every direction is blocked."""
        s = self._settings
        north = float(position_ned[0]) - view.corner[0] * view.cell
        east = float(position_ned[1]) - view.corner[1] * view.cell
        goal = math.atan2(goal_ned[1] - position_ned[1], goal_ned[0] - position_ned[0])
        speed = math.hypot(velocity_ned[0], velocity_ned[1])
        heading = math.atan2(velocity_ned[1], velocity_ned[0]) if speed > 0.3 else goal
        density = densities(view.states, view.cell, north, east, s.window, s.radius)
        self._blocked = np.where(self._blocked, density > s.low, density > s.high)
        turning = speed * speed / s.turning_acceleration
        masked = mask(self._blocked, view.states, view.cell, north, east, s.window, s.radius, heading, turning)
        previous = heading if self._previous is None else self._previous
        course = cheapest(masked, goal, heading, previous)
        if math.isnan(course):
            self._previous = None
            return None
        self._previous = course
        return course


@compiled
def densities(states: Bytes, cell: float, north: float, east: float, window: float, radius: float) -> Array:
    """The primary polar histogram (SECTORS,), of a place counted from the map's corner (m)."""
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
    north: float,
    east: float,
    window: float,
    radius: float,
    heading: float,
    turning: float,
) -> BoolArray:
    """The masked histogram: blocked too is what lies beyond an obstacle on the way round, left or right.

    `turning` (m) is the radius of the turning circles; an enlarged obstacle that touches one blocks all directions from
    its own to straight back on that side.
    """
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
                continue  # it is nearer than it should be already: the histogram shows the ways off
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
    """The candidate direction (rad) of the lowest cost; NaN if there is none."""
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
    """Directions (n,) through the openings between blocked sectors."""
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
