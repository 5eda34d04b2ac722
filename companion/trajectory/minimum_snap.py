"""The smoothest curve through points, of least integral of the squared snap, as fast as some limits allow.

Among all functions through given points at given times, from rest to rest, the one of least integral of its squared
fourth derivative is the spline of degree 7 with six continuous derivatives (Schoenberg 1964; D. Mellinger and V. Kumar,
ICRA 2011, for quadrotors). So the quadratic programme is one banded system of equations, that of interpolation.

The times are free. Stretching all of them by T divides velocities by T and accelerations by T^2, so that for given
shares of the whole the least T within the limits follows in closed form; the shares are those for which it is least.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize

from protocol.arrays import Array
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_DEGREE = 7
_SAMPLES = 24
"""A leg, in the search of the shares."""
_FINE_SAMPLES = 400
"""A leg, for the final time."""
_CLOSE = 1e-4
"""Relative gain of a step of the search that is not worth another one."""
_LONG_LEG = 4.0
"""Times speed^2 / acceleration: a leg longer than this gets points between. The curve of least snap alone would be at
its peak speed in the middle of it only, at 46 % of it on average."""
_MANY_LEGS = 24
_TILT_SHARE = 0.8
"""Of the limit: the rest is for drag and for corrections."""
_MARGIN = 1.0001
"""For what lies between the samples."""
_SHARPNESS = 12.0
"""Of the norm that stands for the peak in the search: a maximum has no gradient where it changes its place."""


@compiled
def polynomial_at(knots: Array, coefficients: Array, parameter: float) -> Array:
    """(5, 3) value and derivatives of a piecewise polynomial: knots (n + 1,), coefficients (n, degree + 1, 3) of the
    powers of the distance from each piece's left knot."""
    pieces = coefficients.shape[0]
    piece = min(max(np.searchsorted(knots, parameter, side="right") - 1, 0), pieces - 1)
    x = parameter - knots[piece]
    out = np.zeros((5, 3))
    for power in range(coefficients.shape[1] - 1, -1, -1):
        for axis in range(3):
            for order in range(4, 0, -1):  # each derivative by Horner's rule, over its factorial
                out[order, axis] = out[order, axis] * x + out[order - 1, axis]
            out[0, axis] = out[0, axis] * x + coefficients[piece, power, axis]
    out[2] *= 2.0
    out[3] *= 6.0
    out[4] *= 24.0
    return out


