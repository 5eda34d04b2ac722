"""The study of tracking on sensors: what its figures are made of, and some of its flights."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from studies.sensed import BESIDE_M, CENTRES_M, FLOORS_M, WRONG_M, plan, sag, wrong
from studies.tracks import Flight, Tracked, fly


def brief(flight: Flight, laps: float = 1.5) -> Flight:
    """The same, lower and for fewer laps."""
    return replace(flight, shape=msgspec.structs.replace(flight.shape, laps=laps), height=6.0)


def test_the_sag_is_that_of_the_thrust() -> None:
    """Which goes with the square of the voltage."""
    assert sag(Tracked(0.5, 0.6, 0.3, 0.4, 0.9, 0.0, None, np.empty(0), np.empty((0, 3)))) == pytest.approx(0.19)


def test_on_a_corrected_receiver_the_vehicle_keeps_to_centimetres() -> None:
    tracked = fly(brief(plan("default", "circle", 4.0, "rtk", 1)))
    assert tracked.fault is None and tracked.told_rmse_m < tracked.rmse_m < FLOORS_M["rtk", 4.0]
    other = fly(brief(plan("the paper's laws", "circle", 4.0, "rtk", 1)))
    assert other.told_rmse_m > 3.0 * tracked.told_rmse_m


def test_on_the_truth_what_is_told_is_true() -> None:
    tracked = fly(brief(plan("default", "circle", 4.0, "perfect", 1), 1.0))
    assert abs(tracked.told_rmse_m - tracked.rmse_m) < 0.0005


def test_on_a_receiver_it_errs_as_its_estimator_does() -> None:
    tracked = fly(brief(plan("default", "lemniscate", 8.0, "gnss", 2), 3.0))
    assert tracked.fault is None and tracked.rmse_m - tracked.estimate_rmse_m < BESIDE_M
    assert tracked.estimate_rmse_m > 3.0 * tracked.told_rmse_m


@pytest.mark.parametrize("centre", CENTRES_M)
def test_all_at_once(centre: str) -> None:
    tracked = fly(brief(wrong(centre, "+30 %", 1), 3.0))
    assert tracked.fault is None and tracked.told_rmse_m < WRONG_M and sag(tracked) > 0.15
