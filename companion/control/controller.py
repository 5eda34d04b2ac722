"""The laws of this folder one after the other, in two compiled steps:

`acceleration_command`: disturbance observer -> prediction -> position law -> acceleration
`attitude_command`: acceleration -> thrust -> attitude -> rates or torque

Between the two steps the guard may change the acceleration.
"""

from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import Settings
from companion.control import backstepping, disturbance_observer, flatness, laws, lqr, prediction, se3, thrust, tilt
from companion.control.foreign import foreign_laws
from companion.control.jumps import fade_jumps
from companion.control.lift_off import LiftOff
from companion.control.margin import Pace, pace_for, paced
from companion.control.parameters import PARAMETERS, controller_parameters, design_of
from companion.control.tracking_error import TrackingError
from companion.outputs import OUTPUTS, TurningInput
from companion.records import CONTROL_FIELDS
from companion.reports import LinkDelay, Motors
from companion.state import Output, Reference, Setpoint, VehicleState
from protocol.arrays import Array, Vector
from protocol.frames import from_axes, from_rotation_vector, multiply, to_body, to_rotation_vector, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import VehicleParameters

MEMORY = np.dtype(
    [
        ("observer", disturbance_observer.OBSERVER),
        ("commands", prediction.COMMAND, prediction.HISTORY),
        ("count", "i8"),
        ("poses", prediction.POSE, prediction.HISTORY),
        ("poses_count", "i8"),
        ("time_ns", "i8"),
        ("adaptive_term", "f8", 3),
        ("integral", "f8", 3),
        ("reference_rates", "f8", 3),
        ("reference_turning", "f8", 3),
        ("rate_jump", "f8", 3),
        ("rate_jump_change", "f8", 3),
        ("flatness_guess", "f8", (3, 3)),
        ("limited", "b1"),
        # of the present step, from `acceleration_command` to `attitude_command`
        ("dt", "f8"),
        ("reference", "f8", (6, 3)),
        ("acceleration", "f8", 3),
        ("position", "f8", 3),
        ("velocity", "f8", 3),
        ("attitude", "f8", 4),
        ("rates", "f8", 3),
        ("turning", "f8", 3),
        ("e1", "f8", 3),
        ("e2", "f8", 3),
        ("velocity_error", "f8", 3),
        ("wanted", "f8", 3),
        ("attitude_error", "f8", 3),
        ("turning_reference", "f8", (3, 3)),
        ("disturbance", "f8", 3),
        ("thrust_scale", "f8"),
        ("drag_scale", "f8"),
    ],
    align=True,
)
"""What the controller remembers from step to step. `turning` is an angular acceleration (rad/s2, FRD); `count` the
number of commands that were ever sent, `poses_count` that of poses; `rate_jump` and its `rate_jump_change` see
`fade_jumps`; `velocity_error` (m/s) and `wanted` (the reference's acceleration, m/s2) are what the position law takes,
in the time that it runs in; `attitude_error` (rad, FRD) and `turning_reference` (a `_Turning`) what the attitude law
takes."""

CONTROLLER = np.dtype([("parameters", PARAMETERS), ("memory", MEMORY)], align=True)

SIZE = sum(size for _, size in CONTROL_FIELDS)
ATTITUDE, RATES, TORQUE, THRUST = slice(15, 19), slice(19, 22), slice(22, 25), 25
"""Places in CONTROL_FIELDS."""

_LONGEST_STEP_S = 0.1
_ITERATIONS = 2
"""Iterations of the reference's flatness, which start from the last step's result."""
_ATTITUDE, _ANGULAR_ACCELERATION = int(TurningInput.ATTITUDE), int(TurningInput.ANGULAR_ACCELERATION)


