"""The vehicle's estimate of its own motion."""

from collections import deque

from vehicle_sim.physics.motion import Motion
from vehicle_sim.timing import TICK_NS


class Estimator:
    """For now the estimate is exact, but late: the true motion of `delay_s` ago, rounded up to whole ticks."""

    def __init__(self, delay_s: float, start: Motion) -> None:
        # in nanoseconds, so that a delay of whole ticks is not rounded up
        delay_ticks = -(round(delay_s * 1e9) // -TICK_NS)
        self._past = deque([start], maxlen=1 + delay_ticks)

    def update(self, truth: Motion) -> Motion:
        """The estimate after one more tick, at whose end the vehicle moves so."""
        self._past.append(truth)
        return self._past[0]
