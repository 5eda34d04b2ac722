"""Wall time, or a faster clock. In lockstep the vehicle gives the time instead, see companion/runtime/runner.py."""

import math
import time
from collections.abc import Callable


class RealClock:
    """Starts at 0 when it is made and runs `factor` times as fast as `monotonic_ns`, by default time.monotonic_ns.

    Raises ValueError for a factor that is not positive and finite.
    """

    def __init__(self, factor: float = 1.0, monotonic_ns: Callable[[], int] | None = None) -> None:
        if not 0.0 < factor < math.inf:
            raise ValueError(f"a clock can't run {factor} times as fast")
        self.factor = factor
        self._monotonic_ns = monotonic_ns or time.monotonic_ns
        self._start_ns = self._monotonic_ns()

    def now_ns(self) -> int:
        elapsed = self._monotonic_ns() - self._start_ns
        return elapsed if self.factor == 1.0 else int(elapsed * self.factor)

    def wall_seconds_until(self, time_ns: int) -> float:
        """Wall time (s) until a time of this clock; negative if that has passed."""
        return (time_ns - self.now_ns()) * 1e-9 / self.factor
