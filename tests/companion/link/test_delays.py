"""How late the link is, from ages and round trips."""

import math
import random
from itertools import pairwise

import pytest

from companion.config import Prediction
from companion.link.delays import Delays
from protocol.clock_offset import ClockOffset
from protocol.peer import Peer

MS = 1_000_000
PERIOD_S = 0.004


class Link:
    """Attitudes every period and a round trip every 0.1 s."""

    def __init__(self, told_every: float = 5.0) -> None:
        self.delays, self.clock, self.now_ns = Delays(PERIOD_S, Prediction(told_every=told_every)), ClockOffset(), 0
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
    assert delays.known is Delays(PERIOD_S, Prediction()).known or delays.known.total == 0.0
    assert delays.words(0, 1.0, 0.6, instead=False) is None and delays.shortcoming(0.45) is None


@pytest.mark.parametrize("way_ms", [20, 50, 200])
def test_age_and_half_of_the_round_trip(way_ms: int) -> None:
    delays = measured(way_ms, 2 * way_ms + 4)
    assert delays.known.age == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.command == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.unsteady == 0.0
    said = delays.words(0, 0.5, math.radians(31.0), instead=False)
    assert said is not None and "loops at 50 % of their bandwidth, 31 degrees of phase margin left" in said.text
    assert delays.words(0, 0.5, 0.5, instead=False) is None  # once
    assert delays.shortcoming(0.45) is None and delays.shortcoming(0.03) is not None


@pytest.mark.parametrize("late_s", [0.1, 0.2, 0.4])
def test_a_link_that_is_late_now_and_then_is_not_later_and_later(late_s: float) -> None:
    """What is presumed of the way back after a rise was added to what was presumed before: up to 2.9 s for 0.2 s."""
    link, most = Link(), 0.0
    for age_ms in (0.0, 1e3 * late_s) * 25:
        most = max(most, *link.run(late_s, age_ms, 2.0 * age_ms + 4.0))
    assert 1.5 * late_s < most < 2.2 * late_s


def test_after_a_rise_the_way_back_is_presumed_as_much_longer_as_it_was_before() -> None:
    link = Link()
    link.run(3.0, 10, 164)
    assert link.delays.known.command == pytest.approx(0.08, abs=2.1e-3)
    link.run(0.1, 100, None)
    assert link.delays.known.age == pytest.approx(0.1, abs=2.1e-3)
    assert link.delays.known.command == pytest.approx(0.17, abs=5e-3)


@pytest.mark.parametrize(("told_every", "fewest", "most"), [(0.0, 20, 200), (2.0, 5, 6)])
def test_what_changes_all_the_time_is_said_now_and_then_and_how_it_ends(
    told_every: float, fewest: int, most: int
) -> None:
    """For 10 s it is later and less late by turns, then on time."""
    link, said = Link(told_every), []
    for age_ms in (*[0] * 10, *[200] * 10) * 25 + (0,) * 200:
        link.run(0.02, age_ms, 2 * age_ms + 4)
        said.append(link.delays.words(link.now_ns, 1.0, None, instead=False))
    told = [each.text for each in said if each is not None]
    assert fewest <= len(told) <= most and told[-1] in ("the link is 0 ms late", "the link is 8 ms late")


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
    delays = Delays(PERIOD_S, Prediction())
    delays.arrived(age_ms * MS, 0, ClockOffset())
    assert (delays.shortcoming(0.45) is not None) == refused


def test_when_an_attitude_was_measured() -> None:
    """By its own age where that can be true; as long ago as usual where it queued up, or the clock is not known."""
    delays = measured(40, 84)
    peer, now_ns = Peer(1, 1), 100_000 * MS
    assert delays.known.age == 0.04
    assert delays.take(99_990, now_ns, None) == delays.take(99_990, now_ns, peer) == now_ns - 40 * MS
    peer.offset_ns = 500 * MS
    for age_ms, taken_ms in ((0, 0), (10, 10), (500, 500), (501, 40), (-3, 0)):
        assert delays.take(100_500 - age_ms, now_ns, peer) == now_ns - taken_ms * MS


