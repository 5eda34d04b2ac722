"""The types of the log's records that are the companion's own. Without numba, so that whoever reads a log does not load
the autopilot."""

from enum import IntEnum

from protocol.flightlog import record_type

CONTROL_FIELDS = (
    ("e1", 3),
    ("e2", 3),
    ("lyapunov", 3),
    ("lyapunov_rate", 3),
    ("acceleration_command_ned", 3),
    ("attitude_command_ned_frd", 4),
    ("rates_command_frd", 3),
    ("torque_command", 3),
    ("thrust_command", 1),
    ("predicted_position_ned", 3),
    ("disturbance_ned", 3),
    ("thrust_scale", 1),
    ("drag_scale", 1),
)
"""What the controller returns, in this order. `lyapunov` is V (19) of each axis and `lyapunov_rate` the V' (22) that
the law promises, both of backstepping, whichever law flies; torque and thrust are fractions of the whole."""

_FLAGS = (
    ("state", "uint8"),
    ("phase", "uint8"),
    ("step", "uint16"),
    ("blocked", "bool"),
    ("limited", "bool"),
    ("guard_reason", "uint8"),
)
_VECTORS = (
    ("position_ned", 3),
    ("velocity_ned", 3),
    ("attitude_ned_frd", 4),
    ("rates_frd", 3),
    ("reference_position_ned", 3),
    ("reference_velocity_ned", 3),
    ("reference_acceleration_ned", 3),
    ("target_ned", 3),
    *CONTROL_FIELDS,
    ("reference_yaw", 1),
    ("reference_yaw_rate", 1),
    ("position_age", 1),
    ("speed_limit", 1),
    ("clearance", 1),
    ("free_distance", 1),
    ("guard_change", 1),
)
WORST = (("worst_error", 1), ("worst_torque", 3), ("worst_thrust", 1))


def _vectors(kind: str, vectors: tuple[tuple[str, int], ...]) -> list[tuple[str, str]]:
    return [(name, kind if size == 1 else f"{kind}[{size}]") for name, size in vectors]


TRACE = record_type("/companion/trace", "courier/Trace", [*_FLAGS, *_vectors("float64", _VECTORS)])
"""The trace of a control step. `lyapunov` and the commands: see `CONTROL_FIELDS`; `limited`: a limit on thrust or tilt
bit; `guard_reason`: `avoidance.guard.Reason`, and `guard_change` (m/s2) what the guard made of the acceleration;
`free_distance` (m): of the way seen free, inf if all of it is or none is flown over the map."""

LOGGED = record_type("/companion/trace", "courier/LoggedTrace", [*_FLAGS, *_vectors("float32", (*_VECTORS, *WORST))])
"""The trace of a control step and those since the record before it: `blocked` and `limited` at any of them, the
greatest `guard_reason`, `guard_change` and `position_age`, the least `speed_limit`, `clearance` and `free_distance`;
the greatest distance from the reference (`worst_error`, m), and torque and thrust where they were greatest in size.
All else is the step's own."""

PLANNED_CORNERS = 16
PLANNED = record_type(
    "/companion/planned",
    "courier/Planned",
    [
        ("number", "uint32"),
        ("asked_ns", "int64"),
        ("corners", "uint8"),
        ("way_ned", f"float32[{2 * PLANNED_CORNERS}]"),
        ("speeds", f"float32[{PLANNED_CORNERS}]"),
    ],
    {"way_ned": "m north, m east of each corner", "speeds": "m/s at each"},
)
"""An answer's arrival, an event; for people to look at, the first corners of its way."""
ASKED = record_type(
    "/companion/asked",
    "courier/Asked",
    [
        ("number", "uint32"),
        ("asked_ns", "int64"),
        ("ring_ns", "int64"),
        ("ring_boot_us", "uint64"),
        ("position_ned", "float64[3]"),
        ("attitude_ned_frd", "float64[4]"),
        ("ground_down", "float64"),
        ("here_ned", "float64[3]"),
        ("velocity_ned", "float64[3]"),
        ("goal_ned", "float64[3]"),
        ("speed", "float64"),
        ("margin", "float64"),
    ],
    {
        "ring_ns": "when it arrived; ring_boot_us: when it was measured, on the vehicle's clock",
        "position_ned": "of the ring, with attitude_ned_frd; here_ned: of the vehicle now",
        "goal_ned": "NaN: no way is asked for",
        "margin": "m by which obstacles are taken for larger",
    },
)
"""A question, with what a replay need not wait for to answer it; no event, it follows from those before."""
TICK = record_type("/companion/ticks", "courier/Tick", [("late_ns", "int64")])


class OperationKind(IntEnum):
    """The numbers go into the log."""

    LAND_REQUEST = 0
    LOG_FAULT = 1
    LOG_RECOVERED = 2
    PLANNER_FAULT = 3
    ORDER = 4
    PLANNER_STARTING = 5
    PLANNER_READY = 6


OPERATION = record_type(
    "/companion/operations",
    "courier/Operation",
    [("kind", "uint8"), ("text", "string")],
    {
        "kind": ", ".join(f"{kind} {kind.name.lower().replace('_', ' ')}" for kind in OperationKind),
        "text": "of a fault: what is wrong; of an order: what to fly, as JSON",
    },
)
"""An event that is neither a tick nor a datagram nor a plan: what the operator asks for, and faults around the
autopilot."""
LEGACY_REQUEST = record_type("/companion/requests", "courier/Request", [("what", "string")])
"""The same in logs of version 0.1: "land", "log recovered", or what is wrong behind "log fault: " or
"planner fault: "."""
LOOP = record_type("/companion/loop", "courier/Loop", [("worst_ns", "uint32"), ("latency_ns", "uint32[]")])
"""Wall time from the receipt of a datagram with a new attitude to the command's departure, for those of a tenth of a
second: how the machine did, not an event."""
AUDIT = record_type(
    "/companion/audit",
    "courier/Audit",
    [
        ("parameter", "string"),
        ("value", "float64"),
        ("wanted", "string"),
        ("why", "string"),
        ("safety", "uint8"),
    ],
    {
        "value": "NaN: the vehicle does not have it, or does not say it",
        "safety": "0 safe, 1 unsafe, 2 refused",
    },
)
"""A parameter of the vehicle as it was read before the flight, and how it was judged. No event: the vehicle's answers
are in its datagrams."""
RECORD_TYPES = (LOGGED, TICK, OPERATION, ASKED, PLANNED, LOOP, AUDIT)
"""All that a flight writes."""
