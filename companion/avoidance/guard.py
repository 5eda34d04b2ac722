"""The guard: last of all, whatever the method. It lets through what leaves a way to stop, and nothing else.

1. `limit`: the speed from which the vehicle stops within what was seen free, straight on and the way it is sent.
2. `filter`: the acceleration command is moved, as little as possible, to where a barrier holds for every point. A
   point is no danger while the vehicle can stop before it, h = s(d - keep-out) - c (d the distance, c the closing
   speed, s the highest one from which `braking` stops in time), or while it flies past, h = y - keep-out (y how far a
   straight flight misses the point). h' >= -steepness h is a half-plane of accelerations (control barrier functions
   after Ames et al. 2019; the braking barrier of Borrmann et al. 2015; the other bounds the collision cone of
   Thontepu et al. 2022 by its miss distance). One of the two must hold: the one that the command comes nearer to
   (the second only if it holds already or nearly so, or a wall would be steered past instead of stopped at).
   The nearest acceleration in the intersection of half-planes has a closed form in two dimensions: the command
   itself, its foot on one edge, or the corner of two. Where the intersection is empty all are relaxed by the same,
   smallest amount.
3. A stop, straight or with a swerve, from where that command leads to within a moment must lie in free space;
   otherwise the stop that is still there is flown, and where there is none the one that stays free longest.

Unknown is not free, with a smaller keep-out of its own, as it can't be hit before it was seen. An old view stops the
vehicle. Down is left alone.
"""

import math

import msgspec
import numpy as np

from companion.avoidance.braking import stopping_speed
from companion.config import AvoidanceGuard
from companion.perception.distance_field import Floats, between
from companion.perception.free_space import FreeSpace
from companion.state import Reason
from protocol.arrays import Array
from protocol.jit import compiled

_MOST = 16
"""Half-planes that are looked at together: the tightest."""
_SWERVES = (0.0, 0.4, -0.4, 0.8, -0.8, 1.1, -1.1)
"""Angles (rad) between the deceleration of a stop and straight back; first come, first flown."""
_STOP_SAMPLE = 0.4
"""m of a stop between two samples at its fastest: less than any keep-out."""
_TOLERANCE = 1e-9
_MOVES = 0.3
"""m/s; slower has no course."""
_GRAZE = 0.1
"""m of keep-out that a flight past may lack to be steered further out instead of braked."""
_FAR = 100.0
"""m, beyond every window."""
_HALVINGS = 24


_REASONS = tuple(Reason)


class SpeedLimit(msgspec.Struct, frozen=True, gc=False):
    """What may be flown."""

    speed: float
    """m/s"""
    free: float
    """m of seen free way, the shorter of both directions."""


class Verdict(msgspec.Struct, frozen=True, gc=False):
    """An acceleration that may be flown."""

    acceleration_ned: Array
    changed: float
    """m/s2 between it and the command."""
    reason: Reason


