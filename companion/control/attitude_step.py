"""From an acceleration to thrust, attitude, and rates or torque, with what the reference's flatness feeds forward."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.control import backstepping, flatness, lqr, prediction, se3, thrust, tilt, torque_observer
from companion.control.jumps import fade_jumps
from protocol.arrays import Array, Vector
from protocol.frames import from_axes, from_rotation_vector, multiply, to_body, to_rotation_vector, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_ITERATIONS = 2
"""Iterations of the reference's flatness, which start from the last step's result."""


@compiled
def _sum(a: Vector, b: Array) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def _difference(a: Array | Vector, b: Array) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


class _Turning(NamedTuple):
    """How the reference turns, in the vehicle's present body axes, and the change of its thrust."""

    rates: Vector
    """rad/s."""
    acceleration: Vector
    """rad/s2."""
    acceleration_ahead: Vector
    """rad/s2, a rotor's lag later."""
    thrust_change: float
    """N, within a rotor's lag."""


@compiled
def attitude_command(
    acceleration: Array,
    now_ns: int,
    ahead: Array,
    mass: float,
    changed: bool,
    controller: NDArray[np.void],
    out: Array,
) -> bool:
    """Thrust, attitude, and rates or torque for an acceleration (3,) in m/s2, NED: writes CONTROL_FIELDS (SIZE,) into
    `out`, and returns whether a limit on thrust or tilt was reached.

    The state is that of the last `acceleration_command`; `ahead` is the rows (6, 3) of the reference a rotor's lag
    later.
    """
    p, m = controller[0].parameters, controller[0].memory
    # A rotor that gives `thrust_scale` times its thrust lifts as if all else were so much less.
    mass, drag = mass / m.thrust_scale, p.compensated_drag_kg_s * m.drag_scale / m.thrust_scale
    against_drag = thrust.drag_compensation(m.velocity, m.attitude, drag, mass)
    thrust_ned, limited = thrust.thrust_vector(
        acceleration - m.disturbance + against_drag, mass, p.min_thrust_n, p.max_thrust_n, p.max_tilt
    )
    command = flatness.attitude_command(thrust_ned, m.reference[5, 0])
    reference = _reference_turning(command, ahead, mass, drag, p, m)
    collective = thrust.collective(thrust_ned, m.attitude)
    if p.predicts:
        collective += reference.thrust_change
    collective = min(max(collective, p.min_thrust_n), p.max_thrust_n)
    rates, torque, turning_input = _inner_loop(command, reference, p, m)
    if p.turning_input == prediction.ATTITUDE:
        if p.attitude_lead > 0.0:
            command = _attitude_sent(command, reference, p, m)
        turning_input = to_rotation_vector(command)
    m.offset[:] = m.torque.offset * torque_observer.thrust_share(collective, mass * GRAVITY)
    command = _against_offset(command, rates, torque, p, m)
    m.limited = limited or changed
    m.count = prediction.remember(
        m.commands, m.count, now_ns + p.command_delay_ns, collective, p.turning_input, turning_input
    )

    v, v_rate = backstepping.lyapunov(m.e1, m.e2, p.c1, p.c2)
    out[0:3] = m.e1
    out[3:6] = m.e2
    out[6:9] = v
    out[9:12] = v_rate
    out[12:15] = acceleration
    out[15:19] = command
    out[19:22] = rates
    out[22:25] = torque
    out[25] = thrust.on_the_wire(collective, m.attitude, p.angle_boost) / p.full_thrust_n
    out[26:29] = m.position
    out[29:32] = m.disturbance
    out[32] = m.thrust_scale
    out[33] = m.drag_scale
    return limited


@compiled
def turn_otherwise(rates: Array, turning: Array, controller: NDArray[np.void], out: Array) -> None:
    """Put other rates (3,) in rad/s, and another angular acceleration (3,) in rad/s2, in the place of those of the last
    `attitude_command`, within the limits; both are changed to what these allow."""
    p, m = controller[0].parameters, controller[0].memory
    rates, torque, turning_input = _limited(rates, turning, p, m)
    _against_offset(out[15:19], rates, torque, p, m)
    out[19:22] = rates
    out[22:25] = torque
    if p.turning_input != prediction.ATTITUDE:
        m.commands[(m.count - 1) % prediction.HISTORY].input[:] = turning_input


@compiled
def _flat_motion(reference: Array, disturbance: Array) -> flatness.FlatMotion:
    """The reference's motion (6, 3), flown against a disturbance (3,) in m/s2, NED."""
    return flatness.FlatMotion(
        flatness.vector(reference[1]),
        _difference(reference[2], disturbance),
        flatness.vector(reference[3]),
        flatness.vector(reference[4]),
        flatness.vector(reference[5]),
    )


