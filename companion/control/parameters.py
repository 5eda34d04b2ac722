"""What the compiled controller needs of the settings and of the vehicle, as one record."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.config import STEEPEST_DEG, Control, Estimation, Limits, Settings
from companion.control import disturbance_observer, laws, lqr, torque_observer
from companion.control.laws import FOREIGN, GAINS, LAWS
from companion.control.margin import Design
from companion.control.tracking_error import TrackingError
from companion.outputs import OUTPUTS, TurningInput
from companion.state import Output
from protocol.arrays import Array
from protocol.vehicle_parameters import VehicleParameters

PARAMETERS = np.dtype(
    [
        ("law", "i8"),
        ("gains", "f8", (GAINS, 3)),
        ("adaptive", "b1"),
        ("lee_attitude_error", "b1"),
        ("c1", "f8", 3),
        ("c2", "f8", 3),
        ("gamma", "f8", 3),
        ("unit", "f8", 3),
        ("adaptation_bound", "f8"),
        ("feed_velocity", "f8"),
        ("feed_acceleration", "f8"),
        ("feed_attitude", "b1"),
        ("compensated_drag_kg_s", "f8", 3),
        ("drag_kg_s", "f8", 3),
        ("observes", "b1"),
        ("velocity_noise", "f8"),
        ("torque_bandwidth", "f8"),
        ("offset_bound", "f8", 3),
        ("velocity_variance", "f8", 3),
        ("velocity_correlation", "f8"),
        ("initial_deviation", "f8", disturbance_observer.STATES),
        ("walk", "f8", disturbance_observer.STATES),
        ("fading", "f8"),
        ("climb", "f8"),
        ("predicts", "b1"),
        ("half_period_ns", "i8"),
        ("command_delay_ns", "i8"),
        ("pace", "f8"),
        ("turning_input", "i8"),
        ("rotor_lag", "f8"),
        ("rate_loop", "f8", 3),
        ("assumed_rate_loop", "f8", 3),
        ("assumed_attitude_loop", "f8"),
        ("attitude_lead", "f8"),
        ("torque_gain", "f8", (3, 3)),
        ("rates_gain", "f8", (3, 3)),
        ("rate_limit", "f8", 3),
        ("torque_scale", "f8", 3),
        ("full_torque", "f8", 3),
        ("inertia", "f8", 3),
        ("min_thrust_n", "f8"),
        ("max_thrust_n", "f8"),
        ("full_thrust_n", "f8"),
        ("max_tilt", "f8"),
        ("tilt_braking", "f8"),
        ("angle_boost", "b1"),
    ],
    align=True,
)
"""SI units. Of the fields that do not speak for themselves: `gains` are the law's (`laws.Law`); `c1`, `c2` those of the
Lyapunov function, whichever law flies; `unit` is 1, 1, 1; `half_period_ns` and `command_delay_ns` are together the time
from a command to its effect, half of the time that it is held included; `pace` is that of `margin`; `fading` (1/s) that
of a vertical disturbance; `angle_boost` is the vehicle's (`thrust.on_the_wire`), set once it is known; `attitude_lead`
(s) the lag of the vehicle's attitude loop; the `assumed` gains (1/s) of its loops are its own or, where these are not
known, usual ones; `torque_scale` the fractions of full torque for one unit of U2, U3, U4."""

_SMALL = 1e-3
"""m and m/s: an error that is within any law's linear range."""
_RATE_LOOPS = 20.0, 20.0, 3.0
"""1/s, by axis; of a vehicle whose own rate loops are not known. About the yaw axis PX4's was seen to have 2 to 2.5,
ArduCopter's 2 to 4, both with an integral."""
SLOW_YAW_GAIN = 0.25 * _RATE_LOOPS[2]
"""1/s; the gain from the heading's error to a yaw rate above such a loop, at most: a quarter of the loop's own gain.
With that there is no overshoot."""
_TILT_KEPT = 0.92
"""Share of the tilt's limit that is commanded where the rate loops are not known. PX4's loops, and what its estimator
is wrong by, have tilted a vehicle by 2.6 degrees more."""


def kept_tilt(limits: Limits) -> float:
    """The tilt (rad) that is commanded at most where the rate loops are not known; pi: there is no limit."""
    return limits.tilt if limits.tilt_deg > STEEPEST_DEG else _TILT_KEPT * limits.tilt


