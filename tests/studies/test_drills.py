"""The flights that a search for failures is measured on."""

import numpy as np
import pytest

from studies import drills
from studies.campaigns.search import Chooser
from studies.drills import DRILLS, WEATHER
from studies.worlds import HULL

CALM = dict.fromkeys(WEATHER, 0.0) | {"lag": 1.0}


def values(**changes: tuple[float, ...]) -> dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]:
    """Two flights in calm air, or as they are changed."""
    given = {name: (value, value) for name, value in CALM.items()} | changes
    return {name: np.array(each) for name, each in given.items()}


@pytest.fixture
def without_gusts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drills, "GUST_N", 0.0)


def test_a_gate_is_alike_on_both_sides(without_gusts: None) -> None:
    flights = values(across=(4.0, -4.0), speed=(3.0, 3.0), width=(4.0, 4.0))
    left, right = DRILLS["gate"].clearance(flights, np.array([1, 2]))
    # the rotors turn another way on either side
    assert left == pytest.approx(right, abs=1e-4) and 0.3 < left < 2.0 - HULL


def test_a_wind_towards_the_post_takes_what_one_away_from_it_gives(without_gusts: None) -> None:
    flights = values(across=(2.0, -2.0), speed=(3.0, 3.0), aside=(2.5, 2.5))
    towards, away = DRILLS["post"].clearance(flights, np.array([1, 2]))
    assert towards < 2.5 - 0.3 - HULL < away and 0.5 * (towards + away) == pytest.approx(2.5 - 0.3 - HULL, abs=0.01)


def test_who_is_told_later_stops_so_much_nearer_to_the_wall(without_gusts: None) -> None:
    flights = values(speed=(4.0, 4.0), sight=(10.0, 10.0), late=(0.0, 0.25))
    soon, late = DRILLS["wall"].clearance(flights, np.array([1, 2]))
    assert 0.0 < late < soon < 10.0 - HULL


@pytest.mark.parametrize("name", DRILLS)
def test_gusts_are_those_of_the_seed(name: str) -> None:
    drill = DRILLS[name]
    middle = {key: np.full(3, 0.5 * (low + high)) for key, (low, high) in drill.ranges.items()}
    found = drill.clearance(middle, np.array([7, 8, 7]))
    assert found[0] == found[2] != found[1]


@pytest.mark.parametrize("sampler", ["cma", "random"])
def test_a_search_asks_the_same_again(sampler: str) -> None:
    ranges = DRILLS["gate"].ranges
    choosers = [Chooser(ranges, sampler, 5) for _ in range(2)]
    for _ in range(3):
        first, second = (chooser.ask() for chooser in choosers)
        assert first == second and all(set(found) == set(ranges) for found, _ in first)
        assert all(low <= found[name] <= high for found, _ in first for name, (low, high) in ranges.items())
        for chooser in choosers:
            chooser.tell([found["width"] for found, _ in first])
