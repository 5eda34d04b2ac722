"""The height of flight, where the settings allow another than the route's: over what stands in the way, or under it.

The map is flat and knows nothing of other heights: what there is at one is seen from there alone. So the vehicle stops,
goes to another height straight up or down, looks around for a while, and if the way from there is not too dear goes
`margin` farther, for an edge that is just below (or above) the ring, and flies on. Otherwise it tries the next height,
and after the last one comes back.

Nobody has seen what is between a height and the route's anywhere but where the route's was left. So the vehicle comes
back to it there alone, or at a goal that is stopped at, which is free by the mission's word; on the legs in between the
height is kept, or left outward.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from companion.config import AvoidanceAltitudeSearch
from protocol.arrays import Array

_THERE_M = 0.2
"""From a height, where it is reached."""
_STANDS = 0.3
"""m/s at which the vehicle stands."""
_SAME_PLACE_M = 1.0
_GAP_NS = 500_000_000
"""Without a judgement for so long, the time before counts no more."""


class _Stage(Enum):
    FLY = "on, at the height that was found"
    BRAKE = "to a stand"
    MOVE = "to a height that is tried"
    LOOK = "around, there"
    CLEAR = "by the margin beyond it"
    BACK = "to the route's"


@dataclass(frozen=True, slots=True)
class Place:
    """Where the vehicle is and what the leg says. Heights are down (m, NED)."""

    here: Array
    """(3,)"""
    route: float
    """The goal's height."""
    lowest: float
    """Nothing below is tried."""


class Change(NamedTuple):
    """Of the height."""

    down: float
    """m, NED"""
    why: str


class AltitudeSearch:
    """From one goal that is stopped at to the next."""

    def __init__(self, settings: AvoidanceAltitudeSearch) -> None:
        self._settings = settings
        self._allowed = True
        self.begin()

    def begin(self) -> None:
        """At the route's height, with all others to be tried."""
        self._stage = _Stage.FLY
        self._down: float | None = None
        """What is flown at, or on the way to; None: the route's."""
        self._up = True
        self._left: list[float] | None = None
        """Those that were not tried yet; None: it is not known which there are."""
        self._route_left_at: tuple[float, float] | None = None
        self._dear_since_ns: int | None = None
        self._judged_ns = 0
        self._looks_since_ns: int | None = None

    def next_leg(self, *, stopped: bool) -> None:
        """The goal was reached: stopped at, or flown through."""
        if stopped or self._down is None:
            self.begin()
        else:
            self._left = self._route_left_at = self._dear_since_ns = None
            self._stage = _Stage.FLY

    def forbid(self) -> None:
        """Keep the height, and try no other one any more."""
        self._allowed = False
        self._stage = _Stage.FLY

    @property
    def busy(self) -> bool:
        """The vehicle does not go on: it is on its way to a height, or looks around there."""
        return self._stage is not _Stage.FLY

    def flown(self, route: float) -> float:
        """Down (m) of the flight to a goal whose own is `route`."""
        if self._down is None:
            return route
        return min(route, self._down) if self._up else max(route, self._down)

    def slowed(self, speed: float) -> float:
        """As fast as may be flown at the present height, at most `speed` (m/s)."""
        return speed if self._down is None else min(speed, self._settings.speed)

    def advance(self, down: float, speed: float, now_ns: int) -> None:
        """The vehicle is at that height (m, NED) and has that horizontal speed (m/s)."""
        if self._stage is _Stage.BRAKE and speed < _STANDS:
            self._stage, self._down, self._up = _Stage.MOVE, self._target, self._target_is_up
        there = self._down is not None and abs(down - self._down) < _THERE_M
        if self._stage is _Stage.MOVE and there:
            self._stage, self._looks_since_ns = _Stage.LOOK, now_ns
        elif self._stage is _Stage.CLEAR and there:
            self._stage = _Stage.FLY
        elif self._stage is _Stage.BACK and there:
            self._stage, self._down = _Stage.FLY, None

    _target, _target_is_up = 0.0, True
    """Where to, once it stands."""

    def consider(self, detour: float, stuck: bool, place: Place, now_ns: int) -> Change | None:
        """An answer about the way: it costs `detour` (m) more than was to be expected, or nothing comes nearer to the
        goal. None if there is no change."""
        dear = detour > self._settings.height_cost * self._settings.step
        if self._stage is _Stage.LOOK:
            assert self._looks_since_ns is not None and self._down is not None
            if now_ns - self._looks_since_ns < self._settings.dwell_time * 1e9:
                return None
            if dear:
                return self._try_next(place)
            self._stage = _Stage.CLEAR
            self._down += -self._settings.margin if self._up else self._settings.margin
            return Change(self._down, "there is a way, going on")
        if self._stage is not _Stage.FLY or not (self._dear_for_long(dear, now_ns) or stuck):
            return None
        return self._try_next(place)

    def _dear_for_long(self, dear: bool, now_ns: int) -> bool:
        if not dear or now_ns - self._judged_ns > _GAP_NS or self._dear_since_ns is None:
            self._dear_since_ns = now_ns
        self._judged_ns = now_ns
        return dear and now_ns - self._dear_since_ns >= self._settings.dwell_time * 1e9

    def _try_next(self, place: Place) -> Change | None:
        """The next height; after the last one back to the route's, if that can be."""
        if not self._allowed:
            return None
        if self._left is None:
            self._left = self._heights(place)
        north, east = float(place.here[0]), float(place.here[1])
        returns = self._route_left_at is not None and math.dist(self._route_left_at, (north, east)) < _SAME_PLACE_M
        if self._down is not None and not returns:  # outward only
            self._left = [down for down in self._left if (down < self._down if self._up else down > self._down)]
        self._dear_since_ns = None
        if not self._left:
            if self._down is None or not returns:
                self._stage = _Stage.FLY
                return None
            self._stage, self._down = _Stage.BACK, place.route
            return Change(place.route, "no better way, back")
        if self._down is None:
            self._route_left_at = north, east
        self._stage, self._target = _Stage.BRAKE, self._left.pop(0)
        self._target_is_up = self._target < place.route
        return Change(self._target, "no way or a long one, trying")

    def _heights(self, place: Place) -> list[float]:
        """Those that may be tried: up first, each a step farther, or where the limit is."""
        settings = self._settings
        up = self._steps(settings.max_climb - settings.margin)
        down = self._steps(min(settings.max_descent, place.lowest - place.route) - settings.margin)
        return [*(place.route - height for height in up), *(place.route + height for height in down)]

    def _steps(self, most: float) -> list[float]:
        step = self._settings.step
        steps = [step * (k + 1) for k in range(math.floor(max(most, 0.0) / step + 1e-9))]
        if most > (steps[-1] if steps else 0.0) + _THERE_M:
            steps.append(most)
        return steps
