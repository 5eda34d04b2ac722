"""How the mission is taken up again by a vehicle that others have flown elsewhere.

Steps straight up or down look out for nothing, so they are flown at their own place alone: the way there is a leg of
the route, around obstacles.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from companion.mission.plan import Phase, Step, is_beside
from protocol.arrays import Array

_LOW = (Phase.DESCEND, Phase.RELEASE, Phase.CLIMB)
_LOWER_M = 1.0
"""A vehicle that is so much lower than the route climbs before it goes anywhere."""


class TakenUp(NamedTuple):
    """What is flown from now on."""

    step: int
    """Its index in the mission."""
    parts: tuple[Step, ...] = ()
    """What is flown in place of it, one after the other; empty: the step itself."""


def taken_up(plan: Sequence[Step], index: int, here: Array, settled: float) -> TakenUp:
    """How the step of that index is flown on from a place (3,) m, NED. The parcel is released within `settled` (m) of
    its place, and a vehicle that is farther away goes there again."""
    if plan[index].phase is Phase.RELEASE and index > 0:
        place = plan[index - 1].target_ned
        if place is not None and math.dist(place.tolist(), here.tolist()) > settled:
            index -= 1
    step = plan[index]
    if step.phase not in (Phase.TAKEOFF, Phase.DESCEND, Phase.CLIMB) or step.target_ned is None:
        return TakenUp(index)
    if not is_beside(step.target_ned, here):
        return TakenUp(index)
    if step.phase is Phase.DESCEND:
        above = _above(plan, index)
        return TakenUp(index, (*_climb(step, above, here), _to(above, step), step))
    climb = _climb(step, step.target_ned, here)
    if step.phase is Phase.TAKEOFF or not plan[index + 1].avoids:
        return TakenUp(index, (*climb, _to(step.target_ned, step)))
    return TakenUp(index, tuple(climb)) if climb else TakenUp(index + 1)


def climb_first(left: Sequence[Step], phase: Phase, here: Array) -> list[Step]:
    """What a vehicle at a place (3,) m, NED flies in that phase of a delivery before it leaves the steps that are left:
    the climb after it, straight up from wherever it is."""
    climb = next((step for step in left if step.phase is Phase.CLIMB), None)
    if phase not in _LOW or climb is None or climb.target_ned is None:
        return []
    return _climb(climb, climb.target_ned, here) if is_beside(climb.target_ned, here) else [climb]


def way_to(step: Step, before: Sequence[Step], here: Array | None) -> Array:
    """(3,) m, NED: the straight way to a step from the one before it, or from a place (3,) if that is farther away."""
    places = [other.target_ned for other in before if other.target_ned is not None][-1:]
    if here is not None:
        places.append(here)
    ways = [] if step.target_ned is None else [step.target_ned - place for place in places]
    return max(ways, key=lambda way: float(way @ way), default=np.zeros(3))


def _above(plan: Sequence[Step], index: int) -> Array:
    """(3,) m, NED: where the descent of that index begins, at the height of the route."""
    low = plan[index].target_ned
    assert low is not None
    for step in (*plan[index + 1 :], *plan[index - 1 :: -1]):  # a climb follows, back to where the descent began
        if step.target_ned is not None and step.phase is not Phase.DESCEND and not is_beside(step.target_ned, low):
            return np.array([*low[:2], min(step.target_ned[2], low[2])])
    return low


def _climb(step: Step, above: Array, here: Array) -> list[Step]:
    """Straight up to the height of a place (3,), in place of a step, where the vehicle is much lower."""
    if here[2] - above[2] <= _LOWER_M:
        return []
    return [replace(step, phase=Phase.CLIMB, target_ned=np.array([*here[:2], above[2]]))]


def _to(place: Array, step: Step) -> Step:
    """Around obstacles to where a step begins (3,)."""
    return Step(Phase.ROUTE, place, avoids=True, speed=step.speed)
