"""Whether the time stamps of the telemetry can be those of the vehicle's clock.

The clock is known from the stamp that came soonest: no later one leads further, however late the link is. A single
stamp that does is wrong. Attitudes that all lead further, or all fall back behind what has come already, show that the
clock was set: a link that becomes slower or faster does neither.
"""

from collections import deque
from typing import Final

from companion.reports import ClockSet, Rebooted
from protocol.boot_time import later_ms
from protocol.peer import Peer

TOLERANCE_MS: Final = 150
"""By which stamps may lead further than the soonest one, and fall back where messages overtake one another."""
_DRIFT: Final = 2e-4
"""Relative drift between two clocks, at most."""
_TELLING, _TELLING_NS = 4, 50_000_000
"""So many attitudes over so long show that the clock was set."""
_GAP_NS = 300_000_000
"""Within a shorter gap no vehicle reboots."""
_ODD, _ODD_APART_NS, _ODD_WITHIN_NS = 10, 50_000_000, 2_000_000_000
"""So many odd stamps, so far apart, within this time are of a second clock: one that was set is believed sooner."""


class OddStamps:
    """Messages whose stamps are not believed, or show that a clock was set or that the vehicle rebooted: those of
    another vehicle with the same ids come on and on. Times in ns of our clock."""

    def __init__(self) -> None:
        self._latest_ns: deque[int] = deque(maxlen=_ODD)

    def add(self, now_ns: int) -> None:
        """One has come."""
        if not self._latest_ns or now_ns - self._latest_ns[-1] >= _ODD_APART_NS:
            self._latest_ns.append(now_ns)

    def go_on(self, now_ns: int) -> bool:
        """They come on and on."""
        return len(self._latest_ns) == _ODD and now_ns - self._latest_ns[0] < _ODD_WITHIN_NS


class Stamps:
    """The stamps of one vehicle's attitudes and positions: in ms of its clock; times in ns of ours."""

    def __init__(self) -> None:
        self._soonest: tuple[int, int] | None = None
        """The stamp that came soonest, and when."""
        self._latest_ms = self._latest_ns = 0
        """Stamp of the latest attitude that was believed, and when it came,"""
        self._lead_ns = 0
        """and how far its stamp led the soonest one."""
        self._odd: tuple[int, int, int] | None = None
        """The run of attitudes that are not believed: when the first came, the lead of its stamp, and how many there
        are."""

    def take(
        self, stamp_ms: int, now_ns: int, peer: Peer, *, of_attitude: bool, flies: bool
    ) -> ClockSet | Rebooted | bool:
        """What the stamp of an attitude or a position shows, which `peer` is told, too, or whether it is believed."""
        if not of_attitude:
            return self.believes(stamp_ms, now_ns)
        set_by_ms = self.attitude(stamp_ms, now_ns, flies=flies)
        if set_by_ms:
            peer.clock_set(stamp_ms)
            return ClockSet(set_by_ms)
        if set_by_ms is None or not peer.observe_boot_time(stamp_ms):
            return set_by_ms is not None
        self.__init__()  # type: ignore[misc]
        return Rebooted()

    def believes(self, stamp_ms: int, now_ns: int) -> bool:
        """It does not lead the vehicle's clock; before the first attitude that is not known."""
        return self._soonest is None or self._lead(stamp_ms, now_ns) <= TOLERANCE_MS * 1_000_000

    def attitude(self, stamp_ms: int, now_ns: int, *, flies: bool) -> int | None:
        """Take the stamp of an attitude: by how much (ms) it shows that the clock was set, None if it is not to be
        believed. A clock that falls back is followed where the vehicle `flies`: else it may have rebooted."""
        if self._soonest is None:
            self._soonest, self._latest_ms, self._latest_ns = (stamp_ms, now_ns), stamp_ms, now_ns
            return 0
        lead_ns = self._lead(stamp_ms, now_ns)
        falls = flies and later_ms(stamp_ms, self._latest_ms) < -TOLERANCE_MS
        if lead_ns <= TOLERANCE_MS * 1_000_000 and (not falls or now_ns - self._latest_ns > _GAP_NS):
            if lead_ns >= (self._soonest[1] - now_ns) * _DRIFT:
                self._soonest, lead_ns = (stamp_ms, now_ns), 0
            self._believe(stamp_ms, now_ns, lead_ns)
            return 0
        odd = self._odd
        if odd is None or abs(lead_ns - odd[1]) > TOLERANCE_MS * 1_000_000:
            odd = now_ns, lead_ns, 0
        self._odd = odd = odd[0], odd[1], odd[2] + 1
        if odd[2] < _TELLING or now_ns - odd[0] < _TELLING_NS:
            return None
        set_by_ms = round((lead_ns - self._lead_ns) * 1e-6)
        self._soonest = self._soonest[0] + set_by_ms, self._soonest[1]
        self._believe(stamp_ms, now_ns, self._lead_ns)
        return set_by_ms

    def _lead(self, stamp_ms: int, now_ns: int) -> int:
        assert self._soonest is not None
        return later_ms(stamp_ms, self._soonest[0]) * 1_000_000 - (now_ns - self._soonest[1])

    def _believe(self, stamp_ms: int, now_ns: int, lead_ns: int) -> None:
        if later_ms(stamp_ms, self._latest_ms) > 0 or self._odd is not None or now_ns - self._latest_ns > _GAP_NS:
            self._latest_ms, self._latest_ns, self._lead_ns = stamp_ms, now_ns, lead_ns
        self._odd = None
