"""Time laws: the parameter of a path over time, from rest smoothly to a constant rate and back, and the chain rule that
joins path and time law up to snap."""

import math
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled

Phases = tuple[float, float, float, float, float]


class Path(Protocol):
    """A curve in space that begins at 0, 0, 0 (m, NED)."""

    def at(self, parameter: float) -> Array:
        """(5, 3) position (m) and its derivatives by the parameter."""

    def flown(self, phases: Phases, time_s: float, origin_ned: Array) -> Array:
        """(6, 3) position, velocity, acceleration, jerk and snap (m, s; NED), and the heading of the horizontal motion,
        its rate and its acceleration (rad, s), at a time of the law with these phases.

        `origin_ned` (3,) is where the curve's 0, 0, 0 lies. It is one compiled call: each array that leaves compiled
        code costs half a microsecond, and a control step asks for two references.
        """


@compiled
def _rate(x: float, length: float) -> Array:
    """(5,) integral, value and three derivatives by time of the smooth step 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7 with
    x = t / length.

    Its first three derivatives vanish at 0 and 1, so a motion is continuous up to snap at both ends.
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
    """(5,) parameter and its derivatives by time up to the fourth; at rest before 0 and after the end.

    The parameter begins at `start`, reaches `rate` (1/s) within `up` (s), keeps it for `cruise` (s) and comes to rest
    within `down` (s).
    """
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
    """(5, 3) position and its derivatives by time, from those of the path (5, 3) by its parameter and those of the
    parameter (5,) by time (formula of Faa di Bruno)."""
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


@compiled
def _heading(path: Array, law: Array) -> tuple[float, float, float]:
    """The heading (rad) of the horizontal tangent, and its first two derivatives by time, from the path (5, 3) and the
    time law (5,)."""
    x1, y1, x2, y2, x3, y3 = path[1, 0], path[1, 1], path[2, 0], path[2, 1], path[3, 0], path[3, 1]
    square = x1 * x1 + y1 * y1
    if square == 0.0:
        return 0.0, 0.0, 0.0
    first = (x1 * y2 - y1 * x2) / square
    second = (x1 * y3 - y1 * x3 - 2.0 * first * (x1 * x2 + y1 * y2)) / square
    return math.atan2(y1, x1), first * law[1], second * law[1] ** 2 + first * law[2]


@compiled
def motion(path: Array, law: Array, origin: Array) -> Array:
    """(6, 3) as `Path.flown`, from the path (5, 3) and its derivatives by the parameter, and those of the parameter
    (5,) by time."""
    out = np.empty((6, 3))
    out[:5] = compose(path, law)
    out[0] += origin
    out[5, 0], out[5, 1], out[5, 2] = _heading(path, law)
    return out


@dataclass(frozen=True, slots=True)
class TimeLaw:
    """A parameter from `start` to `end`, or one that stays where both are the same: from rest to `wanted_rate` (1/s) in
    `up_s`, and to rest in `down_s` (s). If the distance is too short for both ramps, the rate is lower."""

    start: float
    end: float
    wanted_rate: float
    up_s: float
    down_s: float
    phases: Phases = field(init=False)
    """The arguments of `law_at` before the time."""

    def __post_init__(self) -> None:
        distance = self.end - self.start
        cruise = max(distance / self.rate - 0.5 * (self.up_s + self.down_s), 0.0) if distance > 0.0 else 0.0
        object.__setattr__(self, "phases", (self.start, self.rate, self.up_s, cruise, self.down_s))

    @property
    def rate(self) -> float:
        """The highest rate (1/s) that is reached."""
        ramps = 0.5 * (self.up_s + self.down_s)
        distance = self.end - self.start
        return self.wanted_rate if ramps == 0.0 or distance > self.wanted_rate * ramps else distance / ramps

    @property
    def duration_s(self) -> float:
        return sum(self.phases[2:])

    def at(self, time_s: float) -> Array:
        """(5,) parameter and its derivatives by time."""
        return law_at(*self.phases, time_s)

    def resumed(self, parameter: float, ramp_s: float) -> "TimeLaw":
        """The time law from rest at that parameter to the same end."""
        return replace(self, start=parameter, up_s=ramp_s)
