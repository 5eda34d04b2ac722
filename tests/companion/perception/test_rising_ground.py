"""Which returns are ground that rises: the same in the map, in the tracks and in what the other methods get."""

import numpy as np
import pytest

from companion.config_avoidance import AvoidanceMap, AvoidanceTracks
from companion.perception.map_view import OCCUPIED
from companion.perception.rolling_map import RollingMap
from companion.perception.scans import obstacle_points
from companion.perception.tracks import Tracker
from companion.state import Scan
from protocol.arrays import Array

HERE, LEVEL = np.array([0.0, 0.0, -3.0]), np.array([1.0, 0.0, 0.0, 0.0])
LOWEST = -0.5
"""m, NED: 2.5 m below the scan."""


def scan_of(time_ns: int, away: float) -> Scan:
    """One beam ahead that returns from so far away (m), at the height of the vehicle."""
    hit = np.zeros(72, np.bool_)
    hit[0] = True
    bearings: Array = np.radians(5.0 * np.arange(72))
    return Scan(time_ns, 0, bearings, np.where(hit, away, 15.0), hit, np.ones(72, np.bool_))


@pytest.mark.parametrize(("slope", "away", "ground"), [(0.0, 9.0, False), (0.3, 8.0, False), (0.3, 9.0, True)])
def test_a_return_is_the_ground_s_below_a_line_that_rises_with_the_slope(
    slope: float, away: float, ground: bool
) -> None:
    tracker, rolling = Tracker(AvoidanceTracks()), RollingMap(AvoidanceMap(), 0.36)
    for k in range(4):
        scan = scan_of(k * 66_000_000, away)
        tracker.add(scan, HERE, LEVEL, LOWEST, slope)
        rolling.add(scan, HERE, LEVEL, LOWEST, slope=slope)
    view = rolling.view(4 * 66_000_000)
    assert (len(obstacle_points(scan_of(0, away), HERE, LEVEL, LOWEST, slope)) == 0) is ground
    assert (tracker.tracks.size == 0) is ground
    assert bool(np.any(view.states == OCCUPIED)) is not ground


def test_the_layer_of_the_map_goes_with_the_ground() -> None:
    """The vehicle climbs by 4 m: with the ground what it saw is kept, above flat ground it is not."""
    for rises, kept in ((True, True), (False, False)):
        rolling = RollingMap(AvoidanceMap(), 0.36)
        for k in range(40):
            climb = 0.1 * k
            scan = scan_of(k * 66_000_000, 6.0)
            if k > 5:
                scan = Scan(scan.time_ns, 0, scan.bearings_frd, scan.ranges_m, scan.hit & False, scan.known & False)
            rolling.add(scan, HERE - (0.0, 0.0, climb), LEVEL, LOWEST - rises * climb)
        assert bool(np.any(rolling.view(40 * 66_000_000).states == OCCUPIED)) is kept
