"""Tracks where the beams of the rings change: another sensor's, or a driver's that measures them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.perception.tracks import Tracker
from companion.state import Scan
from protocol.frames import from_euler
from tests.companion.perception.test_tracks import PERIOD_NS, SETTINGS, Scene


@pytest.mark.parametrize(("beams", "first"), [(8, 0.0), (36, 0.0), (72, 0.3), (72, -0.3)])
def test_with_rings_of_another_sensor_all_tracks_begin_anew(beams: int, first: float) -> None:
    """Eighths tell nothing of what moves: a walker would stand where the ring before showed it, for ever."""
    scene = Scene()
    for k in range(40):
        scene.see([(2.0 - 1.4 * k / 15.0, 5.0)], yaw=math.pi / 2)
    assert scene.tracker.moving.size == 1
    bearings = first + np.linspace(0.0, 2.0 * math.pi, beams, endpoint=False)
    every = np.ones(beams, np.bool_)
    scan = Scan(40 * PERIOD_NS, 0, bearings, np.full(beams, 15.0), ~every, every)
    scene.tracker.add(scan, np.array([0.0, 0.0, -2.0]), from_euler(0.0, 0.0, math.pi / 2), -0.3)
    assert scene.tracker.tracks.size == 0


@pytest.mark.parametrize("turn", [0.0, 2.0 * math.pi])
def test_bearings_that_a_driver_measures_are_those_of_one_sensor(turn: float) -> None:
    """They differ a little from turn to turn of the LiDAR, and may be counted from another side."""
    scene, seen = Scene(), []
    for k in range(40):
        scan = scene.see([(2.0 - 1.4 * k / 15.0, 5.0)], yaw=math.pi / 2)
        seen.append(replace(scan, bearings_frd=scan.bearings_frd + (0.01 + turn if k % 2 else 0.0)))
    tracker = Tracker(SETTINGS)
    for scan in seen:
        tracker.add(scan, np.array([0.0, 0.0, -2.0]), from_euler(0.0, 0.0, math.pi / 2), -0.3)
    assert tracker.moving.size == 1
