"""The companion's trace: what it thought at each control step, and what of it goes into the log.

A replay makes the trace of every step again, to the bit; the log keeps as much of it as is worth looking at.
"""

import math
import struct

import numpy as np

from companion.avoidance.guard import Reason, Verdict
from companion.control import cascade
from companion.mission import Phase
from companion.state import AvoidanceDecision, Reference, VehicleState
from companion.supervisor import State
from protocol.flightlog import record_type
from protocol.frames import Array

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
    *cascade.FIELDS,
    ("reference_yaw", 1),
    ("reference_yaw_rate", 1),
    ("position_age", 1),
    ("speed_limit", 1),
    ("clearance", 1),
    ("free_distance", 1),
    ("guard_change", 1),
)
_WORST = (("worst_error", 1), ("worst_torque", 3), ("worst_thrust", 1))


def _vectors(kind: str, vectors: tuple[tuple[str, int], ...]) -> list[tuple[str, str]]:
    return [(name, kind if size == 1 else f"{kind}[{size}]") for name, size in vectors]


TRACE = record_type("/companion/trace", "courier/Trace", [*_FLAGS, *_vectors("float64", _VECTORS)])
"""Of a control step. `lyapunov` and the commands: see `control.cascade`; `limited`: a limit on thrust or tilt bit;
`guard_reason`: `avoidance.guard.Reason`, and `guard_change` (m/s2) what the guard made of the acceleration;
`free_distance` (m): of the way seen free, inf if all of it is or none is flown over the map."""

LOGGED = record_type("/companion/trace", "courier/LoggedTrace", [*_FLAGS, *_vectors("float32", (*_VECTORS, *_WORST))])
"""Of a control step and those since the record before it: `blocked` and `limited` at any of them, the greatest
`guard_reason`, `guard_change` and `position_age`, the least `speed_limit`, `clearance` and `free_distance`; the
greatest distance from the reference (`worst_error`, m), and torque and thrust where they were greatest in size. All
else is the step's own."""

_HEAD = struct.Struct("<BBH??B")
_STATE_BYTES = 4
_TAIL = struct.Struct("<7d")
_WORST_OF_TAIL = 5
"""Its last so many values."""


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
            _HEAD.pack(state, phase, step, decision.blocked, limited, reason),
            vehicle.position_ned.tobytes(),
            vehicle.velocity_ned.tobytes(),
            vehicle.attitude_ned_frd.tobytes(),
            vehicle.rates_frd.tobytes(),
            reference.rows[:3].tobytes(),
            decision.target_ned.tobytes(),
            control.tobytes(),
            _TAIL.pack(
                *reference.rows[5, :2].tolist(),
                vehicle.position_age_ns * 1e-9,
                decision.speed_limit,
                decision.clearance,
                free,
                change,
            ),
        )
    )


def _layout(*wanted: str) -> struct.Struct:
    """Of a TRACE record: its flags from `blocked` on and these of its vectors, in their order; the rest is skipped."""
    parts = [f"{size}d" if name in wanted else f"{8 * size}x" for name, size in _VECTORS]
    return struct.Struct(f"<{_STATE_BYTES}x??B" + "".join(parts))


_JUDGED = _layout(
    "position_ned",
    "reference_position_ned",
    "torque_command",
    "thrust_command",
    "position_age",
    "speed_limit",
    "clearance",
    "free_distance",
    "guard_change",
)
_Worst = tuple[bool, bool, int, float, float, float, float, float, float, float, float, float, float]
"""The error is squared."""
_NONE: _Worst = (False, False, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, math.inf, math.inf, 0.0)


class Thinning:
    """Chooses the records of the log: `rate` (Hz) of them, and the steps before and after a change of state, phase or
    step of the mission, so that no stretch is longer or shorter than it was."""

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0
        self._state = b""
        self._last: tuple[int, bytes] | None = None
        self._worst = _NONE

    def step(self, time_ns: int, trace: bytes) -> list[tuple[int, bytes]]:
        """Take a TRACE record in; the LOGGED ones that are due, with their times."""
        records = []
        if trace[:_STATE_BYTES] != self._state:
            records = self.rest()
            self._state, self._due_ns = trace[:_STATE_BYTES], time_ns
        self._worst = _worse(self._worst, trace)
        self._last = time_ns, trace
        if time_ns >= self._due_ns:
            self._due_ns += self._period_ns
            if self._due_ns <= time_ns:
                self._due_ns = time_ns + self._period_ns
            records += self.rest()
        return records

    def rest(self) -> list[tuple[int, bytes]]:
        """What came since the last record, as one more; none if nothing did."""
        if self._last is None:
            return []
        (time_ns, trace), self._last = self._last, None
        worst, self._worst = self._worst, _NONE
        return [(time_ns, _logged(trace, worst))]


def _worse(known: _Worst, trace: bytes) -> _Worst:
    """With one step more. At each step, so nothing is called that an expression can do."""
    blocked, limited, reason, error, roll, pitch, yaw, thrust, age, speed, clearance, free, change = known
    (now_blocked, now_limited, now_reason, north, east, down, to_north, to_east, to_down, *rest) = _JUDGED.unpack(trace)
    now_roll, now_pitch, now_yaw, now_thrust, now_age, now_speed, now_clearance, now_free, now_change = rest
    now_error = (to_north - north) ** 2 + (to_east - east) ** 2 + (to_down - down) ** 2
    return (
        blocked or now_blocked,
        limited or now_limited,
        now_reason if now_reason > reason else reason,
        now_error if now_error > error else error,
        now_roll if abs(now_roll) > abs(roll) else roll,
        now_pitch if abs(now_pitch) > abs(pitch) else pitch,
        now_yaw if abs(now_yaw) > abs(yaw) else yaw,
        now_thrust if abs(now_thrust) > abs(thrust) else thrust,
        now_age if now_age > age else age,
        now_speed if now_speed < speed else speed,
        now_clearance if now_clearance < clearance else clearance,
        now_free if now_free < free else free,
        now_change if now_change > change else change,
    )


def _logged(trace: bytes, worst: _Worst) -> bytes:
    blocked, limited, reason, error, *actuation = worst[:-_WORST_OF_TAIL]
    floats = np.frombuffer(trace, "<f8", offset=_HEAD.size).astype("<f4")
    floats[-_WORST_OF_TAIL:] = worst[-_WORST_OF_TAIL:]
    flags, own = struct.pack("<??B", blocked, limited, reason), struct.pack("<5f", math.sqrt(error), *actuation)
    return b"".join((trace[:_STATE_BYTES], flags, floats.tobytes(), own))
