"""Prediction of the state at which the command that is computed now takes effect.

Telemetry is old when it arrives, and a command acts later still. The motion is integrated over that gap, from the
measured state on and under the commands that were sent meanwhile, with the rotors and the vehicle's own loops of rate
and attitude as first-order lags (the forward model of a Smith predictor). The states of the lags can't be measured.
They are computed from the commands of the last 0.3 s, which is long enough for the lags to forget where they started.
How an attitude that was commanded turns the vehicle also depends on its attitude then: there the turning starts as the
loops ask for at the measurement.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.outputs import TurningInput
from protocol.arrays import Array, Quaternion, Vector
from protocol.frames import product, rotation_quaternion, to_body, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

COMMAND = np.dtype([("time_ns", "i8"), ("turning_input", "i8"), ("thrust_n", "f8"), ("input", "f8", 3)], align=True)
"""A command, which the vehicle follows from `time_ns` on. `input` (3,), FRD, is what `turning_input` says, a
TurningInput."""
HISTORY = 256
"""How many commands are remembered: 1 s of them."""
POSE = np.dtype([("time_ns", "i8"), ("attitude", "f8", 4), ("thrust_n", "f8")], align=True)
"""An attitude that was measured, and the thrust then."""
_MEMORY_NS = 300_000_000
"""How far into the past the lags are followed."""
_STEP_NS = 2_000_000
"""Step of the integration from the measurement on."""
_LAG_STEP_NS = 4_000_000
"""Step over the past, where the lags alone are followed."""

ATTITUDE, ANGULAR_ACCELERATION = int(TurningInput.ATTITUDE), int(TurningInput.ANGULAR_ACCELERATION)


class Measured(NamedTuple):
    """A measured state."""

    position: Array
    """(3,) m, NED."""
    velocity: Array
    """(3,) m/s, NED."""
    attitude: Array
    """(4,) quaternion from FRD to NED."""
    rates: Array
    """(3,) rad/s, FRD."""


class Model(NamedTuple):
    """The vehicle as the prediction knows it."""

    rotor_lag: float
    """Time constant of the rotors (s)."""
    rate_loop: Array
    """(3,) gain (1/s) of the vehicle's rate loop."""
    attitude_loop: float
    """Gain (1/s) of its attitude loop."""
    mass: float
    """kg, divided by the scale of the thrust."""
    drag: Array
    """(3,) kg/s along the body's axes, divided by the scale of the thrust."""
    disturbance: Array
    """(3,) m/s2, NED."""


class Predicted(NamedTuple):
    """The state at the end of the prediction, and the thrust at its beginning."""

    position: Array
    """(3,) m, NED."""
    velocity: Array
    """(3,) m/s, NED."""
    attitude: Quaternion
    """From FRD to NED."""
    rates: Array
    """(3,) rad/s, FRD."""
    angular_acceleration: Array
    """(3,) rad/s2, FRD."""
    thrust: float
    """N."""
    measured_thrust: float
    """N, at the time of the measurement."""


@compiled
def remember(
    commands: NDArray[np.void], count: int, time_ns: int, thrust_n: float, turning_input: int, input_frd: Array
) -> int:
    """Write a command into the circular buffer `commands` (HISTORY,) of COMMAND; the new count of all commands that
    were ever written."""
    entry = commands[count % HISTORY]
    entry.time_ns = time_ns
    entry.thrust_n = thrust_n
    entry.turning_input = turning_input
    entry.input[:] = input_frd
    return count + 1


@compiled
def _in_force(commands: NDArray[np.void], count: int, index: int, time_ns: int) -> int:
    """The number of the command in force at a time: `index` or a later one."""
    while index + 1 < count and commands[(index + 1) % HISTORY].time_ns <= time_ns:
        index += 1
    return index


@compiled
def keep_pose(poses: NDArray[np.void], count: int, time_ns: int, attitude: Array, thrust_n: float) -> int:
    """Write a measured attitude (4,) into the circular buffer `poses` (HISTORY,) of POSE; the new count."""
    entry = poses[count % HISTORY]
    entry.time_ns = time_ns
    entry.attitude[:] = attitude
    entry.thrust_n = thrust_n
    return count + 1


@compiled
def pose_at(poses: NDArray[np.void], count: int, time_ns: int) -> int:
    """The number of the latest pose that is no younger than a time; of the oldest that is kept if none is so old."""
    number = count - 1
    oldest = max(count - HISTORY, 0)
    while number > oldest and poses[number % HISTORY].time_ns > time_ns:
        number -= 1
    return number


@compiled
def caught_up(
    measured: Measured, measured_ns: int, position_ns: int, poses: NDArray[np.void], count: int, model: Model
) -> Measured:
    """A state whose velocity was measured at `position_ns`, before its attitude, and whose position was carried on by
    that velocity: both as they have changed since, by the attitudes and thrusts of `keep_pose`."""
    if count == 0:
        return measured
    p, v = measured.position.copy(), measured.velocity.copy()
    number, time = pose_at(poses, count, position_ns), position_ns
    while time < measured_ns:
        pose, end = poses[number % HISTORY], measured_ns
        if number + 1 < count:
            end = min(max(poses[(number + 1) % HISTORY].time_ns, time), measured_ns)
        dt, left = (end - time) * 1e-9, (measured_ns - end) * 1e-9
        a = _acceleration(pose.attitude, v, pose.thrust_n, model)
        for i in range(3):
            change = dt * (a[i] + (GRAVITY if i == 2 else 0.0))
            v[i] += change
            p[i] += change * (0.5 * dt + left)
        time, number = end, number + 1
        if number >= count:
            break
    return Measured(p, v, measured.attitude, measured.rates)


