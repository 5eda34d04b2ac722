"""Which time stamps are those of the vehicle's clock, and when it was set."""

import random

import pytest

from companion.link.stamps import TOLERANCE_MS, Stamps

MS = 1_000_000


class Vehicle:
    """Attitudes every 4 ms, which arrive after a delay (ms)."""

    def __init__(self, start_ms: int = 90_000) -> None:
        self.stamps, self.now_ns, self.clock_ms = Stamps(), 0, start_ms
        self.delay_ms = 20

    def run(self, count: int, delay_ms: int = 20, wrong_ms: int = 0) -> list[int | None]:
        """What is made of so many attitudes, whose stamps are wrong by so much."""
        found = []
        self.now_ns += max(delay_ms - self.delay_ms, 0) * MS  # nothing arrives meanwhile
        self.clock_ms += max(delay_ms - self.delay_ms, 0)
        self.delay_ms = delay_ms
        for _ in range(count):
            self.now_ns, self.clock_ms = self.now_ns + 4 * MS, self.clock_ms + 4
            stamp_ms = (self.clock_ms + wrong_ms - delay_ms) % 2**32
            found.append(self.stamps.attitude(stamp_ms, self.now_ns, flies=True))
        return found


@pytest.mark.parametrize("start_ms", [90_000, 2**32 - 500])
@pytest.mark.parametrize("wrong_ms", [4000, 200, -500, -80_000])
@pytest.mark.parametrize("count", [1, 3, 12])
def test_a_few_wrong_stamps_are_refused_and_nothing_else(start_ms: int, wrong_ms: int, count: int) -> None:
    vehicle = Vehicle(start_ms)
    assert vehicle.run(100) == [0] * 100
    assert vehicle.run(count, wrong_ms=wrong_ms) == [None] * count
    assert vehicle.run(100) == [0] * 100


@pytest.mark.parametrize("wrong_ms", [4000, 300, -500, -80_000])
def test_wrong_stamps_that_go_on_show_that_the_clock_was_set(wrong_ms: int) -> None:
    vehicle = Vehicle()
    vehicle.run(100)
    found = vehicle.run(100, wrong_ms=wrong_ms)
    assert found[:12] == [None] * 12 and found.count(None) <= 14, "within 60 ms"
    assert [each for each in found if each] == [wrong_ms] and found[-1] == 0
    assert vehicle.run(1, wrong_ms=wrong_ms + 4000) == [None], "the clock that it is now"
    found = vehicle.run(100)
    assert [each for each in found if each] == [-wrong_ms], "it is set back"


def test_with_jitter_a_clock_that_was_set_is_seen_as_soon() -> None:
    vehicle, generator = Vehicle(), random.Random(18)
    vehicle.run(100)
    found = [vehicle.run(1, delay_ms=generator.randrange(20, 60), wrong_ms=4000)[0] for _ in range(40)]
    (set_by_ms,) = filter(None, found)
    assert set_by_ms == pytest.approx(4000, abs=80) and found.count(None) < 20


@pytest.mark.parametrize("delay_ms", [0, 150, 600])
def test_a_link_that_changes_sets_no_clock(delay_ms: int) -> None:
    vehicle = Vehicle()
    vehicle.run(100)
    assert vehicle.run(200, delay_ms=delay_ms) == [0] * 200
    assert vehicle.run(200) == [0] * 200


def test_messages_that_overtake_one_another_set_no_clock() -> None:
    vehicle, generator = Vehicle(), random.Random(18)
    vehicle.run(10)
    for _ in range(2000):
        assert vehicle.run(1, delay_ms=generator.randrange(5, 105)) == [0]


@pytest.mark.parametrize("ppm", [-150, 150])
def test_clocks_that_drift_apart_are_followed(ppm: int) -> None:
    vehicle = Vehicle()
    for second in range(7200):
        vehicle.now_ns, vehicle.clock_ms = second * 10**9, 90_000 + second * 1000 + ppm * second // 1000
        assert vehicle.run(1) == [0]
    assert vehicle.run(1, wrong_ms=TOLERANCE_MS + 30) == [None]


def test_positions_are_measured_by_the_clock_of_the_attitudes() -> None:
    vehicle = Vehicle()
    assert vehicle.stamps.believes(5, 0), "no clock is known yet"
    vehicle.run(100)
    now_ms = vehicle.clock_ms
    assert vehicle.stamps.believes(now_ms, vehicle.now_ns) and vehicle.stamps.believes(now_ms - 900, vehicle.now_ns)
    assert not vehicle.stamps.believes(now_ms + 4000, vehicle.now_ns)


def test_on_the_ground_a_clock_that_falls_back_is_believed_at_once() -> None:
    vehicle = Vehicle()
    vehicle.run(10)
    assert vehicle.stamps.attitude(100, vehicle.now_ns + 4 * MS, flies=False) == 0
