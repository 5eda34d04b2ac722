"""The trace: state, reference and commands of each control step, and the choice of what goes into the log.

A replay computes the trace of every step again, bit for bit, so the log holds a thinned selection of it.
"""

import math
import struct

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.avoidance.guard import Verdict
from companion.mission.plan import Phase
from companion.records import TRACE, WORST
from companion.state import AvoidanceDecision, Reason, Reference, VehicleState
from companion.supervision.states import State
from protocol.arrays import Array
from protocol.jit import compiled

Floats = NDArray[np.float32]

_HEAD = struct.Struct("<BBH??B")
_STATE_BYTES = 4
"""State, phase and step: the first bytes of a record."""
_TAIL = struct.Struct("<7d")
_WORST_IN_TAIL = 5
"""How many values at the tail's end are logged with the worst of several steps."""
_STEP = TRACE.dtype
_WORST_SIZE = sum(size for _, size in WORST)


class ControlStep(msgspec.Struct, frozen=True, gc=False):
    """What one control step started from and led to."""

    state: State
    phase: Phase
    step: int
    """Index of the mission's step."""
    vehicle: VehicleState
    reference: Reference
    control: Array
    """(controller.SIZE,) CONTROL_FIELDS, from `Controller.attitude_command`."""
    limited: bool
    """A limit on thrust or tilt was reached."""
    decision: AvoidanceDecision
    free_distance: float
    """m of the way seen free; inf if no way over the map is flown."""
    verdict: Verdict | None
    """The guard's; None where it was not asked."""


def pack(step: ControlStep) -> bytes:
    """The payload of one TRACE record."""
    vehicle, decision, verdict = step.vehicle, step.decision, step.verdict
    reason, change = (Reason.NONE, 0.0) if verdict is None else (verdict.reason, verdict.changed)
    rows = step.reference.rows
    return b"".join(
        (
            _HEAD.pack(step.state, step.phase, step.step, decision.blocked, step.limited, reason),
            vehicle.position_ned.tobytes(),
            vehicle.velocity_ned.tobytes(),
            vehicle.attitude_ned_frd.tobytes(),
            vehicle.rates_frd.tobytes(),
            rows[:3].tobytes(),
            decision.target_ned.tobytes(),
            step.control.tobytes(),
            _TAIL.pack(
                *rows[5, :2].tolist(),
                vehicle.position_age_ns * 1e-9,
                decision.speed_limit,
                decision.clearance,
                step.free_distance,
                change,
            ),
        )
    )


class Thinning:
    """Chooses the records of the log: `rate` (Hz) of them, and the control steps before and after a change of state,
    phase or step of the mission, so that each phase has its true length in the log."""

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0
        self._state = b""
        self._steps: list[bytes] = []
        """TRACE records since the last LOGGED one."""
        self._time_ns = 0
        """Time of the last of them."""

    def step(self, time_ns: int, trace: bytes) -> list[tuple[int, bytes]]:
        """Take a TRACE record in; return the LOGGED records that are due, with their times."""
        records = []
        if trace[:_STATE_BYTES] != self._state:
            records = self.rest()
            self._state, self._due_ns = trace[:_STATE_BYTES], time_ns
        self._steps.append(trace)
        self._time_ns = time_ns
        if time_ns >= self._due_ns:
            self._due_ns += self._period_ns
            if self._due_ns <= time_ns:
                self._due_ns = time_ns + self._period_ns
            records += self.rest()
        return records

    def rest(self) -> list[tuple[int, bytes]]:
        """The LOGGED record of the steps since the last one; none if there were no steps."""
        if not self._steps:
            return []
        record = _logged(self._steps)
        self._steps.clear()
        return [(self._time_ns, record)]


def _logged(steps: list[bytes]) -> bytes:
    """The LOGGED record of some TRACE records: the last of them, with the worst of all."""
    last = steps[-1]
    floats = np.frombuffer(last, "<f8", offset=_HEAD.size).astype("<f4")
    worst = np.zeros(_WORST_SIZE, "<f4")
    blocked, limited, reason = _worst(np.frombuffer(b"".join(steps), _STEP), floats[-_WORST_IN_TAIL:], worst)
    flags = struct.pack("<??B", blocked, limited, reason)
    return b"".join((last[:_STATE_BYTES], flags, floats.tobytes(), worst.tobytes()))


@compiled
def _worst(steps: NDArray[np.void], tail: Floats, worst: Floats) -> tuple[bool, bool, int]:
    """Write the worst of the steps (n,) of TRACE into `tail` (_WORST_IN_TAIL,), which holds the last step's values, and
    into `worst` (_WORST_SIZE,), the fields WORST. Returns `blocked`, `limited` and `guard_reason`."""
    blocked, limited, reason, error = False, False, 0, 0.0
    age, speed, clearance, free, change = 0.0, math.inf, math.inf, math.inf, 0.0
    roll, pitch, yaw, thrust = 0.0, 0.0, 0.0, 0.0
    for k in range(steps.shape[0]):
        step = steps[k]
        blocked, limited = blocked or step.blocked, limited or step.limited
        reason = max(reason, step.guard_reason)
        place, wanted, torque = step.position_ned, step.reference_position_ned, step.torque_command
        square = 0.0
        for axis in range(3):
            square += (wanted[axis] - place[axis]) ** 2
        error = max(error, square)
        roll = torque[0] if abs(torque[0]) > abs(roll) else roll
        pitch = torque[1] if abs(torque[1]) > abs(pitch) else pitch
        yaw = torque[2] if abs(torque[2]) > abs(yaw) else yaw
        thrust = step.thrust_command if abs(step.thrust_command) > abs(thrust) else thrust
        age, change = max(age, step.position_age), max(change, step.guard_change)
        speed, free = min(speed, step.speed_limit), min(free, step.free_distance)
        clearance = min(clearance, step.clearance)
    tail[0], tail[1], tail[2], tail[3], tail[4] = age, speed, clearance, free, change
    worst[0], worst[1], worst[2], worst[3], worst[4] = math.sqrt(error), roll, pitch, yaw, thrust
    return blocked, limited, reason
