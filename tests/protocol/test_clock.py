"""Clocks: never backwards, and as fast as they say."""

import math
import time

import pytest

from protocol.clock import RealClock


def test_a_real_clock_starts_at_zero_and_never_goes_back() -> None:
    before_ns = time.monotonic_ns()
    clock = RealClock()
    times = [clock.now_ns() for _ in range(1000)]
    elapsed_ns = time.monotonic_ns() - before_ns
    assert times == sorted(times)
    assert times[0] >= 0
    assert times[-1] <= elapsed_ns
    assert all(isinstance(each, int) for each in times)


@pytest.mark.parametrize("factor", [0.1, 1.0, 7.5, 1000.0])
def test_a_factor_stretches_the_machines_time(factor: float) -> None:
    before_ns = time.monotonic_ns()
    clock = RealClock(factor)
    after_ns = time.monotonic_ns()
    while time.monotonic_ns() == after_ns:  # some time must pass for a factor to show
        pass
    earliest_ns = time.monotonic_ns() - after_ns
    now_ns = clock.now_ns()
    latest_ns = time.monotonic_ns() - before_ns
    assert earliest_ns * factor - 1 <= now_ns <= latest_ns * factor + 1
    assert now_ns > 0 or factor < 1.0


@pytest.mark.parametrize("factor", [0.5, 1.0, 20.0])
def test_waiting_is_in_the_walls_seconds(factor: float) -> None:
    clock = RealClock(factor)
    earlier_ns = clock.now_ns()
    wait_s = clock.wall_seconds_until(earlier_ns + 1_000_000_000_000)
    later_ns = clock.now_ns()
    assert (1e12 - (later_ns - earlier_ns)) * 1e-9 / factor - 1e-6 <= wait_s <= 1e12 * 1e-9 / factor + 1e-6
    assert clock.wall_seconds_until(earlier_ns - 5_000_000_000) <= -5.0 / factor


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_impossible_factors(factor: float) -> None:
    with pytest.raises(ValueError, match="times as fast"):
        RealClock(factor)
