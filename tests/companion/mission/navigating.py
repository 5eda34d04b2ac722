"""Navigators at a step of a mission, and vehicles to judge."""

from pathlib import Path

import numpy as np

from companion.mission import plan as missions
from companion.mission.navigator import Navigator
from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.reports import CommandReport, MotionReport
from companion.runtime.files import load_settings
from companion.state import VehicleState
from protocol.arrays import Array

ROOT = Path(__file__).resolve().parents[3]
MISSIONS = sorted(path.stem for path in (ROOT / "missions").glob("*.toml"))
SECOND = 1_000_000_000
START = np.array([5.0, -7.0, 1.5])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
ALONG = MotionReport(following=False, rests=False, track_start_ned=None, over_map=False)
ON_MAP = MotionReport(following=False, rests=False, track_start_ned=None, over_map=True)
ACCEPTED = CommandReport(True, 1, "accepted")
DEFAULTS = load_settings(None, [])
CURVE_S = 20.0
"""What a track takes here."""


def navigator_of(mission: Mission, *overrides: str) -> Navigator:
    """A mission at its beginning, with the vehicle at `START`."""
    navigator = before(mission, *overrides)
    navigator.begin(START)
    return navigator


def before(mission: Mission, *overrides: str) -> Navigator:
    steps = missions.steps(mission, np.zeros(3))
    durations = [None if step.curve is None else CURVE_S for step in steps]
    return Navigator(load_settings(None, list(overrides)), mission, durations)


def vehicle(place: Array, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> VehicleState:
    return VehicleState(0, np.asarray(place, np.float64), np.array(velocity), UPRIGHT, np.zeros(3), 0)


def target_of(navigator: Navigator) -> Array:
    target = navigator.step.target_ned
    assert target is not None
    return target


def at_step(mission: Mission, phase: Phase, *overrides: str) -> Navigator:
    """A mission at its first step of that phase."""
    navigator = navigator_of(mission, *overrides)
    while navigator.phase is not phase:
        navigator.next_step(0)
    return navigator


ROUTE = Mission(
    name="route",
    waypoints=[Waypoint(10.0, 0.0, 3.0), Waypoint(20.0, 5.0, 4.0, hold_s=2.0), Waypoint(40.0, 5.0, 3.0)],
    delivery=Delivery(),
    speed=4.0,
)
"""Through one waypoint, a stop of 2 s at another one, and a delivery at the last."""


def overdue(navigator: Navigator, seconds: float) -> float:
    return navigator.report(round(seconds * SECOND), flying=True).overdue
