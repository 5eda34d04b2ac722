"""Heights that count from the ground below the vehicle, where the settings say so: the mission rises and falls with it.

What is known is the ground straight below. The vehicle climbs as the ground will stand a second ahead, sinks as it
stands here, and waits where it has come too low. Where the ground is not seen any more, the height is kept, and nothing
that a scan shows counts as ground: so it flies around what rises.

Elsewhere the ground is flat, and heights count from the start, but for the drift of the vehicle's estimate
(`mission.height_drift`).
"""

import math
from dataclasses import replace

import numpy as np

from companion.config import Settings
from companion.mission.height_drift import HeightDrift
from companion.mission.plan import Phase, Step
from companion.state import Announcement, Ground, Severity
from protocol.arrays import Array

_CHANGE_M = 0.1
"""m by which the ground must rise or fall for the mission to follow."""
_LEAST_SHARE, _LEAST_M = 0.6, 1.0
"""A vehicle that is lower than this share of its height, and than so many m, waits until it has climbed."""


class GroundFollowing:
    """The ground under one mission, as m (NED, down) from that of the start."""

    def __init__(self, settings: Settings) -> None:
        follows = settings.avoidance.ground_slope > 0.0
        self._ground_height = settings.avoidance.ground_height
        self._drift = None if follows else HeightDrift(settings.trajectory.height_drift)
        """None: the ground itself is followed."""
        self._start = 0.0
        """m, NED: the ground of the start."""
        self._highest = -math.inf
        """m, NED: beyond it nothing is lifted."""
        self._offset = 0.0
        """By which heights are shifted."""
        self._ground = Ground(0.0, 0.0)
        self._known = True
        self.too_low = False
        """The vehicle should climb before it goes on."""

    def begin(self, start_down: float, highest: float = -math.inf) -> None:
        """The vehicle stands on the ground (m, NED); heights are lifted up to the `highest` (m, NED)."""
        self._start, self._offset, self._ground = start_down, 0.0, Ground(start_down, start_down)
        self._highest = highest

    @property
    def lowest_return(self) -> float:
        """m, NED: what a scan shows below this is the ground."""
        return self._ground.here - self._ground_height if self._known else math.inf

    def follow(self, ground: Ground | None, step: Step, down: float, now_ns: int) -> tuple[bool, Announcement | None]:
        """The ground is there now, with the vehicle at a height (m, NED) on the way to a step of the mission as it was
        planned; whether heights have changed, and what is to be said."""
        before, said = (self._offset, self.too_low), None
        if self._drift is not None:
            said = self._drift.follow(ground, self._start, now_ns)
            level = self._start - self._drift.rise
            ground = Ground(level, level) if self._drift.rise or self._offset else None
        elif not _is_fixed(step):
            said = self._notice(known=ground is not None)
        if ground is not None and not _is_fixed(step):
            self._ground = ground
            if abs(ground.ahead - self._start - self._offset) > _CHANGE_M:
                self._offset = ground.ahead - self._start
            wanted = math.inf if step.target_ned is None else self._start - float(step.target_ned[2])
            self.too_low = step.avoids and ground.ahead - down < min(_LEAST_SHARE * wanted, _LEAST_M)
        return (self._offset, self.too_low) != before, said

    def _notice(self, *, known: bool) -> Announcement | None:
        """Whether the ground has been lost or found."""
        if known is self._known:
            return None
        self._known = known
        if known:
            return Announcement(Severity.NOTICE, "the ground below is seen again")
        self.too_low = False
        text = "the ground below is not seen any more: keeping the height, and flying around all that is in the way"
        return Announcement(Severity.WARNING, text)

    def shifted(self, step: Step) -> Step:
        """A step of the mission as it was planned, above the ground of now."""
        if step.target_ned is None or _is_fixed(step) or not self._offset:
            return step
        north, east, down = step.target_ned.tolist()
        return replace(step, target_ned=np.array((north, east, max(down + self._offset, min(self._highest, down)))))

    def planned(self, place_ned: Array) -> Array:
        """A place (3,) as if the ground were that of the start: the opposite of `shifted`, below the highest."""
        return place_ned - np.array((0.0, 0.0, self._offset)) if self._offset else place_ned


def _is_fixed(step: Step) -> bool:
    """Its heights count from the place of the start all the same: a take-off, and a track, home too."""
    return step.phase is Phase.TAKEOFF or step.curve is not None
