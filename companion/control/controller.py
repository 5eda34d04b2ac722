"""The laws of this folder one after the other, in two compiled steps:

`wish`: estimation -> prediction -> position law -> acceleration
`obey`: acceleration -> thrust -> attitude -> rates or torque
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config import Settings
from companion.control import (
    backstepping,
    disturbance_observer,
    flatness,
    lqr,
    pid,
    prediction,
    se3,
    sliding_mode,
    thrust,
)
from companion.records import CONTROL_FIELDS
from companion.state import Output, Reference, VehicleState
from protocol.arrays import Array, Vector
from protocol.frames import from_axes, from_rotation_vector, multiply, to_body, to_world
from protocol.jit import compiled
from protocol.vehicle_parameters import VehicleParameters

LAWS = ("backstepping", "se3", "sliding_mode", "pid")
_BACKSTEPPING, _SE3, _SLIDING_MODE, _PID = range(4)

PARAMETERS = np.dtype(
    [
        ("law", "i8"),
        ("c1", "f8", 3),
        ("c2", "f8", 3),
        ("gamma", "f8", 3),
        ("adaptation_bound", "f8"),
        ("gain_1", "f8", 3),  # of the laws that are compared: position, slope, proportional
        ("gain_2", "f8", 3),  # velocity, reaching, derivative
        ("gain_3", "f8", 3),  # integral
        ("boundary", "f8"),
        ("feed_velocity", "f8"),
        ("feed_acceleration", "f8"),
        ("feed_attitude", "b1"),
        ("drag_kg_s", "f8", 3),  # as compensated
        ("model_drag_kg_s", "f8", 3),
        ("estimates", "b1"),
        ("noise", "f8"),
        ("spread", "f8", 8),
        ("walk", "f8", 8),
        ("predicts", "b1"),
        ("input_kind", "i8"),
        ("rotor_lag", "f8"),
        ("rate_loop", "f8", 3),
        ("attitude_lead", "f8"),
        ("torque_gain", "f8", (3, 3)),
        ("rates_gain", "f8", (3, 3)),
        ("rate_limit", "f8", 3),
        ("torque_scale", "f8", 3),
        ("full_torque", "f8", 3),
        ("inertia", "f8", 3),
        ("lowest_n", "f8"),
        ("highest_n", "f8"),
        ("full_n", "f8"),
        ("tilt", "f8"),
    ],
    align=True,
)
"""What the laws need of settings and body; `torque_scale`: fractions of full torque for one unit of U2, U3, U4."""

MEMORY = np.dtype(
    [
        ("estimate", disturbance_observer.ESTIMATE),
        ("sent", prediction.SENT, prediction.KEPT),
        ("count", "i8"),
        ("time_ns", "i8"),
        ("adapted", "f8", 3),
        ("integral", "f8", 3),
        ("reference_rates", "f8", 3),
        ("reference_turning", "f8", 3),
        ("jump", "f8", 3),
        ("letting", "f8", 3),
        ("guess", "f8", (3, 3)),
        ("limited", "b1"),
        ("dt", "f8"),  # of the present step, from `wish` to `obey`: what follows, too
        ("at", "f8", 3),
        ("moving", "f8", 3),
        ("turned", "f8", 4),
        ("turns", "f8", 3),
        ("turning", "f8", 3),
        ("e1", "f8", 3),
        ("e2", "f8", 3),
        ("disturbance", "f8", 3),
        ("scale", "f8"),
        ("drag_scale", "f8"),
    ],
    align=True,
)
"""What the laws remember from step to step."""

SIZE = sum(size for _, size in CONTROL_FIELDS)
ATTITUDE, RATES, TORQUE, THRUST = slice(15, 19), slice(19, 22), slice(22, 25), 25

_LONGEST_S = 0.1
_FADING_S = 0.05
_ROUNDS = 2
"""Of substitution in the flatness of the reference, from the last step's result on."""


