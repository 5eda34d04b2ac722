"""The noise of a LiDAR's ranges, found out at rest."""

import math

import numpy as np
import pytest

from companion.config_avoidance import AvoidanceTracks
from companion.perception.range_noise import RangeNoise
from companion.perception.tracks import Tracker
from companion.state import Scan
from protocol.arrays import Array

UPRIGHT: Array = np.array([1.0, 0.0, 0.0, 0.0])
BEARINGS: Array = np.radians(5.0 * np.arange(72))
ALL = np.ones(72, np.bool_)


def room() -> Array:
    """(72,) m to the walls of a room of 12 m, from its middle."""
    return np.asarray(6.0 / np.maximum(np.abs(np.cos(BEARINGS)), np.abs(np.sin(BEARINGS))))


@pytest.mark.parametrize("sigma", [0.02, 0.1])
def test_it_is_what_changes_at_rest(sigma: float) -> None:
    """A few beams, as of who walks past, change little of it. All rings lie in the same memory."""
    noise, rng, ranges = RangeNoise(), np.random.default_rng(1), np.empty(72)
    for ring in range(20):
        ranges[:] = room() + sigma * rng.standard_normal(72)
        ranges[10:16] = 1.0 + 0.1 * ring
        noise.take(ranges, ALL, np.array([0.0, 0.0, -2.0]), UPRIGHT)
    assert noise.sigma_m == pytest.approx(sigma, rel=0.3)


def test_a_vehicle_that_moves_or_turns_tells_nothing_of_it() -> None:
    turned = [np.array([math.cos(0.01 * k), 0.0, 0.0, math.sin(0.01 * k)]) for k in range(20)]
    for places, attitudes in (
        ([np.array([0.1 * k, 0.0, -2.0]) for k in range(20)], [UPRIGHT] * 20),
        ([np.array([0.0, 0.0, -2.0])] * 20, turned),
    ):
        noise, rng = RangeNoise(), np.random.default_rng(1)
        for place, attitude in zip(places, attitudes, strict=True):
            noise.take(room() + 0.1 * rng.standard_normal(72), ALL, place, attitude)
        assert noise.sigma_m == 0.0


def test_few_beams_few_rings_and_other_rings_tell_nothing_of_it() -> None:
    noise, rng, here = RangeNoise(), np.random.default_rng(1), np.array([0.0, 0.0, -2.0])
    for count in (72, 36) * 10:
        noise.take(room()[:count] + 0.1 * rng.standard_normal(count), ALL[:count], here, UPRIGHT)
    for _ in range(20):
        noise.take(room() + 0.1 * rng.standard_normal(72), np.arange(72) < 7, here, UPRIGHT)
    for _ in range(5):  # the first one has none before it, of which all were seen
        noise.take(room() + 0.1 * rng.standard_normal(72), ALL, here, UPRIGHT)
    assert noise.sigma_m == 0.0


def test_a_noisy_room_stands() -> None:
    """Seen with 10 cm of noise, at rest and then in a flight along it, no piece of its walls moves."""
    tracker, rng = Tracker(AvoidanceTracks()), np.random.default_rng(4)
    moved = 0
    for ring in range(120):
        north = 0.05 * max(ring - 30, 0) - 2.0
        along, across = np.cos(BEARINGS), np.sin(BEARINGS)
        with np.errstate(divide="ignore"):
            ahead = np.where(along > 0.0, (6.0 - north) / along, (-6.0 - north) / along)
            ranges = np.minimum(ahead, np.abs(3.0 / across)) + 0.1 * rng.standard_normal(72)
        scan = Scan(ring * 66_000_000, ring * 66_000, BEARINGS, ranges, ALL, ALL)
        tracker.add(scan, np.array([north, 0.0, -2.0]), UPRIGHT, -0.6)
        moved += bool(tracker.moving.size)
    assert moved == 0
