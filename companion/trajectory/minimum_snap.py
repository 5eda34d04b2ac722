"""Minimum-snap curves: the least integral of the squared snap through given points, in the least time within limits.

Among all functions through given points at given times, from rest to rest, the one of least integral of its squared
fourth derivative is the spline of degree 7 with six continuous derivatives (Schoenberg 1964; D. Mellinger and V. Kumar,
ICRA 2011, for quadrotors). So the quadratic programme is one banded system of equations, that of interpolation.

The times are free. Stretching all of them by T divides velocities by T and accelerations by T^2. So for given shares of
the legs in the whole duration the least T within the limits follows in closed form. The shares are searched for which T
is least.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.config import STEEPEST_DEG
from companion.trajectory.timing import Phases, law_at, motion
from protocol.arrays import Array
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_DEGREE = 7
_SAMPLES = 24
"""Samples of each leg in the search of the shares."""
_FINE_SAMPLES = 400
"""Samples of each leg for the final duration."""
_TOLERANCE = 1e-4
"""The search ends with a step whose relative gain is less."""
_LONG_LEG = 4.0
"""Legs longer than this times speed^2 / acceleration are subdivided. The curve of least snap alone would reach its peak
speed only in the middle of such a leg, and 46 % of it on average."""
_MAX_LEGS = 24
"""Legs are not made shorter than the whole length over this number."""
_TILT_SHARE = 0.8
"""Share of the tilt's limit that is planned with; the rest is for drag and corrections."""
_MARGIN = 1.0001
"""Factor on the duration for peaks between the samples."""
_NORM_ORDER = 12.0
"""Order of the norm that stands for the peak in the search: a maximum has no gradient where its place changes."""


@compiled
def polynomial_at(knots: Array, coefficients: Array, parameter: float) -> Array:
    """(5, 3) value and first four derivatives of a piecewise polynomial, with its knots (n + 1,) and the coefficients
    (n, degree + 1, 3) of the powers of the distance from each piece's left knot."""
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
def _polynomial_flown(knots: Array, coefficients: Array, phases: Phases, time: float, origin: Array) -> Array:
    law = law_at(phases[0], phases[1], phases[2], phases[3], phases[4], time)
    return motion(polynomial_at(knots, coefficients, law[0]), law, origin)