class Controller:
    """The controller of one flight."""

    def __init__(self, settings: Settings, body: VehicleParameters, output: Output) -> None:
        self._parameters = _parameters(settings, body, output)
        self._memory = np.zeros(1, MEMORY)
        self._reference = np.zeros(18)
        self._ahead_ns = 0
        self._half_period_ns = 0
        if settings.control.prediction.enabled:
            self._half_period_ns = round(0.5e9 / settings.rates.attitude)
            self._half_period_ns += round(settings.control.prediction.command_delay * 1e9)
            self._ahead_ns = round(body.rotor_time_constant_s * 1e9)
        self.reset()

    def reset(self) -> None:
        """Forget everything: nothing is flown."""
        self._memory[:] = np.zeros(1, MEMORY)
        disturbance_observer.start(self._memory["estimate"], self._parameters["spread"][0])

    def reference_times(self, now_ns: int) -> tuple[int, int]:
        """When the command takes effect, and when the rotors will have followed it: the times of the reference and
        of the one `ahead`."""
        return now_ns + self._half_period_ns, now_ns + self._half_period_ns + self._ahead_ns

    def wish(
        self, state: VehicleState, now_ns: int, measured_ns: int, reference: Reference, mass: float, airborne: bool
    ) -> Array:
        """The acceleration (3,) in m/s2, NED, that the position law asks for.

        The state was measured at `measured_ns`; `mass` in kg; what a flight teaches is learnt while `airborne`.
        """
        self._reference = reference.rows.ravel()
        acceleration = np.empty(3)
        wish(
            state.position_ned,
            state.velocity_ned,
            state.attitude_ned_frd,
            state.rates_frd,
            measured_ns,
            now_ns,
            now_ns + self._half_period_ns,
            self._reference,
            mass,
            airborne,
            self._parameters,
            self._memory,
            acceleration,
        )
        return acceleration

    def obey(
        self,
        acceleration_ned: Array,
        now_ns: int,
        ahead: Reference,
        mass: float,
        changed: bool = False,
    ) -> tuple[Array, bool]:
        """CONTROL_FIELDS (SIZE,) for an acceleration, that of `wish` or what came out of it, and whether a limit bit.

        The state and the reference are those of `wish`.

        `changed`: it is not that of `wish`, so that the integrals wait.
        """
        flat, out = ahead.rows.ravel(), np.empty(SIZE)
        limited = obey(
            acceleration_ned, now_ns, self._reference, flat, mass, changed, self._parameters, self._memory, out
        )
        return out, limited


