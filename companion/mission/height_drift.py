"""How much nearer flat ground is than heights say, as a range finder that looks down shows it: the estimate drifts.

A vehicle that is lower than it believes sees the ground where none should be as soon as it leans, and sees no farther.
It can't tell a drift from ground that rises, nor need it. What begins with a step is no drift but stands there.
"""

from companion.state import Announcement, Ground, Severity

_ROOM_FOR_M = 0.2
"""m that flights have room for as they are, by the tilt and the range finder."""
_RATE = 0.5
"""m/s: faster than estimates drift, and slow enough for what is passed over to change little."""
_STEP_M = 0.4
"""m by which a drift can't change at once."""
_TOLD_M = 0.5
"""A rise that is told."""


class HeightDrift:
    """The drift under one mission."""

    def __init__(self, most: float) -> None:
        """`most`: `trajectory.height_drift`."""
        self._most = most
        self._updated_ns: int | None = None
        self._seen = 0.0
        """m by which the ground was nearer when it was last seen, and"""
        self._unseen_s = 0.0
        """s for which nothing has been seen below since. What stands there is something, for as long as it may be."""
        self._told = False
        self.rise = 0.0
        """m by which the ground is nearer, less what there is room for."""

    def follow(self, ground: Ground | None, start_down: float, now_ns: int) -> Announcement | None:
        """The ground is there now, that of the start was at a height (m, NED); what is to be said of it."""
        seconds = 0.0 if self._updated_ns is None else (now_ns - self._updated_ns) * 1e-9
        self._updated_ns = now_ns
        if ground is None:
            self._unseen_s += seconds
            return None
        nearer = start_down - ground.here
        if abs(nearer - self._seen) > _STEP_M + _RATE * self._unseen_s or nearer > self._most:
            return None
        self._seen, self._unseen_s = nearer, 0.0
        wanted, change = max(nearer - _ROOM_FOR_M, 0.0), _RATE * seconds
        self.rise = min(max(wanted, self.rise - change), self.rise + change)
        if self._told or self.rise < _TOLD_M:
            return None
        self._told = True
        text = f"the ground below is {nearer:.1f} m nearer than the vehicle's height says: flying higher while it is"
        return Announcement(Severity.NOTICE, text)
