"""Whether the vehicle's estimate of its position or attitude jumped."""

import numpy as np

from companion.view.accumulators.continuation import Continuation
from companion.view.accumulators.exceedances import Exceedances
from companion.view.batches import Table
from companion.view.columns import stacked
from companion.view.lines import Floats

_NOISE_M, _ACCELERATION_M_S2 = 0.3, 10.0
_NOISE_RAD, _ACCELERATION_RAD_S2 = 0.1, 20.0


class EstimatorJumps:
    """Steps of position (m) and attitude (rad) that velocity and body rates do not explain, by sender.

    A step may differ from the mean of the two velocities times the interval by some noise and by what an acceleration
    between the two messages could make.
    """

    def __init__(self) -> None:
        self.position: dict[str, Exceedances] = {}
        self.attitude: dict[str, Exceedances] = {}
        self._continued: dict[str, Continuation] = {}

    def add_message(self, sender: str, name: str, times: Floats, table: Table) -> None:
        """Messages of one name: times (n,) in s and fields (n,); names without a pose are ignored."""
        if name == "LOCAL_POSITION_NED":
            self._add_positions(sender, times, self._joined(f"{sender}/{name}", table))
        elif name == "ATTITUDE_QUATERNION":
            self._add_attitudes(sender, times, self._joined(f"{sender}/{name}", table))

    def _joined(self, key: str, table: Table) -> Table:
        return self._continued.setdefault(key, Continuation()).join(table)

    def _add_positions(self, sender: str, times: Floats, joined: Table) -> None:
        seconds = np.diff(joined["time_boot_ms"].astype(np.float64)) * 1e-3
        positions, velocities = stacked(joined, "x", "y", "z"), stacked(joined, "vx", "vy", "vz")
        unexplained = np.diff(positions, axis=0) - 0.5 * (velocities[1:] + velocities[:-1]) * seconds[:, None]
        jumps = self.position.setdefault(sender, Exceedances())
        jumps.add(
            times[len(times) - len(unexplained) :],
            np.linalg.norm(unexplained, axis=1),
            _NOISE_M + _ACCELERATION_M_S2 * seconds**2,
        )

    def _add_attitudes(self, sender: str, times: Floats, joined: Table) -> None:
        seconds = np.diff(joined["time_boot_ms"].astype(np.float64)) * 1e-3
        q = stacked(joined, "q1", "q2", "q3", "q4")
        angle = 2.0 * np.arccos(np.abs((q[1:] * q[:-1]).sum(axis=1)).clip(max=1.0))
        rates = stacked(joined, "rollspeed", "pitchspeed", "yawspeed")
        explained = 0.5 * (np.linalg.norm(rates[1:], axis=1) + np.linalg.norm(rates[:-1], axis=1)) * seconds
        jumps = self.attitude.setdefault(sender, Exceedances())
        jumps.add(
            times[len(times) - len(angle) :],
            np.abs(angle - explained),
            _NOISE_RAD + _ACCELERATION_RAD_S2 * seconds**2,
        )