class Guard:
    """Told of each new free space, asked at each control step."""

    def __init__(self, settings: AvoidanceGuard) -> None:
        self._settings = settings
        self._space: FreeSpace | None = None

    def look(self, space: FreeSpace) -> None:
        """From now on this is what is known to be free."""
        self._space = space

    def limit(self, position_ned: Array, velocity_ned: Array, way: Array, delay_s: float, speed: float) -> SpeedLimit:
        """At most `speed` (m/s). `way` (k, 2): the places, NED, that the vehicle is sent to one after the other.
        `delay_s`: from a thing's appearance to the first braking, scan period + age of the view + lag."""
        s = self._settings
        if self._space is None:
            return SpeedLimit(0.0, 0.0)
        free = self._free(position_ned, velocity_ned, way, s.keep_out, s.keep_out_unseen)
        allowed = stopping_speed(free, s.braking, delay_s)
        if self._space.tight and allowed < s.crawl:
            free = self._free(position_ned, velocity_ned, way, s.keep_out_tight, s.keep_out_unseen_tight)
            allowed = max(allowed, min(s.crawl, stopping_speed(free, s.braking, delay_s)))
        return SpeedLimit(min(speed, allowed), free)

    def filter(self, position_ned: Array, velocity_ned: Array, acceleration_ned: Array, now_ns: int) -> Verdict:
        """What may be commanded instead of an acceleration (3,) (m/s2, gravity left out)."""
        s = self._settings
        space = self._space
        if space is None or now_ns - space.seen_ns > s.stale_s * 1e9:
            north, east = straight_stop(velocity_ned[0], velocity_ned[1], s.braking)
            number = int(Reason.STALE)
        else:
            north, east, number = guarded(
                space.points,
                (now_ns - space.seen_ns) * 1e-9,
                space.to_occupied,
                space.to_unseen,
                space.cell,
                space.corner[0] * space.cell,
                space.corner[1] * space.cell,
                position_ned,
                velocity_ned,
                acceleration_ned,
                s.keep_out_tight if space.tight else s.keep_out,
                s.keep_out_unseen_tight if space.tight else s.keep_out_unseen,
                s.braking,
                s.steepness,
                s.nearness,
                s.lag_s,
                s.horizon_s,
            )
        reason = _REASONS[number]
        if reason is Reason.NONE:
            return Verdict(acceleration_ned, 0.0, reason)
        command = acceleration_ned.tolist()
        changed = math.hypot(north - command[0], east - command[1])
        return Verdict(np.array([north, east, command[2]]), changed, reason)

    def _free(self, position_ned: Array, velocity_ned: Array, way: Array, occupied: float, unseen: float) -> float:
        """m along the way, or along the present course if that is less."""
        space = self._space
        assert space is not None
        return free_ahead(
            space.to_occupied,
            space.to_unseen,
            space.cell,
            space.corner[0] * space.cell,
            space.corner[1] * space.cell,
            position_ned,
            velocity_ned,
            way,
            occupied,
            unseen,
        )


@compiled
def _room(to_occupied: Floats, to_unseen: Floats, cell: float, north: float, east: float) -> tuple[float, float]:
    """Distances (m) to occupied and to unseen at a place counted from the window's corner; 0, 0 outside."""
    row, column = north / cell - 0.5, east / cell - 0.5
    return between(to_occupied, row, column), between(to_unseen, row, column)


@compiled
def free_way(
    to_occupied: Floats, to_unseen: Floats, cell: float, places: Array, occupied: float, unseen: float
) -> float:
    """Distance (m) along the straight lines between places (k, 2), counted from the window's corner, until a keep-out
    is entered; from within one, until it gets nearer. inf if the way's end is reached."""
    at_occupied, at_unseen = _room(to_occupied, to_unseen, cell, places[0, 0], places[0, 1])
    occupied, unseen = min(occupied, at_occupied), min(unseen, at_unseen)
    flown = 0.0
    for k in range(places.shape[0] - 1):
        dn, de = places[k + 1, 0] - places[k, 0], places[k + 1, 1] - places[k, 1]
        length = math.hypot(dn, de)
        along = 0.0
        while along < length:
            share = along / length
            a, b = _room(to_occupied, to_unseen, cell, places[k, 0] + share * dn, places[k, 1] + share * de)
            if a < occupied or b < unseen or (a == 0.0 and b == 0.0):
                return flown + along
            along += max(min(a - occupied, b - unseen), 0.5 * cell)
        flown += length
    return math.inf


@compiled
def free_ahead(
    to_occupied: Floats,
    to_unseen: Floats,
    cell: float,
    corner_n: float,
    corner_e: float,
    here: Array,
    velocity: Array,
    way: Array,
    occupied: float,
    unseen: float,
) -> float:
    """Distance (m) free along a way (k, 2) from `here` (2,) or more, or straight on with the velocity if that is less.
    `corner_n`, `corner_e` (m): the window's corner."""
    places = np.empty((way.shape[0] + 1, 2))
    places[0], places[1:] = here[:2], way
    places[:, 0] -= corner_n
    places[:, 1] -= corner_e
    free = free_way(to_occupied, to_unseen, cell, places, occupied, unseen)
    speed = math.hypot(velocity[0], velocity[1])
    if speed > _MOVES:
        onward = np.empty((2, 2))
        onward[0] = places[0]
        onward[1, 0] = places[0, 0] + _FAR / speed * velocity[0]
        onward[1, 1] = places[0, 1] + _FAR / speed * velocity[1]
        free = min(free, free_way(to_occupied, to_unseen, cell, onward, occupied, unseen))
    return free


