"""The sensors: what a perfect one would read, and the errors that their settings ask for."""

import itertools

import msgspec
import numpy as np
import pytest

from protocol.arrays import Array
from tests.vehicle_sim.estimation.flown_paths import hover, lemniscate, settings_of
from vehicle_sim.estimation import kalman
from vehicle_sim.sensors.settings import Wander
from vehicle_sim.sensors.suite import SensorSuite, as_row, gained, wanders
from vehicle_sim.timing import TICK_S


def test_the_angle_and_the_speed_gained_lead_from_one_motion_to_the_next() -> None:
    """Through every attitude, and exactly: the filter takes the same steps."""
    motions = [as_row(motion) for motion in lemniscate(5.0)]
    nominal, since, read = np.zeros(kalman.NOMINAL), np.zeros(kalman.SINCE), np.empty(6)
    nominal[:4], nominal[4:7], nominal[7:10] = motions[0][6:10], motions[0][:3], motions[0][3:6]
    for before, now in itertools.pairwise(motions):
        gained(before, now, read[:3], read[3:])
        kalman.predict(nominal, read, TICK_S, since)
    assert abs(nominal[:4] @ motions[-1][6:10]) == pytest.approx(1.0, abs=1e-12)
    assert nominal[4:7] == pytest.approx(motions[-1][:3], abs=1e-9)
    assert nominal[7:10] == pytest.approx(motions[-1][3:6], abs=1e-3), "a trapezoid's error"


def allan(rates: Array, ticks: int) -> Array:
    """Allan deviation of samples (n, axes) at so many ticks."""
    means = rates[: len(rates) // ticks * ticks].reshape(-1, ticks, rates.shape[1]).mean(axis=1)
    found: Array = np.sqrt(0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0))
    return found


def test_the_inertial_unit_s_noise_is_its_density() -> None:
    """Allan deviation at rest, at a time at which the noise outweighs the wander."""
    settings = settings_of("gnss")
    motion, *_ = hover(0.004)
    suite, row, reads = SensorSuite(settings, motion, np.random.default_rng(1)), as_row(motion), []
    for _ in range(60_000):
        suite.advance(row)
        reads.append(suite.gained / TICK_S)
    found = allan(np.array(reads), 25) * np.sqrt(25 * TICK_S)
    inertial = settings.inertial
    for axes, density in ((found[:3], inertial.gyro_noise), (found[3:], inertial.accelerometer_noise)):
        assert np.sqrt((axes**2).mean()) == pytest.approx(density, rel=0.05)


def test_wanders_keep_their_deviation_and_forget_in_their_time() -> None:
    settings = settings_of("gnss")
    motion, *_ = hover(0.004)
    suite = SensorSuite(settings, motion, np.random.default_rng(1))
    for each, keeps, walks in zip(wanders(settings), *suite.walk, strict=True):
        assert keeps ** (each.time_s / TICK_S) == pytest.approx(np.exp(-1.0))
        assert (keeps * each.deviation) ** 2 + walks**2 == pytest.approx(each.deviation**2)
    starts = np.array([SensorSuite(settings, motion, np.random.default_rng(seed)).errors for seed in range(400)])
    expected = np.array([each.deviation for each in wanders(settings)])
    expected[6:9] = 0.0
    assert starts.std(axis=0) == pytest.approx(expected, rel=0.15)


def test_an_imbalance_shakes_with_the_square_of_the_speed_and_carries_nowhere() -> None:
    """One rotor alone: a force that turns with it, whose integral over a tick is that of a sine."""
    settings, imbalance_m, deviations = settings_of("gnss"), 1e-6, []
    still = msgspec.structs.replace(settings.inertial, accelerometer_noise=0.0, accelerometer_bias=Wander(0.0, 1.0))
    quiet = msgspec.structs.replace(settings, inertial=still)
    motion, *_ = hover(0.004)
    for speed in (200.0, 400.0):
        suite, reads = SensorSuite(quiet, motion, np.random.default_rng(1), imbalance_m), []
        for _ in range(5000):
            suite.advance(as_row(motion), (0.0, speed, 0.0, 0.0))
            reads.append(suite.gained[3:5].copy())
        gains = np.array(reads)
        mean = imbalance_m * speed**2 * np.sinc(speed * TICK_S / (2.0 * np.pi)) / np.sqrt(2.0)
        assert gains.std(axis=0) / TICK_S == pytest.approx((mean, mean), rel=0.01)
        assert np.abs(gains.cumsum(axis=0)).max() <= 2.01 * imbalance_m * speed, "a circle's diameter"
        deviations.append(suite.vibration[1])
    assert deviations[1] > 2.0 * deviations[0] > 0.0


def test_it_saturates() -> None:
    settings = settings_of("gnss")
    narrow = msgspec.structs.replace(settings.inertial, gyro_range=0.1, accelerometer_range=5.0)
    motions = list(lemniscate(1.0))
    suite = SensorSuite(msgspec.structs.replace(settings, inertial=narrow), motions[0], np.random.default_rng(1))
    reads = []
    for motion in motions[1:]:
        suite.advance(as_row(motion))
        reads.append(np.abs(suite.gained) / TICK_S)
    most = np.max(reads, axis=0)
    assert most[2] == pytest.approx(0.1) and most[5] == pytest.approx(5.0)
