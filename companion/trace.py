"""The companion's trace: what it thought at each control step, one fixed record in the log."""

import struct

from companion.avoidance.guard import Reason, Verdict
from companion.control import cascade
from companion.mission import Phase
from companion.state import AvoidanceDecision, Reference, VehicleState
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
    ("target_ned", 3),
    *cascade.FIELDS,
    ("reference_yaw", 1),
    ("reference_yaw_rate", 1),
    ("position_age", 1),
    ("speed_limit", 1),
    ("clearance", 1),
    ("free_distance", 1),
    ("guard_change", 1),
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
        ("guard_reason", "uint8"),
        *((name, "float64" if size == 1 else f"float64[{size}]") for name, size in _VECTORS),
    ],
)
"""`lyapunov` and the commands: see `control.cascade`; `limited`: a limit on thrust or tilt bit;
`guard_reason`: `avoidance.guard.Reason`, and `guard_change` (m/s2) what the guard made of the acceleration;
`free_distance` (m): of the way seen free, inf if all of it is or none is flown over the map."""

_HEAD = struct.Struct("<BBH??B")
_TAIL = struct.Struct("<7d")


def pack(
    state: State,
    phase: Phase,
    step: int,
    vehicle: VehicleState,
    reference: Reference,
    control: Array,
    limited: bool,
    decision: AvoidanceDecision,
    free: float,
    verdict: Verdict | None,
) -> bytes:
    """The payload of one TRACE record; `control` is what `Cascade.obey` returned, `free` the way (m) seen free, and
    `verdict` the guard's, None where it was not asked."""
    reason, change = (Reason.NONE, 0.0) if verdict is None else (verdict.reason, verdict.changed)
    return b"".join(
        (
            _HEAD.pack(state.value, phase.value, step, decision.blocked, limited, reason),
            vehicle.position_ned.tobytes(),
            vehicle.velocity_ned.tobytes(),
            vehicle.attitude_ned_frd.tobytes(),
            vehicle.rates_frd.tobytes(),
            reference.position_ned.tobytes(),
            reference.velocity_ned.tobytes(),
            reference.acceleration_ned.tobytes(),
            decision.target_ned.tobytes(),
            control.tobytes(),
            _TAIL.pack(
                reference.yaw,
                reference.yaw_rate,
                vehicle.position_age_ns * 1e-9,
                decision.speed_limit,
                decision.clearance,
                free,
                change,
            ),
        )
    )
