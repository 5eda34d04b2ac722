"""What the model lacks, estimated in flight: the scale of the thrust (mass, battery, worn propellers), the scale of
the drag, and a disturbing acceleration (wind, a slung load).

The velocity obeys v' = g + thrust_scale f + drag_scale r + disturbance, where f and r are the accelerations that
thrust and drag should give. That is linear in the unknown, so a Kalman filter on (v, disturbance, thrust_scale,
drag_scale) with random walks for the last three sees each through its own regressor: at hover the scale of the thrust
and a vertical disturbance can't be told apart and share the change by their variances; in motion they part. The scale
of the thrust is the hover-thrust estimate of PX4's MulticopterHoverThrustEstimator, without its restriction to hover.
"""

import math

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

ESTIMATE = np.dtype(
    [
        ("time_ns", "i8"),
        ("mean", "f8", 8),  # velocity_ned, disturbance_ned, thrust_scale, drag_scale
        ("variance", "f8", (8, 8)),
        ("thrust_effect", "f8", 3),
        ("drag_effect", "f8", 3),
    ],
    align=True,
)
VELOCITY, DISTURBANCE, THRUST_SCALE, DRAG_SCALE = slice(0, 3), slice(3, 6), 6, 7

THRUST_SCALES = (0.5, 1.8)
DRAG_SCALES = (0.0, 3.0)
_MOST_DISTURBANCE = 8.0
_LONGEST_S = 0.1


@compiled
def start(estimate: NDArray[np.void], spread: Array) -> None:
    """Nominal values, with the standard deviations `spread` (8,)."""
    e = estimate[0]
    e.time_ns = 0
    e.mean[:] = 0.0
    e.mean[6] = 1.0
    e.mean[7] = 1.0
    e.variance[:, :] = 0.0
    for i in range(8):
        e.variance[i, i] = spread[i] * spread[i]


@compiled
def update(
    estimate: NDArray[np.void],
    time_ns: int,
    velocity: Array,
    thrust_effect: Array,
    drag_effect: Array,
    noise: float,
    walk: Array,
) -> None:
    """Take in a velocity (m/s, NED) measured at `time_ns`, with the nominal accelerations (3,) of thrust and drag then.

    `noise`: standard deviation of a velocity (m/s); `walk` (8,): how far each part wanders in a second; a part that
    does not is not estimated if it began without spread.
    """
    e = estimate[0]
    dt = (time_ns - e.time_ns) * 1e-9
    e.time_ns = time_ns
    if not 0.0 < dt <= _LONGEST_S:
        if dt > _LONGEST_S:
            e.mean[0:3] = velocity
        e.thrust_effect[:] = thrust_effect
        e.drag_effect[:] = drag_effect
        return
    m, variance = e.mean, e.variance
    f = 0.5 * dt * (thrust_effect + e.thrust_effect)
    r = 0.5 * dt * (drag_effect + e.drag_effect)
    e.thrust_effect[:] = thrust_effect
    e.drag_effect[:] = drag_effect
    for i in range(3):
        m[i] += dt * m[3 + i] + f[i] * m[6] + r[i] * m[7]
    m[2] += dt * GRAVITY
    # variance <- F variance F', F adds to each velocity what the others did to it
    for i in range(3):
        for k in range(8):
            variance[i, k] += dt * variance[3 + i, k] + f[i] * variance[6, k] + r[i] * variance[7, k]
    for i in range(3):
        for k in range(8):
            variance[k, i] += dt * variance[k, 3 + i] + f[i] * variance[k, 6] + r[i] * variance[k, 7]
    for k in range(8):
        variance[k, k] += dt * walk[k] * walk[k]
    gain, row = np.empty(8), np.empty(8)
    for i in range(3):
        innovation = velocity[i] - m[i]
        total = variance[i, i] + noise * noise
        for k in range(8):
            gain[k], row[k] = variance[k, i] / total, variance[i, k]
            m[k] += gain[k] * innovation
        for k in range(8):
            for n in range(8):
                variance[k, n] -= gain[k] * row[n]
    m[6] = min(max(m[6], THRUST_SCALES[0]), THRUST_SCALES[1])
    m[7] = min(max(m[7], DRAG_SCALES[0]), DRAG_SCALES[1])
    size = math.sqrt(m[3] * m[3] + m[4] * m[4] + m[5] * m[5])
    if size > _MOST_DISTURBANCE:
        for i in range(3, 6):
            m[i] *= _MOST_DISTURBANCE / size
