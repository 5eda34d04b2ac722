"""The clock filter against clocks and ways that are known."""

import random

import pytest

from protocol.clock_offset import ClockOffset

MS = 1_000_000
S = 1_000_000_000
WINDOW = 16
"""s; one round trip a second."""


class Link:
    """Ways with jitter between two clocks: `there` and `back` (ms) from and to."""

    def __init__(self, there: tuple[float, float], back: tuple[float, float], loss: float = 0.0, seed: int = 1) -> None:
        self.there, self.back, self.loss = there, back, loss
        self.generator = random.Random(seed)
        self.clock = ClockOffset()
        self.fastest: list[tuple[int, int]] = []
        """ns, there and back, of the round trips that were made."""

    def ask(self, now_ns: int, offset_ns: int) -> bool:
        """A round trip at a true offset; False if it is lost."""
        there, back = (round(self.generator.uniform(*way) * MS) for way in (self.there, self.back))
        if self.generator.random() < self.loss:
            return False
        self.clock.round_trip(now_ns, now_ns + there + offset_ns, now_ns + there + back)
        self.fastest = [*self.fastest, (there, back)][-WINDOW:]
        return True

    def error_ns(self, offset_ns: int) -> int:
        assert self.clock.offset_ns is not None
        return self.clock.offset_ns - offset_ns

    @property
    def half_difference_ns(self) -> float:
        """Half the difference of the fastest ways of the window: what no filter can do without."""
        return (min(each[0] for each in self.fastest) - min(each[1] for each in self.fastest)) / 2


@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize(
    ("there", "back"),
    [((0, 4), (0, 4)), ((20, 20), (20, 20)), ((50, 100), (50, 100)), ((5, 205), (5, 25)), ((100, 200), (30, 40))],
)
def test_it_errs_by_half_the_difference_of_the_fastest_ways(
    there: tuple[float, float], back: tuple[float, float], loss: float
) -> None:
    link = Link(there, back, loss)
    for second in range(1, 200):
        if link.ask(second * S, 77 * S):
            assert abs(link.error_ns(77 * S) - link.half_difference_ns) <= 1
    assert link.clock.round_trip_ns is not None
    assert sum(there) / 2 + sum(back) / 2 == pytest.approx(link.clock.round_trip_ns / MS, abs=60)


@pytest.mark.parametrize("drift", [-100e-6, 30e-6, 100e-6])
def test_it_follows_a_drift(drift: float) -> None:
    """No further behind than the clocks part within the window."""
    link = Link((20, 40), (20, 40), 0.2, seed=2)
    for second in range(1, 1000):
        offset_ns = 5 * S + round(drift * second * S)
        if link.ask(second * S, offset_ns):
            left = 2 * WINDOW * abs(drift) * S  # losses lengthen the window
            assert abs(link.error_ns(offset_ns) - link.half_difference_ns) <= left


@pytest.mark.parametrize("jump_s", [-100, -4, -0.5, 0.5, 4, 1000])
def test_a_clock_that_was_set_is_followed_at_the_next_answer(jump_s: float) -> None:
    link = Link((50, 60), (50, 60), seed=3)
    offset_ns = 77 * S
    for second in range(1, 60):
        if second == 30:
            offset_ns += round(jump_s * S)
        link.ask(second * S, offset_ns)
        assert abs(link.error_ns(offset_ns)) <= 5 * MS  # half of what the ways may differ by


def test_a_jump_within_the_round_trip_is_over_after_the_window() -> None:
    link = Link((50, 50), (50, 50))
    for second in range(1, 90):
        link.ask(second * S, 77 * S if second < 30 else 77 * S + 40 * MS)
        assert abs(link.error_ns(77 * S if second < 30 else 77 * S + 40 * MS)) <= 50 * MS  # half a round trip
    assert link.error_ns(77 * S + 40 * MS) == 0


def test_questions_of_the_peer_bound_it() -> None:
    link = Link((10, 10), (90, 90))
    link.clock.asked(S + 77 * S, S)
    assert link.clock.offset_ns is None
    link.ask(2 * S, 77 * S)
    assert link.error_ns(77 * S) == -40 * MS
    link.clock.asked(77 * S + 3 * S - 10 * MS, 3 * S)  # 10 ms on its way
    assert link.error_ns(77 * S) == 0
    link.clock.asked(99 * S, 3 * S)  # of another clock
    assert link.error_ns(77 * S) == 0


@pytest.mark.parametrize(("before", "after"), [((20, 25), (150, 155)), ((5, 60), (150, 200))])
def test_a_link_that_becomes_slower_is_known_after_five_round_trips(
    before: tuple[float, float], after: tuple[float, float]
) -> None:
    link = Link(before, before)
    for tenth in range(1, 100):
        link.ask(tenth * S // 10, 77 * S)
    link.there = link.back = after
    link.ask(10 * S, 77 * S)
    assert link.clock.round_trip_ns is not None and link.clock.round_trip_ns <= 2 * before[1] * MS, "one is none"
    for tenth in range(101, 105):
        link.ask(tenth * S // 10, 77 * S)
    assert link.clock.round_trip_ns >= 2 * after[0] * MS
    assert link.clock.spread_ns <= (after[1] - after[0]) * MS / 2, "what was before does not count"
    assert abs(link.error_ns(77 * S)) <= before[1] * MS, "but for the clock"


def test_a_link_that_becomes_faster_is_known_within_seconds() -> None:
    link = Link((150, 155), (150, 155))
    for tenth in range(1, 100):
        link.ask(tenth * S // 10, 77 * S)
    link.there = link.back = (20, 25)
    for tenth in range(100, 130):
        link.ask(tenth * S // 10, 77 * S)
    assert link.clock.round_trip_ns is not None and link.clock.round_trip_ns <= 50 * MS