@compiled
def _acceleration(attitude: Array | Quaternion, velocity: Array, thrust_n: float, model: Model) -> Vector:
    """m/s2, NED, without gravity."""
    drag, d = model.drag, model.disturbance
    x, y, z = to_body(attitude, velocity)
    lift, pull = to_world(attitude, (0.0, 0.0, -thrust_n)), to_world(attitude, (drag[0] * x, drag[1] * y, drag[2] * z))
    return (
        (lift[0] - pull[0]) / model.mass + d[0],
        (lift[1] - pull[1]) / model.mass + d[1],
        (lift[2] - pull[2]) / model.mass + d[2],
    )


@compiled
def lag_share(dt: float, lag: float) -> float:
    """The share of the way to its input that a first-order lag covers within `dt`; both in s."""
    return 1.0 - math.exp(-dt / lag) if lag > 0.0 else 1.0


@compiled
def turning_asked(command: Any, attitude: Array | Quaternion, rates: Array, model: Model) -> Vector:
    """The angular acceleration (rad/s2, FRD) that a COMMAND asks for at an attitude and rates (3,)."""
    x, y, z = command.input[0], command.input[1], command.input[2]
    if command.turning_input == ANGULAR_ACCELERATION:
        return x, y, z
    if command.turning_input == ATTITUDE:
        inverse = attitude[0], -attitude[1], -attitude[2], -attitude[3]
        w, x, y, z = product(inverse, rotation_quaternion(x, y, z))
        gain = math.copysign(2.0 * model.attitude_loop, w)
        x, y, z = gain * x, gain * y, gain * z
    loop = model.rate_loop
    return loop[0] * (x - rates[0]), loop[1] * (y - rates[1]), loop[2] * (z - rates[2])


@compiled
def _follow_lags(
    commands: NDArray[np.void], count: int, until_ns: int, measured: Measured, model: Model, turning: Array
) -> tuple[float, int]:
    """Follow the lags over the past up to `until_ns`: the thrust (N) and the number of the command in force then.

    Writes the angular acceleration (3,) in rad/s2 then, which is zero at the call, into `turning`.
    """
    time = until_ns - _MEMORY_NS
    index = _in_force(commands, count, max(count - HISTORY, 0), time)
    thrust, rate = commands[index % HISTORY].thrust_n, commands[index % HISTORY].input.copy()
    step, share = 0, 0.0
    attitude = measured.attitude
    q = attitude[0], attitude[1], attitude[2], attitude[3]
    while time < until_ns:
        index = _in_force(commands, count, index, time)
        end = min(time + _LAG_STEP_NS, until_ns)
        dt = (end - time) * 1e-9
        if end - time != step:  # the steps are alike but for the last one, and an exponential costs more than a step
            step, share = end - time, lag_share(dt, model.rotor_lag)
        command = commands[index % HISTORY]
        thrust += share * (command.thrust_n - thrust)
        if command.turning_input != ATTITUDE:
            asked = turning_asked(command, q, rate, model)
            for i in range(3):
                turning[i] += share * (asked[i] - turning[i])
                rate[i] += dt * turning[i]
        time = end
    if commands[index % HISTORY].turning_input == ATTITUDE:
        turning[:] = turning_asked(commands[index % HISTORY], q, measured.rates, model)
    return thrust, index


@compiled
def predict(
    measured: Measured, measured_ns: int, until_ns: int, commands: NDArray[np.void], count: int, model: Model
) -> Predicted:
    """The state at `until_ns` from the one measured at `measured_ns`, under the commands of `remember`."""
    p, v, w, turning = measured.position.copy(), measured.velocity.copy(), measured.rates.copy(), np.zeros(3)
    attitude = measured.attitude
    q = attitude[0], attitude[1], attitude[2], attitude[3]
    if count == 0:
        return Predicted(p, v, q, w, turning, 0.0, 0.0)
    thrust, index = _follow_lags(commands, count, measured_ns, measured, model, turning)
    measured_thrust = thrust
    time = measured_ns
    while time < until_ns:
        index = _in_force(commands, count, index, time)
        end = min(time + _STEP_NS, until_ns)
        dt = (end - time) * 1e-9
        share = lag_share(dt, model.rotor_lag)
        command = commands[index % HISTORY]
        thrust += share * (command.thrust_n - thrust)
        asked = turning_asked(command, q, w, model)
        for i in range(3):
            turning[i] += share * (asked[i] - turning[i])
        a = _acceleration(q, v, thrust, model)
        for i in range(3):
            w[i] += dt * turning[i]
            change = dt * a[i]
            if i == 2:
                change += dt * GRAVITY
            p[i] += dt * (v[i] + 0.5 * change)
            v[i] += change
        q = product(q, rotation_quaternion(dt * w[0], dt * w[1], dt * w[2]))
        time = end
    return Predicted(p, v, q, w, turning, thrust, measured_thrust)
