"""An estimate without error."""

from collections import deque

from vehicle_sim.physics.motion import Motion
from vehicle_sim.tick import EXACT
from vehicle_sim.timing import TICK_NS


class DelayedTruth:
    """The vehicle flies on the truth, and tells it late: as it was `delay_s` ago, rounded up to whole ticks."""

    error = EXACT
    reset_counter = 0
    position_lost = False

    def __init__(self, delay_s: float, start: Motion) -> None:
        # in nanoseconds, so that a delay of whole ticks is not rounded up
        delay_ticks = -(round(delay_s * 1e9) // -TICK_NS)
        self._past = deque([start], maxlen=1 + delay_ticks)

    def update(self, truth: Motion) -> tuple[Motion, Motion]:
        """What the vehicle flies on after one more tick, at whose end it moves so, and what it tells."""
        self._past.append(truth)
        return truth, self._past[0]
