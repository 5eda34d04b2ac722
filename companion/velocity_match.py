"""The velocity that goes with the position as it moves.

An estimator that corrects its position by satellites may say for seconds a velocity that is not the rate of that
position: PX4's differ by 0.25 m/s (RMS, in its own simulation), ArduPilot's by 0.03. A controller that believes both
stands beside its reference by that difference times the damping over the stiffness. So the difference is learned from
the positions, slowly enough that noise of the positions makes no speed, and added to the velocity.

It is a complementary filter: the position's rate below 1 / `settling` (s), the velocity above. Where both agree, as in
a simulation without noise, it changes next to nothing.
"""

import math

import numpy as np

from companion.reports import PositionReport
from protocol.arrays import Array
from protocol.boot_time import later_ms
from protocol.jit import compiled

_GAP_S = 0.2
"""Over a longer gap the mean of two velocities says too little of the way between."""
_STEP_M = 0.1
"""A position that moved so far beside its velocity was set, and says nothing of a speed."""
_MOST = 1.0
"""m/s."""
_LEFT_M = 0.3
"""m from where it stood: there a vehicle flies. Held by the ground, its velocity may be anything."""


class VelocityMatch:
    """Learns what the velocity lacks."""

    def __init__(self, settling: float) -> None:
        """`settling` in s; 0: nothing is learned."""
        self._settling = settling
        self._before: PositionReport | None = None
        self._lack = np.zeros(3)
        self._flies = False
        self._stood_ned: Array | None = None
        """(3,) m: the first place after `begin`."""

    def begin(self, *, stands: bool) -> None:
        """A flight begins: learn from now on, or, of a vehicle that `stands`, once it has left."""
        self._lack, self._flies, self._stood_ned = np.zeros(3), not stands, None

    def clock_set(self) -> None:
        """The vehicle's clock was set: its stamps say nothing of the time from the last report to the next."""
        self._before = None

    def velocity(self, report: PositionReport) -> Array:
        """(3,) m/s, NED: that of the report and what it lacks."""
        if not self._settling:
            return report.velocity_ned
        before, self._before = self._before, report
        if not self._flies:
            self._stood_ned = report.position_ned if self._stood_ned is None else self._stood_ned
            self._flies = math.dist(self._stood_ned.tolist(), report.position_ned.tolist()) > _LEFT_M
        elif before is not None:
            seconds = later_ms(report.boot_time_ms, before.boot_time_ms) * 1e-3
            if 0.0 < seconds < _GAP_S:
                self._lack = _learned(
                    self._lack,
                    before.position_ned,
                    before.velocity_ned,
                    report.position_ned,
                    report.velocity_ned,
                    (seconds, self._settling),
                )
        velocity: Array = report.velocity_ned + self._lack
        return velocity


@compiled
def _learned(
    lack: Array, place: Array, velocity: Array, place_now: Array, velocity_now: Array, times: tuple[float, float]
) -> Array:
    """(3,) m/s: the lack, after the vehicle went on from one place (3,) (m) to another. `times`: it took, and a lack
    settles, in s."""
    seconds, settling = times
    aside = np.empty(3)
    for axis in range(3):
        aside[axis] = place_now[axis] - place[axis] - 0.5 * (velocity[axis] + velocity_now[axis]) * seconds
    if np.abs(aside).max() > _STEP_M:
        return lack
    share = seconds / (settling + seconds)
    for axis in range(3):
        aside[axis] = min(max(lack[axis] + share * (aside[axis] / seconds - lack[axis]), -_MOST), _MOST)
    return aside
