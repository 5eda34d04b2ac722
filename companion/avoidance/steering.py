"""The motion along a path: the desired velocity, and a reference of limited acceleration and jerk that takes it up.

A smooth path is followed by its curve: the acceleration that keeps the vehicle on it is known before it is off it. The
reference stays close to the vehicle. Where the guard has changed the command, the reference yields towards the
vehicle's own motion, so that it does not go on asking for what can't be flown.
"""

import math

import msgspec
import numpy as np

from companion.avoidance.clearance import Place
from companion.avoidance.path import Path
from companion.avoidance.smoothing import curvature
from companion.config_avoidance import Avoidance, AvoidanceCourse
from companion.state import Reference
from protocol.arrays import Array
from protocol.jit import compiled

_LOOKAHEAD_M, _TIGHT_LOOKAHEAD_M, _LOOKAHEAD_S = 0.8, 0.25, 0.35
"""Least lookahead distance along a path and along a tight one, and lookahead time."""
_APPROACH_M, _APPROACH_1_S = 1.0, 1.5
"""Within this distance of the goal the vehicle flies straight to it, at this speed by distance."""
_DIAGONAL = math.sqrt(2.0)
"""Length of a cell's diagonal by that of its side."""
_SLOWING_FROM = 1.5
"""m/s below the speeds of a curve that fall: a faster vehicle begins to brake as they do."""
_SLOW_M, _SLOW_SPEED = 8.0, 3.0
"""Without vertices: the speed (m/s) within this distance (m) of the goal, at most."""
_TURN_SPEED = 1.0
"""m/s that is allowed along a bearing whatever the present motion."""
_YIELD_S = 0.1
"""Time constant with which the reference yields."""
_MAX_STEP_S = 0.05


class Steering(msgspec.Struct, frozen=True, gc=False):
    """What to do now."""

    velocity: Array
    """(2,) m/s, NED"""
    path: Array
    """(k, 2) m, NED: the vertices that the vehicle flies to, one after the other."""
    acceleration: Array
    """(2,) m/s2, NED: that of the motion along a curve; 0 without one."""


def steer(path: Path, here: Array, velocity: Array, goal: Array, speed: float, settings: Avoidance) -> Steering:
    """The desired velocity along a path to a goal.

    `here`, `velocity` and `goal` (2,) m and m/s, NED; at most at `speed` (m/s), with the braking of the settings.
    """
    limits = speed, settings.course.braking
    goal = approached(path, here, goal, settings)
    if path.smooth:
        return Steering(*along_curve(path.vertices, path.speeds, here, velocity, goal, (*limits, settings.guard.lag_s)))
    if len(path.vertices):
        lookahead = _TIGHT_LOOKAHEAD_M if path.tight else _LOOKAHEAD_M
        return Steering(*along(path.vertices, path.speeds, here, velocity, goal, (*limits, lookahead)), np.zeros(2))
    if path.bearing is not None:
        return Steering(*towards(path.bearing, here, velocity, goal, *limits), np.zeros(2))
    return Steering(np.zeros(2), here[None].copy(), np.zeros(2))


def approached(path: Path, here: Array, goal: Array, settings: Avoidance) -> Array:
    """Where the vehicle goes at the end, (2,) m, NED: to the end of the path in place of a goal nearby that is in an
    obstacle, or that nobody knows the way to. What is merely nearer to an obstacle than the inflation is flown to."""
    if not len(path.vertices) or math.dist(here.tolist(), goal.tolist()) >= _APPROACH_M:
        return goal
    end: Array = path.vertices[-1]
    room = settings.plan.inflation - settings.plan.tight_inflation + _DIAGONAL * settings.map.cell
    return end if math.dist(end.tolist(), goal.tolist()) > room else goal


@compiled
def _approach(direction: Array, speed: float, offset: Array) -> Array:
    """The velocity (2,) (m/s) along a direction (2,) at `speed`; straight to a goal that is near, at `offset` (2,)
    (m)."""
    distance = math.hypot(offset[0], offset[1])
    if distance < _APPROACH_M:
        direction, speed = offset, min(speed, _APPROACH_1_S * distance)
    length = math.hypot(direction[0], direction[1])
    if length < 1e-6:
        return np.zeros(2)
    velocity: Array = direction * (speed / length)
    return velocity


@compiled
def along(
    vertices: Array, speeds: Array, here: Array, velocity: Array, goal: Array, limits: tuple[float, float, float]
) -> tuple[Array, Array]:
    """Velocity (2,) (m/s) and remaining vertices (n, 2) for vertices (k, 2) (m, NED), at least two, and their speeds
    (k,).

    `limits`: speed (m/s), braking (m/s2) and least lookahead distance (m).
    """
    speed, braking, lookahead = limits
    now = math.hypot(velocity[0], velocity[1])
    leg, done, length = _nearest(vertices, here)
    to_vertex = max(length - done - 0.1 * now, 0.0)
    allowed = min(speed, math.sqrt(speeds[leg + 1] ** 2 + 2.0 * braking * to_vertex))
    remaining = _remaining(vertices, leg, done + max(lookahead, _LOOKAHEAD_S * now))
    return _approach(remaining[0] - here, allowed, goal - here), remaining


