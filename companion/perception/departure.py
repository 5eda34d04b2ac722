"""Whether an obstacle was seen to move: it is now where nothing was, or nothing is now where it was.

A sector reports its nearest return, which lies anywhere on an arc across the sector. An obstacle has moved if a ring
saw past the whole arc of another ring's return. What stands never shows that, however coarse the sectors are, if it was
hit above the beam that saw past and below: a tilted ring passes over a van, and under the crown of a tree.
"""

import math
from typing import Any, NamedTuple

from protocol.arrays import Array
from protocol.frames import to_body
from protocol.jit import compiled

_BEYOND_M = 0.15
"""m that a ring must have seen past an arc: more than the range noise."""
_DEPTH_M = 0.2
"""m behind a return that must be free, too: a beam may graze the front of what stands."""
_LEVEL_M = 1.0
"""m from the height of a return up to which a beam would have met the obstacle."""
_WHOLE = 1e-3
"""Part of a sector: so near to a whole number of them a ring closes. Others leave a gap, and what is counted from
beyond it lies between two of their beams."""
_HEIGHT_M = 0.02
"""m beyond the heights at which an obstacle was hit, at which a beam would have met it, too: level rings see all at one
height."""
_LOW_M = 0.5
"""m below the sensor from which on an obstacle may be low: its top is somewhere above its return."""
_OVER_LOW_M = 0.05
"""m above the return of a low one up to which a beam would have met it. Higher up it may have passed over the top: as
the vehicle nears a car, a hedge or a garden wall that its tilted scan has met, the scan rises over it."""
SIGHTS, SIGHT_EVERY = 3, 3
"""Places, with the rings that saw a track there, beside which it is to be seen that it has left; and the number of
scans after which the next of them takes the place of an older one. From nearer a sector is narrower."""
_SEEN_LEVEL_M, _OFF_LEVEL_M = 0.3, 0.6
"""m from the sensor's height: up to the first a ring has seen a track level, from the second on from too far above or
below."""


class Sight(NamedTuple):
    """How far a ring saw. Exists in compiled code only."""

    free: Array
    """(n,) m along each beam; 0 where it has not measured."""
    position: Array
    """(3,) NED (m) of the sensor."""
    attitude: Array
    """(4,) NED to FRD."""
    first: float
    """rad: bearing of the first beam."""
    step: float
    """rad from one beam to the next, the width of a sector; negative if they go to the left."""


@compiled
def seen_past(sight: Sight, place: Array, origin: Array, heights: tuple[float, float]) -> bool:
    """Whether a ring saw past the whole arc of a return at a `place` that was seen from `origin`, (3,) m NED each, and
    past what was right behind it. `heights` (m, NED): the highest and the lowest at which the obstacle was hit."""
    distance = max(math.hypot(place[0] - origin[0], place[1] - origin[1]), 1e-6)
    behind = place.copy()
    behind[:2] += _DEPTH_M / distance * (place[:2] - origin[:2])
    return _arc_seen_past(sight, place, origin, heights) and _arc_seen_past(sight, behind, origin, heights)


@compiled
def passes_off(sight: Sight, place: Array) -> bool:
    """Whether a tilted ring passes a place (3,) NED (m) so far above or below that it can't show what stands there."""
    offset = place[0] - sight.position[0], place[1] - sight.position[1], place[2] - sight.position[2]
    down = to_body(sight.attitude, (0.0, 0.0, 1.0))
    off: bool = abs(to_body(sight.attitude, offset)[2]) > _LEVEL_M * down[2]
    return off


@compiled
def _arc_seen_past(sight: Sight, place: Array, origin: Array, heights: tuple[float, float]) -> bool:
    aside = math.tan(0.5 * abs(sight.step))
    across_n, across_e = aside * (origin[1] - place[1]), aside * (place[0] - origin[0])
    around = 2.0 * math.pi / abs(sight.step)  # sectors of a whole ring
    if abs(around - round(around)) < _WHOLE:
        around = float(round(around))
    down = to_body(sight.attitude, (0.0, 0.0, 1.0))
    over = _OVER_LOW_M if place[2] - sight.position[2] > _LOW_M else _LEVEL_M
    farthest, ends = 0.0, (0.0, 0.0)
    for side in (1.0, -1.0):
        offset = (
            place[0] + side * across_n - sight.position[0],
            place[1] + side * across_e - sight.position[1],
            place[2] - sight.position[2],
        )
        x, y, z = to_body(sight.attitude, offset)
        height = place[2] - z / down[2]
        if not (-_LEVEL_M * down[2] <= z <= over * down[2] and heights[0] <= height <= heights[1]):
            return False
        x, y = x - z / down[2] * down[0], y - z / down[2] * down[1]  # straight above or below, in the scan's plane
        farthest = max(farthest, math.hypot(x, y))
        ends = ends[1], (math.atan2(y, x) - sight.first) / sight.step
    turn = (ends[1] - ends[0] + 0.5 * around) % around - 0.5 * around  # from one end to the other, the short way round
    start, turn = (ends[0], turn) if turn >= 0.0 else (ends[1], -turn)
    for k in range(math.floor(start + 0.5), math.floor(start + turn + 0.5) + 1):
        beam = k % around
        for near in (math.floor(beam), math.ceil(beam) if math.ceil(beam) < around else 0):
            if near >= sight.free.size or sight.free[near] < farthest + _BEYOND_M:
                return False
    return True


@compiled
def seen_level(track: Any, place: Array, sight: Sight) -> bool:
    """Whether a TRACK that has not left the place where it stood is seen at the sensor's height, and was not there: the
    scan of a tilted vehicle meets it low or high, and passes below or above what is nearer or farther, so that it can't
    show that the track has left."""
    off_level = abs(track["place"][0, 2] - track["position"][0, 2]) > _OFF_LEVEL_M
    return not track["left"] and off_level and abs(place[2] - sight.position[2]) < _SEEN_LEVEL_M


@compiled
def stand(track: Any, place: Array, sight: Sight) -> None:
    """A TRACK stands at a place (3,) NED (m), as a ring sees it."""
    track["left"], track["start"][:] = False, place[:2]
    track["highest"] = track["lowest"] = place[2]
    for k in range(SIGHTS):
        take_place(track, k, place, sight)


@compiled
def hit_at(track: Any, down: float) -> None:
    """A TRACK was hit at a height (m, NED)."""
    track["highest"], track["lowest"] = min(track["highest"], down), max(track["lowest"], down)


@compiled
def take_place(track: Any, k: int, place: Array, sight: Sight) -> None:
    """That a TRACK has left a place (3,) NED (m) is to be seen beside what this ring sees."""
    track["place"][k], track["position"][k], track["attitude"][k] = place, sight.position, sight.attitude
    track["free"][k, : sight.free.size] = sight.free


@compiled
def has_left(track: Any, place: Array, sight: Sight) -> bool:
    """Whether a TRACK that a ring sees at a place (3,) NED (m) was seen to have left one of the places where it was:
    the ring sees past that, or the one that saw it there saw past this. Of what seems to stand, the first place alone
    is looked at."""
    heights = (track["highest"] - _HEIGHT_M, track["lowest"] + _HEIGHT_M)
    for k in range(SIGHTS if track["fast_scans"] > 0 else 1):
        free, position, attitude = track["free"][k, : sight.free.size], track["position"][k], track["attitude"][k]
        before = Sight(free, position, attitude, sight.first, sight.step)
        sees_past = seen_past(sight, track["place"][k], position, heights)
        if sees_past or seen_past(before, place, sight.position, heights):
            return True
    return False
