"""When a path is where: a smooth law from rest to a constant rate and back, and the chain rule up to snap."""

from dataclasses import dataclass, replace

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def _rate(x: float, length: float) -> Array:
    """Integral, value and three derivatives by time of the step 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7, x = t / length.

    Its first three derivatives vanish at 0 and 1, so that what is joined there is continuous up to snap.
    """
    x2, y = x * x, 1.0 - x
    return np.array(
        [
            length * x2 * x2 * x * (7.0 + x * (-14.0 + x * (10.0 - 2.5 * x))),
            x2 * x2 * (35.0 + x * (-84.0 + x * (70.0 - 20.0 * x))),
            140.0 * x2 * x * y * y * y / length,
            420.0 * x2 * y * y * (1.0 - 2.0 * x) / length**2,
            840.0 * x * y * (1.0 - 5.0 * x + 5.0 * x2) / length**3,
        ]
    )


@compiled
def law_at(start: float, rate: float, up: float, cruise: float, down: float, time: float) -> Array:
    """(5,) parameter and its derivatives by time up to the fourth, at rest before 0 and after the end."""
    law = np.zeros(5)
    law[0] = start
    if time < 0.0:
        return law
    if time >= up + cruise + down:
        law[0] += rate * (0.5 * up + cruise + 0.5 * down)
    elif time < up:
        law += rate * _rate(time / up, up)
    elif time < up + cruise or down == 0.0:
        law[0] += rate * (0.5 * up + time - up)
        law[1] = rate
    else:
        left = rate * _rate((up + cruise + down - time) / down, down)
        law[0] += rate * (0.5 * up + cruise + 0.5 * down) - left[0]
        law[1], law[2], law[3], law[4] = left[1], -left[2], left[3], -left[4]
    return law


@compiled
def compose(path: Array, law: Array) -> Array:
    """(5, 3) derivatives by time, from (5, 3) those of the path by its parameter and (5,) those of the parameter by
    time (Faa di Bruno)."""
    u1, u2, u3, u4 = law[1], law[2], law[3], law[4]
    out = np.empty((5, 3))
    for axis in range(3):
        p1, p2, p3, p4 = path[1, axis], path[2, axis], path[3, axis], path[4, axis]
        out[0, axis] = path[0, axis]
        out[1, axis] = p1 * u1
        out[2, axis] = p2 * u1**2 + p1 * u2
        out[3, axis] = p3 * u1**3 + 3.0 * p2 * u1 * u2 + p1 * u3
        out[4, axis] = p4 * u1**4 + 6.0 * p3 * u1**2 * u2 + p2 * (3.0 * u2**2 + 4.0 * u1 * u3) + p1 * u4
    return out


@dataclass(frozen=True, slots=True)
class TimeLaw:
    """The parameter from `start` to `end` (> start): up to `rate` (1/s) in `up_s`, and down to rest in `down_s`.

    A way too short for both is passed at a lower rate."""

    start: float
    end: float
    wanted_rate: float
    up_s: float
    down_s: float

    @property
    def rate(self) -> float:
        """The highest."""
        ramps = 0.5 * (self.up_s + self.down_s)
        way = self.end - self.start
        return self.wanted_rate if way > self.wanted_rate * ramps else way / ramps

    @property
    def duration_s(self) -> float:
        return sum(self.phases[2:])

    @property
    def phases(self) -> tuple[float, float, float, float, float]:
        """What `law_at` takes before the time."""
        cruise = max((self.end - self.start) / self.rate - 0.5 * (self.up_s + self.down_s), 0.0)
        return self.start, self.rate, self.up_s, cruise, self.down_s

    def at(self, time_s: float) -> Array:
        """(5,) the parameter and its derivatives by time."""
        return law_at(*self.phases, time_s)

    def resumed(self, parameter: float, ramp_s: float) -> "TimeLaw":
        """From rest at that parameter to the same end."""
        return replace(self, start=parameter, up_s=ramp_s)
