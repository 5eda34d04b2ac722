"""How much larger obstacles are taken for, by how certain the vehicle is of its velocity."""

import numpy as np
import pytest

from companion.avoidance.drift_margin import DriftMargin
from protocol.arrays import Array


def variance(north: float, east: float = 0.0, down: float = 0.0) -> Array:
    """Of standard deviations."""
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


def test_a_large_one_is_told_once() -> None:
    drift = DriftMargin(2.0)
    assert drift.news() is None
    drift.follow(variance(0.05))
    assert drift.news() is None, "0.04 m"
    for _ in range(100):
        drift.follow(variance(0.13))
    news = drift.news()
    assert news is not None and "0.17 m larger" in news.text
    assert drift.news() is None
