"""The way to where the vehicle lands, by which the battery is judged: how long it takes."""

import math
from collections.abc import Iterable

import numpy as np

from companion.config import Trajectory
from companion.mission.plan import Mission, Phase, Step
from companion.mission.stall import Trail
from companion.mission.step_time import way_s
from protocol.arrays import Array

_SINKING = 0.7
"""m/s at which vehicles land."""
_HOMEWARD = {Phase.CLIMB, Phase.RETURN, Phase.LAND}
"""A mission of which nothing else is left leads home."""


class WayHome:
    """The ways of one flight, of places m, NED, as if the ground were that of the start."""

    def __init__(self, mission: Mission, limits: Trajectory) -> None:
        self.trail = Trail(mission.speed, limits)
        self._mission, self._limits = mission, limits
        self._home = np.zeros(3)
        """(3,) m, NED: above the landing place."""
        self._ground_down = 0.0
        """m, NED: the landing place's."""

    def begin(self, start: Array, home: Array) -> None:
        """The vehicle stands at `start`, to which it comes back by way of `home`, (3,) m, NED each."""
        self._home, self._ground_down = home, float(start[2])

    def to_landing(
        self, here: Array, phase: Phase, left: Iterable[Step], most: float, *, cut_short: bool
    ) -> tuple[bool, float]:
        """Whether the mission leads straight to where it lands, and the time (s) to the nearest landing place known
        from a place (3,): as slowly as the vehicle came, and at `most` m/s.

        `left`: what is left of the mission, which is in a `phase`; `cut_short`: that is the way home.
        """
        if phase is Phase.LAND:
            return True, self._landing_s(here)
        homeward = cut_short or phase is Phase.RETURN
        if phase is Phase.CLIMB:  # from the last delivery, or from one before
            left = tuple(left)
            homeward |= {Phase.RETURN} < {step.phase for step in left} <= _HOMEWARD
        slower = self.trail.slowness * max(self._mission.speed / most, 1.0)
        back_s = slower * self.trail.back_s(here, self._home) + self._landing_s(self._home)
        if homeward or self._mission.return_home:
            return homeward, back_s
        rest_s = self._rest_s(here, left, most, back_s)
        return rest_s <= back_s, min(rest_s, back_s)

    def _rest_s(self, here: Array, left: Iterable[Step], most: float, until_s: float) -> float:
        """s through the steps that are left, with their holds, and down; inf for more than `until_s`, and where a track
        is on the way."""
        total, place = 0.0, here
        for step in left:
            total += step.hold_s
            if step.target_ned is not None:
                speed = min(step.speed or self._mission.speed, most)
                total += self.trail.slowness * way_s(step.target_ned - place, speed, self._limits)
                place = step.target_ned
            if step.curve is not None or total > until_s:
                return math.inf
        return total + self._landing_s(place)

    def _landing_s(self, place: Array) -> float:
        """s from a place (3,) straight down to the ground."""
        return max(self._ground_down - float(place[2]), 0.0) / _SINKING
