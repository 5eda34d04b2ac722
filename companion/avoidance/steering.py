"""The motion along a way: a velocity that is wished for at each control step, and a reference with limited acceleration
and jerk that takes it up.

A way is corners with the speeds at which they may be turned, or, where there is none, a bearing. The reference is kept
on a short leash and gives in where the guard has changed the command: what can't be flown is not asked for any longer.
"""

import math

import msgspec
import numpy as np

from companion.config import AvoidanceCourse
from protocol.arrays import Array
from protocol.jit import compiled

_AHEAD_M, _TIGHT_AHEAD_M, _AHEAD_S = 0.8, 0.25, 0.35
"""The way is flown towards a place that lies so far ahead on it."""
_APPROACH_M, _APPROACH_1_S = 1.0, 1.5
"""So near to the goal it is flown straight to, at this speed by distance."""
_SLOW_M, _SLOW_SPEED = 8.0, 3.0
"""m and m/s: without a way, no faster than this so near to the goal."""
_TURN_SPEED = 1.0
"""m/s that a bearing across the present motion leaves."""
_GIVING_IN_S = 0.1
_LONGEST_S = 0.05


class Way(msgspec.Struct, frozen=True):
    """What to fly along, as of one scan."""

    corners: Array
    """(k, 2) NED, from where the vehicle was; (0, 2) if there is only a bearing, or nothing at all."""
    speeds: Array
    """(k,) m/s at the corners."""
    bearing: float | None = None
    """rad from north; None with corners, or if the vehicle is to stay."""
    tight: bool = False
    """There is no way with room but a long one, if any: this one is tight, or leads to where there may be one."""
    detour: float = 0.0
    """What it costs (m) beyond the least that was to be expected; inf: there is none, but a direction; 0: not known."""


NO_WAY = Way(np.empty((0, 2)), np.empty(0))


class Wish(msgspec.Struct, frozen=True, gc=False):
    """What to do now."""

    velocity: Array
    """(2,) m/s north and east."""
    places: Array
    """(k, 2) NED that the vehicle is sent to one after the other."""


def wish(way: Way, here: Array, velocity: Array, goal: Array, speed: float, braking: float) -> Wish:
    """From a place (2,) with a velocity (2,) along the way to a goal (2,), at most at `speed` (m/s)."""
    if len(way.corners):
        ahead = _TIGHT_AHEAD_M if way.tight else _AHEAD_M
        return Wish(*along(way.corners, way.speeds, here, velocity, goal, speed, braking, ahead))
    if way.bearing is not None:
        return Wish(*towards(way.bearing, here, velocity, goal, speed, braking))
    return Wish(np.zeros(2), here[None].copy())


@compiled
def _approach(way: Array, speed: float, offset: Array) -> Array:
    """The velocity (2,) along `way` (2,) at `speed`, or straight to a goal that is near, at `offset` (2,)."""
    distance = math.hypot(offset[0], offset[1])
    if distance < _APPROACH_M:
        way, speed = offset, min(speed, _APPROACH_1_S * distance)
    length = math.hypot(way[0], way[1])
    if length < 1e-6:
        return np.zeros(2)
    velocity: Array = way * (speed / length)
    return velocity


@compiled
def along(
    corners: Array,
    speeds: Array,
    here: Array,
    velocity: Array,
    goal: Array,
    speed: float,
    braking: float,
    least_ahead: float,
) -> tuple[Array, Array]:
    """Velocity (2,) and places (n, 2) to fly to, for corners (k, 2), at least two, and their speeds (k,)."""
    now = math.hypot(velocity[0], velocity[1])
    nearest, leg, done, length = math.inf, 0, 0.0, 0.0
    for k in range(corners.shape[0] - 1):
        dn, de = corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1]
        whole = math.hypot(dn, de)
        if whole < 1e-6:
            continue
        flown = ((here[0] - corners[k, 0]) * dn + (here[1] - corners[k, 1]) * de) / whole
        flown = min(max(flown, 0.0), whole)
        share = flown / whole
        off = math.hypot(corners[k, 0] + share * dn - here[0], corners[k, 1] + share * de - here[1])
        if off < nearest:
            nearest, leg, done, length = off, k, flown, whole
    to_corner = max(length - done - 0.1 * now, 0.0)
    allowed = min(speed, math.sqrt(speeds[leg + 1] ** 2 + 2.0 * braking * to_corner))
    ahead = done + max(least_ahead, _AHEAD_S * now)
    while ahead > length and leg + 2 < corners.shape[0]:
        ahead -= length
        leg += 1
        length = math.hypot(corners[leg + 1, 0] - corners[leg, 0], corners[leg + 1, 1] - corners[leg, 1])
    share = min(ahead / max(length, 1e-9), 1.0)
    places = corners[leg:].copy()
    places[0] += share * (corners[leg + 1] - corners[leg])
    return _approach(places[0] - here, allowed, goal - here), places


