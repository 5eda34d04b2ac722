"""The machine's clock, or a faster one. (In lockstep the vehicle says the time: see companion/runtime/runner.py.)"""

import math
import time


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
