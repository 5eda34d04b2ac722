"""From a measured state and a reference to an acceleration: disturbance observer, prediction and position law."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.control import backstepping, disturbance_observer, laws, prediction, thrust, torque_observer
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.frames import to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

LONGEST_STEP_S = 0.1


@compiled
def acceleration_command(
    measured: tuple[Array, Array, Array, Array],
    times: tuple[int, int, int],
    reference: Array,
    mass: float,
    airborne: bool,
    tied: bool,
    controller: NDArray[np.void],
) -> None:
    """Disturbance observer, prediction and position law, which write their results into the memory of `controller`
    (1,) of CONTROLLER (an array as a compiled function's result would cost more than all arguments).

    `measured` is position, velocity, attitude and rates (see `prediction.Measured`), `times` (ns) are now and when
    attitude and position were measured, `reference` the rows (6, 3) of a `Reference`, which may be `tied`; `mass` in
    kg.
    """
    now_ns = times[0]
    p, m = controller[0].parameters, controller[0].memory
    since = now_ns - m.time_ns if m.time_ns else 0  # nothing has passed since a reset
    m.dt = min(max(since * 1e-9, 0.0), LONGEST_STEP_S)
    m.time_ns = now_ns
    m.reference[:] = reference
    mean = m.observer.mean
    m.thrust_scale, m.drag_scale = mean[disturbance_observer.THRUST_SCALE], mean[disturbance_observer.DRAG_SCALE]
    m.disturbance[:] = mean[disturbance_observer.DISTURBANCE]
    state = prediction.Measured(measured[0], measured[1], measured[2], measured[3])
    if airborne and m.count > 0 and (p.predicts or p.observes or p.torque_bandwidth > 0.0):
        _observe_and_predict(state, times, mass, p, m)
    else:
        m.position[:], m.velocity[:], m.attitude[:], m.rates[:] = state
        m.turning[:] = 0.0
    reference_velocity, pace = p.feed_velocity * reference[1], p.pace
    m.e1[:], m.e2[:] = backstepping.errors(m.position, m.velocity, reference[0], reference_velocity, pace * p.c1)
    if airborne and not m.limited:
        gamma = pace * pace * p.gamma
        adapted = backstepping.integrated(m.adaptive_term, m.e2, gamma, m.dt, p.adaptation_bound)
        integral = backstepping.integrated(m.integral, m.e1, pace * p.unit, m.dt, p.adaptation_bound)
        first = 2 if tied else 0
        m.adaptive_term[first:], m.integral[first:] = adapted[first:], integral[first:]
    if p.adaptive:
        m.disturbance += m.adaptive_term
    # the law in a time that runs at the pace: speeds are by 1 / pace, accelerations by 1 / pace^2 greater there
    m.velocity_error[:] = (reference_velocity - m.velocity) / pace
    m.wanted[:] = p.feed_acceleration * reference[2] / (pace * pace)
    # [:]: plain arrays, as `design_of` calls the law with. A field of a record is another type, compiled once more.
    error = TrackingError(m.e1[:], m.velocity_error[:], m.e2 / pace, m.integral[:])
    m.acceleration[:] = pace * pace * laws.acceleration_command(p.law, error, m.wanted[:], p.gains[:])


@compiled
def _observe_and_predict(state: prediction.Measured, times: tuple[int, int, int], mass: float, p: Any, m: Any) -> None:
    """Write the state at the time that the command takes effect into the memory, and update the observer."""
    now_ns, measured_ns, position_ns = times
    until_ns = now_ns + p.half_period_ns + p.command_delay_ns if p.predicts else measured_ns
    model = prediction.Model(
        p.rotor_lag,
        p.assumed_rate_loop,
        p.assumed_attitude_loop,
        mass / m.thrust_scale,
        p.drag_kg_s * m.drag_scale / m.thrust_scale,
        m.disturbance,
    )
    late = position_ns < measured_ns
    now_there = prediction.caught_up(state, measured_ns, position_ns, m.poses, m.poses_count, model) if late else state
    predicted = prediction.predict(now_there, measured_ns, until_ns, m.commands, m.count, model)
    m.position[:], m.velocity[:], m.attitude[:] = predicted.position, predicted.velocity, predicted.attitude
    m.rates[:], m.turning[:] = predicted.rates, predicted.angular_acceleration
    m.poses_count = prediction.keep_pose(m.poses, m.poses_count, measured_ns, state.attitude, predicted.measured_thrust)
    if p.torque_bandwidth > 0.0:
        share = torque_observer.thrust_share(predicted.measured_thrust, model.mass * GRAVITY)
        tuning = share, p.torque_bandwidth, p.offset_bound
        torque_observer.update(m.torque, measured_ns, state, m.commands, m.count, model, tuning)
    if p.observes:
        pose = m.poses[prediction.pose_at(m.poses, m.poses_count, position_ns) % prediction.HISTORY]
        disturbance_observer.update(
            m.observer,
            position_ns,
            state.velocity,
            np.array(to_world(pose.attitude, (0.0, 0.0, -pose.thrust_n / mass))),
            -thrust.drag_compensation(state.velocity, pose.attitude, p.drag_kg_s, mass),
            disturbance_observer.Noise(
                p.velocity_noise, p.walk, p.fading, p.velocity_variance, p.velocity_correlation, p.climb
            ),
        )
