"""The search for another height of flight than the route's, over or under an obstacle, where the settings allow it.

The map is flat: the obstacles at a height can be seen from that height only. So the vehicle stops, flies straight up or
down to another height, and looks around. If the detour from there is short enough, it flies `margin` farther, past an
edge just below (or above) the scan, and continues. Otherwise it tries the next height, and returns after the last one.

The space between a height and the route's has been seen only where the vehicle left the route's height. So it returns
to that height only there, or at a goal that it stops at, which the mission declares free. On the legs between, it keeps
its height or moves farther from the route's. So does a vehicle that others have flown to well above the route's height.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from companion.config_avoidance import AvoidanceAltitudeSearch
from companion.state import EVERY_HEIGHT
from protocol.arrays import Array

_REACHED_M = 0.2
"""m from a height within which it is reached."""
_STANDSTILL = 0.3
"""m/s below which the vehicle stands still."""
_SAME_PLACE_M = 1.0
"""m, horizontal, within which the vehicle is back where it left the route's height."""
_HIGHER_M = 1.0
"""m: so much from a height is another one."""
_GAP_NS = 500_000_000
"""After so long without a path, the time for which the detour was too long starts again."""


class _Stage(Enum):
    FLY = "follow the path at the present height"
    BRAKE = "stop before a change of height"
    MOVE = "fly to the next height"
    LOOK = "look around there"
    CLEAR = "fly the margin beyond it"
    BACK = "return to the route's height"


@dataclass(frozen=True, slots=True)
class Place:
    """Where the vehicle and the goal are (m, NED)."""

    here: Array
    """(3,) the vehicle's position."""
    route: float
    """Down: the height of the goal."""
    lowest: float
    """Down: the lowest height that may be tried."""
    highest: float = -math.inf
    """Down: the highest one."""


class Change(NamedTuple):
    """A change of height."""

    down: float
    """m, NED: the new height."""
    why: str
    """For the operator."""


