"""How late the link makes things, from the ages of the attitudes and from the round trips of TIMESYNC."""

import math

from companion.config import Prediction
from companion.reports import LinkDelay
from companion.state import Announcement, Severity
from protocol.clock_offset import ClockOffset
from protocol.peer import Peer

_SHARE = 1 / 64
"""Weight of a new age in the mean."""
_STEP_S = 0.004
"""A change by less is none, and what is known is a multiple: a tick of most vehicles."""
_RISE_NS = 20_000_000
"""Attitudes that are all older than is known by more than this show that the link has become slower:"""
_TELLING, _TELLING_NS = 4, 20_000_000
"""so many of them, over so long."""
_CORRECTION_NS = 10_000_000
"""A clock's offset that changes by more changes what is known of the ages at once."""
_SPREADS, _INTERVALS = 2.0, 3.0
"""Within so much of the link's unsteadiness, and so many usual intervals, no attitude is overdue."""
_ANSWERS = 10
"""After a rise so many round trips are waited for until they are believed."""

_WORTH_A_WORD_S = 0.02


class Delays:
    """The delays of one vehicle. `known` is another object only after a change."""

    def __init__(self, period: float, settings: Prediction) -> None:
        """`period` (s) of the telemetry. An attitude that is older than the `longest` of the settings queued up, or has
        another clock than TIMESYNC: not where one was younger before by that clock."""
        self._settings = settings
        self._longest_ns, self._overdue_ns = round(settings.longest * 1e9), settings.overdue * 1e9
        self.latest_ns = 0
        """When the latest attitude was measured, on the companion's clock."""
        self._latest_boot_ms: int | None = None
        """The same on the vehicle's."""
        self._interval_ns = 0.0
        """The usual one between two of them."""
        self._offset_ns: int | None = None
        """The vehicle's clock minus ours, at the latest attitude."""
        self.known = LinkDelay()
        self._period_ns = period * 1e9
        self._said_s, self._silent_until_ns = 0.0, 0
        self._one_clock = False
        """Attitudes and TIMESYNC have the same."""
        self._age_ns: float | None = None
        self._least_ns, self._count, self._since_ns = math.inf, 0, 0
        """The least age of those that came since then, and how many these are."""
        self._presumed_ns, self._unbelieved = 0.0, 0
        """After a rise: the way back, and how many round trips are still to come."""
        self._before_ns = 0.0
        """By how much the way back was the longer one when it was known last. What is presumed adds to that, not to
        what was presumed before: a link that is late now and then is not later and later."""

    def take(self, boot_time_ms: int, now_ns: int, peer: Peer | None) -> int:
        """An attitude with this time has arrived: when it was measured, on the companion's clock; as long ago as usual
        where its age is not known."""
        age_ns = round(self.known.age * 1e9)
        if peer is not None and peer.offset_ns is not None:
            found_ns = now_ns - boot_time_ms * 1_000_000 + peer.offset_ns
            if found_ns <= self._longest_ns:
                age_ns, self._one_clock = max(found_ns, 0), True
                self._correct(peer.offset_ns, peer.clock)
                self.arrived(age_ns, now_ns, peer.clock)
            elif self._one_clock:  # where all queue up, the loop does not keep pace with them
                self.arrived(found_ns, now_ns, peer.clock)
        before_ns, self.latest_ns, known = self.latest_ns, now_ns - age_ns, self._latest_boot_ms is not None
        self._latest_boot_ms = boot_time_ms
        if known:
            self._interval_ns += _SHARE * (self.latest_ns - before_ns - self._interval_ns)
        return self.latest_ns

    def clock_changed(self) -> None:
        """The vehicle has set its clock, or started anew."""
        self._one_clock = False

    def asks_for_attitudes(self, now_ns: int, *, airborne: bool) -> bool:
        """How long a command takes is too long, or `airborne` not known, for one that turns the vehicle on and on."""
        return self.known.total > self._settings.attitudes_beyond or (airborne and self.is_overdue(now_ns))

    def is_overdue(self, now_ns: int) -> bool:
        """The latest attitude is older than usual, by more than jitter and a few losses explain: none has come since,
        or it came late."""
        usual_ns = 1e9 * (self.known.age + _SPREADS * self.known.unsteady)
        late_ns = now_ns - self.latest_ns - usual_ns
        return 0.0 < self._overdue_ns < late_ns > _INTERVALS * self._interval_ns

    def lacks_news(self, boot_time_ms: int, now_ns: int) -> bool:
        """The latest attitude, which has this time, is overdue, and not older than can be predicted over."""
        taken = boot_time_ms == self._latest_boot_ms and now_ns - self.latest_ns <= self._longest_ns
        return taken and self.is_overdue(now_ns)

    def _correct(self, offset_ns: int, clock: ClockOffset) -> None:
        """The vehicle's clock is known better, or worse: ages are others, and no way has become slower."""
        before_ns, self._offset_ns = self._offset_ns, offset_ns
        if before_ns is not None and self._age_ns is not None and abs(offset_ns - before_ns) > _CORRECTION_NS:
            self._age_ns = max(self._age_ns + offset_ns - before_ns, 0.0)
            self._judge(clock)

    def arrived(self, age_ns: int, now_ns: int, clock: ClockOffset) -> None:
        """An attitude that was so old on arrival. The mean follows it slowly, but a rise of all at once; then the way
        back has probably become as much slower, which no round trip can tell yet."""
        self._age_ns = age_ns if self._age_ns is None else self._age_ns + _SHARE * (age_ns - self._age_ns)
        if not self._count:  # not before: what queued up while our loop stood still comes at once, and tells nothing
            self._since_ns = now_ns
        self._least_ns, self._count = min(self._least_ns, age_ns), self._count + 1
        if self._count >= _TELLING and now_ns - self._since_ns >= _TELLING_NS:
            least_ns, rise_ns = self._least_ns, self._least_ns - self.known.age * 1e9
            self._least_ns, self._count = math.inf, 0
            if rise_ns > _RISE_NS:
                self._age_ns = max(self._age_ns, least_ns)
                if not self._unbelieved:
                    self._before_ns = (self.known.command - self.known.age) * 1e9
                self._presumed_ns, self._unbelieved = max(self._before_ns + least_ns, 0.0), _ANSWERS
                self._judge(clock)

    def answered(self, clock: ClockOffset) -> None:
        """A round trip is over."""
        self._unbelieved = max(self._unbelieved - 1, 0)
        self._judge(clock)

    def _judge(self, clock: ClockOffset) -> None:
        """What was measured; an answer waits for the vehicle's next sending, which delays no command."""
        if clock.round_trip_ns is None:
            return
        command_ns = 0.5 * max(clock.round_trip_ns - self._period_ns, 0.0)
        if self._unbelieved:
            command_ns = max(command_ns, self._presumed_ns)
        found = [each * 1e-9 for each in (self._age_ns or 0.0, command_ns, clock.spread_ns)]
        known = self.known.age, self.known.command, self.known.unsteady
        if max(abs(new - old) for new, old in zip(found, known, strict=True)) >= _STEP_S:
            self.known = LinkDelay(*(_STEP_S * round(each / _STEP_S) for each in found))

    def shortcoming(self, longest: float) -> str | None:
        """What speaks against a flight that may be late by `longest` (s) at most."""
        # ages are known at once, round trips seconds later: until then the way back may be as late as the way there
        late = max(self.known.total, 2e-9 * (self._age_ns or 0.0))
        return f"the link is {1e3 * late:.0f} ms late, {1e3 * longest:.0f} ms at most" if late > longest else None

    def words(self, now_ns: int, pace: float, margin: float | None, *, instead: bool) -> Announcement | None:
        """What is to be said of how late the link is now, if that is news and the last is some time ago. The vehicle is
        flown at a pace, with a phase margin (rad) left (`control.margin`), and by attitudes `instead` of its output."""
        late = self.known.total
        if abs(late - self._said_s) < _WORTH_A_WORD_S or now_ns < self._silent_until_ns:
            return None
        self._said_s, self._silent_until_ns = late, now_ns + round(self._settings.told_every * 1e9)
        by = ": attitudes are commanded" if instead else ""
        slower = f": loops at {100.0 * pace:.0f} % of their bandwidth" if pace < 1.0 else ""
        left = "" if margin is None else f", {math.degrees(margin):.0f} degrees of phase margin left"
        return Announcement(Severity.NOTICE, f"the link is {1e3 * late:.0f} ms late{by}{slower}{left}")