def _parameters(settings: Settings, body: VehicleParameters, output: Output) -> NDArray[np.void]:
    """One record of PARAMETERS; the LQR's gains are computed here."""
    control, limits = settings.control, settings.limits
    position, attitude, estimates = control.position, control.attitude, control.estimation
    angle_weight, rate_weight = list(attitude.angle_weight), list(attitude.rate_weight)
    if attitude.bandwidth is not None:
        angle_weight, rate_weight = lqr.weights_for(body, attitude.bandwidth, attitude.damping)
    K = lqr.attitude_gain(body, angle_weight, rate_weight, attitude.input_weight)
    tilt_rate, yaw_rate = math.radians(limits.roll_pitch_rate_deg), math.radians(limits.yaw_rate_deg)
    lag, known_loop = body.rotor_time_constant_s, min(body.rate_loop_gain_1_s) > 0.0
    record = np.zeros(1, PARAMETERS)
    values = {
        "law": LAWS.index(position.law),
        "c1": position.c1,
        "c2": position.c2,
        "gamma": position.adaptation,
        "adaptation_bound": position.adaptation_bound,
        "boundary": control.sliding_mode.boundary,
        "feed_velocity": position.feedforward != "none",
        "feed_acceleration": position.feedforward == "acceleration",
        "feed_attitude": attitude.feedforward,
        "drag_kg_s": body.drag_kg_s if position.drag_compensation else (0.0, 0.0, 0.0),
        "model_drag_kg_s": body.drag_kg_s,
        "estimates": estimates.disturbance or estimates.thrust_scale or estimates.drag_scale,
        "noise": estimates.velocity_noise,
        "predicts": control.prediction.enabled,
        "input_kind": {
            Output.ATTITUDE: prediction.UNKNOWN,
            Output.RATES: prediction.RATES,
            Output.ACTUATORS: prediction.ANGULAR_ACCELERATION,
        }[output],
        "rotor_lag": lag,
        "rate_loop": body.rate_loop_gain_1_s,
        "attitude_lead": 1.0 / body.attitude_loop_gain_1_s if body.attitude_loop_gain_1_s > 0.0 else 0.0,
        "torque_gain": lqr.axis_gain(K),
        "rates_gain": lqr.rate_gain(K),
        "rate_limit": (tilt_rate, tilt_rate, yaw_rate),
        "torque_scale": lqr.to_torque(body) / np.array(body.full_torque_nm),
        "full_torque": body.full_torque_nm,
        "inertia": body.inertia_kgm2,
        "lowest_n": limits.lowest_thrust * body.max_thrust_n,
        "highest_n": limits.highest_thrust * body.max_thrust_n,
        "full_n": body.max_thrust_n,
        "tilt": limits.tilt,
    }
    for name, value in values.items():
        record[name] = value
    parts = (
        (slice(3, 6), estimates.disturbance, 0.0, estimates.disturbance_walk),
        (disturbance_observer.THRUST_SCALE, estimates.thrust_scale, 0.3, estimates.thrust_scale_walk),
        (
            disturbance_observer.DRAG_SCALE,
            estimates.drag_scale and max(body.drag_kg_s) > 0.0,
            0.3,
            estimates.drag_scale_walk,
        ),
    )
    record["spread"][0, :3] = 1.0
    record["walk"][0, :3] = estimates.acceleration_noise
    for part, wanted, spread, walk in parts:
        if wanted:
            record["spread"][0, part], record["walk"][0, part] = spread, walk
    if attitude.design == "sampled" and lag > 0.0:
        weights = (angle_weight, rate_weight, attitude.input_weight)
        entries = [float(b) for b in np.array(lqr.to_torque(body)) / np.array(body.inertia_kgm2)]
        period = 1.0 / settings.rates.attitude
        record["torque_gain"] = lqr.sampled_gain(None, entries, lag, period, *weights)
        if known_loop:
            record["rates_gain"] = lqr.sampled_gain(body.rate_loop_gain_1_s, entries, lag, period, *weights)
    others = {
        "se3": (control.se3.position_gain, control.se3.velocity_gain, (0.0, 0.0, 0.0)),
        "sliding_mode": (control.sliding_mode.slope, control.sliding_mode.gain, (0.0, 0.0, 0.0)),
        "pid": (control.pid.proportional, control.pid.derivative, control.pid.integral),
    }
    if position.law in others:
        record["gain_1"], record["gain_2"], record["gain_3"] = others[position.law]
    return record


@compiled
def _sum(a: Vector, b: Array) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def _difference(a: Array | Vector, b: Array) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _fade_jumps(reference_rates: Vector, reference_turning: Vector, dt: float, memory: Any) -> None:
    """What the reference's rates jumped by, where the jerk does, is held back in `memory.jump` and let through like the
    step response of a critically damped filter: neither rates nor angular acceleration (`memory.letting`) step. Rates
    that their own derivative explains pass untouched.
    """
    left = math.exp(-dt / _FADING_S)
    for i in range(3):
        if dt > 0.0:
            expected = memory.reference_rates[i] + 0.5 * dt * (memory.reference_turning[i] + reference_turning[i])
            jump = memory.jump[i] + reference_rates[i] - expected
            pull = (jump / _FADING_S - memory.letting[i]) * dt
            memory.jump[i] = left * (jump + pull)
            memory.letting[i] = left * (memory.letting[i] + pull / _FADING_S)
        memory.reference_rates[i] = reference_rates[i]
        memory.reference_turning[i] = reference_turning[i]


