"""How much larger obstacles are taken for, by how certain the vehicle is of its velocity."""

import numpy as np
import pytest

from companion.avoidance.drift_margin import DriftMargin
from protocol.arrays import Array


def variance(north: float, east: float = 0.0, down: float = 0.0) -> Array:
    """The variances (3,) that belong to standard deviations (m/s)."""
    return np.square((north, east, down))


@pytest.mark.parametrize(
    ("told", "margin"),
    [
        (variance(0.0), 0.0),  # nothing is said
        (variance(0.03), 0.0),
        (variance(0.08), 0.1),
        (variance(0.02, 0.13), 0.2),
        (variance(0.0, 0.0, 1.0), 0.0),  # the map is flat
        (variance(5.0), 0.3),
    ],
)
def test_it_is_what_the_larger_of_both_deviations_exceeds_the_room_by(told: Array, margin: float) -> None:
    assert DriftMargin(2.0).follow(told) == pytest.approx(margin)
    assert DriftMargin(0.0).follow(told) == 0.0


def test_it_follows_over_seconds() -> None:
    drift = DriftMargin(2.0)
    assert drift.follow(variance(0.03)) == 0.0
    followed = [drift.follow(variance(0.13)) for _ in range(640)]
    assert followed[0] < 0.01 and followed[43] == pytest.approx(0.1, rel=0.02)
    assert followed == sorted(followed) and followed[-1] == pytest.approx(0.2, rel=1e-3)


def test_a_large_one_is_told_and_told_again_where_it_grows() -> None:
    drift = DriftMargin(2.0)
    assert drift.news() is None
    told = []
    for deviation in (0.05, 0.07, 0.13, 0.08, 0.13):
        for _ in range(1000):
            drift.follow(variance(deviation))
            news = drift.news()
            told += [] if news is None else [news.text.partition("taken for ")[2]]
    assert told == ["0.05 m larger", "0.08 m larger", "0.11 m larger", "0.17 m larger"]
