"""The filter beside PX4's EKF2, on the sensors that PX4 v1.16.1 recorded in its SIH: a take-off and most of a circle at
4 m/s. `bench/estimator.py` compares them on any such log; this one is 20 s of it, every fifth estimate of EKF2."""

import gzip
from pathlib import Path

import pytest

from bench.estimator import ERRORS, OURS, compared

RECORDED = Path(__file__).with_name("px4_sih_circle.ulg.gz")


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    log = tmp_path_factory.mktemp("px4") / "circle.ulg"
    log.write_bytes(gzip.decompress(RECORDED.read_bytes()))
    return compared(log, "px4_sih")


@pytest.mark.parametrize("beliefs", [OURS, f"{OURS}, EKF2's noises"])
@pytest.mark.parametrize("error", ERRORS)
def test_it_is_as_near_to_the_truth(found: dict[str, list[float]], beliefs: str, error: str) -> None:
    at = ERRORS.index(error)
    assert found[beliefs][at] < 1.1 * found["EKF2"][at]


def test_what_the_simulation_is_told_of_the_noise_is_right(found: dict[str, list[float]]) -> None:
    """A filter that knows how noisy each sensor is does much better than one that believes otherwise."""
    ours, believing = found[OURS], found[f"{OURS}, EKF2's noises"]
    assert ours[ERRORS.index("level (m)")] < 0.75 * believing[ERRORS.index("level (m)")]
    assert ours[ERRORS.index("up (m)")] < 0.5 * believing[ERRORS.index("up (m)")]
