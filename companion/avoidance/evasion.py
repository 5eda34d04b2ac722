"""Evasion of moving obstacles: which way to get out of the way of what can't be stopped for.

A vehicle that brakes, or stands, is met by what goes on. So the time until the vehicle comes too near to where a moving
obstacle will be is looked at, and if that is soon, the vehicle accelerates aside: a velocity obstacle (Fiorini and
Shiller 1998) over manoeuvres that the vehicle can fly, each of which ends with a stop in free space.

How near is too near is counted in standard deviations of the obstacle's place, which grow with the time from now as its
velocity is uncertain (a chance constraint: Zhu and Alonso-Mora 2019). The manoeuvre that is nearest to the command is
taken of those that keep enough of them; of those that don't, the one that keeps most. Those to the side of the first
have a bonus, so that the vehicle does not waver between the two sides of what comes ahead on. Where none keeps clear,
shorter ones are tried in directions that lack the room for the others: a step aside is all that an aisle has room for.
An evasion that goes on ends with a stop as soon as that keeps enough: among several who walk, a vehicle that goes on
accelerating aside meets the next one, ever faster and leaning so far that it hardly sees where it flies to.
"""

import math
from typing import NamedTuple

from companion.avoidance.clearance import ClearanceMap, KeepOut, Place, clearance_at
from companion.avoidance.stops import straight_stop
from protocol.arrays import Array
from protocol.jit import compiled

_SOON_S, _GOES_ON_S = 1.2, 1.8
"""s within which a moving obstacle must come too near to be evaded, and for an evasion to go on: a vehicle that stops
evading too soon returns into the way."""
_HORIZON_S = 1.6
"""s that a manoeuvre is looked ahead."""
_STEP_S = 0.08
_NOMINAL_S = 0.4
"""s for which the command is expected to last."""
_DIRECTIONS = 16
_BURSTS_S = (0.32, 0.8)
"""s of acceleration, before the stop."""
_SHORT_S, _SHORT_ROOM_M = 0.16, 0.05
"""The burst that is tried where none of these keeps clear, and the room (m) that it leaves beside the least: others
follow it."""
_SIGMAS, _ENOUGH_SIGMAS = 2.0, 2.5
"""Standard deviations: with fewer the vehicle evades; with so many a manoeuvre is good enough, and it stops evading."""
_LEAST_SIGMA_M = 0.05
_SAME_WAY = 1.5
"""Standard deviations that a manoeuvre gains by an acceleration to the side of the first, and loses by one to the other
side. Not along the way of the obstacle: who began to run from it may find that it must step aside."""
_UNSEEN = 1.0
"""Standard deviations that a manoeuvre loses where it leads through what was not seen free."""
_FAR = 1e3

Motion = tuple[float, float, float, float]
"""Place north and east (m), velocity north and east (m/s)."""


class Agility(NamedTuple):
    """How the vehicle moves out of the way."""

    acceleration: float
    """m/s2"""
    braking: float
    """m/s2"""
    lag: float
    """s from a command to its acceleration."""
    stops: bool = True
    """An evasion that goes on gives way to a stop that keeps clear."""


class Push(NamedTuple):
    """An acceleration for a while, and what follows."""

    north: float
    """m/s2"""
    east: float
    duration: float
    """s"""
    stops: bool
    """A stop follows; else the vehicle flies on."""


@compiled
def sigmas(mover: Array, before: Motion, after: Motion, times: tuple[float, float], at_first: float) -> float:
    """By how many standard deviations a mover's place would have to be another for the vehicle to touch its room
    between two moments; many where it comes no nearer than it was `at_first` (m).

    `mover` (MOVER_COLUMNS,): of `perception.free_space`; `before` and `after`: the vehicle's motion at `times` (s, of
    the mover's).
    """
    n0, e0 = before[0] - mover[0] - times[0] * mover[2], before[1] - mover[1] - times[0] * mover[3]
    n1, e1 = after[0] - mover[0] - times[1] * mover[2], after[1] - mover[1] - times[1] * mover[3]
    dn, de = n1 - n0, e1 - e0
    square = dn * dn + de * de
    share = min(max(-(n0 * dn + e0 * de) / square, 0.0), 1.0) if square > 1e-12 else 0.0
    n, e = n0 + share * dn, e0 + share * de
    distance = math.sqrt(n * n + e * e)
    if distance >= at_first:
        return _FAR
    size = max(distance, 1e-6)
    n, e, t = n / size, e / size, times[0] + share * (times[1] - times[0])
    nn, ne, ee = n * n, 2.0 * n * e, e * e
    place = nn * mover[5] + ne * mover[6] + ee * mover[7]
    both = nn * mover[8] + ne * mover[9] + ee * mover[10]
    speed = nn * mover[11] + ne * mover[12] + ee * mover[13]
    variance = max(place + t * (both + t * speed), 0.0)
    return (distance - float(min(mover[4], at_first))) / (math.sqrt(variance) + _LEAST_SIGMA_M)


