"""The estimator: as wrong as it says, and no more."""

import math
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from protocol.arrays import Array
from studies.joined import Joined, mission_of
from tests.vehicle_sim.estimation.flown_paths import hover, lemniscate, settings_of
from vehicle_sim.estimation.estimator import OUTPUT_S, Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.faults import Failure
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.sensors.suite import SensorSuite
from vehicle_sim.timing import TICK_S

SEEDS = 10
FREE = ("avoidance.method=none",)
PATHS = {"hover": hover, "lemniscate": lemniscate}


def estimator_of(settings: SensorSettings, seed: int, start: Motion) -> Estimator:
    noise, alignment = np.random.default_rng(seed).spawn(2)
    return Estimator(SensorSuite(settings, start, noise), 0.0, start, alignment)


@lru_cache
def path(name: str, duration_s: float) -> tuple[Motion, ...]:
    return tuple(PATHS[name](duration_s))


def wrong(estimator: Estimator) -> Array:
    """From the estimate to the truth, in the order of the filter's errors (9,)."""
    error = estimator.error
    turned = 2.0 * math.copysign(1.0, error[6]) * error[7:10]
    return -np.concatenate((turned, error[3:6], error[:3]))


def squared(estimator: Estimator) -> float:
    """The error measured by its covariance (NEES)."""
    error = wrong(estimator)
    return float(error @ np.linalg.solve(estimator.covariance[:9, :9], error))


FARTHEST_M = {"gnss": 0.5, "rtk": 0.05, "vio": 1.0}
"""After 75 m of way."""


@pytest.mark.parametrize(
    ("level", "name"), [("gnss", "lemniscate"), ("rtk", "lemniscate"), ("vio", "lemniscate"), ("gnss", "hover")]
)
def test_it_is_as_wrong_as_it_says(level: str, name: str) -> None:
    """After a quarter of a minute the errors of ten vehicles have the squares that their covariances say."""
    motions, settings = path(name, 15.0), settings_of(level)
    ends = []
    for seed in range(SEEDS):
        estimator = estimator_of(settings, seed, motions[0])
        for motion in motions[1:]:
            estimator.update(motion)
        ends.append(squared(estimator))
        assert np.linalg.norm(wrong(estimator)[6:8]) < FARTHEST_M[level]
    low, high = chi2.ppf((0.025 / 4, 1.0 - 0.025 / 4), 9 * SEEDS)  # 5 % over all four
    assert low < sum(ends) < high


