"""What can go wrong with a sensor while it runs: the kinds of failure of MAV_CMD_INJECT_FAILURE."""

from collections import deque
from enum import IntEnum

import numpy as np

from protocol.arrays import Array

SLOW_NS = 1_000_000_000
"""A slow sensor measures once in this time."""
LATE_NS = 500_000_000
"""Age of the readings of a delayed sensor."""
BLINK_NS = 500_000_000
"""An intermittent sensor is silent for this time, and measures for as long."""


class Failure(IntEnum):
    """FAILURE_TYPE."""

    OK = 0
    OFF = 1
    STUCK = 2
    GARBAGE = 3
    WRONG = 4
    SLOW = 5
    DELAYED = 6
    INTERMITTENT = 7


class Fault:
    """Between a sensor of n values and who reads it."""

    def __init__(self, offset: Array, rng: np.random.Generator) -> None:
        """`offset` (n,): how wrong a wrong reading is, and the standard deviation of garbage."""
        self._offset = offset
        self._rng = rng
        self._past: deque[tuple[int, Array]] = deque()
        """The readings of the last `LATE_NS`, with their times; one older than that comes first."""
        self._last: Array | None = None
        self._last_ns = -SLOW_NS
        self.failure = Failure.OK

    def read(self, reading: Array, time_ns: int) -> Array | None:
        """What is read where the sensor measures this (n,); None: nothing."""
        self._past.append((time_ns, reading))
        while len(self._past) > 1 and self._past[1][0] <= time_ns - LATE_NS:
            self._past.popleft()
        found = reading if self.failure is Failure.OK else self._changed(reading, time_ns)
        if found is not None:
            self._last, self._last_ns = found, time_ns
        return found

    def _changed(self, reading: Array, time_ns: int) -> Array | None:
        match self.failure:
            case Failure.OFF:
                return None
            case Failure.STUCK:
                return reading if self._last is None else self._last
            case Failure.GARBAGE:
                return reading + self._offset * self._rng.standard_normal(len(reading))
            case Failure.WRONG:
                return reading + self._offset
            case Failure.SLOW:
                return reading if time_ns - self._last_ns >= SLOW_NS else None
            case Failure.DELAYED:
                then_ns, late = self._past[0]
                return late if then_ns <= time_ns - LATE_NS else None
            case Failure.INTERMITTENT:
                return None if time_ns // BLINK_NS % 2 else reading
        return reading