@compiled
def along_curve(
    vertices: Array, speeds: Array, here: Array, velocity: Array, goal: Array, limits: tuple[float, float, float]
) -> tuple[Array, Array, Array]:
    """Velocity (2,) (m/s), remaining vertices (n, 2) and acceleration (2,) (m/s2) for points (k, 2) (m, NED) of a
    curve, at least two, and their speeds (k,).

    The velocity is that of the curve where the vehicle is, and back to it. The acceleration is the centripetal one and
    the braking where the vehicle will be after the lag. `limits`: speed (m/s), braking (m/s2) and lag (s).
    """
    speed, braking, lag = limits
    now = math.hypot(velocity[0], velocity[1])
    leg, done, length = _nearest(vertices, here)
    lookahead = max(_LOOKAHEAD_M, _LOOKAHEAD_S * now)
    share = done / max(length, 1e-9)
    tangent_n, tangent_e = _tangent(vertices, leg, share)
    aim_n = vertices[leg, 0] + share * (vertices[leg + 1, 0] - vertices[leg, 0]) + lookahead * tangent_n
    aim_e = vertices[leg, 1] + share * (vertices[leg + 1, 1] - vertices[leg, 1]) + lookahead * tangent_e
    remaining = _remaining(vertices, leg, done + lookahead)
    allowed = math.sqrt(speeds[leg + 1] ** 2 + 2.0 * braking * (length - done))

    soon, done, length = _leg_after(vertices, leg, done + lag * now)
    share = min(done / max(length, 1e-9), 1.0)
    allowed_soon = math.sqrt(speeds[soon + 1] ** 2 + 2.0 * braking * (1.0 - share) * length)
    slows = allowed_soon < speed and speeds[soon + 1] < speeds[soon]
    slowing = braking * min(max(1.0 - (allowed - now) / _SLOWING_FROM, 0.0), 1.0) if slows else 0.0
    bend = (1.0 - share) * curvature(vertices, soon) + share * curvature(vertices, soon + 1)
    tangent_n, tangent_e = _tangent(vertices, soon, share)
    acceleration = np.array(
        [-slowing * tangent_n - now * now * bend * tangent_e, now * now * bend * tangent_n - slowing * tangent_e]
    )
    wanted = _approach(np.array([aim_n - here[0], aim_e - here[1]]), min(speed, allowed), goal - here)
    return wanted, remaining, acceleration


@compiled
def _nearest(vertices: Array, here: Array) -> tuple[int, float, float]:
    """The leg of a path (k, 2) nearest to a place (2,), how far along it that is (m), and its length (m)."""
    nearest, leg, done, length = math.inf, 0, 0.0, 0.0
    for k in range(vertices.shape[0] - 1):
        dn, de = vertices[k + 1, 0] - vertices[k, 0], vertices[k + 1, 1] - vertices[k, 1]
        whole = math.hypot(dn, de)
        if whole < 1e-6:
            continue
        flown = ((here[0] - vertices[k, 0]) * dn + (here[1] - vertices[k, 1]) * de) / whole
        flown = min(max(flown, 0.0), whole)
        share = flown / whole
        off = math.hypot(vertices[k, 0] + share * dn - here[0], vertices[k, 1] + share * de - here[1])
        if off < nearest:
            nearest, leg, done, length = off, k, flown, whole
    return leg, done, length


@compiled
def _leg_after(vertices: Array, leg: int, ahead: float) -> tuple[int, float, float]:
    """The leg on which a path (k, 2) is `ahead` (m) of the begin of one of its legs, how far along it, and its length
    (m); beyond its end on the last."""
    length = math.hypot(vertices[leg + 1, 0] - vertices[leg, 0], vertices[leg + 1, 1] - vertices[leg, 1])
    while ahead > length and leg + 2 < vertices.shape[0]:
        ahead -= length
        leg += 1
        length = math.hypot(vertices[leg + 1, 0] - vertices[leg, 0], vertices[leg + 1, 1] - vertices[leg, 1])
    return leg, ahead, length


@compiled
def _remaining(vertices: Array, leg: int, ahead: float) -> Array:
    """What of a path (k, 2) lies `ahead` (m) of the begin of one of its legs: (n, 2), from that place on."""
    leg, ahead, length = _leg_after(vertices, leg, ahead)
    remaining = vertices[leg:].copy()
    remaining[0] += min(ahead / max(length, 1e-9), 1.0) * (vertices[leg + 1] - vertices[leg])
    return remaining


