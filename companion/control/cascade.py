"""The laws of this folder one after the other, as one compiled step."""

import math

import numpy as np
from numpy.typing import NDArray

from companion.config import Settings
from companion.control import backstepping, flatness, lqr, thrust
from protocol.body import Body
from protocol.compiled import compiled
from protocol.frames import Array

PARAMETERS = np.dtype(
    [
        ("c1", "f8", 3),
        ("c2", "f8", 3),
        ("drag_kg_s", "f8", 3),
        ("K", "f8", (3, 6)),
        ("rate_gain", "f8", 3),
        ("rate_limit", "f8", 3),
        ("torque_scale", "f8", 3),
        ("lowest_n", "f8"),
        ("highest_n", "f8"),
        ("full_n", "f8"),
        ("tilt", "f8"),
    ],
    align=True,
)
"""What the laws need of settings and body; `torque_scale`: fractions of full torque for one unit of U2, U3, U4."""

FIELDS = (
    ("e1", 3),
    ("e2", 3),
    ("lyapunov", 3),
    ("lyapunov_rate", 3),
    ("acceleration_command_ned", 3),
    ("attitude_command_ned_frd", 4),
    ("rates_command_frd", 3),
    ("torque_command", 3),
    ("thrust_command", 1),
)
"""What `step` returns, in this order. `lyapunov` is V (19) of each axis and `lyapunov_rate` the V' (22) that the law
promises; torque and thrust are fractions of the whole."""

SIZE = sum(size for _, size in FIELDS)
ATTITUDE, RATES, TORQUE, THRUST = slice(15, 19), slice(19, 22), slice(22, 25), 25


def parameters(settings: Settings, body: Body) -> NDArray[np.void]:
    """One record of PARAMETERS; the LQR's gain is computed here."""
    attitude, limits = settings.control.attitude, settings.limits
    K = lqr.attitude_gain(body, attitude.angle_weight, attitude.rate_weight, attitude.input_weight)
    tilt_rate, yaw_rate = math.radians(limits.roll_pitch_rate_deg), math.radians(limits.yaw_rate_deg)
    record = np.zeros(1, PARAMETERS)
    record["c1"] = settings.control.position.c1
    record["c2"] = settings.control.position.c2
    record["drag_kg_s"] = body.drag_kg_s if settings.control.position.drag_compensation else (0.0, 0.0, 0.0)
    record["K"] = K
    record["rate_gain"] = lqr.rate_gain(K)
    record["rate_limit"] = (tilt_rate, tilt_rate, yaw_rate)
    record["torque_scale"] = lqr.to_torque(body) / np.array(body.full_torque_nm)
    record["lowest_n"] = limits.lowest_thrust * body.max_thrust_n
    record["highest_n"] = limits.highest_thrust * body.max_thrust_n
    record["full_n"] = body.max_thrust_n
    record["tilt"] = limits.tilt
    return record


@compiled
def step(
    position: Array,
    velocity: Array,
    attitude: Array,
    rates: Array,
    reference_position: Array,
    reference_velocity: Array,
    reference_acceleration: Array,
    yaw: float,
    yaw_rate: float,
    mass: float,
    parameters: NDArray[np.void],
) -> tuple[Array, bool]:
    """FIELDS (26,) and whether a limit on thrust or tilt bit. World vectors NED, body vectors FRD, `mass` in kg."""
    p = parameters[0]
    acceleration, e1, e2 = backstepping.acceleration_command(
        position, velocity, reference_position, reference_velocity, reference_acceleration, p.c1, p.c2
    )
    v, v_rate = backstepping.lyapunov(e1, e2, p.c1, p.c2)
    against_drag = thrust.drag_compensation(velocity, attitude, p.drag_kg_s, mass)
    thrust_ned, limited = thrust.thrust_vector(acceleration + against_drag, mass, p.lowest_n, p.highest_n, p.tilt)
    command = flatness.attitude_command(thrust_ned, yaw)
    error = lqr.attitude_error(attitude, command)
    reference_rates = np.array([0.0, 0.0, yaw_rate])
    out = np.empty(26)
    out[0:3] = e1
    out[3:6] = e2
    out[6:9] = v
    out[9:12] = v_rate
    out[12:15] = acceleration
    out[15:19] = command
    out[19:22] = lqr.rates_command(error, reference_rates, p.rate_gain, p.rate_limit)
    torque = lqr.inputs(error, reference_rates - rates, p.K) * p.torque_scale
    out[22:25] = np.minimum(np.maximum(torque, -1.0), 1.0)
    out[25] = thrust.collective(thrust_ned, attitude, p.highest_n) / p.full_n
    return out, limited
