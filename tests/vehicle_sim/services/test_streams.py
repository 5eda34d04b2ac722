"""The schedule of the streams: intervals in whole ticks, on common multiples."""

import pytest

from vehicle_sim.services.streams import TICK_US, Schedule


def ticks_of(schedule: Schedule, message_id: int, ticks: range) -> list[int]:
    return [tick for tick in ticks if message_id in schedule.due(tick)]


@pytest.mark.parametrize("interval_us", [1, TICK_US, 2 * TICK_US, 5 * TICK_US + 3])
def test_a_stream_is_due_at_the_multiples_of_its_interval(interval_us: int) -> None:
    schedule = Schedule({7: (0, 0)})
    assert schedule.set_interval(7, interval_us)
    every = max(1, interval_us // TICK_US)
    assert ticks_of(schedule, 7, range(1, 200)) == list(range(every, 200, every))
    assert schedule.interval_us(7) == every * TICK_US


def test_a_later_change_keeps_common_multiples() -> None:
    """So that two messages with one interval travel together, whenever each was asked for."""
    schedule = Schedule({1: (6 * TICK_US, 0), 2: (0, 0)})
    assert ticks_of(schedule, 1, range(1, 8)) == [6]
    schedule.set_interval(2, 6 * TICK_US)
    assert [schedule.due(tick) for tick in range(8, 13)] == [[], [], [], [], [1, 2]]


def test_off_default_least_and_unknown() -> None:
    schedule = Schedule({1: (10 * TICK_US, 4 * TICK_US)})
    assert schedule.set_interval(1, -1) and schedule.interval_us(1) == -1
    assert ticks_of(schedule, 1, range(1, 50)) == []
    assert schedule.set_interval(1, TICK_US) and schedule.interval_us(1) == 4 * TICK_US
    assert schedule.set_interval(1, 0) and schedule.interval_us(1) == 10 * TICK_US
    assert not schedule.set_interval(1, -2) and not schedule.set_interval(2, 0)
    assert schedule.interval_us(2) == 0


@pytest.mark.parametrize("ticks", [2**31 // TICK_US, 2**31 // TICK_US + 1, 10**9])
def test_an_interval_of_more_than_36_minutes_is_kept_and_told_as_the_longest(ticks: int) -> None:
    """MESSAGE_INTERVAL has an int32 of microseconds."""
    schedule = Schedule({1: (ticks * TICK_US, ticks * TICK_US)})
    assert schedule.interval_us(1) == min(ticks * TICK_US, 2**31 - 1)
    assert [schedule.due(tick) for tick in (ticks - 1, ticks)] == [[], [1]]
