"""Disturbance observer: a Kalman filter for what the model of the vehicle lacks.

It estimates the scale of the thrust (mass, battery, worn propellers), the scale of the drag, a damping along the
rotors' axis, and a disturbing acceleration (wind, a slung load) from the measured velocity, which changes by

    v' = g + thrust_scale f + drag_scale r + axial_damping a + disturbance

where f and r are the accelerations that thrust and drag should cause, and a is the negative part of the velocity along
the rotors' axis: rotors that climb give less thrust, which no vehicle file knows well. This is linear in the unknowns,
so a Kalman filter on (v, disturbance, thrust_scale, drag_scale, axial_damping) identifies each through its own
regressor. What a regressor does not show must not wander:

- At hover f is vertical and constant, so the thrust's scale and a vertical disturbance can't be told apart. The
  vertical disturbance therefore falls back to 0 (a Gauss-Markov process), while the scale keeps (a random walk): what
  lasts is the scale, what passes is the disturbance. A horizontal disturbance is always observable and is a random
  walk.
- At low speed r and a say nothing of drag and damping. They are corrected by a share that falls with the speed, along
  the axis for the damping (the partial update of the Schmidt-Kalman filter; K. Brink, "Partial-update Schmidt-Kalman
  filter", J. Guidance 40(9), 2017), and walk by that share.
- In a steady climb the thrust's scale and the damping can't be told apart either. Their covariance says so, and what
  the climb left open is settled as soon as it ends.
- Noise of the velocity is measured by the innovations, whose variance beyond what the filter expects is noise
  (R. Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE TAC 15(2), 1970), so that an
  estimator's noise does not pass for a disturbance.

The scale of the thrust is the hover-thrust estimate of PX4's MulticopterHoverThrustEstimator without its restriction to
hover.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

STATES = 9
OBSERVER = np.dtype(
    [
        ("time_ns", "i8"),
        ("mean", "f8", STATES),
        ("covariance", "f8", (STATES, STATES)),
        ("effects", "f8", (3, 3)),
        ("velocity", "f8", 3),
        ("noise", "f8", 3),
    ],
    align=True,
)
"""The filter's state. `mean` is velocity (m/s, NED), disturbance (m/s2, NED), thrust scale, drag scale and axial
damping (1/s, beyond the vehicle file's drag); the `effects` (see `update`) and the measured `velocity` are those of the
last update; `noise` is the variance of a velocity (m2/s2) by the innovations."""
VELOCITY, DISTURBANCE, THRUST_SCALE, DRAG_SCALE, AXIAL_DAMPING = slice(0, 3), slice(3, 6), 6, 7, 8
"""Places in `mean`."""
_DOWNWARD = 5
"""Index of the vertical disturbance."""

THRUST_SCALE_BOUNDS = (0.1, 10.0)
DRAG_SCALE_BOUNDS = (0.0, 3.0)
AXIAL_DAMPING_BOUNDS = (-1.0, 2.0)
"""1/s."""
DISTURBANCE_BOUND = 8.0
"""Greatest size of the disturbance (m/s2)."""
NOISE_BOUND = 0.25
"""Greatest standard deviation of a velocity (m/s) that the innovations are believed."""
_NOISE_WINDOW_S = 2.0
"""Time constant of the innovations' variance."""
_DRAG_SPEED = 1.0
"""m/s; at this speed the drag's scale, or the axial damping, gets half of its correction."""
_PRESUMED = 0.2
"""Standard deviation of a thrust scale that was found at lift-off, as a share of it."""
_LONGEST_S = 0.1
"""After a longer gap between two updates the velocity is set anew, and nothing is estimated from the gap."""


class Noise(NamedTuple):
    """How certain the parts of the model are."""

    velocity: float
    """m/s, the least standard deviation of a measured velocity."""
    walk: Array
    """(STATES,) how far each state wanders in a second, in the units of `mean`. A state without walk that started
    without deviation keeps its nominal value."""
    fading: float
    """1/s; the rate at which a vertical disturbance falls back to 0."""
    told: Array
    """(3,) m2/s2, NED: its variance, as the vehicle says; zero where it does not."""
    correlation: float
    """s; for so long an error of it lasts."""


@compiled
def reset(observer: Any, deviation: Array) -> None:
    """Start a record of OBSERVER with nominal values and standard deviations (STATES,), in the units of `mean`."""
    observer.time_ns = 0
    observer.mean[:] = 0.0
    observer.mean[6] = 1.0
    observer.mean[7] = 1.0
    observer.noise[:] = 0.0
    observer.covariance[:, :] = 0.0
    for i in range(STATES):
        observer.covariance[i, i] = deviation[i] * deviation[i]


def presume(observer: Any, thrust_scale: float) -> None:
    """Begin a record of OBSERVER, after `reset`, with a thrust scale that is known to about a fifth."""
    scale = min(max(thrust_scale, THRUST_SCALE_BOUNDS[0]), THRUST_SCALE_BOUNDS[1])
    observer["mean"][THRUST_SCALE] = scale
    observer["covariance"][THRUST_SCALE, THRUST_SCALE] = (_PRESUMED * scale) ** 2


@compiled
def _excitation(x: float, y: float, z: float) -> float:
    """The share of its correction that a speed's effect gets, for a velocity (m/s) that shows it."""
    square = x * x + y * y + z * z
    square *= square
    return square / (square + _DRAG_SPEED * _DRAG_SPEED * _DRAG_SPEED * _DRAG_SPEED)


@compiled
def _predict(observer: Any, dt: float, effects: Array, noise: Noise, excitation: tuple[float, float]) -> None:
    """Carry mean and covariance on by `dt` (s). `effects` (3, 3): change of the velocity (m/s) by thrust, drag and
    axial damping, a row each; `excitation`: the shares of the last two's corrections that count."""
    mean, covariance, walk = observer.mean, observer.covariance, noise.walk
    f, r, a = effects[0], effects[1], effects[2]
    for i in range(3):
        mean[i] += dt * mean[3 + i] + f[i] * mean[6] + r[i] * mean[7] + a[i] * mean[8]
    mean[2] += dt * GRAVITY
    # covariance <- F covariance F', where F adds to each velocity the effects of the other states
    for i in range(3):
        for k in range(STATES):
            by_scales = f[i] * covariance[6, k] + r[i] * covariance[7, k] + a[i] * covariance[8, k]
            covariance[i, k] += dt * covariance[3 + i, k] + by_scales
    for i in range(3):
        for k in range(STATES):
            by_scales = f[i] * covariance[k, 6] + r[i] * covariance[k, 7] + a[i] * covariance[k, 8]
            covariance[k, i] += dt * covariance[k, 3 + i] + by_scales
    kept = 1.0 - dt * noise.fading
    mean[_DOWNWARD] *= kept
    for k in range(STATES):
        covariance[_DOWNWARD, k] *= kept
        covariance[k, _DOWNWARD] *= kept
    for k in range(DRAG_SCALE):
        covariance[k, k] += dt * walk[k] * walk[k]
    for k in range(DRAG_SCALE, STATES):
        covariance[k, k] += dt * excitation[k - DRAG_SCALE] * walk[k] * walk[k]


@compiled
def _lasting(dt: float, correlation: float) -> float:
    """How much more uncertain the mean of many measurements, `dt` (s) apart, is where their errors last: the spectral
    density at zero of a first-order process over that of white noise of the same variance."""
    return 1.0 / math.tanh(0.5 * dt / correlation) if correlation > 0.0 else 1.0


@compiled
def _correct(observer: Any, velocity: Array, dt: float, certainty: Noise, excitation: tuple[float, float]) -> None:
    """Correct mean and covariance by a measured velocity (3,), one axis after the other."""
    mean, covariance, noise = observer.mean, observer.covariance, observer.noise
    gain, row = np.empty(STATES), np.empty(STATES)
    least, lasting = certainty.velocity * certainty.velocity, _lasting(dt, certainty.correlation)
    share = min(dt / _NOISE_WINDOW_S, 1.0)
    for i in range(3):
        innovation = velocity[i] - mean[i]
        seen = min(innovation * innovation - covariance[i, i], NOISE_BOUND * NOISE_BOUND)
        noise[i] += share * (seen - noise[i])
        told = min(certainty.told[i], NOISE_BOUND * NOISE_BOUND) * lasting
        total = covariance[i, i] + max(least, noise[i], told)
        for k in range(STATES):
            gain[k], row[k] = covariance[k, i] / total, covariance[i, k]
        for k in range(STATES):
            for n in range(STATES):
                covariance[k, n] -= gain[k] * row[n]
        # of the partial update's covariance, only the entries between the last two differ from the whole update's
        for k in range(DRAG_SCALE, STATES):
            for n in range(DRAG_SCALE, STATES):
                left = (1.0 - excitation[k - DRAG_SCALE]) * (1.0 - excitation[n - DRAG_SCALE])
                covariance[k, n] += left * gain[k] * row[n]
        for k in range(DRAG_SCALE, STATES):
            gain[k] *= excitation[k - DRAG_SCALE]
        for k in range(STATES):
            mean[k] += gain[k] * innovation


@compiled
def update(observer: Any, time_ns: int, velocity: Array, effects: Array, noise: Noise) -> None:
    """Update a record of OBSERVER with a velocity (3,) in m/s, NED, that was measured at `time_ns`.

    `effects` (3, 3) are the nominal accelerations (m/s2, NED) of thrust and drag at that time, and that of an axial
    damping of 1/s. A velocity that is the last one again, of a vehicle that sends it less often than its attitude,
    corrects nothing.
    """
    dt = (time_ns - observer.time_ns) * 1e-9
    observer.time_ns = time_ns
    before = observer.velocity
    repeated = velocity[0] == before[0] and velocity[1] == before[1] and velocity[2] == before[2]
    observer.velocity[:] = velocity
    if 0.0 < dt <= _LONGEST_S:
        by_all = _excitation(velocity[0], velocity[1], velocity[2])
        along = effects[2]
        excitation = by_all, _excitation(along[0], along[1], along[2])
        _predict(observer, dt, 0.5 * dt * (effects + observer.effects), noise, excitation)
        if not repeated:
            _correct(observer, velocity, dt, noise, excitation)
        _bound(observer.mean)
    elif dt > _LONGEST_S:
        observer.mean[0:3] = velocity
    observer.effects[:] = effects


@compiled
def _bound(mean: Array) -> None:
    """Keep the estimates (STATES,) within their bounds."""
    mean[6] = min(max(mean[6], THRUST_SCALE_BOUNDS[0]), THRUST_SCALE_BOUNDS[1])
    mean[7] = min(max(mean[7], DRAG_SCALE_BOUNDS[0]), DRAG_SCALE_BOUNDS[1])
    mean[8] = min(max(mean[8], AXIAL_DAMPING_BOUNDS[0]), AXIAL_DAMPING_BOUNDS[1])
    size = math.sqrt(mean[3] * mean[3] + mean[4] * mean[4] + mean[5] * mean[5])
    if size > DISTURBANCE_BOUND:
        for i in range(3, 6):
            mean[i] *= DISTURBANCE_BOUND / size
