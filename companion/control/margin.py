"""How fast the loops may be with a delay: the phase margin of the linear design, and the pace that keeps it.

For one horizontal axis about hover the vehicle is x' = A x + B u with x = (position, velocity, angle, rate, angular
acceleration), and both laws together are u = -K x on the predicted state. Broken at the plant's input, a loop whose
state is predicted over a delay T by the commands under way (a Smith predictor in state space; Z. Artstein, "Linear
systems with delayed controls: a reduction", IEEE TAC 27(4), 1982) is

    L(s) = K e^(A T) (sI - A)^-1 B e^(-s (T + left)) / (1 + K int_0^T e^((A - sI) t) dt B)

where `left` is a delay that is not predicted over. Prediction takes the delay out of the closed loop's poles, and pays
for it in margin: the longer the delay, the slower the loop must be for the same margin.

The pace p slows the whole design down as if time ran at p: gains on the error of position by p^2, on that of velocity
by p, and those of the attitude with them. A pace of 1 is the design itself.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.vehicle_parameters import GRAVITY

FLOOR = math.radians(30.0)
"""Phase margin (rad) that is kept, or the design's own without delay if that is less."""
LEAST_PACE = 0.1
"""The slowest that is flown."""
_FREQUENCIES = np.geomspace(0.05, 200.0, 400)
"""rad/s"""
_PACES = np.linspace(LEAST_PACE, 1.0, 46)
_TERMS = 10


class Design(NamedTuple):
    """What one axis is flown with. Hashable, so that a result can be remembered."""

    position: float
    """1/s2; acceleration by an error of position."""
    velocity: float
    """1/s; acceleration by an error of velocity."""
    attitude: tuple[float, float, float]
    """The inner law's gains on angle, rate and angular acceleration, at full pace."""
    input_gain: float
    """Angular acceleration (rad/s2) by one unit of the input, once the rotors have followed."""
    rate_feedback: float
    """1/s; of the vehicle's own rate loop: 0 where it is given torque."""
    angle_feedback: float
    """1/s; of its own attitude loop: 0 where it is given rates or torque."""
    rotor_lag: float
    """s"""


class Pace(NamedTuple):
    """How fast the loops are with a delay, and what that leaves."""

    share: float = 1.0
    """Share of the design's own bandwidth that is flown with."""
    margin: float | None = None
    """Phase margin (rad); None without a delay."""


ComplexArray = NDArray[np.complexfloating[Any, Any]]


class _Response(NamedTuple):
    """L at the frequencies is (K ahead) / (1 + K under_way), each (n, 5)."""

    ahead: ComplexArray
    under_way: ComplexArray


def _exponential(A: Array, time: float) -> Array:
    """e^(A t), by a series and squaring."""
    squarings = max(math.ceil(math.log2(max(float(np.abs(A).sum(axis=1).max()) * time, 1e-9))) + 3, 0)
    step, term, result = A * (time / 2.0**squarings), np.eye(len(A)), np.eye(len(A))
    for n in range(1, _TERMS):
        term = term @ step / n
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def plant(design: Design) -> tuple[Array, Array]:
    """A (5, 5) and B (5,) of one axis."""
    lag, k = max(design.rotor_lag, 1e-3), design.rate_feedback
    A = np.diag([1.0, GRAVITY, 1.0, 1.0], 1)
    A[4] = 0.0, 0.0, -k * design.angle_feedback / lag, -k / lag, -1.0 / lag
    return A, np.array([0.0, 0.0, 0.0, 0.0, design.input_gain / lag])


def feedback(design: Design, pace: float) -> Array:
    """K (5,) at a pace."""
    outer = np.array([pace * pace * design.position, pace * design.velocity]) / GRAVITY
    if design.angle_feedback > 0.0:  # the angle itself is commanded
        return np.array([*outer, 0.0, 0.0, 0.0])
    angle, rate, turning = paced(np.array(design.attitude), pace, torque=design.rate_feedback == 0.0)
    return np.array([*(angle * outer), angle, rate, turning])


def paced(gain: Array, pace: float, *, torque: bool) -> Array:
    """Gains (..., 3) on angle, rate and angular acceleration at a pace: of a rate command, or of a `torque`."""
    slowed: Array = gain * np.array([pace * pace, pace, 1.0] if torque else [pace, 1.0, 1.0])
    return slowed


def _response(design: Design, delay: float, left: float) -> _Response:
    A, B = plant(design)
    s = 1j * _FREQUENCIES
    moves = np.linalg.solve(s[:, None, None] * np.eye(5) - A, np.broadcast_to(B[:, None], (len(s), 5, 1)))[:, :, 0]
    later = np.exp(-s * delay)[:, None]
    ahead = moves @ _exponential(A, delay).T * later
    return _Response(ahead * np.exp(-s * left)[:, None], moves - ahead)


def _margin(response: _Response, K: Array) -> float:
    loop = (response.ahead @ K) / (1.0 + response.under_way @ K)
    above = np.abs(loop) >= 1.0
    crossings = np.nonzero(above[:-1] != above[1:])[0]
    if len(crossings) == 0:
        return math.pi
    phase = np.unwrap(np.angle(loop))
    phase -= 2.0 * math.pi * (phase[0] > 0.0)  # at rest two integrators and the lead of a velocity: just above -pi
    low, high = np.log(np.abs(loop[crossings])), np.log(np.abs(loop[crossings + 1]))
    margins = math.pi + phase[crossings] + low / (low - high) * (phase[crossings + 1] - phase[crossings])
    # beyond the first crossing the loop has turned round -1 on either side of it
    others = np.abs((margins[1:] + math.pi) % (2.0 * math.pi) - math.pi)
    return float(min([margins[0], *others]))


def phase_margin(design: Design, delay: float, left: float = 0.0, pace: float = 1.0) -> float:
    """rad, with a delay (s) that is predicted over and one that is `left`."""
    return _margin(_response(design, delay, left), feedback(design, pace))


@lru_cache(maxsize=64)
def pace_for(design: Design, delay: float, left: float) -> Pace:
    """The fastest pace, at most 1, up to which the phase margin is the floor; the slowest one if it nowhere is."""
    if delay + left <= 0.0:
        return Pace()
    floor = min(FLOOR, phase_margin(design, 0.0))
    response = _response(design, delay, left)
    best, *faster = _PACES.tolist()
    margin = _margin(response, feedback(design, best))
    for pace in faster if margin >= floor else ():
        next_margin = _margin(response, feedback(design, pace))
        if next_margin < floor:
            break
        best, margin = pace, next_margin
    return Pace(best, margin)