@compiled
def polynomials_at(knots: Array, coefficients: Array, samples: int) -> Array:
    """(n samples + 1, 5, 3) `polynomial_at` at that many places of each piece."""
    pieces = coefficients.shape[0]
    out = np.empty((pieces * samples + 1, 5, 3))
    for i in range(pieces * samples + 1):
        piece = min(i // samples, pieces - 1)
        share = (i - piece * samples) / samples
        out[i] = polynomial_at(knots, coefficients, knots[piece] + share * (knots[piece + 1] - knots[piece]))
    return out


@dataclass(frozen=True, slots=True)
class PiecewisePolynomial:
    """A path whose parameter is time; see `polynomial_at`."""

    knots: Array
    coefficients: Array

    def at(self, parameter: float) -> Array:
        """(5, 3) position and derivatives."""
        return polynomial_at(self.knots, self.coefficients, parameter)

    @property
    def duration_s(self) -> float:
        return float(self.knots[-1])

    def stretched(self, factor: float) -> "PiecewisePolynomial":
        """The same curve, that many times as slow."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=float)
        return PiecewisePolynomial(self.knots * factor, self.coefficients * powers[:, np.newaxis])


@dataclass(frozen=True, slots=True)
class Limits:
    """Of the motion as a whole (m, s, rad)."""

    speed: float
    acceleration: float
    tilt: float


def through(points: Array, durations: Array) -> PiecewisePolynomial:
    """The curve of least snap through `points` (n + 1, 3), at rest at both ends, with `durations` (n,) of its legs."""
    knots = np.concatenate(([0.0], np.cumsum(durations)))
    rest = [(order, np.zeros(3)) for order in (1, 2, 3)]
    spline = make_interp_spline(knots, points, k=_DEGREE, bc_type=(rest, rest))
    powers = [spline(knots[:-1], nu=order) / math.factorial(order) for order in range(_DEGREE + 1)]
    return PiecewisePolynomial(knots, np.ascontiguousarray(np.stack(powers, axis=1)))


def snap_integral(curve: PiecewisePolynomial) -> float:
    """Of the squared snap over time (m2/s7), exact."""
    nodes, weights = np.polynomial.legendre.leggauss(_DEGREE - 3)
    total = 0.0
    for left, right in zip(curve.knots, curve.knots[1:], strict=False):
        half = 0.5 * (right - left)
        snaps = np.array([curve.at(left + half * (1.0 + node))[4] for node in nodes])
        total += half * float(weights @ (snaps**2).sum(axis=1))
    return total


def _loads(curve: PiecewisePolynomial, limits: Limits, samples: int) -> Array:
    """(3, m) by what speed, acceleration and tilt ask the curve to be stretched at each of its samples."""
    motion = polynomials_at(curve.knots, curve.coefficients, samples)
    velocity, acceleration = motion[:, 1], motion[:, 2]
    slope = math.tan(_TILT_SHARE * limits.tilt)
    # The tilt: horizontal acceleration <= slope (g - acceleration downward).
    leaning = np.hypot(acceleration[:, 0], acceleration[:, 1]) + slope * acceleration[:, 2]
    return np.stack(
        (
            np.linalg.norm(velocity, axis=1) / limits.speed,
            np.sqrt(np.linalg.norm(acceleration, axis=1) / limits.acceleration),
            np.sqrt(np.maximum(leaning, 0.0) / (GRAVITY * slope)),
        )
    )


def proportional(points: Array, limits: Limits) -> Array:
    """(n,) durations of the legs as if each were flown on its own, from rest to rest."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    ramp = limits.speed**2 / limits.acceleration
    short = 2.0 * np.sqrt(lengths / limits.acceleration)
    durations: Array = np.where(lengths < ramp, short, (lengths + ramp) / limits.speed)
    return durations


def allocated(points: Array, limits: Limits) -> Array:
    """(n,) shares of the legs in the whole duration for which that is least (L-BFGS-B on a smooth bound)."""
    first = proportional(points, limits)

    def time(logarithms: Array) -> float:
        durations = np.exp(logarithms)
        curve = through(points, durations / durations.sum())
        loads = _loads(curve, limits, _SAMPLES)
        peak = loads.max()
        return float(np.log(peak) + np.log(((loads / peak) ** _SHARPNESS).mean()) / _SHARPNESS)

    found = minimize(time, np.log(first / first.sum()), method="L-BFGS-B", options={"ftol": _CLOSE})
    durations: Array = np.exp(found.x)
    shares: Array = durations / durations.sum()
    return shares


def divided(points: Array, limits: Limits) -> Array:
    """(m + 1, 3) the points, and others on the straight legs between them so that none is long."""
    offsets = np.diff(points, axis=0)
    lengths = np.linalg.norm(offsets, axis=1)
    longest = max(_LONG_LEG * limits.speed**2 / limits.acceleration, float(lengths.sum()) / _MANY_LEGS)
    parts = np.ceil(lengths / longest).astype(int).tolist()
    legs = [points[i] + np.outer(np.arange(n) / n, offsets[i]) for i, n in enumerate(parts)]
    return np.concatenate((*legs, points[-1:]))


def plan(points: Array, limits: Limits) -> PiecewisePolynomial:
    """The curve through `points` (n + 1, 3; m, NED, n >= 1, no two neighbours equal) from rest to rest that reaches,
    and does not pass, one of the limits."""
    points = divided(points, limits)
    curve = through(points, allocated(points, limits))
    return curve.stretched(_MARGIN * float(_loads(curve, limits, _FINE_SAMPLES).max()))