@compiled
def closing_limit(distance: float, braking: float, nearness: float) -> tuple[float, float]:
    """The highest closing speed (m/s) at a distance (m) from the keep-out and its slope (1/s).

    The square root of the braking distance, continued by its tangent of slope `nearness`; negative within.
    """
    corner = braking / (nearness * nearness)
    if distance <= corner:
        return nearness * distance, nearness
    speed = math.sqrt(2.0 * braking * (distance - 0.5 * corner))
    return speed, braking / speed


@compiled
def half_planes(
    points: Array,
    north: float,
    east: float,
    velocity_n: float,
    velocity_e: float,
    command_n: float,
    command_e: float,
    braking: float,
    steepness: float,
    nearness: float,
) -> Array:
    """(n, 5) for points (n, 5): a unit vector, the bound of the acceleration along it (m/s2), the barrier h and the
    scale of its rate: h' + steepness h = scale (bound - acceleration along the vector)."""
    planes = np.empty((points.shape[0], 5))
    for k in range(points.shape[0]):
        dn, de = points[k, 0] - north, points[k, 1] - east
        distance = max(math.hypot(dn, de), 1e-3)
        un, ue = dn / distance, de / distance
        vn, ve = velocity_n - points[k, 2], velocity_e - points[k, 3]
        closing, across = vn * un + ve * ue, ve * un - vn * ue
        limit, slope = closing_limit(distance - points[k, 4], braking, nearness)
        barrier = limit - closing
        bound = steepness * barrier - slope * closing + across * across / distance
        planes[k] = un, ue, bound, barrier, 1.0
        speed = math.hypot(vn, ve)
        if closing <= 0.0 or speed < _MOVES or distance <= points[k, 4]:
            continue
        miss = distance * abs(across) / speed
        if miss < points[k, 4] - _GRAZE:
            continue
        side = 1.0 if across > 0.0 else -1.0
        gn = (-side * de - miss * vn / speed) / speed
        ge = (side * dn - miss * ve / speed) / speed
        scale = math.hypot(gn, ge)
        past = steepness * (miss - points[k, 4]) / scale
        if past + (gn * command_n + ge * command_e) / scale > bound - un * command_n - ue * command_e:
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
    """The point of the intersection of half-planes that is nearest to a point; False if it is empty."""
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
            corner_n = (b * planes[m, 1] - c * planes[k, 1]) / cross
            corner_e = (c * planes[k, 0] - b * planes[m, 0]) / cross
            away = math.hypot(corner_n - north, corner_e - east)
            if away < best and _feasible(planes, relaxed, corner_n, corner_e):
                best, best_n, best_e = away, corner_n, corner_e
    return best < math.inf, best_n, best_e


@compiled
def nearest_allowed(planes: Array, north: float, east: float) -> tuple[float, float]:
    """The acceleration nearest to a command that all half-planes (n, 5) allow; where none is, they are relaxed by the
    smallest amount that serves them all."""
    found, n, e = _project(planes, 0.0, north, east)
    if found:
        return n, e
    low, high = 0.0, 0.0
    for k in range(planes.shape[0]):
        high = max(high, planes[k, 0] * north + planes[k, 1] * east - planes[k, 2])
    n, e = north, east
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        found, middle_n, middle_e = _project(planes, middle, north, east)
        if found:
            high, n, e = middle, middle_n, middle_e
        else:
            low = middle
    return n, e


@compiled
def _tightest(planes: Array) -> Array:
    """The half-planes with the smallest bounds, at most _MOST."""
    if planes.shape[0] <= _MOST:
        return planes
    order = np.argsort(planes[:, 2], kind="mergesort")
    return planes[order[:_MOST]]


