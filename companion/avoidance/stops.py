"""Braking manoeuvres of the guard: straight, or with a swerve that ends beside the straight one."""

import math
from typing import NamedTuple

from companion.avoidance.clearance import ClearanceMap, KeepOut, Place, clearance_at
from protocol.jit import compiled

_SWERVES = (0.0, 0.4, -0.4, 0.8, -0.8, 1.1, -1.1)
"""Angles (rad) between the deceleration of a stop and straight back, in the order of preference."""
_SAMPLE = 0.4
"""m between two samples of a stop at its fastest: less than any keep-out."""


class Braking(NamedTuple):
    """How the vehicle brakes."""

    deceleration: float
    """m/s2"""
    lag: float
    """s from the command to the deceleration."""


@compiled
def stop_free_share(
    clearances: ClearanceMap, place: Place, velocity: Place, swerve: float, keep_out: KeepOut, braking: Braking
) -> float:
    """Share of a stop that lies outside of the keep-outs, 1 if all of it does.

    `place` counts from the map's corner (m); `velocity` in m/s, NED. The vehicle flies on for the lag, then
    decelerates, turned by `swerve` (rad) from straight back for the first half of the time and to the other side for
    the second, so that it ends at rest beside the straight stop.
    """
    speed = math.hypot(velocity[0], velocity[1])
    un, ue = (velocity[0] / speed, velocity[1] / speed) if speed > 1e-6 else (1.0, 0.0)
    back, side = braking.deceleration * math.cos(swerve), braking.deceleration * math.sin(swerve)
    duration = speed / back
    a, b = clearance_at(clearances, place[0], place[1])
    occupied, unseen = min(keep_out.occupied, a), min(keep_out.unseen, b)
    samples = math.ceil(speed * (duration + braking.lag) / _SAMPLE) + 1
    for k in range(1, samples + 1):
        t = k / samples * (duration + braking.lag) - braking.lag
        along = speed * (t + braking.lag)
        across = 0.0
        if t > 0.0:
            along -= 0.5 * back * t * t
            late = max(t - 0.5 * duration, 0.0)
            across = side * (0.5 * t * t - late * late)
        north, east = place[0] + along * un - across * ue, place[1] + along * ue + across * un
        a, b = clearance_at(clearances, north, east)
        if a < occupied or b < unseen or (a == 0.0 and b == 0.0):
            return (k - 1) / samples
    return 1.0


@compiled
def best_stop(
    clearances: ClearanceMap, place: Place, velocity: Place, keep_out: KeepOut, braking: Braking
) -> tuple[float, float]:
    """Swerve (rad) and free share of the first stop that is free to its end, or of the one that is free the longest.

    `place` counts from the map's corner (m); `velocity` in m/s, NED. A vehicle that comes to rest within the lag stops
    straight: it has no time to lean to one side and then to the other, and a swerve would only push it aside.
    """
    best, best_share = 0.0, -1.0
    slow = math.hypot(velocity[0], velocity[1]) < braking.deceleration * braking.lag
    for k in range(1 if slow else len(_SWERVES)):
        swerve = _SWERVES[k]
        share = stop_free_share(clearances, place, velocity, swerve, keep_out, braking)
        if share > best_share:
            best, best_share = swerve, share
        if share == 1.0:
            break
    return best, best_share


@compiled
def straight_stop(north: float, east: float, deceleration: float) -> Place:
    """Acceleration (m/s2, NED) that brakes a velocity (m/s, NED), less and less below 0.5 m/s."""
    share = -deceleration / max(math.hypot(north, east), 0.5)
    return share * north, share * east