def test_without_fixes_it_drifts_and_says_so_and_comes_back() -> None:
    settings = settings_of("gnss")
    assert settings.gnss is not None
    gnss = msgspec.structs.replace(settings.gnss, outages_s=[(10.0, 15.0)])
    motions = path("lemniscate", 30.0)
    estimator = estimator_of(msgspec.structs.replace(settings, gnss=gnss), 3, motions[0])
    said = {}
    for motion in motions[1:]:
        estimator.update(motion)
        if motion.time_ns in (10_000_000_000, 15_000_000_000, 20_000_000_000):
            said[motion.time_ns // 1_000_000_000] = estimator.deviations[0]
            assert squared(estimator) < chi2.ppf(0.999, 9)
    assert said[15] > 2.0 * said[10] and said[20] < 0.7 * said[15]


def test_one_wild_fix_is_refused() -> None:
    motions = path("hover", 12.0)
    estimator = estimator_of(settings_of("gnss"), 1, motions[0])
    fix = estimator.suite.fix
    wild = (9_000_000_000, 9_200_000_000)

    def meddled(time_ns: int) -> object:
        found = fix(time_ns)
        assert found is not None
        return found._replace(position_ned=found.position_ned + 20.0) if time_ns == wild[0] else found

    estimator.suite.fix = meddled  # type: ignore[method-assign, assignment]
    ratios = []
    for motion in motions[1:]:
        estimator.update(motion)
        if wild[0] <= motion.time_ns < wild[1]:
            ratios.append(estimator.fix_ratios.max())
        assert np.linalg.norm(wrong(estimator)[6:]) < 1.0
    assert max(ratios) > 25.0


def test_its_innovations_are_as_large_as_it_says() -> None:
    """The squares of fixes', fields' and heights' innovations over their variances (NIS), once they have settled."""
    motions, settings = path("lemniscate", 15.0), settings_of("gnss")
    check_innovations(motions, settings, {6: [], 3: [], 1: []})


def test_the_innovations_of_poses_are_as_large_as_it_says() -> None:
    """Three of each, the velocities' are none."""
    ends = []
    for seed in range(4):
        motions, settings = path("lemniscate", 15.0), settings_of("vio")
        estimator = estimator_of(settings, seed, motions[0])
        last = estimator.fix_ratios
        for motion in motions[1:]:
            estimator.update(motion)
            if estimator.fix_ratios is not last and motion.time_ns > 5_000_000_000:
                assert not estimator.fix_ratios[3:].any()
                ends.append(float(estimator.fix_ratios.sum()))
            last = estimator.fix_ratios
    low, high = chi2.ppf((0.001, 0.999), 3 * len(ends))
    assert len(ends) > 1000 and low < sum(ends) < high


def check_innovations(motions: tuple[Motion, ...], settings: SensorSettings, seen: dict[int, list[float]]) -> None:
    for seed in range(4):
        estimator = estimator_of(settings, seed, motions[0])
        last: list[Array] = []
        for motion in motions[1:]:
            estimator.update(motion)
            ratios = [estimator.fix_ratios, estimator.field_ratios, estimator.height_ratios]
            if last and motion.time_ns > 5_000_000_000:
                for new, old in zip(ratios, last, strict=True):
                    if new is not old:
                        seen[len(new)].append(float(new.sum()))
            last = ratios
    for freedom, squares in seen.items():
        low, high = chi2.ppf((0.001, 0.999), freedom * len(squares))
        assert low < sum(squares) < high, freedom


def test_after_long_without_a_fix_it_believes_the_next_one() -> None:
    """A receiver that is wrong by 20 m is refused for seven seconds; then the position jumps, and a counter says so."""
    motions = path("lemniscate", 18.0)
    estimator = estimator_of(settings_of("gnss"), 3, motions[0])
    jumps = []
    for motion in motions[1:]:
        estimator.suite.positioning.failure = Failure.WRONG if motion.time_ns > 10_000_000_000 else Failure.OK
        before = estimator.reset_counter
        estimator.update(motion)
        if estimator.reset_counter != before:
            jumps.append(motion.time_ns * 1e-9)
        if 1_000_000_000 < motion.time_ns < 17_000_000_000:
            assert np.linalg.norm(wrong(estimator)[6:8]) < 3.0
            late = motion.time_ns - 10_000_000_000
            assert estimator.position_lost is (late > 5_000_000_000) or 4_900_000_000 < late < 5_200_000_000
    assert len(jumps) == 1 and jumps[0] == pytest.approx(17.1, abs=0.25)
    assert not estimator.position_lost
    error = wrong(estimator)
    assert error[6:9] == pytest.approx((-20.0, -20.0, -20.0), abs=3.0), "it flies on by what it is told"


def test_the_jump_leaves_a_filter_that_is_consistent() -> None:
    """Reset to a healthy fix from anywhere, it errs as it says."""
    motions, ends = path("lemniscate", 15.0), []
    for seed in range(SEEDS):
        estimator = estimator_of(settings_of("gnss"), seed, motions[0])
        for motion in motions[1:]:
            if motion.time_ns == 10_000_000_000:
                estimator.nominal[7:10] += 300.0
                estimator._taken_ns = 0
            estimator.update(motion)
        assert estimator.reset_counter == 1
        ends.append(squared(estimator))
    low, high = chi2.ppf((0.001, 0.999), 9 * SEEDS)
    assert low < sum(ends) < high


def test_what_it_tells_goes_over_to_a_correction_and_jumps_at_a_reset_alone() -> None:
    """The filter is corrected by centimetres at a fix. What is told moves as its own velocity says, and 1.5 s after the
    last correction it is what the filter has."""
    motions, settings, outage = path("lemniscate", 15.0), settings_of("gnss"), round(6.0 / TICK_S)
    estimator = estimator_of(settings, 3, motions[0])
    sensors = estimator.suite.positioning, estimator.suite.barometer, estimator.suite.magnetometer
    told, filtered, away = [], [], []
    for motion in motions[1:]:
        if motion.time_ns > 6_000_000_000:
            for sensor in sensors:
                sensor.failure = Failure.OFF
        present, _ = estimator.update(motion)
        told.append([*present.position_ned, *present.velocity_ned])
        filtered.append(np.concatenate((estimator.nominal[7:10], estimator.nominal[4:7])))
        away.append(np.abs(told[-1] - filtered[-1]).max())
    rows, filter_rows = np.array(told)[:outage], np.array(filtered)[:outage]
    steps = np.diff(rows[:, :3], axis=0) - TICK_S * rows[1:, 3:]
    filter_steps = np.diff(filter_rows[:, :3], axis=0) - TICK_S * filter_rows[1:, 3:]
    assert np.abs(filter_steps).max() > 0.05 and np.abs(steps).max() < 0.002
    between = np.abs(filter_steps).max(axis=1) < 2e-4
    assert between.mean() > 0.5
    assert steps[between] == pytest.approx((TICK_S / OUTPUT_S * (filter_rows - rows)[:-1, :3])[between], abs=2e-4)
    jerks, filter_jerks = (np.abs(np.diff(each[:, 3:], n=2, axis=0)).max() for each in (rows, filter_rows))
    assert filter_jerks > 0.05 and jerks < 0.2 * filter_jerks
    assert max(away[:outage]) > 0.01 and max(away[outage + round(1.5 / TICK_S) :]) < 1e-3
    estimator.nominal[7:10] += 300.0
    estimator._taken_ns = 0
    for sensor in sensors:
        sensor.failure = Failure.OK
    later = iter(path("lemniscate", 16.0)[round(15.0 / TICK_S) + 1 :])
    while not estimator.reset_counter:
        present, _ = estimator.update(next(later))
    assert present.position_ned == tuple(estimator.nominal[7:10])


def test_the_same_seed_errs_the_same() -> None:
    motions = path("hover", 2.0)
    ends = []
    for seed in (1, 1, 2):
        estimator = estimator_of(settings_of("gnss"), seed, motions[0])
        for motion in motions[1:]:
            present, _ = estimator.update(motion)
        ends.append(present)
    assert ends[0] == ends[1] != ends[2]


def test_an_odometry_drifts_with_its_way_and_not_at_rest() -> None:
    """And the filter says so: it has nothing else to go by."""
    said, erred = {}, {}
    for name in PATHS:
        motions = path(name, 15.0)
        ends = []
        for seed in range(SEEDS):
            estimator = estimator_of(settings_of("vio"), seed, motions[0])
            for motion in motions[1:]:
                estimator.update(motion)
            ends.append(estimator.suite.errors[6:9].copy())
        said[name], erred[name] = estimator.deviations[0], float(np.std(ends))
    assert erred["hover"] == 0.0 and said["hover"] < 0.05
    assert erred["lemniscate"] == pytest.approx(0.03 * math.sqrt(75.0), rel=0.3)
    assert said["lemniscate"] == pytest.approx(math.sqrt(2.0) * 0.03 * math.sqrt(75.0), rel=0.2)


def test_after_an_outage_an_odometry_s_next_pose_is_where_it_is() -> None:
    settings, motions = settings_of("vio"), path("hover", 20.0)
    assert settings.vio is not None
    vio = msgspec.structs.replace(settings.vio, outages_s=[(2.0, 12.0)])
    estimator = estimator_of(msgspec.structs.replace(settings, vio=vio), 1, motions[0])
    for motion in motions[1:]:
        estimator.update(motion)
        if motion.time_ns == 11_000_000_000:
            assert estimator.position_lost
            estimator.nominal[7:9] += 50.0
    assert not estimator.position_lost and estimator.reset_counter == 1
    assert np.linalg.norm(wrong(estimator)[6:9]) < 0.1
    assert np.linalg.norm(wrong(estimator)[3:6]) < 0.2


@pytest.mark.parametrize("level", ["gnss", "rtk", "vio"])
def test_a_companion_flies_on_it(level: str) -> None:
    sensors = (f'estimator.sensors="{level}"',)
    joined = Joined(mission_of("hover"), overrides=FREE, vehicle_overrides=sensors, remembers=False).fly()
    assert joined.autopilot.supervisor.fault is None and joined.vehicle.summary().outcome == "landed"
    trace = joined.trace()
    true = np.array(joined.truths)[np.array(joined.trace_ticks), :3]
    apart = np.linalg.norm(true - trace["position_ned"], axis=1)
    assert 0.001 < apart.max() < {"gnss": 1.5, "rtk": 0.15, "vio": 0.3}[level]


def silenced(table: Any) -> Any:
    """A table of a sensor file without any noise, wander or drift."""
    if not isinstance(table, dict):
        return table
    quiet = ("noise", "gyro_noise", "accelerometer_noise", "position_noise", "velocity_noise", "deviation", "drift")
    none = {key: [0.0, 0.0] if isinstance(table[key], tuple | list) else 0.0 for key in quiet if key in table}
    return {key: silenced(value) for key, value in table.items()} | none


@pytest.mark.parametrize("level", ["gnss", "vio"])
def test_sensors_without_any_noise_are_flown_on(level: str) -> None:
    settings = msgspec.convert(silenced(msgspec.to_builtins(settings_of(level))), SensorSettings)
    motions = path("lemniscate", 20.0)
    estimator = estimator_of(settings, 1, motions[0])
    for motion in motions[1:]:
        estimator.update(motion)
    assert all(math.isfinite(each) for each in estimator.deviations)
    assert np.abs(estimator.error[:6]).max() < 0.1
