"""Where the vehicle will be when the command that is computed now takes effect.

Telemetry is old when it arrives, and a command acts later still. From the measured state the motion is integrated
over that gap under the commands that were sent meanwhile, with the rotors' lag and the vehicle's rate loop as first
order lags (a Smith predictor's forward model). The lags' own states can't be measured: they follow from the commands
of the last 0.3 s, for they forget.
"""

import math

import numpy as np
from numpy.typing import NDArray

from protocol.compiled import compiled
from protocol.frames import GRAVITY, Array, from_rotation_vector, multiply, rotate, rotate_inverse

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
) -> tuple[Array, Array, Array, Array, Array, float, float]:
    """The state at `until_ns` from that at `measured_ns`: position, velocity (NED), attitude, rates, angular
    acceleration (FRD), thrust (N), and the thrust (N) at `measured_ns`.

    `mass`, `drag` as the thrust's scale makes them appear; `disturbance` (3,) in m/s2, NED.
    """
    p, v, q, w = position.copy(), velocity.copy(), attitude.copy(), rates.copy()
    turning = np.zeros(3)
    if count == 0:
        return p, v, q, w, turning, 0.0, 0.0
    index = max(count - KEPT, 0)
    time = measured_ns - _MEMORY_NS
    while index + 1 < count and sent[(index + 1) % KEPT].time_ns <= time:
        index += 1
    thrust = sent[index % KEPT].thrust_n
    rate = sent[index % KEPT].input.copy()  # of the model that the lags' states come from
    thrust_then = thrust
    known = kind == ANGULAR_ACCELERATION or (kind == RATES and rate_loop[0] > 0.0)
    while time < until_ns:
        while index + 1 < count and sent[(index + 1) % KEPT].time_ns <= time:
            index += 1
        measured = time >= measured_ns
        end = min(time + _STEP_NS, until_ns) if measured else min(time + _COARSE_NS, measured_ns)
        dt = (end - time) * 1e-9
        share = 1.0 - math.exp(-dt / rotor_lag) if rotor_lag > 0.0 else 1.0
        command = sent[index % KEPT]
        thrust += share * (command.thrust_n - thrust)
        if known:
            for i in range(3):
                wanted = command.input[i]
                if kind == RATES:
                    wanted = rate_loop[i] * (wanted - (w[i] if measured else rate[i]))
                turning[i] += share * (wanted - turning[i])
                if not measured:
                    rate[i] += dt * turning[i]
        if measured:
            w = w + dt * turning
            force = rotate(q, np.array([0.0, 0.0, -thrust])) - rotate(q, drag * rotate_inverse(q, v))
            change = dt * (force / mass + disturbance)
            change[2] += dt * GRAVITY
            p = p + dt * (v + 0.5 * change)
            v = v + change
            q = multiply(q, from_rotation_vector(dt * w))
        else:
            thrust_then = thrust
        time = end
    return p, v, q, w, turning, thrust, thrust_then