def controller_parameters(settings: Settings, body: VehicleParameters, output: Output) -> NDArray[np.void]:
    """(1,) of PARAMETERS; the LQR's gains are computed here."""
    record = np.zeros(1, PARAMETERS)
    parts = (
        _position(settings.control, body),
        _observer(settings.control.estimation, body),
        _timing(settings, body),
        _attitude(settings, body),
        _limits(settings.limits, body),
        {"turning_input": OUTPUTS[output].turning_input},
    )
    for values in parts:
        for name, value in values.items():
            record[name] = value
    return record


def _position(control: Control, body: VehicleParameters) -> dict[str, Any]:
    """The position law, and what is fed forward to it."""
    position, law = control.position, LAWS.get(control.position.law, FOREIGN)
    gains = np.zeros((GAINS, 3))
    rows = law.gains(control)
    gains[: len(rows)] = rows
    return {
        "law": law.number,
        "gains": gains,
        "adaptive": law.adaptive,
        "lee_attitude_error": law.lee_attitude_error,
        "c1": position.c1,
        "c2": position.c2,
        "gamma": position.adaptation,
        "unit": 1.0,
        "adaptation_bound": position.adaptation_bound,
        "feed_velocity": position.feedforward != "none",
        "feed_acceleration": position.feedforward == "acceleration",
        "compensated_drag_kg_s": body.drag_kg_s if position.drag_compensation else (0.0, 0.0, 0.0),
        "drag_kg_s": body.drag_kg_s,
    }


def _observer(estimation: Estimation, body: VehicleParameters) -> dict[str, Any]:
    """The disturbance observer: a state that is not estimated has neither deviation nor walk."""
    deviation, walk = np.zeros(disturbance_observer.STATES), np.zeros(disturbance_observer.STATES)
    deviation[disturbance_observer.VELOCITY] = 1.0
    walk[disturbance_observer.VELOCITY] = estimation.acceleration_noise
    if estimation.disturbance:
        walk[disturbance_observer.DISTURBANCE] = estimation.disturbance_walk
    if estimation.thrust_scale:
        deviation[disturbance_observer.THRUST_SCALE] = 0.3
        walk[disturbance_observer.THRUST_SCALE] = estimation.thrust_scale_walk
    if estimation.drag_scale and max(body.drag_kg_s) > 0.0:
        deviation[disturbance_observer.DRAG_SCALE] = 0.3
        walk[disturbance_observer.DRAG_SCALE] = estimation.drag_scale_walk
    return {
        "observes": estimation.disturbance or estimation.thrust_scale or estimation.drag_scale,
        "torque_bandwidth": estimation.torque_bandwidth,
        "velocity_noise": estimation.velocity_noise,
        "velocity_correlation": estimation.velocity_correlation,
        "initial_deviation": deviation,
        "walk": walk,
        "fading": estimation.disturbance_fading,
        "climb": estimation.climb_uncertainty if estimation.thrust_scale else 0.0,
    }


def _timing(settings: Settings, body: VehicleParameters) -> dict[str, Any]:
    """Delays and lags."""
    predicts, command_delay = settings.control.prediction.enabled, settings.control.prediction.command_delay
    return {
        "predicts": predicts,
        "half_period_ns": round(0.5e9 / settings.rates.attitude) if predicts else 0,
        "command_delay_ns": round(command_delay * 1e9) if predicts else 0,
        "pace": 1.0,
        "rotor_lag": body.rotor_time_constant_s,
        "rate_loop": body.rate_loop_gain_1_s,
        "attitude_lead": 1.0 / body.attitude_loop_gain_1_s if body.attitude_loop_gain_1_s > 0.0 else 0.0,
    }


def _attitude(settings: Settings, body: VehicleParameters) -> dict[str, Any]:
    """The attitude's LQR."""
    torque_gain, rates_gain = _attitude_gains(settings, body)
    return {
        "assumed_rate_loop": [loop or usual for loop, usual in zip(body.rate_loop_gain_1_s, _RATE_LOOPS, strict=True)],
        "assumed_attitude_loop": body.attitude_loop_gain_1_s or rates_gain[1, 0],
        "feed_attitude": settings.control.attitude.feedforward,
        "torque_gain": torque_gain,
        "rates_gain": rates_gain,
        "torque_scale": lqr.to_torque(body) / np.array(body.full_torque_nm),
        "full_torque": body.full_torque_nm,
        "offset_bound": torque_observer.SHARE_OF_FULL * np.array(body.full_torque_nm) / np.array(body.inertia_kgm2),
        "inertia": body.inertia_kgm2,
    }


