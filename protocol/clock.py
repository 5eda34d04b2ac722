"""Clocks: real (or faster by a factor), and one that is set from outside (tests, lockstep)."""

import math
import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic nanoseconds from an arbitrary start."""

    def now_ns(self) -> int: ...


class RealClock:
    """The machine's monotonic clock, from 0 at construction, running `factor` times as fast.

    Raises ValueError for a factor that is not positive and finite.
    """

    def __init__(self, factor: float = 1.0) -> None:
        if not 0.0 < factor < math.inf:
            raise ValueError(f"a clock can't run {factor} times as fast")
        self.factor = factor
        self._start_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        elapsed = time.monotonic_ns() - self._start_ns
        return elapsed if self.factor == 1.0 else int(elapsed * self.factor)

    def wall_seconds_until(self, time_ns: int) -> float:
        """How long to wait for a time of this clock; negative if it has passed."""
        return (time_ns - self.now_ns()) * 1e-9 / self.factor


class ManualClock:
    """Stands still until `set`; in lockstep it is set by what the vehicle says the time is."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def set(self, time_ns: int) -> None:
        """Never backwards: an earlier time raises ValueError."""
        if time_ns < self._now_ns:
            raise ValueError(f"a monotonic clock can't go back from {self._now_ns} to {time_ns} ns")
        self._now_ns = time_ns
