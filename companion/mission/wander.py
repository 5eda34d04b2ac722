"""How far a vehicle wanders about its reference: what its estimator's noise leaves, and wind.

A vehicle that wanders 0.2 m can't be told to be within 0.1 m of a place. Whether it has arrived is judged against what
was seen of it over the last seconds. What lifts off is still finding its thrust: that is no wander.
"""

import math

from companion.config import Trajectory
from companion.state import VehicleState
from protocol.arrays import Array

_SHARE = 1.0 / 1000.0
"""Weight of a control step in the mean squares: a window of 4 s at 250 Hz."""
_LIFTING_OFF = 750
"""Control steps in the air that do not count yet: 3 s at 250 Hz."""
_SIGMAS = 2.5
_MOST = 5.0
"""A bound grows to so many times itself, at most."""


class Wander:
    """Mean squares of the errors."""

    def __init__(self) -> None:
        self._position = 0.0
        """m2."""
        self._rate = 0.0
        """m2/s2."""
        self._left = _LIFTING_OFF

    def add(self, errors: Array) -> None:
        """The errors (6,) of a step in the air: of the position (m), and of the virtual rate (m/s)."""
        if self._left:
            self._left -= 1
            return
        x, y, z, u, v, w = errors.tolist()
        self._position += _SHARE * (x * x + y * y + z * z - self._position)
        self._rate += _SHARE * (u * u + v * v + w * w - self._rate)

    def distance(self, settled: float) -> float:
        """m; within this a vehicle has arrived that should come within `settled`."""
        return max(settled, min(_SIGMAS * math.sqrt(self._position), _MOST * settled))

    def speed(self, settled: float) -> float:
        """m/s; the same for the speed."""
        return max(settled, min(_SIGMAS * math.sqrt(self._rate), _MOST * settled))


class Settling:
    """Whether a vehicle has come to rest at a place."""

    def __init__(self, settings: Trajectory, *, at_once: bool) -> None:
        """`at_once`: nothing is waited for."""
        self.wander = Wander()
        self._settings = settings
        self._at_once = at_once

    @property
    def distance(self) -> float:
        """m from a place that is reached, once the reference rests there."""
        return self.wander.distance(self._settings.settled_distance)

    def reached(self, target_ned: Array, state: VehicleState, reference_rests: bool) -> bool:
        """Near to a place (3,) and slow. Wander widens the bounds once the reference rests: before, its errors are
        those of a manoeuvre."""
        if self._at_once:
            return True
        near, slow = self._settings.settled_distance, self._settings.settled_speed
        if reference_rests:
            near, slow = self.distance, self.wander.speed(slow)
        distance = math.dist(target_ned.tolist(), state.position_ned.tolist())
        return distance < near and math.hypot(*state.velocity_ned.tolist()) < slow
