"""One peer, judged by what it sends: losses, heartbeat, restarts, clock offset. No input or output, and no clock."""

from collections import deque
from typing import Final

from protocol.boot_time import later_ms
from protocol.clock_offset import ClockOffset
from protocol.framing import Frame

_REORDERED: Final = 64
"""A sequence number at most this far back belongs to a late frame or a duplicate."""
_BOOT_TIME_TOLERANCE_MS: Final = 1000
"""A time since boot that falls by at most this much is of a message that another one has overtaken."""
_REQUESTS_KEPT: Final = 32
"""TIMESYNC requests that may still be answered."""


class Peer:
    """One sender (system, component). Times are nanoseconds of the caller's monotonic clock.

    MAVLink's sequence number has 8 bits, so the meaning of a jump is a convention. Up to 127 skipped frames are lost.
    A frame up to 64 back is late, if it was counted as lost, or a duplicate. Any other jump is a restart of the sender
    and no loss. So a pause in which more than 127 frames were lost is undercounted.
    """

    def __init__(self, system: int, component: int) -> None:
        self.system = system
        self.component = component
        self.lost = 0
        """Frames that were skipped and have not arrived since."""
        self.late = 0
        """Frames that arrived after they had been counted as lost."""
        self.duplicates = 0
        """Frames that had already arrived."""
        self.restarts = 0
        """Jumps of the sequence number that neither losses nor reordering explain."""
        self.reboots = 0
        """Falls of the time since boot by more than a second."""
        self.heard_ns: int | None = None
        """When the last frame arrived."""
        self.clock = ClockOffset()
        self.offset_ns: int | None = None
        """The peer's clock minus ours; None while unknown."""
        self.order = 0
        """Place among all, as they were sent, of the frame that was observed last: one that comes late has a lower one
        than those that overtook it."""
        self._newest = 0
        """The highest of them."""
        self._sequence: int | None = None
        self._missing = 0  # bit k: the frame k before the newest has not arrived
        self._heartbeat_ns: int | None = None
        self.boot_time_ms: int | None = None
        """The latest time since boot; None before the first."""
        self._requests: deque[int] = deque(maxlen=_REQUESTS_KEPT)

    def observe(self, frame: Frame, now_ns: int) -> bool:
        """Count a frame that arrived; False for a frame of another sender, which is ignored."""
        if frame.system != self.system or frame.component != self.component:
            return False
        self.heard_ns = now_ns
        ahead = 1 if self._sequence is None else (frame.sequence - self._sequence) & 0xFF
        if ahead == 1 and not self._missing:  # almost always
            self._sequence = frame.sequence
            self.order = self._newest = self._newest + 1
        else:
            self._observe_jump(frame.sequence, ahead)
        return True

    def _observe_jump(self, sequence: int, ahead: int) -> None:
        """Count a frame that is `ahead` of the newest, modulo 256, or comes while others are missing."""
        back = -ahead & 0xFF
        if 0 < ahead <= 128:
            self._newest += ahead
            self.lost += ahead - 1
            self._missing = (self._missing << ahead | (1 << ahead) - 2) & (1 << _REORDERED + 1) - 1
        elif back <= _REORDERED:
            if self._missing >> back & 1:
                self._missing &= ~(1 << back)
                self.late += 1
                self.lost -= 1
            else:
                self.duplicates += 1
            self.order = self._newest - back
            return
        else:
            self._newest += 1
            self.restarts += 1
            self._missing = 0
        self._sequence, self.order = sequence, self._newest

    def heartbeat(self, now_ns: int) -> None:
        """A HEARTBEAT of this peer arrived."""
        self._heartbeat_ns = now_ns

    def heartbeat_age_ns(self, now_ns: int) -> int | None:
        """None before the first one."""
        return None if self._heartbeat_ns is None else now_ns - self._heartbeat_ns

    def observe_boot_time(self, time_boot_ms: int) -> bool:
        """Take a time since boot (32 bits, which wrap after 49.7 days); True if it shows that the peer has rebooted.

        A fall of up to a second is a message that was overtaken. After a reboot the sequence number and the clock
        offset are unknown again.
        """
        if self.boot_time_ms is not None:
            step_ms = later_ms(time_boot_ms, self.boot_time_ms)
            if -_BOOT_TIME_TOLERANCE_MS <= step_ms < 0:
                return False
            if step_ms < 0:
                self.boot_time_ms = time_boot_ms
                self._sequence = None
                self._missing = 0
                self.clock, self.offset_ns = ClockOffset(), None
                self._requests.clear()
                self.reboots += 1
                return True
        self.boot_time_ms = time_boot_ms
        return False

    def clock_set(self, time_boot_ms: int) -> None:
        """The peer's clock was set, and says this now: its offset is unknown until a question is answered."""
        self.boot_time_ms = time_boot_ms
        self.clock.forget()
        self.offset_ns = None
        self._requests.clear()

    def timesync_request(self, now_ns: int) -> tuple[int, int]:
        """The fields (tc1, ts1) of a TIMESYNC request to send now."""
        self._requests.append(now_ns)
        return 0, now_ns

    def timesync_reply(self, tc1: int, ts1: int, now_ns: int) -> bool:
        """Take the answer to one of the last requests, however long it took; False for any other."""
        if tc1 == 0 or ts1 not in self._requests:
            return False
        self._requests.remove(ts1)
        self.clock.round_trip(ts1, tc1, now_ns)
        self.offset_ns = self.clock.offset_ns
        return True

    def timesync_asked(self, ts1: int, now_ns: int) -> None:
        """Take a TIMESYNC request of the peer, sent at `ts1` of its clock."""
        if self.offset_ns is not None:
            self.clock.asked(ts1, now_ns)
            self.offset_ns = self.clock.offset_ns
