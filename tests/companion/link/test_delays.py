"""How late the link is, from ages and round trips."""

import pytest

from companion.link.delays import Delays
from protocol.clock_offset import ClockOffset

MS, S = 1_000_000, 1_000_000_000
PERIOD_S = 0.004


def measured(age_ms: int, round_trip_ms: int) -> Delays:
    delays, clock = Delays(PERIOD_S), ClockOffset()
    for _ in range(300):
        delays.arrived(age_ms * MS)
    for second in range(1, 5):
        clock.round_trip(second * S, second * S + 3 * S, second * S + round_trip_ms * MS)
        delays.settle(clock)
    return delays


@pytest.mark.parametrize("round_trip_ms", [0, 2, 4])
def test_an_answer_within_a_period_is_no_delay(round_trip_ms: int) -> None:
    delays = measured(0, round_trip_ms)
    assert delays.known is Delays(PERIOD_S).known or delays.known.total == 0.0
    assert delays.words(1.0) is None and delays.shortcoming(0.45) is None


@pytest.mark.parametrize("way_ms", [20, 50, 200])
def test_age_and_half_of_the_round_trip(way_ms: int) -> None:
    delays = measured(way_ms, 2 * way_ms + 4)
    assert delays.known.age == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.command == pytest.approx(way_ms * 1e-3, abs=2.1e-3)
    assert delays.known.unsteady == 0.0
    said = delays.words(0.5)
    assert said is not None and "loops at 50 %" in said.text
    assert delays.words(0.5) is None  # once
    assert delays.shortcoming(0.45) is None and delays.shortcoming(0.03) is not None


def test_it_is_another_one_only_after_a_change() -> None:
    delays, clock = Delays(PERIOD_S), ClockOffset()
    found = []
    for second in range(1, 40):
        delays.arrived(20 * MS + second % 2 * MS)
        clock.round_trip(second * S, 4 * S, second * S + 44 * MS + second % 3 * MS)
        delays.settle(clock)
        found.append(delays.known)
    assert all(each is found[0] for each in found)


@pytest.mark.parametrize(("age_ms", "refused"), [(200, False), (300, True)])
def test_before_any_round_trip_the_way_back_is_taken_to_be_as_late(age_ms: int, refused: bool) -> None:
    delays = Delays(PERIOD_S)
    delays.arrived(age_ms * MS)
    assert (delays.shortcoming(0.45) is not None) == refused
