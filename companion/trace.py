"""The companion's trace: what it thought at each control step, one fixed record in the log."""

import numpy as np

from companion.mission import Phase
from companion.state import AvoidanceDecision, Reference, Setpoint, VehicleState
from companion.supervisor import State
from protocol.flightlog import record_type
from protocol.frames import Array

_VECTORS = (
    ("position_ned", 3),
    ("velocity_ned", 3),
    ("attitude_ned_frd", 4),
    ("rates_frd", 3),
    ("reference_position_ned", 3),
    ("reference_velocity_ned", 3),
    ("reference_acceleration_ned", 3),
    ("reference_yaw", 1),
    ("reference_yaw_rate", 1),
    ("e1", 3),
    ("e2", 3),
    ("lyapunov", 3),
    ("lyapunov_rate", 3),
    ("acceleration_command_ned", 3),
    ("attitude_command_ned_frd", 4),
    ("rates_command_frd", 3),
    ("torque_command", 3),
    ("thrust_command", 1),
    ("position_age", 1),
    ("target_ned", 3),
    ("speed_limit", 1),
    ("clearance", 1),
)

TRACE = record_type(
    "/companion/trace",
    "courier/Trace",
    [
        ("state", "uint8"),
        ("phase", "uint8"),
        ("step", "uint16"),
        ("blocked", "bool"),
        ("limited", "bool"),
        *((name, "float64" if size == 1 else f"float64[{size}]") for name, size in _VECTORS),
    ],
)
"""`lyapunov` is V (19) of each axis and `lyapunov_rate` the V' (22) that the law promises; `limited`: a limit on
thrust or tilt bit."""


def pack(
    state: State,
    phase: Phase,
    step: int,
    limited: bool,
    vehicle: VehicleState,
    reference: Reference,
    errors: tuple[Array, Array],
    lyapunov: tuple[Array, Array],
    acceleration_ned: Array,
    setpoint: Setpoint,
    decision: AvoidanceDecision,
) -> bytes:
    """The payload of one TRACE record."""
    values = np.concatenate(
        (
            vehicle.position_ned,
            vehicle.velocity_ned,
            vehicle.attitude_ned_frd,
            vehicle.rates_frd,
            reference.position_ned,
            reference.velocity_ned,
            reference.acceleration_ned,
            (reference.yaw, reference.yaw_rate),
            *errors,
            *lyapunov,
            acceleration_ned,
            setpoint.attitude_ned_frd,
            setpoint.rates_frd,
            setpoint.torque,
            (setpoint.thrust, vehicle.position_age_ns * 1e-9),
            decision.target_ned,
            (decision.speed_limit, decision.clearance),
        )
    )
    head = bytes((state.value, phase.value, step & 0xFF, step >> 8, decision.blocked, limited))
    return head + values.tobytes()
