"""The companion's trace: what it thought at each control step, and what of it goes into the log.

A replay makes the trace of every step again, to the bit; the log keeps as much of it as is worth looking at.
"""

import math
import struct

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
_TAIL = struct.Struct("<7d")
_WORST_OF_TAIL = 5
"""Its last so many values."""
_STEP = TRACE.dtype
_OWN = sum(size for _, size in WORST)


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
    """The payload of one TRACE record; `control` is what the controller returned, `free` the way (m) seen free, and
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


class Thinning:
    """Chooses the records of the log: `rate` (Hz) of them, and the steps before and after a change of state, phase or
    step of the mission, so that no stretch is longer or shorter than it was."""

    def __init__(self, rate: float) -> None:
        self._period_ns = round(1e9 / rate)
        self._due_ns = 0
        self._state = b""
        self._steps: list[bytes] = []
        """Those since the last record."""
        self._time_ns = 0
        """Of the last of them."""

    def step(self, time_ns: int, trace: bytes) -> list[tuple[int, bytes]]:
        """Take a TRACE record in; the LOGGED ones that are due, with their times."""
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
        """What came since the last record, as one more; none if nothing did."""
        if not self._steps:
            return []
        record = _logged(self._steps)
        self._steps.clear()
        return [(self._time_ns, record)]


def _logged(steps: list[bytes]) -> bytes:
    last = steps[-1]
    floats = np.frombuffer(last, "<f8", offset=_HEAD.size).astype("<f4")
    own = np.zeros(_OWN, "<f4")
    blocked, limited, reason = _worst(np.frombuffer(b"".join(steps), _STEP), floats[-_WORST_OF_TAIL:], own)
    flags = struct.pack("<??B", blocked, limited, reason)
    return b"".join((last[:_STATE_BYTES], flags, floats.tobytes(), own.tobytes()))


@compiled
def _worst(steps: NDArray[np.void], tail: Floats, own: Floats) -> tuple[bool, bool, int]:
    """Fill in `tail`, whose values are those of the last step, and `own`, _WORST's, with the worst of the steps."""
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
    own[0], own[1], own[2], own[3], own[4] = math.sqrt(error), roll, pitch, yaw, thrust
    return blocked, limited, reason
