"""The offset between two clocks, from questions and answers that take any time on their way.

An answer is sent after its question and arrives after it was sent, so each round trip gives two bounds:

    time of the answer - arrival  <=  offset  <=  time of the answer - time of the question

The lower bound is short by the way back, the upper one by the way there. Over a window the highest lower bound is that
of the fastest way back, and the lowest upper bound that of the fastest way there, whether or not both were of one round
trip. The middle of the two errs by half the difference of the two fastest ways, which nothing but another clock could
show. A drift of 100 ppm adds at most 1.6 ms within the window, and is followed by the window's moving on.
"""

from collections import deque
from typing import Final

_SECOND_NS: Final = 1_000_000_000
_WINDOW: Final = 16
"""Seconds with round trips whose bounds are remembered."""
_USUAL_NS: Final = 5 * _SECOND_NS
"""The usual round trip is the median of those within this time: a link that becomes faster is known as such after half
of it."""
_TELLING: Final = 5
"""So many round trips show that the link has become slower if each is further above the usual one than that is above
the fastest: then they alone count."""
_TOLERANCE_NS: Final = 10_000_000
"""Bounds that contradict each other by more show that a clock was set. Vehicles' clocks have steps of up to 4 ms."""


class ClockOffset:
    """The peer's clock minus ours. Times are nanoseconds, of our clock but for `answered_ns` and `asked_ns`."""

    def __init__(self) -> None:
        self.offset_ns: int | None = None
        """None while unknown."""
        self.round_trip_ns: int | None = None
        """The usual one of late; None before the first."""
        self.spread_ns = 0
        """By how much one way usually differs from its middle: a quarter of what the median is above the fastest."""
        self._lower: deque[int] = deque(maxlen=_WINDOW)
        self._upper: deque[int] = deque(maxlen=_WINDOW)
        """The best bounds of a second each."""
        self._second: int | None = None
        """The second, of our clock, of the latest."""
        self._round_trips: deque[tuple[int, int]] = deque()
        """When they began, and how long they took."""

    def round_trip(self, sent_ns: int, answered_ns: int, now_ns: int) -> None:
        """A question of ours that was sent then and answered at `answered_ns` of the peer's clock."""
        lower, upper = answered_ns - now_ns, answered_ns - sent_ns
        if self._lower and (
            lower > min(self._upper) + _TOLERANCE_NS or upper < max(self._lower) - _TOLERANCE_NS
        ):  # a clock was set
            self._lower.clear()
            self._upper.clear()
        if self._lower and sent_ns // _SECOND_NS == self._second:
            self._lower[-1], self._upper[-1] = max(self._lower[-1], lower), min(self._upper[-1], upper)
        else:
            self._lower.append(lower)
            self._upper.append(upper)
            self._second = sent_ns // _SECOND_NS
        self._took(sent_ns, now_ns - sent_ns)
        self._settle()

    def forget(self) -> None:
        """The peer's clock was set: its offset is unknown. Round trips are of our clock alone."""
        self.offset_ns = None
        self._lower.clear()
        self._upper.clear()

    def _took(self, sent_ns: int, took_ns: int) -> None:
        trips = self._round_trips
        trips.append((sent_ns, took_ns))
        while trips[0][0] <= sent_ns - _USUAL_NS:
            trips.popleft()
        latest = [took for _, took in trips][-_TELLING:]
        if self.round_trip_ns is not None and min(latest) > self.round_trip_ns + 4 * self.spread_ns + _TOLERANCE_NS:
            while len(trips) > len(latest):
                trips.popleft()
        took = sorted(took for _, took in trips)
        self.round_trip_ns = took[(len(took) - 1) // 2]
        self.spread_ns = (self.round_trip_ns - took[0]) // 4

    def asked(self, asked_ns: int, now_ns: int) -> None:
        """A question of the peer's, sent at `asked_ns` of its clock: no later than it arrived."""
        lower = asked_ns - now_ns
        if self._lower and self._lower[-1] < lower <= min(self._upper) + _TOLERANCE_NS:
            self._lower[-1] = lower
            self._settle()

    def _settle(self) -> None:
        self.offset_ns = (max(self._lower) + min(self._upper)) // 2