@compiled
def polynomials_at(knots: Array, coefficients: Array, samples: int) -> Array:
    """(n * samples + 1, 5, 3): `polynomial_at` at equally spaced samples of each piece."""
    pieces = coefficients.shape[0]
    out = np.empty((pieces * samples + 1, 5, 3))
    for i in range(pieces * samples + 1):
        piece = min(i // samples, pieces - 1)
        share = (i - piece * samples) / samples
        out[i] = polynomial_at(knots, coefficients, knots[piece] + share * (knots[piece + 1] - knots[piece]))
    return out


@dataclass(frozen=True, slots=True)
class PiecewisePolynomial:
    """A path whose parameter is time (s); see `polynomial_at`."""

    knots: Array
    coefficients: Array

    def at(self, parameter: float) -> Array:
        """(5, 3) position (m) and its first four derivatives by time."""
        return polynomial_at(self.knots, self.coefficients, parameter)

    def flown(self, phases: Phases, time_s: float, origin_ned: Array) -> Array:
        """See `Path.flown`."""
        return _polynomial_flown(self.knots, self.coefficients, phases, time_s, origin_ned)

    @property
    def duration_s(self) -> float:
        return float(self.knots[-1])

    def stretched(self, factor: float) -> "PiecewisePolynomial":
        """The same curve with its duration multiplied by a factor."""
        powers = factor ** -np.arange(self.coefficients.shape[1], dtype=float)
        return PiecewisePolynomial(self.knots * factor, self.coefficients * powers[:, np.newaxis])


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the motion."""

    speed: float
    """m/s."""
    acceleration: float
    """m/s2."""
    tilt: float
    """rad."""

    @property
    def slope(self) -> float:
        """Horizontal over vertical specific force that may be planned with."""
        return math.tan(_TILT_SHARE * min(self.tilt, math.radians(STEEPEST_DEG)))


def spline_through(points: Array, durations: Array) -> PiecewisePolynomial:
    """The curve of least snap through `points` (n + 1, 3) in m, at rest at both ends, with the `durations` (n,) in s of
    its legs."""
    from scipy.interpolate import make_interp_spline  # a third of what the companion's start would take

    knots = np.concatenate(([0.0], np.cumsum(durations)))
    rest = [(order, np.zeros(3)) for order in (1, 2, 3)]
    spline = make_interp_spline(knots, points, k=_DEGREE, bc_type=(rest, rest))
    powers = [spline(knots[:-1], nu=order) / math.factorial(order) for order in range(_DEGREE + 1)]
    return PiecewisePolynomial(knots, np.ascontiguousarray(np.stack(powers, axis=1)))


def snap_integral(curve: PiecewisePolynomial) -> float:
    """The integral of the squared snap over time (m2/s7), exact."""
    nodes, weights = np.polynomial.legendre.leggauss(_DEGREE - 3)
    total = 0.0
    for left, right in zip(curve.knots, curve.knots[1:], strict=False):
        half = 0.5 * (right - left)
        snaps = np.array([curve.at(left + half * (1.0 + node))[4] for node in nodes])
        total += half * float(weights @ (snaps**2).sum(axis=1))
    return total


def _loads(curve: PiecewisePolynomial, limits: Limits, samples: int) -> Array:
    """(3, m) factors by which speed, acceleration and tilt require the curve to be stretched, at each of m samples."""
    motion = polynomials_at(curve.knots, curve.coefficients, samples)
    velocity, acceleration = motion[:, 1], motion[:, 2]
    slope = limits.slope  # the tilt: horizontal acceleration <= slope (g - acceleration downward)
    leaning = np.hypot(acceleration[:, 0], acceleration[:, 1]) + slope * acceleration[:, 2]
    return np.stack(
        (
            np.linalg.norm(velocity, axis=1) / limits.speed,
            np.sqrt(np.linalg.norm(acceleration, axis=1) / limits.acceleration),
            np.sqrt(np.maximum(leaning, 0.0) / (GRAVITY * slope)),
        )
    )


def rest_to_rest_durations(points: Array, speed: float, acceleration: float) -> Array:
    """(n,) durations (s) of the legs between `points` (n + 1, 3) in m, if each were flown on its own from rest to
    rest, at most at a speed (m/s) and with an acceleration (m/s2)."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    ramp = speed**2 / acceleration
    short = 2.0 * np.sqrt(lengths / acceleration)
    durations: Array = np.where(lengths < ramp, short, (lengths + ramp) / speed)
    return durations


def optimal_shares(points: Array, limits: Limits) -> Array:
    """(n,) shares of the legs in the whole duration for which that is least, by L-BFGS-B on a smooth bound."""
    from scipy.optimize import minimize

    first = rest_to_rest_durations(points, limits.speed, limits.acceleration)

    def time(logarithms: Array) -> float:
        durations = np.exp(logarithms)
        curve = spline_through(points, durations / durations.sum())
        loads = _loads(curve, limits, _SAMPLES)
        peak = loads.max()
        return float(np.log(peak) + np.log(((loads / peak) ** _NORM_ORDER).mean()) / _NORM_ORDER)

    found = minimize(time, np.log(first / first.sum()), method="L-BFGS-B", options={"ftol": _TOLERANCE})
    durations: Array = np.exp(found.x)
    shares: Array = durations / durations.sum()
    return shares


def subdivided(points: Array, limits: Limits) -> Array:
    """(m + 1, 3) the points (n + 1, 3), with more points on the straight lines between them where a leg is long."""
    offsets = np.diff(points, axis=0)
    lengths = np.linalg.norm(offsets, axis=1)
    longest = max(_LONG_LEG * limits.speed**2 / limits.acceleration, float(lengths.sum()) / _MAX_LEGS)
    parts = np.ceil(lengths / longest).astype(int).tolist()
    legs = [points[i] + np.outer(np.arange(n) / n, offsets[i]) for i, n in enumerate(parts)]
    return np.concatenate((*legs, points[-1:]))


def plan(points: Array, limits: Limits) -> PiecewisePolynomial:
    """The curve from rest to rest through `points` (n + 1, 3; m, NED, n >= 1, no two neighbours equal) that reaches one
    of the limits and exceeds none."""
    points = subdivided(points, limits)
    curve = spline_through(points, optimal_shares(points, limits))
    return curve.stretched(_MARGIN * float(_loads(curve, limits, _FINE_SAMPLES).max()))