@compiled
def _tangent(points: Array, leg: int, share: float) -> Place:
    """The unit vector along a curve (n, 2) at a share of one of its legs: between those of its ends."""
    north, east = 0.0, 0.0
    for i, weight in ((leg, 1.0 - share), (leg + 1, share)):
        a, b = points[max(i - 1, 0)], points[min(i + 1, points.shape[0] - 1)]
        weight /= max(math.hypot(b[0] - a[0], b[1] - a[1]), 1e-9)
        north += weight * (b[0] - a[0])
        east += weight * (b[1] - a[1])
    length = max(math.hypot(north, east), 1e-9)
    return north / length, east / length


@compiled
def towards(
    bearing: float, here: Array, velocity: Array, goal: Array, speed: float, braking: float
) -> tuple[Array, Array]:
    """Velocity (2,) (m/s) and vertices (1, 2) (m, NED) for a bearing (rad): slower across the present motion."""
    offset = goal - here
    distance = math.hypot(offset[0], offset[1])
    direction = np.array([math.cos(bearing), math.sin(bearing)])
    allowed = min(speed, math.sqrt(2.0 * braking * distance))
    if distance < _SLOW_M:
        allowed = min(allowed, _SLOW_SPEED)
    now = math.hypot(velocity[0], velocity[1])
    if now > 0.5:
        onward = max((velocity[0] * direction[0] + velocity[1] * direction[1]) / now, 0.0)
        allowed = min(allowed, max(_TURN_SPEED, speed * onward * onward))
    vertices = np.empty((1, 2))
    vertices[0] = here + min(distance, 100.0) * direction
    return _approach(direction, allowed, offset), vertices


class Course:
    """The horizontal reference."""

    def __init__(self, settings: AvoidanceCourse) -> None:
        s = settings
        self._limits = np.array([s.velocity_gain, s.acceleration, s.jerk, s.max_lead])
        self._tied = not s.adapts
        self._motion = np.zeros((3, 2))
        """Position (m), velocity (m/s) and acceleration (m/s2), NED, a row each."""
        self._time_ns: int | None = None
        self._dt = 0.0

    @property
    def active(self) -> bool:
        return self._time_ns is not None

    def start(self, now_ns: int, position: Array, velocity: Array, acceleration: Array) -> None:
        """Start from a motion, (2,) or more each, NED."""
        self._motion = np.array([position[:2], velocity[:2], acceleration[:2]])
        self._time_ns = now_ns

    def stop(self) -> None:
        self._time_ns = None

    def advance(self, now_ns: int, desired: Array, onward: Array, here: Array) -> None:
        """Take up a desired velocity (2,) (m/s, NED), which itself changes by `onward` (2,) (m/s2, NED); `here` (2,)
        (m, NED) is where the vehicle is."""
        assert self._time_ns is not None
        self._dt = dt = min(max((now_ns - self._time_ns) * 1e-9, 0.0), _MAX_STEP_S)
        self._time_ns = now_ns
        _advance(self._motion, desired, onward, here, dt, self._limits)

    def yield_to(self, here: Array, velocity: Array, acceleration: Array) -> None:
        """Move towards the vehicle's own motion, (2,) each, NED, for the duration of the last step."""
        own = np.array([here, velocity, acceleration])
        self._motion = self._motion + min(self._dt / _YIELD_S, 1.0) * (own - self._motion)

    def put(self, time_ns: int, reference: Reference) -> Reference:
        """A reference with north and east of the course, a little after the last step; its rows are written to."""
        assert self._time_ns is not None
        _put(self._motion, (time_ns - self._time_ns) * 1e-9, reference.rows)
        return Reference(reference.rows, tied=self._tied)


@compiled
def _put(motion: Array, dt: float, rows: Array) -> None:
    """The motion (3, 2) after `dt` (s) at the same acceleration; jerk and snap are 0."""
    for axis in range(2):
        position, velocity, acceleration = motion[0, axis], motion[1, axis], motion[2, axis]
        rows[0, axis] = position + dt * velocity + 0.5 * dt * dt * acceleration
        rows[1, axis] = velocity + dt * acceleration
        rows[2, axis] = acceleration
        rows[3, axis] = rows[4, axis] = 0.0


@compiled
def limited(vector: Array, most: float) -> Array:
    """The vector (2,), at most `most` long."""
    length = math.hypot(vector[0], vector[1])
    if length > most:
        vector = vector * (most / length)
    return vector


@compiled
def _advance(motion: Array, desired: Array, onward: Array, here: Array, dt: float, limits: Array) -> None:
    """Advance the motion (3, 2) by `dt` (s) towards a desired velocity that changes by `onward`, (2,) each.

    `limits` (4,): gain of the velocity (1/s), acceleration (m/s2), jerk (m/s3), lead over the vehicle (m).
    """
    gain, acceleration, jerk, max_lead = limits[0], limits[1], limits[2], limits[3]
    asked = limited(gain * (desired - motion[1]) + onward, acceleration)
    motion[2] += limited(asked - motion[2], jerk * dt)
    motion[0] = here + limited(motion[0] + dt * motion[1] + 0.5 * dt * dt * motion[2] - here, max_lead)
    motion[1] += dt * motion[2]
