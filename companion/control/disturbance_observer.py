"""Disturbance observer: a Kalman filter for what the model of the vehicle lacks.

It estimates the scale of the thrust (mass, battery, worn propellers), the scale of the drag, and a disturbing
acceleration (wind, a slung load) from the measured velocity, which changes by

    v' = g + thrust_scale f + drag_scale r + disturbance

where f and r are the accelerations that thrust and drag should cause. This is linear in the unknowns, so a Kalman
filter on (v, disturbance, thrust_scale, drag_scale) identifies each through its own regressor. What a regressor does
not show must not wander:

- At hover f is vertical and constant, so the thrust's scale and a vertical disturbance can't be told apart. The
  vertical disturbance therefore falls back to 0 (a Gauss-Markov process), while the scale keeps (a random walk): what
  lasts is the scale, what passes is the disturbance. A horizontal disturbance is always observable and is a random
  walk.
- Rotors that climb give less thrust, and drag along their axis is little known, so a climb shows another scale of the
  thrust than the hover after it. As the climb ends the scale comes into doubt, and is learned anew.
- At low speed r says nothing of the drag. Its scale is corrected by a share that falls with the speed (the partial
  update of the Schmidt-Kalman filter; K. Brink, "Partial-update Schmidt-Kalman filter", J. Guidance 40(9), 2017), and
  walks by that share.
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

STATES = 8
OBSERVER = np.dtype(
    [
        ("time_ns", "i8"),
        ("mean", "f8", STATES),
        ("covariance", "f8", (STATES, STATES)),
        ("thrust_acceleration", "f8", 3),
        ("drag_acceleration", "f8", 3),
        ("velocity", "f8", 3),
        ("noise", "f8", 3),
        ("climb", "f8"),
        ("rest_s", "f8"),
    ],
    align=True,
)
"""The filter's state. `mean` is velocity (m/s, NED), disturbance (m/s2, NED), thrust scale and drag scale; the
accelerations (m/s2, NED) and the measured `velocity` are those of the last update; `noise` is the variance of a
velocity (m2/s2) by the innovations; `climb` (m/s, down) the vertical speed, in steps
of `_CLIMB_STEP`; for `rest_s` (s) nothing is learned yet."""
VELOCITY, DISTURBANCE, THRUST_SCALE, DRAG_SCALE = slice(0, 3), slice(3, 6), 6, 7
"""Places in `mean`."""
_DOWNWARD = 5
"""Index of the vertical disturbance."""

THRUST_SCALE_BOUNDS = (0.1, 10.0)
DRAG_SCALE_BOUNDS = (0.0, 3.0)
DISTURBANCE_BOUND = 8.0
"""Greatest size of the disturbance (m/s2)."""
NOISE_BOUND = 0.25
"""Greatest standard deviation of a velocity (m/s) that the innovations are believed."""
_NOISE_WINDOW_S = 2.0
"""Time constant of the innovations' variance."""
_DRAG_SPEED = 1.0
"""m/s; at this speed the drag's scale gets half of its correction."""
_PRESUMED = 0.2
"""Standard deviation of a thrust scale that was found at lift-off, as a share of it."""
_CLIMB_STEP = 0.4
"""m/s; vertical speeds that differ by less are the same, so that an estimator's noise is no climb."""
_REST_S = 0.5
"""After a reset of the vehicle's estimate nothing is learned for so long: its filter settles meanwhile, and a velocity
that creeps back to the truth is no acceleration."""
_LONGEST_S = 0.1
"""After a longer gap between two updates the velocity is set anew, and nothing is estimated from the gap."""


class Noise(NamedTuple):
    """How certain the parts of the model are."""

    velocity: float
    """m/s, the least standard deviation of a measured velocity."""
    walk: Array
    """(8,) how far each state wanders in a second, in the units of `mean`. A state without walk that started without
    deviation keeps its nominal value."""
    fading: float
    """1/s; the rate at which a vertical disturbance falls back to 0."""
    told: Array
    """(3,) m2/s2, NED: its variance, as the vehicle says; zero where it does not."""
    correlation: float
    """s; for so long an error of it lasts."""
    climb: float
    """s/m; the share of the thrust's scale that is in doubt when a climb has become slower by 1 m/s."""


@compiled
def reset(observer: Any, deviation: Array) -> None:
    """Start a record of OBSERVER with nominal values and their standard deviations (8,), in the units of `mean`."""
    observer.time_ns = 0
    observer.mean[:] = 0.0
    observer.mean[6] = 1.0
    observer.mean[7] = 1.0
    observer.noise[:] = 0.0
    observer.climb = 0.0
    observer.rest_s = 0.0
    observer.covariance[:, :] = 0.0
    for i in range(STATES):
        observer.covariance[i, i] = deviation[i] * deviation[i]


def presume(observer: Any, thrust_scale: float) -> None:
    """Begin a record of OBSERVER, after `reset`, with a thrust scale that is known to about a fifth."""
    scale = min(max(thrust_scale, THRUST_SCALE_BOUNDS[0]), THRUST_SCALE_BOUNDS[1])
    observer["mean"][THRUST_SCALE] = scale
    observer["covariance"][THRUST_SCALE, THRUST_SCALE] = (_PRESUMED * scale) ** 2


def reset_by_vehicle(observer: Any) -> None:
    """The vehicle's estimate was reset: velocities to come do not go on from those that a record of OBSERVER had."""
    observer["time_ns"], observer["rest_s"] = 0, _REST_S