@compiled
def _advance(motion: Motion, push: Push, braking: float, since: float, dt: float) -> Motion:
    """The motion `dt` (s) later, `since` (s) after the push began."""
    n, e, vn, ve = motion
    wn, we = vn, ve
    if since < push.duration:
        wn, we = vn + dt * push.north, ve + dt * push.east
    elif push.stops:
        speed = math.sqrt(vn * vn + ve * ve)
        left = max(1.0 - dt * braking / speed, 0.0) if speed > 1e-9 else 0.0
        wn, we = left * vn, left * ve
    return n + 0.5 * dt * (vn + wn), e + 0.5 * dt * (ve + we), wn, we


@compiled
def least_sigmas(
    movers: Array, firsts: Array, motion: Motion, push: Push, agility: Agility, span: tuple[float, float]
) -> float:
    """The least `sigmas` of all movers (n, MOVER_COLUMNS) between now and the end of a span (s, of the movers'), with a
    push that begins after the lag. `firsts` (n,) m: their distances now."""
    least, coasting = _FAR, Push(0.0, 0.0, _FAR, False)
    t = 0.0
    while t < span[1] - span[0]:
        dt = agility.lag if t < agility.lag else _STEP_S
        after = _advance(motion, coasting if t < agility.lag else push, agility.braking, t - agility.lag, dt)
        for k in range(movers.shape[0]):
            least = min(least, sigmas(movers[k], motion, after, (span[0] + t, span[0] + t + dt), firsts[k]))
        motion = after
        t += dt
    return least


@compiled
def _nearest(
    movers: Array, firsts: Array, motion: Motion, nominal: Push, agility: Agility, span: tuple[float, float]
) -> tuple[float, Place]:
    """The `least_sigmas` of the mover that comes nearest in a span, and the unit vector across its motion as the
    vehicle sees it."""
    least, nearest = math.inf, 0
    for k in range(movers.shape[0]):
        one = least_sigmas(movers[k : k + 1], firsts[k : k + 1], motion, nominal, agility, span)
        if one < least:
            least, nearest = one, k
    n, e = movers[nearest, 2] - motion[2], movers[nearest, 3] - motion[3]
    size = max(math.sqrt(n * n + e * e), 1e-6)
    return least, (-e / size, n / size)


@compiled
def least_room(
    clearances: ClearanceMap, corner: Place, motion: Motion, push: Push, agility: Agility
) -> tuple[float, float]:
    """The least distances (m) to occupied and to unseen on a push and the stop after it; those at the beginning don't
    count. `corner` (m, NED) is the map's."""
    occupied, unseen = math.inf, math.inf
    coasting = Push(0.0, 0.0, _FAR, False)
    motion = _advance(motion, coasting, agility.braking, 0.0, agility.lag)
    since = 0.0
    while True:
        a, b = clearance_at(clearances, motion[0] - corner[0], motion[1] - corner[1])
        occupied, unseen = min(occupied, a), min(unseen, b)
        if since >= push.duration and motion[2] == 0.0 and motion[3] == 0.0:
            return occupied, unseen
        motion = _advance(motion, push, agility.braking, since, _STEP_S)
        since += _STEP_S


@compiled
def _distances(movers: Array, age: float, motion: Motion) -> Array:
    """(n,) m from the vehicle to each of the movers (n, MOVER_COLUMNS) seen `age` (s) ago."""
    distances = movers[:, 0].copy()
    for k in range(movers.shape[0]):
        north = motion[0] - movers[k, 0] - age * movers[k, 2]
        distances[k] = math.hypot(north, motion[1] - movers[k, 1] - age * movers[k, 3])
    return distances


