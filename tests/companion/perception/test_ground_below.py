"""The plane of the ground, by a range finder that looks down from a vehicle that flies and tilts over known slopes."""

import math

import numpy as np
import pytest

from companion.perception.ground_below import GroundBelow
from companion.reports import RangeBelow
from companion.state import Ground
from protocol.frames import from_euler, to_world

PERIOD_NS = 66_000_000
SLOPE = np.array((-0.2, 0.05))
"""Down over north and east: the ground rises to the north."""


def ground_at(ahead: float) -> float:
    """Under the vehicle's way."""
    return 1.0 + float(SLOPE[0]) * ahead


def flown(
    speed: float, tilt_deg: float = 0.0, noise_m: float = 0.0, *, eastward: bool = False
) -> tuple[Ground | None, float, int]:
    """3 m up the slope, nodding by up to `tilt_deg`, or eastward and rolling up one that rises to the east; the ground,
    how far the vehicle has come, and the time."""
    below, rng = GroundBelow(), np.random.default_rng(1)
    slope, height = SLOPE[::-1] if eastward else SLOPE, 3.0
    ahead, now_ns = 0.0, 0
    for k in range(40):
        ahead, now_ns = speed * k * PERIOD_NS * 1e-9, k * PERIOD_NS
        place = np.array((*(0.0, ahead)[:: 1 if eastward else -1], ground_at(ahead) - height))
        tilt = math.radians(tilt_deg) * math.sin(0.9 * k)
        attitude = from_euler(-tilt, 0.0, 0.0) if eastward else from_euler(0.0, tilt, 0.0)
        beam = np.array(to_world(attitude, (0.0, 0.0, 1.0)))
        # down + d beam_down = 1 + slope (north + d beam_north, ...)
        distance = height / (beam[2] - float(slope @ beam[:2]))
        below.take(RangeBelow(0, distance + noise_m * rng.standard_normal()), (place, attitude), now_ns)
    return below.ground(now_ns), ahead, now_ns


@pytest.mark.parametrize("eastward", [False, True])
@pytest.mark.parametrize("tilt_deg", [0.0, 20.0, 40.0])
def test_the_ground_here_and_ahead_is_that_of_the_slope_however_the_vehicle_tilts(
    tilt_deg: float, eastward: bool
) -> None:
    ground, way, _ = flown(5.0, tilt_deg, eastward=eastward)
    assert ground is not None
    assert ground.here == pytest.approx(ground_at(way), abs=0.1)
    assert ground.ahead == pytest.approx(ground_at(way + 5.0), abs=0.25)


def test_of_ground_that_falls_nothing_is_foretold() -> None:
    ground, way, _ = flown(-5.0)
    assert ground is not None and ground.ahead == ground.here == pytest.approx(ground_at(way), abs=0.1)


def test_noise_at_rest_is_no_slope() -> None:
    ground, _, _ = flown(0.0, noise_m=0.03)
    assert ground is not None
    assert ground.here == pytest.approx(1.0, abs=0.03) and ground.ahead == pytest.approx(ground.here, abs=0.02)


def test_what_stands_counts_once_it_was_seen_twice() -> None:
    below, level = GroundBelow(), from_euler(0.0, 0.0, 0.0)
    place = np.array((0.0, 0.0, -3.0))
    for k in range(10):
        below.take(RangeBelow(0, 3.0), (place, level), k * PERIOD_NS)
    below.take(RangeBelow(0, 1.5), (place, level), 10 * PERIOD_NS)
    assert below.ground(10 * PERIOD_NS) == pytest.approx(Ground(0.0, 0.0))
    below.take(RangeBelow(0, 1.5), (place, level), 11 * PERIOD_NS)
    assert below.ground(11 * PERIOD_NS) == pytest.approx(Ground(-1.5, -1.5))


def test_what_is_old_or_out_of_reach_or_askew_is_not_known() -> None:
    below, level = GroundBelow(), from_euler(0.0, 0.0, 0.0)
    place = np.array((0.0, 0.0, -3.0))
    assert below.ground(0) is None
    for k in range(4):
        below.take(RangeBelow(0, 3.0), (place, level), k * PERIOD_NS)
    later_ns = 3 * PERIOD_NS + 1_100_000_000
    below.take(RangeBelow(0, math.inf), (place, level), later_ns)
    for _ in range(2):
        below.take(RangeBelow(0, 3.0), (place, from_euler(math.radians(50.0), 0.0, 0.0)), later_ns)
    below.take(RangeBelow(0, 3.0), None, later_ns)
    assert below.ground(3 * PERIOD_NS) is not None and below.ground(later_ns) is None


def test_a_beam_that_meets_the_vehicle_itself_is_never_believed() -> None:
    below, level = GroundBelow(), from_euler(0.0, 0.0, 0.0)
    for k in range(20):
        now_ns = k * PERIOD_NS
        below.take(RangeBelow(0, 0.3), (np.array((0.0, 0.0, -0.1 * k)), level), now_ns)
        assert below.ground(now_ns) is None
