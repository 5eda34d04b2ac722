"""Where the vehicle will be when the command that is computed now takes effect.

Telemetry is old when it arrives, and a command acts later still. From the measured state the motion is integrated
over that gap under the commands that were sent meanwhile, with the rotors' lag and the vehicle's rate loop as first
order lags (a Smith predictor's forward model). The lags' own states can't be measured: they follow from the commands
of the last 0.3 s, for they forget.
"""

import math

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, Quaternion
from protocol.frames import product, rotation_quaternion, to_body, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

SENT = np.dtype([("time_ns", "i8"), ("thrust_n", "f8"), ("input", "f8", 3)], align=True)
"""A command: from `time_ns` on in force at the vehicle; `input` is rates (rad/s) or angular acceleration (rad/s2)."""
KEPT = 128
_MEMORY_NS = 300_000_000
_STEP_NS = 2_000_000
_COARSE_NS = 4_000_000
"""Of a step over the past, where the lags alone are followed."""

UNKNOWN, RATES, ANGULAR_ACCELERATION = 0, 1, 2
"""What `input` is; with UNKNOWN the rates are taken to stay."""


@compiled
def remember(sent: NDArray[np.void], count: int, time_ns: int, thrust_n: float, input_frd: Array) -> int:
    """Put a command into the ring `sent` (KEPT,) of SENT; the new count of all that were ever put in."""
    entry = sent[count % KEPT]
    entry.time_ns = time_ns
    entry.thrust_n = thrust_n
    entry.input[:] = input_frd
    return count + 1


@compiled
def _in_force(sent: NDArray[np.void], count: int, index: int, time_ns: int) -> int:
    """The number of the command at a time, `index` or a later one."""
    while index + 1 < count and sent[(index + 1) % KEPT].time_ns <= time_ns:
        index += 1
    return index


@compiled
def _share(dt: float, lag: float) -> float:
    """How much of the way to its command a lag goes within `dt`."""
    return 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0


@compiled
def predict(
    position: Array,
    velocity: Array,
    attitude: Array,
    rates: Array,
    measured_ns: int,
    until_ns: int,
    sent: NDArray[np.void],
    count: int,
    kind: int,
    rotor_lag: float,
    rate_loop: Array,
    mass: float,
    drag: Array,
    disturbance: Array,
) -> tuple[Array, Array, Quaternion, Array, Array, float, float]:
    """The state at `until_ns` from that at `measured_ns`: position, velocity (NED), attitude, rates, angular
    acceleration (FRD), thrust (N), and the thrust (N) at `measured_ns`.

    `mass`, `drag` as the thrust's scale makes them appear; `disturbance` (3,) in m/s2, NED.
    """
    p, v, w, turning = position.copy(), velocity.copy(), rates.copy(), np.zeros(3)
    q = attitude[0], attitude[1], attitude[2], attitude[3]
    if count == 0:
        return p, v, q, w, turning, 0.0, 0.0
    known = kind == ANGULAR_ACCELERATION or (kind == RATES and rate_loop[0] > 0.0)
    # The past, where the lags alone are followed. `rate` is that of the model that their states come from.
    time = measured_ns - _MEMORY_NS
    index = _in_force(sent, count, max(count - KEPT, 0), time)
    thrust, rate = sent[index % KEPT].thrust_n, sent[index % KEPT].input.copy()
    step, share = 0, 0.0
    while time < measured_ns:
        index = _in_force(sent, count, index, time)
        end = min(time + _COARSE_NS, measured_ns)
        dt = (end - time) * 1e-9
        if end - time != step:  # the steps are alike but for the last one, and an exponential costs more than a step
            step, share = end - time, _share(dt, rotor_lag)
        command = sent[index % KEPT]
        thrust += share * (command.thrust_n - thrust)
        if known:
            for i in range(3):
                wanted = command.input[i]
                if kind == RATES:
                    wanted = rate_loop[i] * (wanted - rate[i])
                turning[i] += share * (wanted - turning[i])
                rate[i] += dt * turning[i]
        time = end
    thrust_then = thrust
    while time < until_ns:
        index = _in_force(sent, count, index, time)
        end = min(time + _STEP_NS, until_ns)
        dt = (end - time) * 1e-9
        share = _share(dt, rotor_lag)
        command = sent[index % KEPT]
        thrust += share * (command.thrust_n - thrust)
        if known:
            for i in range(3):
                wanted = command.input[i]
                if kind == RATES:
                    wanted = rate_loop[i] * (wanted - w[i])
                turning[i] += share * (wanted - turning[i])
        x, y, z = to_body(q, v)
        lift, pull = to_world(q, (0.0, 0.0, -thrust)), to_world(q, (drag[0] * x, drag[1] * y, drag[2] * z))
        for i in range(3):
            w[i] += dt * turning[i]
            change = dt * ((lift[i] - pull[i]) / mass + disturbance[i])
            if i == 2:
                change += dt * GRAVITY
            p[i] += dt * (v[i] + 0.5 * change)
            v[i] += change
        q = product(q, rotation_quaternion(dt * w[0], dt * w[1], dt * w[2]))
        time = end
    return p, v, q, w, turning, thrust, thrust_then
