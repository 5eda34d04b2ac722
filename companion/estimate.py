"""Telemetry -> VehicleState, with the ages of its parts and the poses of the last second."""

from collections import deque

import msgspec
import numpy as np

from companion.reports import AttitudeReport, OdometryReport, PositionReport
from companion.state import UNSAID, Certainty, VehicleState
from companion.velocity_match import VelocityMatch
from protocol.arrays import Array
from protocol.boot_time import later_ms

_POSES_KEPT = 512
_LONGEST_CARRY_S = 0.5
_AHEAD_MS = 5000
_LATE_NS, _LATEST_NS, _LATE_INTERVALS = 100_000_000, 400_000_000, 4.0
"""A position is late after so many usual intervals, within these limits."""
_MOST_RESETS = 3
"""In messages one after another; what counts on says nothing of resets."""
_SHARE = 1 / 16
"""Weight of a new interval in the usual one."""


class Estimator:
    """Joins attitude and position reports. Times of arrival are the companion's, times of measurement the vehicle's."""

    def __init__(self, velocity_settling: float = 0.0) -> None:
        """`velocity_settling`: see `VelocityMatch`."""
        self._velocity_settling = velocity_settling
        self._attitude: AttitudeReport | None = None
        self._position: PositionReport | None = None
        self._velocity_match = VelocityMatch(velocity_settling)
        self._velocity = np.zeros(3)
        """(3,) m/s, NED."""
        self.boot_time_ms = 0
        """The vehicle's clock at its latest attitude."""
        self._attitude_ns = 0
        self._position_ns = 0
        self._interval_ns = 0.0
        """The usual one from a position to the next, as they arrive."""
        self._poses: deque[tuple[int, Array, Array]] = deque(maxlen=_POSES_KEPT)
        self._certainty = UNSAID
        self._reset_counter: int | None = None
        """As the vehicle said it last."""
        self._resets_in_row = 0
        self._was_reset = False
        """And no position has come since."""

    def attitude(self, report: AttitudeReport, time_ns: int) -> bool:
        """Take it in; False (and nothing changes) if it is older than what is known, or the same once more: that is as
        old as it was."""
        if not _is_news(report, self._attitude):
            return False
        self._attitude = report
        self.boot_time_ms = report.boot_time_ms
        self._attitude_ns = time_ns
        return True

    def position(self, report: PositionReport, time_ns: int) -> bool:
        """The same for a position; one from far ahead of the attitude is no position either."""
        if not _is_news(report, self._position):
            return False
        if self._attitude is not None and later_ms(report.boot_time_ms, self._attitude.boot_time_ms) > _AHEAD_MS:
            return False
        gap_ns = 0 if self._position is None else min(time_ns - self._position_ns, _LATEST_NS)
        self._interval_ns += _SHARE * (gap_ns - self._interval_ns)
        self._position, self._velocity = report, self._velocity_match.velocity(report)
        self._position_ns = time_ns
        if self._was_reset:  # which may be the first after the reset, if the count was sooner
            self._was_reset = False
            self._certainty = msgspec.structs.replace(self._certainty, resets=self._certainty.resets + 1)
        return True

    def begin(self, *, stands: bool) -> None:
        """A flight begins, of a vehicle that `stands` or one that flies already."""
        self._velocity_match.begin(stands=stands)

    def odometry(self, report: OdometryReport) -> bool:
        """Take it in; whether the vehicle's estimate was reset since the last one."""
        counted = self._reset_counter not in (None, report.reset_counter)
        self._reset_counter = report.reset_counter
        self._resets_in_row = self._resets_in_row + 1 if counted else 0
        self._was_reset = 0 < self._resets_in_row <= _MOST_RESETS
        variance = UNSAID.velocity_variance if report.velocity_variance is None else report.velocity_variance
        self._certainty = Certainty(variance, self._certainty.resets + self._was_reset)
        return self._was_reset

    def restart(self) -> None:
        """Forget everything: the vehicle has rebooted, and its clock begins again."""
        self.__init__(self._velocity_settling)  # type: ignore[misc]

    def clock_set(self, by_ms: int) -> None:
        """The vehicle's clock was set; what is known of before is as old as it was."""
        restamped, wraps = msgspec.structs.replace, 0x1_0000_0000
        self.boot_time_ms = (self.boot_time_ms + by_ms) % wraps
        if self._attitude is not None:
            self._attitude = restamped(self._attitude, boot_time_ms=self.boot_time_ms)
        if self._position is not None:
            self._position = restamped(self._position, boot_time_ms=(self._position.boot_time_ms + by_ms) % wraps)
        self._velocity_match.clock_set()
        self._poses = deque(((pose[0] + by_ms, pose[1], pose[2]) for pose in self._poses), _POSES_KEPT)

    def age_ns(self, now_ns: int) -> int | None:
        """Age (ns) of the older part, by when it came or by its stamp; None before both have come."""
        if self._attitude is None or self._position is None:
            return None
        behind_ms = max(later_ms(self._attitude.boot_time_ms, self._position.boot_time_ms), 0)
        return now_ns - min(self._attitude_ns - behind_ms * 1_000_000, self._position_ns)

    def lacks_position(self, now_ns: int) -> bool:
        """No position has come for so long that the last one is not to be flown by: longer than jitter and a few losses
        explain where they come at their usual interval."""
        age_ns = now_ns - self._position_ns
        if age_ns <= _LATE_NS or self._position is None:
            return False
        return age_ns > min(_LATE_INTERVALS * self._interval_ns, _LATEST_NS)

    def state(self) -> VehicleState | None:
        """The state at the latest attitude, the position carried there by its velocity; None before both have come."""
        attitude, position = self._attitude, self._position
        if attitude is None or position is None:
            return None
        gap_ms = later_ms(attitude.boot_time_ms, position.boot_time_ms)
        carried = position.position_ned
        if gap_ms:
            carried = carried + self._velocity * min(max(gap_ms * 1e-3, 0.0), _LONGEST_CARRY_S)
        self._poses.append((attitude.boot_time_ms, carried, attitude.attitude_ned_frd))
        return VehicleState(
            self._attitude_ns,
            carried,
            self._velocity,
            attitude.attitude_ned_frd,
            attitude.rates_frd,
            gap_ms * 1_000_000,
            self._certainty,
        )

    def pose_at(self, boot_time_us: int) -> tuple[Array, Array] | None:
        """Position and attitude nearest to a time of the vehicle's clock; the oldest kept if that is older still.

        A time that lies outside the vehicle's clock (a sensor with a clock of its own) means the newest pose.
        """
        if not self._poses:
            return None
        wanted_ms = boot_time_us // 1000
        if not 0 <= self._poses[-1][0] - wanted_ms <= 5000:
            return self._poses[-1][1:]
        best = self._poses[-1]
        for pose in reversed(self._poses):
            if abs(pose[0] - wanted_ms) > abs(best[0] - wanted_ms):
                break
            best = pose
        return best[1:]


def _is_news(report: AttitudeReport | PositionReport, known: AttitudeReport | PositionReport | None) -> bool:
    """Whether a report is newer than the one that is known, or something else of the same moment."""
    if known is None:
        return True
    later = later_ms(report.boot_time_ms, known.boot_time_ms)
    if later:
        return later > 0
    return not all(map(np.array_equal, msgspec.structs.astuple(report), msgspec.structs.astuple(known)))
