"""Disturbance observer: a Kalman filter for what the model of the vehicle lacks.

It estimates the scale of the thrust (mass, battery, worn propellers), the scale of the drag, and a disturbing
acceleration (wind, a slung load) from the measured velocity, which changes by

    v' = g + thrust_scale f + drag_scale r + disturbance

where f and r are the accelerations that thrust and drag should cause. This is linear in the unknowns, so a Kalman
filter on (v, disturbance, thrust_scale, drag_scale), with random walks for the last three, identifies each through its
own regressor. At hover the thrust's scale and a vertical disturbance can't be told apart and share the change by their
variances; in motion they separate. The scale of the thrust is the hover-thrust estimate of PX4's
MulticopterHoverThrustEstimator without its restriction to hover.
"""

import math
from typing import Any

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
    ],
    align=True,
)
"""The filter's state. `mean` is velocity (m/s, NED), disturbance (m/s2, NED), thrust scale and drag scale; the
accelerations (m/s2, NED) are those of the last update."""
VELOCITY, DISTURBANCE, THRUST_SCALE, DRAG_SCALE = slice(0, 3), slice(3, 6), 6, 7
"""Places in `mean`."""

THRUST_SCALE_BOUNDS = (0.5, 1.8)
DRAG_SCALE_BOUNDS = (0.0, 3.0)
DISTURBANCE_BOUND = 8.0
"""Greatest size of the disturbance (m/s2)."""
_LONGEST_S = 0.1
"""After a longer gap between two updates the velocity is set anew, and nothing is estimated from the gap."""


@compiled
def reset(observer: Any, deviation: Array) -> None:
    """Start a record of OBSERVER with nominal values and their standard deviations (8,), in the units of `mean`."""
    observer.time_ns = 0
    observer.mean[:] = 0.0
    observer.mean[6] = 1.0
    observer.mean[7] = 1.0
    observer.covariance[:, :] = 0.0
    for i in range(STATES):
        observer.covariance[i, i] = deviation[i] * deviation[i]


@compiled
def _predict(observer: Any, dt: float, f: Array, r: Array, walk: Array) -> None:
    """Carry mean and covariance on by `dt` (s). f, r (3,): change of the velocity (m/s) by nominal thrust and drag."""
    mean, covariance = observer.mean, observer.covariance
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
    for k in range(STATES):
        covariance[k, k] += dt * walk[k] * walk[k]


@compiled
def _correct(observer: Any, velocity: Array, noise: float) -> None:
    """Correct mean and covariance by a measured velocity (3,), one axis after the other."""
    mean, covariance = observer.mean, observer.covariance
    gain, row = np.empty(STATES), np.empty(STATES)
    for i in range(3):
        innovation = velocity[i] - mean[i]
        total = covariance[i, i] + noise * noise
        for k in range(STATES):
            gain[k], row[k] = covariance[k, i] / total, covariance[i, k]
            mean[k] += gain[k] * innovation
        for k in range(STATES):
            for n in range(STATES):
                covariance[k, n] -= gain[k] * row[n]


@compiled
def update(
    observer: Any,
    time_ns: int,
    velocity: Array,
    thrust_acceleration: Array,
    drag_acceleration: Array,
    noise: float,
    walk: Array,
) -> None:
    """Update a record of OBSERVER with a velocity (3,) in m/s, NED, that was measured at `time_ns`, and the nominal
    accelerations (3,) in m/s2, NED, of thrust and drag at that time.

    `noise` is the standard deviation of a velocity (m/s), `walk` (8,) how far each state wanders in a second. A state
    without walk that started without deviation keeps its nominal value.
    """
    dt = (time_ns - observer.time_ns) * 1e-9
    observer.time_ns = time_ns
    if not 0.0 < dt <= _LONGEST_S:
        if dt > _LONGEST_S:
            observer.mean[0:3] = velocity
        observer.thrust_acceleration[:] = thrust_acceleration
        observer.drag_acceleration[:] = drag_acceleration
        return
    f = 0.5 * dt * (thrust_acceleration + observer.thrust_acceleration)
    r = 0.5 * dt * (drag_acceleration + observer.drag_acceleration)
    observer.thrust_acceleration[:] = thrust_acceleration
    observer.drag_acceleration[:] = drag_acceleration
    _predict(observer, dt, f, r, walk)
    _correct(observer, velocity, noise)
    mean = observer.mean
    mean[6] = min(max(mean[6], THRUST_SCALE_BOUNDS[0]), THRUST_SCALE_BOUNDS[1])
    mean[7] = min(max(mean[7], DRAG_SCALE_BOUNDS[0]), DRAG_SCALE_BOUNDS[1])
    size = math.sqrt(mean[3] * mean[3] + mean[4] * mean[4] + mean[5] * mean[5])
    if size > DISTURBANCE_BOUND:
        for i in range(3, 6):
            mean[i] *= DISTURBANCE_BOUND / size