@compiled
def towards(
    bearing: float, here: Array, velocity: Array, goal: Array, speed: float, braking: float
) -> tuple[Array, Array]:
    """Velocity (2,) and places (1, 2) to fly to, for a bearing: slower across the present motion."""
    offset = goal - here
    distance = math.hypot(offset[0], offset[1])
    way = np.array([math.cos(bearing), math.sin(bearing)])
    allowed = min(speed, math.sqrt(2.0 * braking * distance))
    if distance < _SLOW_M:
        allowed = min(allowed, _SLOW_SPEED)
    now = math.hypot(velocity[0], velocity[1])
    if now > 0.5:
        onward = max((velocity[0] * way[0] + velocity[1] * way[1]) / now, 0.0)
        allowed = min(allowed, max(_TURN_SPEED, speed * onward * onward))
    places = np.empty((1, 2))
    places[0] = here + min(distance, 100.0) * way
    return _approach(way, allowed, offset), places


class Course:
    """The horizontal reference: position, velocity and acceleration, a row each."""

    def __init__(self, settings: AvoidanceCourse) -> None:
        self._settings = settings
        self._motion = np.zeros((3, 2))
        self._time_ns: int | None = None
        self._dt = 0.0

    @property
    def active(self) -> bool:
        return self._time_ns is not None

    def start(self, now_ns: int, position: Array, velocity: Array, acceleration: Array) -> None:
        """From a motion, (2,) or more each."""
        self._motion = np.array([position[:2], velocity[:2], acceleration[:2]])
        self._time_ns = now_ns

    def stop(self) -> None:
        self._time_ns = None

    def advance(self, now_ns: int, wanted: Array, here: Array) -> None:
        """Take up a velocity (2,); `here` (2,) is where the vehicle is."""
        assert self._time_ns is not None
        s = self._settings
        self._dt = dt = min(max((now_ns - self._time_ns) * 1e-9, 0.0), _LONGEST_S)
        self._time_ns = now_ns
        _advance(self._motion, wanted, here, dt, s.follow, s.acceleration, s.jerk, s.leash)

    def give_in(self, here: Array, velocity: Array, acceleration: Array) -> None:
        """Towards the vehicle's own motion, (2,) or more each, for as long as the last step took."""
        own = np.array([here[:2], velocity[:2], acceleration[:2]])
        self._motion = self._motion + min(self._dt / _GIVING_IN_S, 1.0) * (own - self._motion)

    def put(self, time_ns: int, rows: Array) -> None:
        """North and east of a reference's rows (6, 3), a little after the last step."""
        assert self._time_ns is not None
        _put(self._motion, (time_ns - self._time_ns) * 1e-9, rows)


@compiled
def _put(motion: Array, dt: float, rows: Array) -> None:
    """The motion (3, 2) `dt` later, with the same acceleration; from jerk on all is 0."""
    for axis in range(2):
        position, velocity, acceleration = motion[0, axis], motion[1, axis], motion[2, axis]
        rows[0, axis] = position + dt * velocity + 0.5 * dt * dt * acceleration
        rows[1, axis] = velocity + dt * acceleration
        rows[2, axis] = acceleration
        rows[3, axis] = rows[4, axis] = 0.0


@compiled
def _shortened(vector: Array, most: float) -> Array:
    length = math.hypot(vector[0], vector[1])
    if length > most:
        vector = vector * (most / length)
    return vector


@compiled
def _advance(
    motion: Array, wanted: Array, here: Array, dt: float, follow: float, most: float, jerk: float, leash: float
) -> None:
    """Make the motion (3, 2) that of `dt` later, at most `most` (m/s2) and `jerk` (m/s3), within `leash` (m) of the
    vehicle."""
    asked = _shortened(follow * (wanted - motion[1]), most)
    motion[2] += _shortened(asked - motion[2], jerk * dt)
    motion[0] = here + _shortened(motion[0] + dt * motion[1] + 0.5 * dt * dt * motion[2] - here, leash)
    motion[1] += dt * motion[2]
