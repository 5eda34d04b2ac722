"""What is known of one peer from what it sends: losses, heartbeat, restarts, clock offset. No I/O and no clock."""

from collections import deque
from typing import Final

from protocol.framing import Frame

_REORDERED: Final = 64
"""A sequence number at most this far back is an old frame that comes late."""
_BOOT_TIME_TOLERANCE_MS: Final = 1000
_ROUND_TRIP_LIMIT_NS: Final = 10_000_000
_CLOCK_JUMP_NS: Final = 20_000_000
"""Two samples within the round-trip limit are at most 10 ms apart, and vehicles' clocks have steps of up to 4 ms."""
_OFFSET_GAIN: Final = 0.1
_REQUESTS_KEPT: Final = 8


class Peer:
    """One (system, component). Times are nanoseconds of the caller's monotonic clock.

    MAVLink's sequence number has 8 bits, so what a jump means is a convention: up to 127 frames skipped are lost; up to
    64 back the frame is late (it was counted as lost before and is no longer) or a duplicate; anything else is a sender
    that started anew, and counts as no loss. A pause in which more than 127 frames were lost is undercounted.
    """

    def __init__(self, system: int, component: int) -> None:
        self.system = system
        self.component = component
        self.received = 0
        """Frames, late ones and duplicates included."""
        self.lost = 0
        self.late = 0
        self.duplicates = 0
        self.restarts = 0
        """Jumps of the sequence number that no loss or reordering explains."""
        self.reboots = 0
        """Falls of the time since boot."""
        self.heard_ns: int | None = None
        """When the last frame arrived."""
        self.rebooted_ns: int | None = None
        self.offset_ns: int | None = None
        """Its clock minus ours, smoothed; None while unknown."""
        self.round_trip_ns: int | None = None
        """Of the last answer to TIMESYNC, taken or not."""
        self._sequence: int | None = None
        self._missing = 0  # bit k: the frame k before the newest has not come
        self._heartbeat_ns: int | None = None
        self._boot_time_ms: int | None = None
        self._requests: deque[int] = deque(maxlen=_REQUESTS_KEPT)

    def observe(self, frame: Frame, now_ns: int) -> bool:
        """Count a frame that arrived; False for one of another sender, which is ignored."""
        if frame.system != self.system or frame.component != self.component:
            return False
        self.received += 1
        self.heard_ns = now_ns
        ahead = 1 if self._sequence is None else (frame.sequence - self._sequence) & 0xFF
        back = -ahead & 0xFF
        if ahead == 1 and not self._missing:
            pass
        elif 0 < ahead <= 128:
            self.lost += ahead - 1
            self._missing = (self._missing << ahead | (1 << ahead) - 2) & (1 << _REORDERED + 1) - 1
        elif back <= _REORDERED:
            if self._missing >> back & 1:
                self._missing &= ~(1 << back)
                self.late += 1
                self.lost -= 1
            else:
                self.duplicates += 1
            return True
        else:
            self.restarts += 1
            self._missing = 0
        self._sequence = frame.sequence
        return True

    def heartbeat(self, now_ns: int) -> None:
        """A HEARTBEAT of this peer arrived."""
        self._heartbeat_ns = now_ns

    def heartbeat_age_ns(self, now_ns: int) -> int | None:
        """None before the first one."""
        return None if self._heartbeat_ns is None else now_ns - self._heartbeat_ns

    def observe_boot_time(self, time_boot_ms: int, now_ns: int) -> bool:
        """Whether this time since boot (32 bits, which wrap after 49.7 days) says that the peer has rebooted.

        A fall of up to a second is a message that was overtaken. After a reboot the sequence and the clock offset are
        learnt anew.
        """
        if self._boot_time_ms is not None:
            step_ms = (time_boot_ms - self._boot_time_ms + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
            if -_BOOT_TIME_TOLERANCE_MS <= step_ms < 0:
                return False
            if step_ms < 0:
                self._boot_time_ms = time_boot_ms
                self._sequence = None
                self._missing = 0
                self.offset_ns = None
                self._requests.clear()
                self.reboots += 1
                self.rebooted_ns = now_ns
                return True
        self._boot_time_ms = time_boot_ms
        return False

    def timesync_request(self, now_ns: int) -> tuple[int, int]:
        """TIMESYNC's (tc1, ts1) to send now."""
        self._requests.append(now_ns)
        return 0, now_ns

    def timesync_reply(self, tc1: int, ts1: int, now_ns: int) -> bool:
        """Take an answer to one of the last requests; returns whether it changed `offset_ns`.

        A round trip of 10 ms or more says too little; a sample too far from the estimate to be noise replaces it, for
        then a clock has been set.
        """
        if tc1 == 0 or ts1 not in self._requests:
            return False
        self._requests.remove(ts1)
        self.round_trip_ns = now_ns - ts1
        if self.round_trip_ns >= _ROUND_TRIP_LIMIT_NS:
            return False
        sample_ns = tc1 - (ts1 + now_ns) // 2
        if self.offset_ns is None or abs(sample_ns - self.offset_ns) > _CLOCK_JUMP_NS:
            self.offset_ns = sample_ns
        else:
            self.offset_ns += round((sample_ns - self.offset_ns) * _OFFSET_GAIN)
        return True

    def timesync_asked(self, ts1: int, now_ns: int) -> None:
        """Its own question arrived: it was sent at `ts1` of its clock, and not after it arrived. That bounds the offset
        from below, where half a round trip errs by as much as the two ways differ."""
        if self.offset_ns is not None and 0 < ts1 - now_ns - self.offset_ns <= _CLOCK_JUMP_NS:
            self.offset_ns = ts1 - now_ns
