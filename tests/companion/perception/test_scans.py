"""Scans assembled from sectors; returns as points in the world."""

import math

import numpy as np
import pytest

from companion.perception.scans import SectorScanAssembler, obstacle_points
from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import from_euler


def test_a_scan_is_complete_or_ends_where_the_next_one_begins() -> None:
    assembler = SectorScanAssembler(8)
    for sector in (0, 2, 4):
        assert assembler.add(sector, 1.0 + sector, True, True, 100, 5) is None
    scan = assembler.add(0, 9.0, False, True, 200, 6)
    assert scan is not None and scan.boot_time_us == 100_000 and scan.time_ns == 6
    assert scan.known.tolist() == [True, False] * 2 + [True] + [False] * 3
    assert scan.ranges_m[[0, 2, 4]].tolist() == [1.0, 3.0, 5.0]
    assert scan.bearings_frd[2] == pytest.approx(np.pi / 2)
    whole = [assembler.add(sector, 2.0, True, True, 200, 7) for sector in range(1, 8)]
    assert whole[:-1] == [None] * 6 and whole[-1] is not None
    assert whole[-1].known.all() and not whole[-1].hit[0] and whole[-1].hit[1:].all()


def test_returns_are_points_in_the_world_without_the_ground() -> None:
    """Heading east, nose down: the beam ahead meets the ground, the one to the right is south, level."""
    bearings: Array = np.radians([0.0, 90.0, 180.0])
    everything = np.ones(3, np.bool_)
    scan = Scan(0, 0, bearings, np.array([8.0, 3.0, 5.0]), np.array([True, True, False]), everything)
    pitch, here = -math.radians(20.0), np.array([1.0, 2.0, -3.0])
    attitude = from_euler(0.0, pitch, math.pi / 2)
    (point,) = obstacle_points(scan, here, attitude, -0.3)
    assert point == pytest.approx([-2.0, 2.0, -3.0])
    ahead, aside = obstacle_points(scan, here, attitude, 1.0)
    assert ahead == pytest.approx([1.0, 2.0 + 8.0 * math.cos(pitch), -3.0 - 8.0 * math.sin(pitch)])
    assert aside == pytest.approx(point)
