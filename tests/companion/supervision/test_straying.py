"""A vehicle that leaves its reference for good, told from one that comes back to it or stays beside it."""

import math
from collections.abc import Iterable

import numpy as np
import pytest

from companion.supervision.straying import Straying

LIMIT = 3.0
DT = 0.004
TIME = np.arange(0.0, 5.0, DT)


def strayed(distances: Iterable[float]) -> float:
    """m from the reference when the vehicle first strays, in any direction; 0 if it never does."""
    straying = Straying(LIMIT)
    for distance in distances:
        straying.look(np.array([0.6 * distance, -0.8 * distance, 0.0]))
        if straying.strayed:
            return straying.strayed
    return 0.0


@pytest.mark.parametrize("speed", [0.1, 1.0, 10.0, 100.0])
def test_who_goes_on_away_strays_from_twice_the_distance_on(speed: float) -> None:
    assert strayed(speed * np.arange(0.0, 10.0 / speed, DT)) == pytest.approx(2.0 * LIMIT, abs=3.0 * speed * DT)


@pytest.mark.parametrize(
    "distances",
    [
        40.0 * np.exp(-TIME) * np.abs(np.cos(TIME)),
        np.maximum(5.9 - 5.0 * np.exp(-TIME), 0.0),
        5.0 + 0.9 * np.sin(3.0 * TIME),
        np.where(TIME < 2.0, 0.0, 20.0 * np.exp(2.0 - TIME)),
        np.where(TIME < 2.0, 4.0, 20.0 * np.exp(2.0 - TIME)),
    ],
    ids=["step", "steady error", "gusts about one", "reset of the estimate", "step from a steady error"],
)
def test_who_comes_back_or_stays_does_not(distances: Iterable[float]) -> None:
    assert strayed(distances) == 0.0


def test_who_swings_ever_farther_strays() -> None:
    swinging = 0.1 * np.exp(TIME) * np.abs(np.sin(TIME))
    assert 2.0 * LIMIT < strayed(swinging) < 2.1 * LIMIT


def test_what_others_fly_and_what_came_before_does_not_count() -> None:
    straying = Straying(LIMIT)
    for distance in (*np.arange(0.0, 5.9, 0.1), math.nan, 5.9, 6.8, 7.7, 8.6):
        straying.look(None if math.isnan(distance) else np.array([0.0, 0.0, distance]))
        assert straying.strayed == 0.0
    straying.look(np.array([0.0, 0.0, 9.0]))
    assert straying.strayed == 9.0
    straying.look(None)
    assert straying.strayed == 0.0


def test_that_the_reference_waits_is_said_once_after_two_seconds() -> None:
    straying, said = Straying(LIMIT), []
    for now in range(0, 20_000_000_000, 4_000_000):
        waits = 1.0 <= now * 1e-9 < 2.9 or now * 1e-9 >= 5.0  # first for less than two seconds
        news = straying.news(0.98 if waits else 1.0, now)
        said += [] if news is None else [now * 1e-9]
    assert said == [pytest.approx(7.0, abs=0.01)]