@compiled
def _stop_free(
    to_occupied: Floats,
    to_unseen: Floats,
    cell: float,
    north: float,
    east: float,
    velocity_n: float,
    velocity_e: float,
    swerve: float,
    occupied: float,
    unseen: float,
    braking: float,
    lag: float,
) -> float:
    """Share of a stop that lies outside of the keep-outs, 1 if all of it does.

    It goes on for `lag`, then decelerates at `braking`, turned by `swerve` from straight back for the first half of the
    time and to the other side for the second, so that it ends at rest beside the straight stop.
    """
    speed = math.hypot(velocity_n, velocity_e)
    un, ue = (velocity_n / speed, velocity_e / speed) if speed > 1e-6 else (1.0, 0.0)
    back, side = braking * math.cos(swerve), braking * math.sin(swerve)
    duration = speed / back
    a, b = _room(to_occupied, to_unseen, cell, north, east)
    occupied, unseen = min(occupied, a), min(unseen, b)
    samples = math.ceil(speed * (duration + lag) / _STOP_SAMPLE) + 1
    for k in range(1, samples + 1):
        t = k / samples * (duration + lag) - lag
        along = speed * (t + lag)
        across = 0.0
        if t > 0.0:
            along -= 0.5 * back * t * t
            late = max(t - 0.5 * duration, 0.0)
            across = side * (0.5 * t * t - late * late)
        a, b = _room(to_occupied, to_unseen, cell, north + along * un - across * ue, east + along * ue + across * un)
        if a < occupied or b < unseen or (a == 0.0 and b == 0.0):
            return (k - 1) / samples
    return 1.0


@compiled
def best_stop(
    to_occupied: Floats,
    to_unseen: Floats,
    cell: float,
    north: float,
    east: float,
    velocity_n: float,
    velocity_e: float,
    occupied: float,
    unseen: float,
    braking: float,
    lag: float,
) -> tuple[float, float]:
    """Swerve (rad) of the first stop that stays free, or of the one that does so longest, and its free share."""
    best, best_share = 0.0, -1.0
    for swerve in _SWERVES:
        share = _stop_free(
            to_occupied, to_unseen, cell, north, east, velocity_n, velocity_e, swerve, occupied, unseen, braking, lag
        )
        if share > best_share:
            best, best_share = swerve, share
        if share == 1.0:
            break
    return best, best_share


@compiled
def straight_stop(velocity_n: float, velocity_e: float, braking: float) -> tuple[float, float]:
    """Acceleration north and east that brakes, gently at the end."""
    share = -braking / max(math.hypot(velocity_n, velocity_e), 0.5)
    return share * velocity_n, share * velocity_e


@compiled
def guarded(
    points: Array,
    age: float,
    to_occupied: Floats,
    to_unseen: Floats,
    cell: float,
    corner_n: float,
    corner_e: float,
    position: Array,
    velocity: Array,
    command: Array,
    occupied: float,
    unseen: float,
    braking: float,
    steepness: float,
    nearness: float,
    lag: float,
    horizon: float,
) -> tuple[float, float, int]:
    """Acceleration north and east and the Reason's number; `corner_n`, `corner_e` (m): the window's corner; `age` (s):
    of the points, which move on meanwhile."""
    vn, ve = velocity[0], velocity[1]
    soon = points.copy()
    soon[:, 0] += (age + lag) * points[:, 2]
    soon[:, 1] += (age + lag) * points[:, 3]
    planes = half_planes(
        soon,
        position[0] + lag * vn,
        position[1] + lag * ve,
        vn,
        ve,
        command[0],
        command[1],
        braking,
        steepness,
        nearness,
    )
    n, e = nearest_allowed(_tightest(planes), command[0], command[1])
    reason = 0 if n == command[0] and e == command[1] else 1
    north, east = position[0] - corner_n, position[1] - corner_e
    soon_n, soon_e = vn + horizon * n, ve + horizon * e
    ahead = 0.5 * horizon
    _, share = best_stop(
        to_occupied,
        to_unseen,
        cell,
        north + ahead * (vn + soon_n),
        east + ahead * (ve + soon_e),
        soon_n,
        soon_e,
        occupied,
        unseen,
        braking,
        lag,
    )
    if share == 1.0:
        return n, e, reason
    swerve, share = best_stop(to_occupied, to_unseen, cell, north, east, vn, ve, occupied, unseen, braking, lag)
    n, e = straight_stop(vn, ve, braking)
    c, s = math.cos(swerve), math.sin(swerve)
    return c * n + s * e, c * e - s * n, 2 if share == 1.0 else 3
