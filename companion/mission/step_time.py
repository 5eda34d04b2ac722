"""The time that a step of the mission takes and may take."""

from companion.config import Settings

_SLOWER = 3.0
"""Times that a way may take: wind, drag and what stands in the way slow the vehicle down."""


class StepTime:
    """The time of one step after the other."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._since_ns = 0
        self._paused_ns = 0

    def begin(self, now_ns: int) -> None:
        """A step begins."""
        self._since_ns = now_ns

    def pause(self, now_ns: int) -> None:
        """From now on the time does not count."""
        self._paused_ns = now_ns

    def resume(self, now_ns: int) -> None:
        """The time since the pause has not counted."""
        self._since_ns += now_ns - self._paused_ns

    def allowed(self, hold_s: float, track_s: float, length: float, speed: float, climb: float) -> float:
        """Time (s) that a step may take which stays somewhere for `hold_s` (s), or follows a track of `track_s` (s),
        after a way of a `length` (m) at a `speed` (m/s) or a `climb` (m) from the ground, whichever is longer."""
        way_s = max(length / speed, climb / self._settings.trajectory.climb_speed)
        return self._settings.supervision.step_timeout + hold_s + _SLOWER * (way_s + track_s)

    def overdue(self, allowed: float, now_ns: int) -> float:
        """s beyond the time allowed (s)."""
        return max((now_ns - self._since_ns) * 1e-9 - allowed, 0.0)