@compiled
def _reference_turning(command: Array, ahead: Array, mass: float, drag: Array, p: Any, m: Any) -> _Turning:
    """Rates and angular acceleration of the reference by its flatness, with jumps faded."""
    attitude, thrust_change = command, 0.0
    rates, turning, turning_ahead = (0.0, 0.0, m.reference[5, 1]), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if p.feed_attitude:
        motion, motion_ahead = _flat_motion(m.reference[:], m.disturbance), _flat_motion(ahead, m.disturbance)
        if not m.flatness_guess.any():
            m.flatness_guess[:] = flatness.first_guess(motion, mass, drag)
        guess = m.flatness_guess[:]
        axes, rates, turning, thrust_now = flatness.inverse_from(guess, motion, mass, drag, _ITERATIONS)
        _, _, turning_ahead, thrust_ahead = flatness.inverse_from(guess.copy(), motion_ahead, mass, drag, _ITERATIONS)
        attitude, thrust_change = from_axes(*axes), thrust_ahead - thrust_now
    fade_jumps(rates, turning, m.dt, m)
    return _Turning(
        to_body(m.attitude, to_world(attitude, _difference(rates, m.rate_jump))),
        to_body(m.attitude, to_world(attitude, _sum(turning, m.rate_jump_change))),
        to_body(m.attitude, to_world(attitude, _sum(turning_ahead, m.rate_jump_change))),
        thrust_change,
    )


@compiled
def _attitude_sent(command: Array, reference: _Turning, p: Any, m: Any) -> Array:
    """The attitude (4,) for a vehicle whose attitude loop is as slow as `p.attitude_lead`: ahead of the command by that
    and within the tilt limit, which the vehicle must not swing past either."""
    if p.feed_attitude:
        command = multiply(command, from_rotation_vector(p.attitude_lead * np.array(reference.rates)))
        command = tilt.within(command, p.max_tilt)
    rates = lqr.attitude_error(m.attitude, command) / p.attitude_lead
    x, y = rates[0], rates[1]
    tilt.limit_rates(rates, tilt.tilt_ahead(m.attitude, m.rates, p.max_tilt, p.tilt_braking))
    if rates[0] == x and rates[1] == y:
        return command
    return tilt.within(multiply(m.attitude, from_rotation_vector(p.attitude_lead * rates)), p.max_tilt)


@compiled
def _against_offset(command: Array, rates: Array, torque: Array, p: Any, m: Any) -> Array:
    """The attitude (4,), within the tilt limit, with which the vehicle's loops keep a command (4,) against the
    disturbing torque; rates and torque (3,) are changed likewise."""
    if not m.offset.any():
        return command
    turn = np.empty(3)
    for i in range(3):
        slower = m.offset[i] / p.assumed_rate_loop[i]
        turn[i] = -slower / p.assumed_attitude_loop
        rates[i] -= slower
        torque[i] = min(max(torque[i] - m.offset[i] * p.inertia[i] / p.full_torque[i], -1.0), 1.0)
    return tilt.within(multiply(command, from_rotation_vector(turn)), p.max_tilt)


@compiled
def _limit(values: Array, limits: Array) -> None:
    """Keep the values (3,) between their limits (3,) and the negative ones, in place."""
    for i in range(3):
        values[i] = np.minimum(np.maximum(values[i], -limits[i]), limits[i])


@compiled
def _inner_loop(command: Array, reference: _Turning, p: Any, m: Any) -> tuple[Array, Array, Array]:
    """The attitude's LQR: rates (3,) in rad/s, torque (3,) in fractions of the full one, and of both what
    `prediction.remember` takes."""
    error = se3.attitude_error(m.attitude, command) if p.lee_attitude_error else lqr.attitude_error(m.attitude, command)
    turns, inertia = m.rates, p.inertia
    rates, turning = np.empty(3), np.empty(3)
    m.attitude_error[:] = error
    for i in range(3):
        rate_error, turning_error = reference.rates[i] - turns[i], reference.acceleration[i] - m.turning[i]
        rate = reference.rates[i] + lqr.feedback(error[i], rate_error, turning_error, p.rates_gain[i])
        if p.rate_loop[i] > 0.0:
            rate += reference.acceleration_ahead[i] / p.rate_loop[i]
        rates[i] = rate
        push = lqr.feedback(error[i], rate_error, turning_error, p.torque_gain[i]) * p.torque_scale[i]
        turning[i] = push * p.full_torque[i] / inertia[i] + reference.acceleration_ahead[i]
        m.turning_reference[0, i], m.turning_reference[1, i] = reference.rates[i], reference.acceleration[i]
        m.turning_reference[2, i] = reference.acceleration_ahead[i]
    return _limited(rates, turning, p, m)


@compiled
def _limited(rates: Array, turning: Array, p: Any, m: Any) -> tuple[Array, Array, Array]:
    """What `_inner_loop` returns, for rates (3,) in rad/s and an angular acceleration (3,) in rad/s2 that are wanted;
    both are changed to what the limits allow."""
    turns, inertia = m.rates, p.inertia
    gyroscopic = flatness.cross(turns, (inertia[0] * turns[0], inertia[1] * turns[1], inertia[2] * turns[2]))
    torque, turning_input = np.empty(3), np.empty(3)
    ahead = tilt.tilt_ahead(m.attitude, turns, p.max_tilt, p.tilt_braking)
    _limit(rates, p.rate_limit)
    tilt.limit_rates(rates, ahead)
    tilt.limit_acceleration(turning, turns, ahead)
    _limit(rates, p.rate_limit)
    for i in range(3):
        push = (turning[i] * inertia[i] + gyroscopic[i]) / p.full_torque[i]
        torque[i] = np.minimum(np.maximum(push, -1.0), 1.0)
        turning_input[i] = rates[i]
        if p.turning_input == prediction.ANGULAR_ACCELERATION:
            turning_input[i] = (torque[i] * p.full_torque[i] - gyroscopic[i]) / inertia[i]
    return rates, torque, turning_input