@compiled
def _predict(observer: Any, dt: float, f: Array, r: Array, noise: Noise, excitation: float) -> None:
    """Carry mean and covariance on by `dt` (s). f, r (3,): change of the velocity (m/s) by nominal thrust and drag;
    `excitation`: the share of the drag's correction that counts."""
    mean, covariance, walk = observer.mean, observer.covariance, noise.walk
    for i in range(3):
        mean[i] += dt * mean[3 + i] + f[i] * mean[6] + r[i] * mean[7]
    mean[2] += dt * GRAVITY
    # covariance <- F covariance F', where F adds to each velocity the effects of the other states
    for i in range(3):
        for k in range(STATES):
            covariance[i, k] += dt * covariance[3 + i, k] + f[i] * covariance[6, k] + r[i] * covariance[7, k]
    for i in range(3):
        for k in range(STATES):
            covariance[k, i] += dt * covariance[k, 3 + i] + f[i] * covariance[k, 6] + r[i] * covariance[k, 7]
    kept = max(1.0 - dt * noise.fading, 0.0)
    mean[_DOWNWARD] *= kept
    for k in range(STATES):
        covariance[_DOWNWARD, k] *= kept
        covariance[k, _DOWNWARD] *= kept
    for k in range(DRAG_SCALE):
        covariance[k, k] += dt * walk[k] * walk[k]
    covariance[DRAG_SCALE, DRAG_SCALE] += dt * excitation * walk[DRAG_SCALE] * walk[DRAG_SCALE]


@compiled
def _lasting(dt: float, correlation: float) -> float:
    """How much more uncertain the mean of many measurements, `dt` (s) apart, is where their errors last: the spectral
    density at zero of a first-order process over that of white noise of the same variance."""
    return 1.0 / math.tanh(0.5 * dt / correlation) if correlation > 0.0 else 1.0


@compiled
def _correct(observer: Any, velocity: Array, dt: float, certainty: Noise, excitation: float) -> None:
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
        drag_variance = covariance[DRAG_SCALE, DRAG_SCALE]
        for k in range(STATES):
            for n in range(STATES):
                covariance[k, n] -= gain[k] * row[n]
        # of the partial update's covariance, only this entry differs from that of the whole update
        counts = excitation * (2.0 - excitation)
        covariance[DRAG_SCALE, DRAG_SCALE] = drag_variance - counts * gain[DRAG_SCALE] * row[DRAG_SCALE]
        gain[DRAG_SCALE] *= excitation
        for k in range(STATES):
            mean[k] += gain[k] * innovation


@compiled
def _climb(observer: Any, speed: float, uncertainty: float) -> None:
    """Doubt the thrust's scale, learned in a climb, where the vertical speed (m/s, down) comes nearer to zero."""
    step = speed - observer.climb
    if abs(step) > _CLIMB_STEP:
        if abs(speed) < abs(observer.climb):
            deviation = uncertainty * step * observer.mean[THRUST_SCALE]
            observer.covariance[THRUST_SCALE, THRUST_SCALE] += deviation * deviation
        observer.climb = speed


@compiled
def update(
    observer: Any,
    time_ns: int,
    velocity: Array,
    thrust_acceleration: Array,
    drag_acceleration: Array,
    noise: Noise,
) -> None:
    """Update a record of OBSERVER with a velocity (3,) in m/s, NED, that was measured at `time_ns`, and the nominal
    accelerations (3,) in m/s2, NED, of thrust and drag at that time.

    A velocity that is the last one again, of a vehicle that sends it less often than its attitude, corrects nothing.
    """
    dt = (time_ns - observer.time_ns) * 1e-9
    observer.time_ns = time_ns
    before, last_thrust, last_drag = observer.velocity, observer.thrust_acceleration, observer.drag_acceleration
    repeated = velocity[0] == before[0] and velocity[1] == before[1] and velocity[2] == before[2]
    observer.velocity[:] = velocity
    observer.rest_s -= min(max(dt, 0.0), _LONGEST_S)
    if 0.0 < dt <= _LONGEST_S and observer.rest_s <= 0.0:
        f, r = 0.5 * dt * (thrust_acceleration + last_thrust), 0.5 * dt * (drag_acceleration + last_drag)
        square = velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2]
        square *= square
        _climb(observer, velocity[2], noise.climb)
        excitation = square / (square + _DRAG_SPEED * _DRAG_SPEED * _DRAG_SPEED * _DRAG_SPEED)
        _predict(observer, dt, f, r, noise, excitation)
        if not repeated:
            _correct(observer, velocity, dt, noise, excitation)
        _bound(observer.mean)
    elif dt > _LONGEST_S or observer.rest_s > 0.0:
        observer.mean[0:3] = velocity
    observer.thrust_acceleration[:] = thrust_acceleration
    observer.drag_acceleration[:] = drag_acceleration


@compiled
def _bound(mean: Array) -> None:
    """Keep the estimates (8,) within their bounds."""
    mean[6] = min(max(mean[6], THRUST_SCALE_BOUNDS[0]), THRUST_SCALE_BOUNDS[1])
    mean[7] = min(max(mean[7], DRAG_SCALE_BOUNDS[0]), DRAG_SCALE_BOUNDS[1])
    size = math.sqrt(mean[3] * mean[3] + mean[4] * mean[4] + mean[5] * mean[5])
    if size > DISTURBANCE_BOUND:
        for i in range(3, 6):
            mean[i] *= DISTURBANCE_BOUND / size
