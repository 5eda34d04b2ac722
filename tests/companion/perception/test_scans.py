"""Returns as points in the world."""

import math

import numpy as np
import pytest

from companion.perception.scans import obstacle_points
from companion.state import Scan
from protocol.arrays import Array
from protocol.frames import from_euler


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
