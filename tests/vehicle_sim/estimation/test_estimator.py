"""The estimator: as wrong as it says, and no more."""

import math
from functools import lru_cache

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from protocol.arrays import Array
from studies.joined import Joined, mission_of
from tests.vehicle_sim.estimation.flown_paths import hover, lemniscate, settings_of
from vehicle_sim.estimation.estimator import Estimator
from vehicle_sim.physics.motion import Motion
from vehicle_sim.sensors.faults import Failure
from vehicle_sim.sensors.settings import SensorSettings
from vehicle_sim.sensors.suite import SensorSuite

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


@pytest.mark.parametrize(("level", "name"), [("gnss", "lemniscate"), ("rtk", "lemniscate"), ("gnss", "hover")])
def test_it_is_as_wrong_as_it_says(level: str, name: str) -> None:
    """After a quarter of a minute the errors of ten vehicles have the squares that their covariances say."""
    motions, settings = path(name, 15.0), settings_of(level)
    ends = []
    for seed in range(SEEDS):
        estimator = estimator_of(settings, seed, motions[0])
        for motion in motions[1:]:
            estimator.update(motion)
        ends.append(squared(estimator))
        assert np.linalg.norm(wrong(estimator)[6:8]) < (0.5 if level == "gnss" else 0.05)
    low, high = chi2.ppf((0.025, 0.975), 9 * SEEDS)
    assert low < sum(ends) < high


def test_without_fixes_it_drifts_and_says_so_and_comes_back() -> None:
    settings = settings_of("gnss")
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
    seen: dict[int, list[float]] = {6: [], 3: [], 1: []}
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
        estimator.suite.gnss.failure = Failure.WRONG if motion.time_ns > 10_000_000_000 else Failure.OK
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


def test_the_same_seed_errs_the_same() -> None:
    motions = path("hover", 2.0)
    ends = []
    for seed in (1, 1, 2):
        estimator = estimator_of(settings_of("gnss"), seed, motions[0])
        for motion in motions[1:]:
            present, _ = estimator.update(motion)
        ends.append(present)
    assert ends[0] == ends[1] != ends[2]


@pytest.mark.parametrize("level", ["gnss", "rtk"])
def test_a_companion_flies_on_it(level: str) -> None:
    sensors = (f'estimator.sensors="{level}"',)
    joined = Joined(mission_of("hover"), overrides=FREE, vehicle_overrides=sensors, remembers=False).fly()
    assert joined.autopilot.supervisor.fault is None and joined.vehicle.summary().outcome == "landed"
    trace = joined.trace()
    true = np.array(joined.truths)[np.array(joined.trace_ticks), :3]
    apart = np.linalg.norm(true - trace["position_ned"], axis=1)
    assert 0.001 < apart.max() < (1.5 if level == "gnss" else 0.15)
