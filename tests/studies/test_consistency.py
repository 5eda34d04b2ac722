"""The study of the estimator's consistency: that it looks at what flew, and a short part of it."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import chi2

from studies.consistency import (
    FLOORS_M,
    HOVER,
    LEMNISCATE,
    STATES,
    Flown,
    Plan,
    averages,
    band,
    fly,
    freedom,
    watch,
)

SEEDS = tuple(range(1, 9))


@lru_cache
def flown(level: str, flight: str, watched_s: float) -> tuple[Plan, Flown]:
    plan = Plan(level, flight, SEEDS, watched_s)
    return plan, fly(plan)


def test_the_band_holds_as_many_averages_as_it_says() -> None:
    low, high = band(3, 50)
    drawn = np.random.default_rng(1).chisquare(3, (20_000, 50)).mean(axis=1) / 3.0
    assert ((low < drawn) & (drawn < high)).mean() == pytest.approx(0.95, abs=0.005)


def test_nothing_is_told_in_the_outage_alone() -> None:
    ticks = range(0, 7500, 5)
    silent = [tick for tick in ticks if Plan("gnss", LEMNISCATE, SEEDS).silent(tick)]
    assert (silent[0], silent[-1], len(silent)) == (2500, 3745, 250)
    assert not any(Plan("gnss", HOVER, SEEDS).silent(tick) for tick in ticks)


@pytest.mark.parametrize(("level", "flight"), [("gnss", LEMNISCATE), ("rtk", HOVER)])
def test_the_flight_s_own_seed_repeats_its_estimate_to_the_bit(level: str, flight: str) -> None:
    plan, path = flown(level, flight, 6.0)
    assert path.fault is None and len(path.motions) > path.begin + 1500
    assert watch(plan, path, SEEDS[0]).position_ned.tolist() == path.position_ned.tolist()


@pytest.mark.parametrize(("level", "flight"), [("gnss", LEMNISCATE), ("rtk", HOVER)])
def test_errors_and_innovations_are_as_large_as_it_says(level: str, flight: str) -> None:
    """The averages over few seeds and a short time, inside of 99.9 % bands."""
    plan, path = flown(level, flight, 6.0)
    watched = [watch(plan, path, seed) for seed in plan.seeds]
    for name, found in averages(level, watched).items():
        degrees = len(SEEDS) * freedom(level, name)
        low, high = chi2.ppf((0.0005, 0.9995), degrees) / degrees
        assert low < found.mean < high, name
        assert len(found.over_flights) >= (30 if name in STATES else 29)
    level_m = np.array([each.level_m[:, 1] for each in watched])
    assert 0.001 < np.sqrt((level_m**2).mean()) < FLOORS_M[level]