class AltitudeSearch:
    """The height of flight from one goal that the vehicle stops at to the next."""

    def __init__(self, settings: AvoidanceAltitudeSearch, give_up_s: float) -> None:
        """`give_up_s`: s without progress after which a height is left in any case."""
        self._settings = settings
        self._give_up_s = give_up_s
        self._allowed = True
        self.begin()

    def begin(self) -> None:
        """Start at the route's height, with no other one tried."""
        self._stage = _Stage.FLY
        self._down: float | None = None
        """m, NED: the present height or the one that the vehicle moves to; None: the route's."""
        self._up = True
        self._target, self._target_is_up = 0.0, True
        """m, NED: the next height, once the vehicle stands still."""
        self._untried: list[float] | None = None
        """m, NED: the heights not tried yet; None: they are not listed yet."""
        self._route_left_at: tuple[float, float] | None = None
        """m, north and east: where the vehicle left the route's height."""
        self._long_since_ns: int | None = None
        self._considered_ns = 0
        self._looks_since_ns: int | None = None

    def next_leg(self, *, stopped: bool) -> None:
        """A goal was reached; `stopped`: the vehicle stopped at it."""
        if stopped or self._down is None:
            self.begin()
        else:
            self._untried = self._route_left_at = self._long_since_ns = None
            self._stage = _Stage.FLY

    def resume(self, down: float, route: float | None) -> bool:
        """Others flew the vehicle, to a height (m, NED). Whether it keeps a height other than the `route`'s: the one
        that it was on, if it is still there, or its own, if that is well above the route's. `route`: None where the
        vehicle goes straight up or down."""
        if route is not None and self._down is not None and abs(down - self._down) < _HIGHER_M:
            self.next_leg(stopped=False)
            return True
        self.begin()
        if route is None or route - down <= _HIGHER_M:
            return False
        self._down = down
        return True

    def forbid(self) -> None:
        """Keep the present height from now on."""
        self._allowed = False
        self._stage = _Stage.FLY

    @property
    def busy(self) -> bool:
        """The vehicle stays where it is: it changes its height, or looks around."""
        return self._stage is not _Stage.FLY

    def flown(self, route: float) -> float:
        """The height of flight (down, m, NED) to a goal at the height `route`."""
        if self._down is None:
            return route
        return min(route, self._down) if self._up else max(route, self._down)

    def in_the_way(self, route: float) -> tuple[float, float]:
        """m above and below the vehicle up to which returns are in the way, with the route's height (down, m, NED):
        nearer on that side at another height, since it flies past the edges there."""
        if self.flown(route) == route:
            return EVERY_HEIGHT
        edge = self._settings.edge_distance
        return (math.inf, edge) if self._up else (edge, math.inf)

    def slowed(self, speed: float) -> float:
        """The speed allowed at the present height, at most `speed` (m/s)."""
        return speed if self._down is None else min(speed, self._settings.speed)

    def advance(self, down: float, speed: float, now_ns: int) -> None:
        """Go on to the next stage where the vehicle's height (m, NED) and horizontal speed (m/s) allow it."""
        if self._stage is _Stage.BRAKE and speed < _STANDSTILL:
            self._stage, self._down, self._up = _Stage.MOVE, self._target, self._target_is_up
        there = self._down is not None and abs(down - self._down) < _REACHED_M
        if self._stage is _Stage.MOVE and there:
            self._stage, self._looks_since_ns = _Stage.LOOK, now_ns
        elif self._stage is _Stage.CLEAR and there:
            self._stage = _Stage.FLY
        elif self._stage is _Stage.BACK and there:
            self._stage, self._down = _Stage.FLY, None

    def consider(self, detour: float, stalled_s: float, place: Place, now_ns: int) -> Change | None:
        """The change of height that a new path calls for, if any.

        `detour`: m, the cost of the path beyond the least expected; `stalled_s`: for so long the vehicle has come no
        nearer to the goal.
        """
        long = detour > self._settings.height_cost * self._settings.step
        if self._stage is _Stage.LOOK:
            assert self._looks_since_ns is not None and self._down is not None
            if now_ns - self._looks_since_ns < self._settings.dwell_time * 1e9:
                return None
            if long or (detour > self._settings.short_detour and self._next_heights(place)):
                return self._try_next(place)
            self._stage = _Stage.CLEAR
            self._down += -self._settings.margin if self._up else self._settings.margin
            return Change(self._down, "there is a way, going on")
        if self._stage is not _Stage.FLY or not (self._long_enough(long, now_ns) or self._is_stuck(stalled_s)):
            return None
        return self._try_next(place)

    def _is_stuck(self, stalled_s: float) -> bool:
        """Whether a height should be left after so long without progress: sooner where there is another one."""
        patience_s = self._settings.patience_s if self._down is not None and self._untried != [] else math.inf
        return stalled_s > min(patience_s, self._give_up_s)

    def _long_enough(self, long: bool, now_ns: int) -> bool:
        """Whether the detour has been too long for the dwell time."""
        if not long or now_ns - self._considered_ns > _GAP_NS or self._long_since_ns is None:
            self._long_since_ns = now_ns
        self._considered_ns = now_ns
        return long and now_ns - self._long_since_ns >= self._settings.dwell_time * 1e9

    def _try_next(self, place: Place) -> Change | None:
        """The next height; after the last one the route's, if the vehicle is where it left that."""
        if not self._allowed:
            return None
        self._untried = self._next_heights(place)
        self._long_since_ns = None
        if not self._untried:
            if self._down is None or not self._returns(place):
                self._stage = _Stage.FLY
                return None
            self._stage, self._down = _Stage.BACK, place.route
            return Change(place.route, "no better way, back")
        if self._down is None:
            self._route_left_at = float(place.here[0]), float(place.here[1])
        self._stage, self._target = _Stage.BRAKE, self._untried.pop(0)
        self._target_is_up = self._target < place.route
        return Change(self._target, "no way or a long one, trying")

    def _returns(self, place: Place) -> bool:
        """Whether the vehicle is where it left the route's height."""
        here = float(place.here[0]), float(place.here[1])
        return self._route_left_at is not None and math.dist(self._route_left_at, here) < _SAME_PLACE_M

    def _next_heights(self, place: Place) -> list[float]:
        """Those that may be tried from here: elsewhere than where the route's was left only what is farther from it."""
        untried = self._heights(place) if self._untried is None else self._untried
        if self._down is None or self._returns(place):
            return untried
        return [down for down in untried if (down < self._down if self._up else down > self._down)]

    def _heights(self, place: Place) -> list[float]:
        """All heights (down, m, NED) that may be tried: up first, a step apart, the last one at the limit."""
        settings = self._settings
        up = self._steps(min(settings.max_climb, place.route - place.highest) - settings.margin)
        down = self._steps(min(settings.max_descent, place.lowest - place.route) - settings.margin)
        return [*(place.route - height for height in up), *(place.route + height for height in down)]

    def _steps(self, most: float) -> list[float]:
        step = self._settings.step
        steps = [step * (k + 1) for k in range(math.floor(max(most, 0.0) / step + 1e-9))]
        if most > (steps[-1] if steps else 0.0) + _REACHED_M:
            steps.append(most)
        return steps