@compiled
def wish(
    position: Array,
    velocity: Array,
    attitude: Array,
    rates: Array,
    measured_ns: int,
    now_ns: int,
    until_ns: int,
    reference: Array,
    mass: float,
    airborne: bool,
    parameters: NDArray[np.void],
    memory: NDArray[np.void],
    out: Array,
) -> None:
    """Estimation, prediction and the position law: fills `out` with the acceleration (3,) in m/s2, NED, that it asks
    for (what compiled code returns as an array costs more than all that it is passed).

    `mass` in kg; the reference (18,) is position to snap, yaw, its rate and acceleration, for `until_ns`.
    """
    p, m = parameters[0], memory[0]
    m.dt = min(max((now_ns - m.time_ns) * 1e-9, 0.0), _LONGEST_S)
    m.time_ns = now_ns
    estimate = memory["estimate"]
    mean = estimate[0].mean
    m.scale, m.drag_scale = mean[disturbance_observer.THRUST_SCALE], mean[disturbance_observer.DRAG_SCALE]
    m.disturbance[:] = mean[disturbance_observer.DISTURBANCE]
    m.at[:], m.moving[:], m.turned[:], m.turns[:], m.turning[:] = position, velocity, attitude, rates, 0.0
    if airborne and m.count > 0 and (p.predicts or p.estimates):
        m.at[:], m.moving[:], m.turned[:], m.turns[:], m.turning[:], _, thrust_then = prediction.predict(
            position,
            velocity,
            attitude,
            rates,
            measured_ns,
            until_ns if p.predicts else measured_ns,
            m.sent,
            m.count,
            p.input_kind,
            p.rotor_lag,
            p.rate_loop,
            mass / m.scale,
            p.model_drag_kg_s * m.drag_scale / m.scale,
            m.disturbance,
        )
        if p.estimates:
            disturbance_observer.update(
                estimate,
                measured_ns,
                velocity,
                np.array(to_world(attitude, (0.0, 0.0, -thrust_then / mass))),
                -thrust.drag_compensation(velocity, attitude, p.model_drag_kg_s, mass),
                p.noise,
                p.walk,
            )
    reference_velocity = p.feed_velocity * reference[3:6]
    reference_acceleration = p.feed_acceleration * reference[6:9]
    acceleration, e1, e2 = backstepping.acceleration_command(
        m.at, m.moving, reference[0:3], reference_velocity, reference_acceleration, p.c1, p.c2
    )
    m.e1[:], m.e2[:] = e1, e2
    if airborne and not m.limited:
        m.adapted[:] = backstepping.adapted(m.adapted, e2, p.gamma, m.dt, p.adaptation_bound)
        m.integral[:] = backstepping.adapted(m.integral, e1, np.ones(3), m.dt, p.adaptation_bound)
    error_rate = reference_velocity - m.moving
    if p.law == _BACKSTEPPING:
        m.disturbance += m.adapted
    elif p.law == _SE3:
        acceleration = se3.acceleration_command(e1, error_rate, reference_acceleration, p.gain_1, p.gain_2)
    elif p.law == _SLIDING_MODE:
        acceleration = sliding_mode.acceleration_command(
            e1, error_rate, reference_acceleration, p.gain_1, p.gain_2, p.boundary
        )
    elif p.law == _PID:
        acceleration = pid.acceleration_command(e1, error_rate, m.integral, p.gain_1, p.gain_3, p.gain_2)
    out[:] = acceleration