class Controller:
    """The controller of one flight."""

    def __init__(self, settings: Settings, body: VehicleParameters, output: Output) -> None:
        self._record = np.zeros(1, CONTROLLER)
        self._parameters, self._memory = self._record["parameters"], self._record["memory"]
        self._parameters[:] = controller_parameters(settings, body, output)
        self._acceleration = self._memory["acceleration"][0]
        disturbance_observer.reset(self._memory["observer"][0], self._parameters["initial_deviation"][0])
        self._memory_bytes = self._memory.view(np.uint8)
        self._at_first = self._memory_bytes.copy()
        self._predicts = settings.control.prediction.enabled
        self._configured = self._parameters.copy()
        self.delay = LinkDelay()
        """The link's delay, as it is flown with."""
        self._acts_after_ns = self._counted_ns()
        self._lift_off, self._motors = LiftOff(settings.limits, body), Motors()
        self._foreign_position, self._foreign_attitude = foreign_laws(settings.control, self._parameters, self._memory)
        self._lag_ns = round(body.rotor_time_constant_s * 1e9) if self._predicts else 0

    def use(self, output: Output) -> None:
        """Command this output from now on."""
        self._configured["turning_input"] = self._parameters["turning_input"] = OUTPUTS[output].turning_input
        self._pace()

    def _counted_ns(self) -> int:
        return int(self._parameters["half_period_ns"][0] + self._parameters["command_delay_ns"][0])

    def follow(self, delay: LinkDelay) -> Pace:
        """Fly with this delay from now on: commands act so much later, and the loops are as fast as it allows. Returns
        the pace."""
        self.delay = delay
        if self._predicts:
            self._parameters["command_delay_ns"] = self._configured["command_delay_ns"] + round(delay.command * 1e9)
        self._acts_after_ns = self._counted_ns()
        return self._pace()

    def present(self, state: VehicleState, now_ns: int) -> VehicleState:
        """Where the vehicle will be when a command of now takes effect, if the link is late: as it was predicted at the
        last step, and moved on since. Without a delay the measured state itself."""
        if self.delay.total <= 0.0:
            return state
        m = self._memory[0]
        since = (now_ns - int(m["time_ns"])) * 1e-9
        if since > _LONGEST_STEP_S:
            return state
        velocity = m["velocity"].copy()
        return msgspec.structs.replace(state, position_ned=m["position"] + since * velocity, velocity_ned=velocity)

    def _pace(self) -> Pace:
        """Slow the design down to the pace that the delay allows."""
        delay, left = self.delay.total, self.delay.unsteady
        if not self._predicts:
            delay, left = 0.0, delay + left
        law = None if self._foreign_position is None else self._foreign_position.small
        pace = pace_for(design_of(self._configured[0], law), delay, left)
        self._parameters["pace"] = pace.share
        self._parameters["rates_gain"] = paced(self._configured["rates_gain"], pace.share, torque=False)
        self._parameters["torque_gain"] = paced(self._configured["torque_gain"], pace.share, torque=True)
        return pace

    def reset(self) -> None:
        """Forget the flight so far: nothing is flown."""
        self._memory_bytes[:] = self._at_first
        for law in (self._foreign_position, self._foreign_attitude):
            if law is not None:
                law.reset()

    def take_off(self) -> None:
        """The vehicle was armed on the ground."""
        self._lift_off.begin()

    def flies(self, state: VehicleState, now_ns: int, mass: float, rises: bool, motors: Motors) -> bool:
        """Whether the vehicle is in the air; see `LiftOff.update`. Until then, `setpoint` gives the thrust to lift off
        with."""
        if motors is not self._motors:
            self._motors = motors
            self._parameters["angle_boost"] = motors.angle_boost
        if self._lift_off.thrust is None:
            return True
        scale = self._lift_off.update(state, now_ns, mass, rises, motors.spooling)
        if scale is not None and self._parameters["initial_deviation"][0, disturbance_observer.THRUST_SCALE] > 0.0:
            disturbance_observer.presume(self._memory["observer"][0], scale)
        return scale is not None

    def reference_times(self, now_ns: int) -> tuple[int, int]:
        """The times of the two references of a step: when the command takes effect, and when the rotors will have
        followed it."""
        return now_ns + self._acts_after_ns, now_ns + self._acts_after_ns + self._lag_ns

    def acceleration_command(
        self, state: VehicleState, now_ns: int, measured_ns: int, reference: Reference, mass: float, airborne: bool
    ) -> Array:
        """The acceleration (3,) in m/s2, NED, that the position law commands.

        The state was measured at `measured_ns`; the reference is for the first of `reference_times`; `mass` in kg. The
        observer and the integrals run while `airborne`.
        """
        measured = state.position_ned, state.velocity_ned, state.attitude_ned_frd, state.rates_frd
        rows = np.ascontiguousarray(reference.rows)
        times = now_ns, measured_ns, measured_ns - max(state.position_age_ns, 0)
        acceleration_command(measured, times, rows, mass, airborne, self._record)
        if self._foreign_position is not None:
            self._foreign_position.command(airborne)
        acceleration: Array = self._acceleration.copy()
        return acceleration

    def attitude_command(
        self, acceleration_ned: Array, now_ns: int, ahead: Reference, mass: float, changed: bool = False
    ) -> tuple[Array, bool]:
        """CONTROL_FIELDS (SIZE,) for an acceleration (3,) in m/s2, NED, and whether a limit on thrust or tilt was
        reached.

        State and reference are those of the last `acceleration_command`; `ahead` is the reference for the second of
        `reference_times`. `changed`: the acceleration is not the commanded one, so the integrals wait.
        """
        rows, out = np.ascontiguousarray(ahead.rows), np.empty(SIZE)
        limited = attitude_command(acceleration_ned, now_ns, rows, mass, changed, self._record, out)
        if self._foreign_attitude is not None:
            turn_otherwise(*self._foreign_attitude.command(limited or changed), self._record, out)
        return out, limited

    def setpoint(self, control: Array, *, idle: bool = False) -> Setpoint:
        """The part of CONTROL_FIELDS (SIZE,) that goes to the vehicle.

        `idle`: nothing is flown, and `control` is changed to one that moves nothing. With armed motors on the ground
        its thrust is that of the lift-off.
        """
        if idle:
            control[RATES] = control[TORQUE] = control[THRUST] = 0.0
        elif self._lift_off.thrust is not None:
            control[THRUST] = self._lift_off.thrust
            self._memory["commands"]["thrust_n"] = self._lift_off.thrust * self._parameters["full_thrust_n"][0]
        values = control.tolist()
        return Setpoint(values[ATTITUDE], values[RATES], values[TORQUE], values[THRUST])