def _attitude_gains(settings: Settings, body: VehicleParameters) -> tuple[Array, Array]:
    """The gains (3, 3) of torques and of rates; see `lqr.axis_gain` and `lqr.rate_gain`."""
    attitude, lag = settings.control.attitude, body.rotor_time_constant_s
    angle_weight, rate_weight = list(attitude.angle_weight), list(attitude.rate_weight)
    if attitude.bandwidth is not None:
        angle_weight, rate_weight = lqr.weights_for(body, attitude.bandwidth, attitude.damping)
    K = lqr.attitude_gain(body, angle_weight, rate_weight, attitude.input_weight)
    torque_gain, rates_gain = lqr.axis_gain(K), lqr.rate_gain(K)
    if attitude.design == "sampled" and lag > 0.0:
        weights = (angle_weight, rate_weight, attitude.input_weight)
        entries = [float(b) for b in np.array(lqr.to_torque(body)) / np.array(body.inertia_kgm2)]
        period = 1.0 / settings.rates.attitude
        torque_gain = lqr.sampled_gain(None, entries, lag, period, *weights)
        if min(body.rate_loop_gain_1_s) > 0.0:
            rates_gain = lqr.sampled_gain(body.rate_loop_gain_1_s, entries, lag, period, *weights)
    if body.rate_loop_gain_1_s[2] == 0.0:
        rates_gain[2, 0] = min(rates_gain[2, 0], SLOW_YAW_GAIN)
    return torque_gain, rates_gain


def design_of(p: Any, law: Callable[[TrackingError], Array] | None = None) -> Design:
    """The design of a record of PARAMETERS along north, which turns the vehicle about its pitch axis.

    `law`: the acceleration (3,) in m/s2 for an error, of a law of another package.
    """
    small, none = np.array([1.0, 0.0, 0.0]) * _SMALL, np.zeros(3)
    if law is None:
        law = partial(_compiled_law, p)
    moved, moving = (
        float(law(error)[0]) / _SMALL
        for error in (TrackingError(small, none, -p["c1"] * small, none), TrackingError(none, small, -small, none))
    )
    takes_torque = p["turning_input"] == TurningInput.ANGULAR_ACCELERATION
    rate_loop = 0.0 if takes_torque else float(p["assumed_rate_loop"][1])
    attitude, strength = p["rates_gain"][1], rate_loop
    if takes_torque:
        attitude = p["torque_gain"][1]
        strength = float(p["torque_scale"][1] * p["full_torque"][1] / p["inertia"][1])
    angle_loop = 0.0
    if p["turning_input"] == TurningInput.ATTITUDE:
        angle_loop = float(p["assumed_attitude_loop"])
        strength = rate_loop * angle_loop
    return Design(moved, moving, tuple(attitude.tolist()), strength, rate_loop, angle_loop, float(p["rotor_lag"]))


def _compiled_law(p: Any, error: TrackingError) -> Array:
    command: Array = laws.acceleration_command(p["law"], error, np.zeros(3), p["gains"])
    return command


def _limits(limits: Limits, body: VehicleParameters) -> dict[str, Any]:
    """Limits of the commands."""
    tilt_rate, yaw_rate = math.radians(limits.roll_pitch_rate_deg), math.radians(limits.yaw_rate_deg)
    loops_known = min(body.rate_loop_gain_1_s[:2]) > 0.0
    return {
        "rate_limit": (tilt_rate, tilt_rate, yaw_rate),
        "min_thrust_n": limits.lowest_thrust * body.max_thrust_n,
        "max_thrust_n": limits.highest_thrust * body.max_thrust_n,
        "full_thrust_n": body.max_thrust_n,
        "max_tilt": limits.tilt if loops_known else kept_tilt(limits),
        "tilt_braking": math.radians(limits.tilt_braking_deg),
    }