@compiled
def obey(
    acceleration: Array,
    now_ns: int,
    reference: Array,
    ahead: Array,
    mass: float,
    changed: bool,
    parameters: NDArray[np.void],
    memory: NDArray[np.void],
    out: Array,
) -> bool:
    """Thrust, attitude, and rates or torque for an acceleration (3,): fills `out` with CONTROL_FIELDS (SIZE,) and says
    whether a limit bit.

    The state is that of the last `wish`; `ahead` is the reference a rotor's lag later.
    """
    p, m = parameters[0], memory[0]
    # A rotor that gives `scale` times its thrust lifts as if all else were so much less.
    seen_mass, seen_drag = mass / m.scale, p.drag_kg_s * m.drag_scale / m.scale
    against_drag = thrust.drag_compensation(m.moving, m.turned, seen_drag, seen_mass)
    thrust_ned, limited = thrust.thrust_vector(
        acceleration - m.disturbance + against_drag, seen_mass, p.lowest_n, p.highest_n, p.tilt
    )
    command = flatness.attitude_command(thrust_ned, reference[15])
    collective = thrust.collective(thrust_ned, m.turned)
    reference_attitude = command
    reference_rates, reference_turning, turning_ahead = (0.0, 0.0, reference[16]), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if p.feed_attitude:
        wanted, wanted_ahead = _difference(reference[6:9], m.disturbance), _difference(ahead[6:9], m.disturbance)
        if not m.guess.any():
            m.guess[:] = flatness.first_guess(reference[3:6], np.array(wanted), seen_mass, seen_drag)
        axes, reference_rates, reference_turning, thrust_now = flatness.refined(
            reference[3:6], wanted, reference[9:12], reference[12:15], reference[15:18], seen_mass, seen_drag,
            m.guess, _ROUNDS,
        )  # fmt: skip
        _, _, turning_ahead, thrust_ahead = flatness.refined(
            ahead[3:6], wanted_ahead, ahead[9:12], ahead[12:15], ahead[15:18], seen_mass, seen_drag,
            m.guess.copy(), _ROUNDS,
        )  # fmt: skip
        reference_attitude = from_axes(*axes)
        if p.predicts:
            collective += thrust_ahead - thrust_now
    _fade_jumps(reference_rates, reference_turning, m.dt, m)
    reference_rates = to_body(m.turned, to_world(reference_attitude, _difference(reference_rates, m.jump)))
    reference_turning = to_body(m.turned, to_world(reference_attitude, _sum(reference_turning, m.letting)))
    turning_ahead = to_body(m.turned, to_world(reference_attitude, _sum(turning_ahead, m.letting)))
    collective = min(max(collective, p.lowest_n), p.highest_n)

    error = se3.attitude_error(m.turned, command) if p.law == _SE3 else lqr.attitude_error(m.turned, command)
    turns, inertia = m.turns, p.inertia
    gyroscopic = flatness.cross(turns, (inertia[0] * turns[0], inertia[1] * turns[1], inertia[2] * turns[2]))
    rates_command, torque, sent_input = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        rate_error, turning_error = reference_rates[i] - turns[i], reference_turning[i] - m.turning[i]
        rate = reference_rates[i] + lqr.feedback(error[i], rate_error, turning_error, p.rates_gain[i])
        if p.rate_loop[i] > 0.0:
            rate += turning_ahead[i] / p.rate_loop[i]
        rates_command[i] = np.minimum(np.maximum(rate, -p.rate_limit[i]), p.rate_limit[i])
        push = lqr.feedback(error[i], rate_error, turning_error, p.torque_gain[i]) * p.torque_scale[i]
        push += (inertia[i] * turning_ahead[i] + gyroscopic[i]) / p.full_torque[i]
        torque[i] = np.minimum(np.maximum(push, -1.0), 1.0)
        sent_input[i] = rates_command[i]
        if p.input_kind == prediction.ANGULAR_ACCELERATION:
            sent_input[i] = (torque[i] * p.full_torque[i] - gyroscopic[i]) / inertia[i]
    if p.attitude_lead > 0.0 and p.feed_attitude and p.input_kind == prediction.UNKNOWN:
        command = multiply(command, from_rotation_vector(p.attitude_lead * np.array(reference_rates)))

    m.limited = limited or changed
    m.count = prediction.remember(m.sent, m.count, now_ns, collective, sent_input)

    v, v_rate = backstepping.lyapunov(m.e1, m.e2, p.c1, p.c2)
    out[0:3] = m.e1
    out[3:6] = m.e2
    out[6:9] = v
    out[9:12] = v_rate
    out[12:15] = acceleration
    out[15:19] = command
    out[19:22] = rates_command
    out[22:25] = torque
    out[25] = collective / p.full_n
    out[26:29] = m.at
    out[29:32] = m.disturbance
    out[32] = m.scale
    out[33] = m.drag_scale
    return limited