@compiled
def _sum(a: Vector, b: Array) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def _difference(a: Array | Vector, b: Array) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def acceleration_command(
    measured: tuple[Array, Array, Array, Array],
    times: tuple[int, int, int],
    reference: Array,
    mass: float,
    airborne: bool,
    controller: NDArray[np.void],
) -> None:
    """Disturbance observer, prediction and position law, which write their results into the memory of `controller`
    (1,) of CONTROLLER (an array as a compiled function's result would cost more than all arguments).

    `measured` is position, velocity, attitude and rates (see `prediction.Measured`), `times` (ns) are now and when
    attitude and position were measured, `reference` the rows (6, 3) of a `Reference`, `mass` in kg.
    """
    now_ns = times[0]
    p, m = controller[0].parameters, controller[0].memory
    m.dt = min(max((now_ns - m.time_ns) * 1e-9, 0.0), _LONGEST_STEP_S)
    m.time_ns = now_ns
    m.reference[:] = reference
    mean = m.observer.mean
    m.thrust_scale, m.drag_scale = mean[disturbance_observer.THRUST_SCALE], mean[disturbance_observer.DRAG_SCALE]
    m.disturbance[:] = mean[disturbance_observer.DISTURBANCE]
    state = prediction.Measured(measured[0], measured[1], measured[2], measured[3])
    if airborne and m.count > 0 and (p.predicts or p.observes):
        _observe_and_predict(state, times, mass, p, m)
    else:
        m.position[:], m.velocity[:], m.attitude[:], m.rates[:] = state
        m.turning[:] = 0.0
    reference_velocity, pace = p.feed_velocity * reference[1], p.pace
    m.e1[:], m.e2[:] = backstepping.errors(m.position, m.velocity, reference[0], reference_velocity, pace * p.c1)
    if airborne and not m.limited:
        gamma = pace * pace * p.gamma
        m.adaptive_term[:] = backstepping.integrated(m.adaptive_term, m.e2, gamma, m.dt, p.adaptation_bound)
        m.integral[:] = backstepping.integrated(m.integral, m.e1, pace * p.unit, m.dt, p.adaptation_bound)
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
        p.turning_input,
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
    if p.observes:
        pose = m.poses[prediction.pose_at(m.poses, m.poses_count, position_ns) % prediction.HISTORY]
        disturbance_observer.update(
            m.observer,
            position_ns,
            state.velocity,
            np.array(to_world(pose.attitude, (0.0, 0.0, -pose.thrust_n / mass))),
            -thrust.drag_compensation(state.velocity, pose.attitude, p.drag_kg_s, mass),
            disturbance_observer.Noise(p.velocity_noise, p.walk, p.fading),
        )


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
    if p.turning_input == _ATTITUDE:
        if p.attitude_lead > 0.0:
            command = _attitude_sent(command, reference, p, m)
        turning_input = to_rotation_vector(command)
    m.limited = limited or changed
    m.count = prediction.remember(m.commands, m.count, now_ns + p.command_delay_ns, collective, turning_input)

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
    out[19:22] = rates
    out[22:25] = torque
    if p.turning_input != _ATTITUDE:
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
        if p.turning_input == _ANGULAR_ACCELERATION:
            turning_input[i] = (torque[i] * p.full_torque[i] - gyroscopic[i]) / inertia[i]
    return rates, torque, turning_input
