"""Whether the frame of a vehicle's positions and velocities has turned with its heading, when that was reset.

A step from a position to the next shows it where the vehicle moves, or is away from the origin that the frame turned
about. At a standstill near the origin nothing does, until the vehicle speeds up: its velocity changes to where its
thrust pushes it, or to that turned. The frame has turned when the heading did, not when it shows.
"""

import cmath
import math
from collections import deque
from typing import NamedTuple

from protocol.frames import wrap

_STEPS = 25
"""So many steps before the jump are looked at; a position may come before the attitude that is reset with it."""
_BEFORE_MS, _AFTER_MS = 100, 500
"""Steps so far from the jump are looked at."""
_SWIFT, _PUSH = 0.2, 20.0
"""m/s and m/s2: two velocities that differ by more tell a frame that turned from one that did not,"""
_FAR_M = 0.3
"""and so do two positions."""
_TELLING = 1.0
"""m2/s3: the square of the thrust's changes, over time, that tells in which frame the vehicle accelerates."""
_AT_REST_S = 0.3
"""Before the jump, it is taken to have stood for so long,"""
_FORGOTTEN_S = 3.0
"""and what it did so long ago is forgotten: a wind changes."""
_LEAST_TURN = 0.35
"""rad; between frames that differ by less accelerations do not tell."""

Place = tuple[int, list[float], list[float]]
"""Time (ms), position (m) and velocity (m/s) as the vehicle says them."""


class Step(NamedTuple):
    """From a position to the next."""

    before: Place
    after: Place
    there: list[float]
    """Where the flight was to go on (m), in its own frame."""

    @property
    def place(self) -> list[float]:
        return self.after[1]

    @property
    def velocity(self) -> list[float]:
        return self.after[2]

    @property
    def dt(self) -> float:
        return (self.after[0] - self.before[0]) * 1e-3


def turns(turn: float, step: Step) -> bool | None:
    """Whether the frame has turned by an angle (rad) in this step; None: it does not show."""
    chord, spin, dt = 2.0 * abs(math.sin(0.5 * turn)), cmath.rect(1.0, turn), step.dt
    speed0, speed1 = complex(*step.before[2][:2]), complex(*step.velocity[:2])
    apart = chord * abs(speed0)
    if apart > _SWIFT + _PUSH * dt:
        return abs(speed1 - spin * speed0) < 0.5 * apart
    there, here = complex(*step.before[1][:2]) + dt * speed0, complex(*step.place[:2])
    apart = chord * abs(there)
    if apart > _FAR_M + 0.5 * _PUSH * dt * dt:
        off, stays = abs(here - spin * there), abs(here - there)
        return True if off < 0.3 * apart else False if stays < 0.3 * apart else None
    return None


class TurnedFrame:
    """What tells whether the frame of positions has turned."""

    def __init__(self) -> None:
        self._steps: deque[Step] = deque(maxlen=_STEPS)
        self._jumped_ms = 0
        self._base: Step | None = None
        """The first one after the jump."""
        self._time = _AT_REST_S
        self._energy, self._thrust, self._gained, self._product = 0.0, 0j, 0j, 0j
        """Sums over time: of the horizontal thrust's square (m2/s3), of it and of the velocity's change, which is taken
        in the flight's frame, as if that had not turned (m/s), and of their product (m2/s3)."""
        self._decided = False

    def step(self, step: Step) -> None:
        """One that was believed."""
        self._steps.append(step)

    def heading_jumped(self, turn: float, time_ms: int) -> Step | None:
        """The heading is turned by an angle (rad) against the frame of positions; the step in which that had turned
        already, if there is one."""
        steps = reversed(self._steps) if turn else ()
        self.__init__()  # type: ignore[misc]
        self._jumped_ms = time_ms
        return next((each for each in steps if 0 <= time_ms - each.after[0] <= _BEFORE_MS and turns(turn, each)), None)

    def shows(self, turn: float, step: Step) -> bool | None:
        """Whether the step is the one in which the frame turned, after the heading; None: it does not show."""
        return turns(turn, step) if 0 <= step.after[0] - self._jumped_ms <= _AFTER_MS else None

    def accelerates(self, turn: float, thrust: complex, change: complex, step: Step) -> Step | None:
        """The first step after the jump, if by now the vehicle is seen to accelerate as if the frame of its positions
        were turned (rad). `thrust`: where it pushes the vehicle (m/s2, north and east of the flight's frame), `change`:
        the velocity's in this step, as that frame has it (m/s)."""
        self._base = self._base or step
        if self._decided or abs(turn) < _LEAST_TURN:
            return None
        dt = step.dt
        kept = math.exp(-dt / _FORGOTTEN_S)
        self._time = kept * self._time + dt
        self._energy = kept * self._energy + abs(thrust) ** 2 * dt
        self._thrust = kept * self._thrust + thrust * dt
        self._gained = kept * self._gained + change
        self._product = kept * self._product + change * thrust.conjugate()
        energy = self._energy - abs(self._thrust) ** 2 / self._time  # a steady thrust stands against a wind
        product = self._product - self._gained * self._thrust.conjugate() / self._time
        if energy < _TELLING or not 0.5 < abs(product) / energy < 2.0:
            return None
        angle = cmath.phase(product)
        turned = abs(wrap(angle - turn)) < 0.3 * abs(turn)
        self._decided = turned or abs(angle) < 0.3 * abs(turn)
        return self._base if turned else None
