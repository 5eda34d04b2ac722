"""The guard: the last stage before the controller's output, whatever the method. It passes accelerations from which the
vehicle can still stop in free space.

1. `limit`: the speed from which the vehicle stops within what was seen free, straight on and along its path, and within
   what its leaning scan sees now (`avoidance.view_ahead`).
2. `filter`: the commanded acceleration is moved, as little as possible, to where the barriers of all points hold
   (`avoidance.barriers`).
3. If something that moves would meet the vehicle soon, it gets out of the way (`avoidance.evasion`).
4. From where that acceleration leads to within the horizon, a stop, straight or with a swerve, must lie in free space
   (`avoidance.stops`). If there is none, the vehicle flies the stop that is free from where it is now. Where there is
   none either, it brakes as hard as it can, along the stop that is then free the longest.

Unknown is not free; it has a smaller keep-out of its own, since it can't be hit before it was seen. If the view is too
old, the vehicle brakes. The vertical acceleration is never changed.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.avoidance.barriers import Barrier, half_planes, nearest_allowed, tightest
from companion.avoidance.braking import stopping_speed
from companion.avoidance.clearance import ClearanceMap, KeepOut, Place, free_ahead
from companion.avoidance.evasion import Agility, evade
from companion.avoidance.stops import Braking, best_stop, straight_stop
from companion.avoidance.view_ahead import ViewAhead
from companion.config_avoidance import AvoidanceGuard
from companion.perception.distance_field import Floats
from companion.perception.free_space import FreeSpace
from companion.state import Reason
from protocol.arrays import Array
from protocol.jit import compiled

Maps = tuple[Floats, Floats]
"""Distances (n, m) to occupied and to unseen cells (m)."""

_REASONS = tuple(Reason)
_SAME_EVASION_NS = 500_000_000
"""After so long without evading, the next evasion may be to any side."""
_NO_MAPS: Maps = (np.empty((0, 0), np.float32), np.empty((0, 0), np.float32))

PARAMETERS = np.dtype(
    [
        ("cell", "f8"),
        ("corner_n", "f8"),
        ("corner_e", "f8"),
        ("occupied", "f8"),
        ("least", "f8"),
        ("unseen", "f8"),
        ("braking", "f8"),
        ("emergency_braking", "f8"),
        ("evasion", "f8"),
        ("evasion_stops", "b1"),
        ("barrier_gain", "f8"),
        ("closing_gain", "f8"),
        ("lag", "f8"),
        ("horizon", "f8"),
    ]
)
"""What the kernels need of the settings and of the map: `corner_n`, `corner_e` (m, NED) of the map, keep-outs (m) from
`occupied` and `unseen` cells and the `least` from occupied ones, the rest as in the settings."""


class SpeedLimit(msgspec.Struct, frozen=True, gc=False):
    """The highest speed that is allowed."""

    speed: float
    """m/s"""
    free: float
    """m seen free, the shorter of along the path and straight on."""


class Verdict(msgspec.Struct, frozen=True, gc=False):
    """An acceleration that is allowed."""

    acceleration_ned: Array
    """(3,) m/s2"""
    changed: float
    """m/s2 between it and the command."""
    reason: Reason


class Guard:
    """Gets each new free space, and filters the command of each control step."""

    def __init__(self, settings: AvoidanceGuard) -> None:
        self._settings = settings
        self._space: FreeSpace | None = None
        self._maps = _NO_MAPS
        self._roomy = _parameters(settings, settings.keep_out, settings.keep_out_unseen)
        self._tight = _parameters(settings, settings.keep_out_tight, settings.keep_out_unseen_tight)
        self.view_ahead = ViewAhead(settings.sight_s)
        self._late_s = 0.0
        self._reaction_s = settings.reaction_time
        self._evasion = 0.0, 0.0
        """m/s2, as it began; 0 without one."""
        self._evaded_ns = 0

    def follow(self, late_s: float, pace: float) -> None:
        """From now on what is seen is so much older when a command takes effect, and the vehicle follows at this pace
        (`control.margin`)."""
        s = self._settings
        self._late_s = late_s
        self._reaction_s = s.reaction_time + late_s + s.lag_s / pace - s.lag_s
        for parameters in (self._roomy, self._tight):
            parameters["lag"], parameters["horizon"] = s.lag_s / pace, s.horizon_s / pace
            parameters["barrier_gain"], parameters["closing_gain"] = s.barrier_gain * pace, s.closing_gain * pace

    def look(self, space: FreeSpace) -> None:
        """Take over the latest free space."""
        self._space = space
        self._maps = space.to_occupied, space.to_unseen
        for parameters in (self._roomy, self._tight):
            parameters["cell"] = space.cell
            parameters["corner_n"] = space.corner[0] * space.cell
            parameters["corner_e"] = space.corner[1] * space.cell

    def limit(self, position_ned: Array, velocity_ned: Array, path: Array, speed: float) -> SpeedLimit:
        """The allowed speed, at most `speed` (m/s).

        `path` (k, 2) m, NED: the vertices that the vehicle flies to, one after the other.
        """
        s = self._settings
        if self._space is None:
            return SpeedLimit(0.0, 0.0)
        sight = min(map(self.view_ahead.distance, (velocity_ned[:2], path[0] - position_ned[:2])))
        free = min(_free_ahead(self._maps, position_ned, velocity_ned, path, self._roomy), sight)
        allowed = stopping_speed(free, s.braking, self._reaction_s)
        if self._space.tight and allowed < s.tight_speed:
            free = _free_ahead(self._maps, position_ned, velocity_ned, path, self._tight)
            allowed = max(allowed, min(s.tight_speed, stopping_speed(free, s.braking, self._reaction_s)))
        return SpeedLimit(min(speed, allowed), free)

    def filter(
        self,
        position_ned: Array,
        velocity_ned: Array,
        acceleration_ned: Array,
        now_ns: int,
        *,
        evades_only: bool = False,
    ) -> Verdict:
        """What may be flown instead of a commanded acceleration (3,) (m/s2, gravity left out); with `evades_only`,
        it is changed to evade what moves and for nothing else."""
        if now_ns - self._evaded_ns > _SAME_EVASION_NS:
            self._evasion = 0.0, 0.0
        space = self._space
        if space is None or now_ns - space.seen_ns > self._settings.stale_s * 1e9:
            if evades_only:
                return Verdict(acceleration_ned, 0.0, Reason.NONE)
            north, east = straight_stop(velocity_ned[0], velocity_ned[1], self._settings.braking)
            number = int(Reason.STALE)
        else:
            north, east, number = _filter(
                (space.points[:0] if evades_only else space.points, space.movers),
                (now_ns - space.seen_ns) * 1e-9 + self._late_s,
                self._maps,
                (position_ned, velocity_ned, acceleration_ned),
                self._evasion,
                self._tight if space.tight else self._roomy,
                evades_only,
            )
        reason = _REASONS[number]
        if reason is Reason.EVASION:
            self._evaded_ns = now_ns
            if self._evasion == (0.0, 0.0):
                self._evasion = north, east
        if reason is Reason.NONE:
            return Verdict(acceleration_ned, 0.0, reason)
        command = acceleration_ned.tolist()
        changed = math.hypot(north - command[0], east - command[1])
        return Verdict(np.array([north, east, command[2]]), changed, reason)


def _parameters(settings: AvoidanceGuard, keep_out: float, keep_out_unseen: float) -> NDArray[np.void]:
    """(1,) PARAMETERS, those of the map not set yet."""
    values = {
        "occupied": keep_out,
        "least": settings.keep_out_tight,
        "unseen": keep_out_unseen,
        "braking": settings.braking,
        "emergency_braking": max(settings.emergency_braking, settings.braking),
        "evasion": settings.evasion,
        "evasion_stops": settings.evasion_stops,
        "barrier_gain": settings.barrier_gain,
        "closing_gain": settings.closing_gain,
        "lag": settings.lag_s,
        "horizon": settings.horizon_s,
    }
    record = np.zeros(1, PARAMETERS)
    for name, value in values.items():
        record[name] = value
    return record


@compiled
def _free_ahead(maps: Maps, position: Array, velocity: Array, path: Array, parameters: NDArray[np.void]) -> float:
    """See `clearance.free_ahead`."""
    p = parameters[0]
    clearances = ClearanceMap(maps[0], maps[1], p.cell)
    return free_ahead(clearances, (p.corner_n, p.corner_e), position, velocity, path, KeepOut(p.occupied, p.unseen))


@compiled
def _filter(
    seen: tuple[Array, Array],
    age: float,
    maps: Maps,
    state: tuple[Array, Array, Array],
    evasion: Place,
    parameters: NDArray[np.void],
    evades_only: bool,
) -> tuple[float, float, int]:
    """Acceleration north and east (m/s2) and the number of the Reason.

    `seen`: points and movers of a FreeSpace, which have moved on for `age` (s). `state`: position, velocity and the
    commanded acceleration; `evasion`: as it began (m/s2).
    """
    p = parameters[0]
    points, movers = seen
    position, velocity, command = state
    vn, ve = velocity[0], velocity[1]
    soon_place = position[0] + p.lag * vn, position[1] + p.lag * ve
    barrier = Barrier(p.braking, p.barrier_gain, p.closing_gain)
    planes = half_planes(points, soon_place, (vn, ve), (command[0], command[1]), barrier)
    n, e = nearest_allowed(tightest(planes), command[0], command[1])
    reason = 0 if n == command[0] and e == command[1] else 1

    clearances = ClearanceMap(maps[0], maps[1], p.cell)
    keep_out, braking = KeepOut(p.occupied, p.unseen), Braking(p.braking, p.lag)
    if movers.shape[0] > 0:
        corner, agility = (p.corner_n, p.corner_e), Agility(p.evasion, p.braking, p.lag, p.evasion_stops)
        motion = position[0], position[1], vn, ve
        around, wish, keep_outs = (clearances, corner), ((n, e), evasion), (keep_out, p.least)
        evades, away_n, away_e = evade(movers, age, around, motion, wish, keep_outs, agility)
        if evades:
            return away_n, away_e, 5
    if evades_only:
        return n, e, 0
    north, east = position[0] - p.corner_n, position[1] - p.corner_e
    next_n, next_e = vn + p.horizon * n, ve + p.horizon * e
    half = 0.5 * p.horizon
    next_place = north + half * (vn + next_n), east + half * (ve + next_e)
    _, share = best_stop(clearances, next_place, (next_n, next_e), keep_out, braking)
    if share == 1.0:
        return n, e, reason
    swerve, share = best_stop(clearances, (north, east), (vn, ve), keep_out, braking)
    if share < 1.0:
        braking = Braking(p.emergency_braking, p.lag)
        swerve, _ = best_stop(clearances, (north, east), (vn, ve), keep_out, braking)
    n, e = straight_stop(vn, ve, braking.deceleration)
    c, s = math.cos(swerve), math.sin(swerve)
    return c * n + s * e, c * e - s * n, 2 if share == 1.0 else 3