class Clocked:
    """Attitudes of a vehicle whose clock is known, and their ages."""

    def __init__(self) -> None:
        self.delays, self.peer, self.now_ns = Delays(PERIOD_S, Prediction()), Peer(1, 1), 100_000 * MS
        self.peer.offset_ns = 7 * MS

    def hear(self, count: int, age_ms: int, period_ms: int = 4) -> None:
        """So many attitudes, one each period, and half as many answers to questions, which took twice their age."""
        for number in range(count):
            self.now_ns += period_ms * MS
            assert self.peer.offset_ns is not None
            measured_ns = self.now_ns - age_ms * MS
            assert self.delays.take((measured_ns + self.peer.offset_ns) // MS, self.now_ns, self.peer) == measured_ns
            if number % 2:
                self.peer.clock.round_trip(self.now_ns - (2 * age_ms + 4) * MS, measured_ns, self.now_ns)
                self.delays.answered(self.peer.clock)


@pytest.mark.parametrize(("period_ms", "late_ms"), [(4, 40), (20, 60), (33, 99)])
def test_an_attitude_is_overdue_once_it_is_later_than_usual(period_ms: int, late_ms: int) -> None:
    """By 40 ms, and by three intervals of telemetry that comes seldom."""
    link = Clocked()
    link.hear(600, 20, period_ms)
    assert link.delays.known.total == pytest.approx(0.04, abs=1e-9)
    due_ns = link.now_ns + late_ms * MS
    assert not link.delays.is_overdue(due_ns - MS) and link.delays.is_overdue(due_ns + MS)
    assert link.delays.asks_for_attitudes(due_ns + MS, airborne=True)
    assert not link.delays.asks_for_attitudes(due_ns + MS, airborne=False)
    boot_ms = (link.now_ns + 7 * MS) // MS - 20
    assert link.delays.lacks_news(boot_ms, due_ns + MS) and not link.delays.lacks_news(boot_ms + 4, due_ns + MS)
    assert not link.delays.lacks_news(boot_ms, link.now_ns + 481 * MS), "too old to be predicted over"
    link.hear(1, 20 + late_ms + 1, period_ms)
    assert link.delays.is_overdue(link.now_ns)  # it has come, late
    assert not Delays(PERIOD_S, Prediction(overdue=0.0)).is_overdue(due_ns)
    assert not Delays(PERIOD_S, Prediction()).lacks_news(0, due_ns), "none has come yet"


def test_jitter_makes_nothing_overdue() -> None:
    link, generator = Clocked(), random.Random(3)
    for _ in range(3000):
        link.hear(2, 5 + generator.choice([0, 0, 50, 100]))
    link.hear(1, 5)
    assert link.delays.known.unsteady > 0.02
    assert not link.delays.is_overdue(link.now_ns + 60 * MS)


@pytest.mark.parametrize(("way_ms", "asks"), [(60, False), (80, True)])
def test_a_link_that_is_late_for_good_asks_for_attitudes(way_ms: int, asks: bool) -> None:
    link = Clocked()
    link.hear(300, way_ms)
    assert link.delays.asks_for_attitudes(link.now_ns, airborne=False) is asks
    said = link.delays.words(link.now_ns, 0.98, 0.5, instead=asks)
    assert said is not None and ("attitudes are commanded" in said.text) is asks


@pytest.mark.parametrize("takes_ms", [6, 25, 50, 200])
def test_attitudes_that_queue_up_because_the_loop_is_too_slow_end_the_flight(takes_ms: int) -> None:
    """Each takes so long, and the vehicle sends one each 4 ms: their age passes all limits between two looks at it."""
    link = Clocked()
    link.hear(300, 20)
    measured_ns, began_ns = link.now_ns - 20 * MS, link.now_ns
    while link.delays.shortcoming(0.45) is None and link.now_ns - began_ns < 1500 * MS:
        link.now_ns, measured_ns = link.now_ns + takes_ms * MS, measured_ns + 4 * MS
        link.delays.take((measured_ns + 7 * MS) // MS, link.now_ns, link.peer)
    assert link.delays.shortcoming(0.45) is not None


@pytest.mark.parametrize("by_ms", [-80, 80])
def test_a_clock_that_is_corrected_makes_no_way_slower(by_ms: int) -> None:
    """The ages are others at once; the way back is as it was."""
    link = Clocked()
    link.hear(300, 200)
    command = link.delays.known.command
    link.peer.offset_ns = 7 * MS - by_ms * MS
    for _ in range(50):
        link.now_ns += 4 * MS
        link.delays.take((link.now_ns - 193 * MS) // MS, link.now_ns, link.peer)
        assert link.delays.known.age == pytest.approx(0.2 - by_ms * 1e-3, abs=0.005)
        assert link.delays.known.command == command


@pytest.mark.parametrize(("pause_ms", "oldest_ms"), [(48, 48), (100, 100), (300, 48)])
def test_what_queued_up_while_the_loop_stood_still_shows_no_slower_link(pause_ms: int, oldest_ms: int) -> None:
    """It comes at once; after a long pause the oldest are left out."""
    link = Link()
    link.run(2.0, 0, 4)
    for _ in range(10):
        link.now_ns += pause_ms * MS
        for age_ms in range(oldest_ms, -4, -4):
            link.delays.arrived(age_ms * MS, link.now_ns, link.clock)
        assert max(link.run(0.1, 0, 4)) < 0.02
