"""At which ticks each message is sent: the message intervals of MAVLink."""

import heapq
from dataclasses import dataclass

from vehicle_sim.timing import TICK_NS

TICK_US = TICK_NS // 1000
_LONGEST_US = 2**31 - 1
"""MESSAGE_INTERVAL has room for no longer interval, which is 36 minutes."""


@dataclass(slots=True)
class Stream:
    """One message that is sent at a rate."""

    message_id: int
    default_ticks: int
    min_ticks: int
    """Its source has no newer data before that."""
    ticks: int
    """Interval; 0: off."""


class Schedule:
    """All streams. Intervals are multiples of the tick, and each stream is sent at multiples of its interval, so that
    messages of one instant travel together."""

    def __init__(self, intervals_us: dict[int, tuple[int, int]]) -> None:
        """`intervals_us`: by message id, the default interval (0: off; at least a tick) and the least one."""
        self._streams: dict[int, Stream] = {}
        for message_id, (default, least) in intervals_us.items():
            ticks = max(1, default // TICK_US) if default else 0
            self._streams[message_id] = Stream(message_id, ticks, max(1, least // TICK_US), ticks)
        self._tick = 0
        self._due: list[tuple[int, int]] = []
        """Heap of (tick, message id)."""
        self._reschedule()

    def begin(self, tick: int) -> None:
        """Nothing is due at this tick or before."""
        self._tick = tick
        self._reschedule()

    def set_interval(self, message_id: int, interval_us: int) -> bool:
        """-1: off, 0: the default, else rounded down to whole ticks, but not below the least interval, and at most
        `_LONGEST_US`.

        False: there is no such message.
        """
        stream = self._streams.get(message_id)
        if stream is None or interval_us < -1:
            return False
        if interval_us == -1:
            stream.ticks = 0
        elif interval_us == 0:
            stream.ticks = stream.default_ticks
        else:
            stream.ticks = max(stream.min_ticks, min(interval_us, _LONGEST_US) // TICK_US)
        self._reschedule()
        return True

    def interval_us(self, message_id: int) -> int:
        """As MESSAGE_INTERVAL reports it: -1 off, 0 no such message, `_LONGEST_US` for what takes longer."""
        stream = self._streams.get(message_id)
        if stream is None:
            return 0
        return min(stream.ticks * TICK_US, _LONGEST_US) or -1

    def _reschedule(self) -> None:
        tick = self._tick
        self._due = [((tick // s.ticks + 1) * s.ticks, s.message_id) for s in self._streams.values() if s.ticks]
        heapq.heapify(self._due)

    def due(self, tick: int) -> list[int]:
        """Go on to a tick; the ids of the messages to send at it."""
        self._tick = tick
        due, ids = self._due, []
        while due and due[0][0] <= tick:
            message_id = due[0][1]
            heapq.heapreplace(due, (tick + self._streams[message_id].ticks, message_id))
            ids.append(message_id)
        return ids