@compiled
def _stop_keeps_clear(
    movers: Array,
    firsts: Array,
    age: float,
    around: tuple[ClearanceMap, Place],
    motion: Motion,
    keep_out: KeepOut,
    agility: Agility,
) -> bool:
    """Whether a vehicle that brakes now keeps enough from the movers, and the keep-outs; the arguments are those of
    `evade`."""
    stop, (clearances, corner) = Push(0.0, 0.0, 0.0, True), around
    if least_sigmas(movers, firsts, motion, stop, agility, (age, age + _HORIZON_S)) < _ENOUGH_SIGMAS:
        return False
    occupied, unseen = least_room(clearances, corner, motion, stop, agility)
    return bool(occupied >= keep_out.occupied and unseen >= keep_out.unseen)


@compiled
def evade(
    movers: Array,
    age: float,
    around: tuple[ClearanceMap, Place],
    motion: Motion,
    wish: tuple[Place, Place],
    keep_outs: tuple[KeepOut, float],
    agility: Agility,
) -> tuple[bool, float, float]:
    """Whether the vehicle must evade movers (n, MOVER_COLUMNS) seen `age` (s) ago, and the acceleration (m/s2).

    `around`: the map and its corner (m, NED); `wish`: the command, and the first acceleration of an evasion that goes
    on, else 0. `keep_outs`: those that are kept where that is possible, and the least (m) from what is occupied: a
    vehicle that has no way to evade outside of that does not.
    """
    (clearances, corner), (command, before) = around, wish
    firsts = _distances(movers, age, motion)
    nominal = Push(command[0], command[1], _NOMINAL_S, False)
    size = math.sqrt(before[0] * before[0] + before[1] * before[1])
    soon, enough = (_SOON_S, _SIGMAS) if size == 0.0 else (_GOES_ON_S, _ENOUGH_SIGMAS)
    least, aside = _nearest(movers, firsts, motion, nominal, agility, (age, age + soon))
    if least >= enough:
        return False, command[0], command[1]
    here, here_unseen = clearance_at(clearances, motion[0] - corner[0], motion[1] - corner[1])
    wide = KeepOut(min(keep_outs[0].occupied, here), min(keep_outs[0].unseen, here_unseen))
    if agility.stops and size > 0.0 and _stop_keeps_clear(movers, firsts, age, around, motion, wide, agility):
        stop_n, stop_e = straight_stop(motion[2], motion[3], agility.braking)
        return True, stop_n, stop_e
    aim = before if size > 0.0 else command
    side = (before[0] * aside[0] + before[1] * aside[1]) / size if size > 0.0 else 0.0
    keep = min(keep_outs[1], here)
    found, best, best_away, north, east = False, -math.inf, math.inf, command[0], command[1]
    for k in range(2 * _DIRECTIONS + 1):
        short = k > _DIRECTIONS
        if short and best >= 0.0:
            break
        angle = 2.0 * math.pi * k / _DIRECTIONS
        n, e = agility.acceleration * math.cos(angle), agility.acceleration * math.sin(angle)
        if k == _DIRECTIONS:
            n = e = 0.0
        away = math.sqrt((n - aim[0]) ** 2 + (e - aim[1]) ** 2)
        same = _SAME_WAY * side * (n * aside[0] + e * aside[1]) / agility.acceleration
        for number in range(len(_BURSTS_S) if k < _DIRECTIONS else 1):
            burst = _SHORT_S if short else _BURSTS_S[number] if k < _DIRECTIONS else 0.0
            push, longer = Push(n, e, burst, True), Push(n, e, _BURSTS_S[0], True)
            kept = same + min(
                least_sigmas(movers, firsts, motion, push, agility, (age, age + _HORIZON_S)), _ENOUGH_SIGMAS
            )
            if kept < best or (kept == best and away >= best_away):
                continue
            if short and least_room(clearances, corner, motion, longer, agility)[0] >= keep:
                continue
            occupied, unseen = least_room(clearances, corner, motion, push, agility)
            if occupied < (min(keep_outs[1] + _SHORT_ROOM_M, here) if short else keep):
                continue
            if occupied < wide.occupied or unseen < wide.unseen:
                kept -= _UNSEEN
            if kept > best or (kept == best and away < best_away):
                found, best, best_away, north, east = True, kept, away, n, e
    return found, north, east
