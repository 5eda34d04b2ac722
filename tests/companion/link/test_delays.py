"""How late the link is, from ages and round trips."""

import math
import random
from itertools import pairwise

import pytest

from companion.link.delays import Delays
from protocol.clock_offset import ClockOffset
from protocol.peer import Peer

MS = 1_000_000
PERIOD_S = 0.004


class Link:
    """Attitudes every period and a round trip every 0.1 s."""

    def __init__(self) -> None:
        self.delays, self.clock, self.now_ns = Delays(PERIOD_S, 0.5), ClockOffset(), 0
        self.generator = random.Random(18)

    def run(self, seconds: float, age_ms: float, round_trip_ms: float | None, jitter_ms: float = 0.0) -> list[float]:
        """For so long with these, or with no answers; the known total (s) at each attitude."""
        totals = []
        for _ in range(round(seconds / PERIOD_S)):
            self.now_ns += 4 * MS
            more = self.generator.uniform(0.0, 2.0 * jitter_ms)
            self.delays.arrived(round((age_ms + more) * MS), self.now_ns, self.clock)
            if round_trip_ms is not None and self.now_ns % (100 * MS) == 0:
                took = round((round_trip_ms + 2.0 * self.generator.uniform(0.0, 2.0 * jitter_ms)) * MS)
                self.clock.round_trip(self.now_ns - took, self.now_ns - took // 2, self.now_ns)
                self.delays.answered(self.clock)
            totals.append(self.delays.known.total)
        return totals


def measured(age_ms: int, round_trip_ms: int) -> Delays:
    link = Link()
    link.run(2.0, age_ms, round_trip_ms)
    return link.delays


@pytest.mark.parametrize("round_trip_ms", [0, 2, 4])
def test_an_answer_within_a_period_is_no_delay(round_trip_ms: int) -> None:
    delays = measured(0, round_trip_ms)
    assert delays.known is Delays(PERIOD_S, 0.5).known or delays.known.total == 0.0
    assert delays.words(1.0, 0.6) is None and delays.shortcoming(0.45) is None


@pytest.mark.parametrize("way_ms", [20, 50, 200])
def test_age_and_half_of_the_round_trip(way_ms: int) -> None:
    delays = measured(way_ms, 2 * way_ms + 4)
    assert delays.known.age == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.command == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.unsteady == 0.0
    said = delays.words(0.5, math.radians(31.0))
    assert said is not None and "loops at 50 % of their bandwidth, 31 degrees of phase margin left" in said.text
    assert delays.words(0.5, 0.5) is None  # once
    assert delays.shortcoming(0.45) is None and delays.shortcoming(0.03) is not None


def test_it_is_another_one_only_after_a_change() -> None:
    link = Link()
    link.run(1.0, 20, 44)
    found = link.delays.known
    link.run(10.0, 20, 44, jitter_ms=1.0)
    assert link.delays.known is found


def test_a_rise_of_the_ages_is_known_at_once_and_presumed_of_the_way_back() -> None:
    link = Link()
    link.run(5.0, 20, 44)
    totals = link.run(0.3, 150, None)  # no round trip can have told yet
    assert max(totals[:3]) < 0.05 and min(totals[10:]) > 0.29, "within 40 ms, and no single one"
    assert link.delays.known.age == pytest.approx(0.15, abs=3e-3)
    assert link.delays.known.command == pytest.approx(0.15, abs=3e-3)
    assert link.delays.known.unsteady == 0.0


@pytest.mark.parametrize(("round_trip_ms", "total"), [(304, 0.3), (174, 0.235)])
def test_round_trips_correct_what_was_presumed(round_trip_ms: int, total: float) -> None:
    link = Link()
    link.run(5.0, 20, 44)
    assert max(link.run(0.3, 150, None)) == pytest.approx(0.3, abs=5e-3)
    assert link.run(1.5, 150, round_trip_ms)[-1] == pytest.approx(total, abs=5e-3)
    assert link.delays.known.unsteady == 0.0


def test_a_fall_is_followed_slowly() -> None:
    link = Link()
    link.run(5.0, 150, 304)
    totals = link.run(8.0, 20, 44)
    assert totals[10] > 0.25 and totals[-1] == pytest.approx(0.04, abs=5e-3)
    assert all(later <= sooner + 1e-9 for sooner, later in pairwise(totals))


def test_jitter_is_no_rise() -> None:
    link = Link()
    link.run(5.0, 20, 44, jitter_ms=15.0)
    totals = link.run(60.0, 20, 44, jitter_ms=15.0)
    assert max(totals) - min(totals) < 0.025


@pytest.mark.parametrize(("age_ms", "refused"), [(200, False), (300, True)])
def test_before_any_round_trip_the_way_back_is_taken_to_be_as_late(age_ms: int, refused: bool) -> None:
    delays = Delays(PERIOD_S, 0.5)
    delays.arrived(age_ms * MS, 0, ClockOffset())
    assert (delays.shortcoming(0.45) is not None) == refused


def test_when_an_attitude_was_measured() -> None:
    """By its own age where that can be true; as long ago as usual where it queued up, or the clock is not known."""
    delays = measured(40, 84)
    peer, now_ns = Peer(1, 1), 100_000 * MS
    assert delays.known.age == 0.04
    assert delays.measured_ns(99_990, now_ns, None) == delays.measured_ns(99_990, now_ns, peer) == now_ns - 40 * MS
    peer.offset_ns = 500 * MS
    for age_ms, taken_ms in ((0, 0), (10, 10), (500, 500), (501, 40), (-3, 0)):
        assert delays.measured_ns(100_500 - age_ms, now_ns, peer) == now_ns - taken_ms * MS
