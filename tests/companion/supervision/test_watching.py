"""A vehicle in its own failsafe: whether it comes down, and whether others have taken it."""

import numpy as np
import pytest

from companion.state import FlightMode, VehicleState, VehicleStatus
from companion.supervision.watching import Descent

SECOND = 1_000_000_000
FAILSAFE = VehicleStatus(FlightMode.MANUAL, True, True)


def at(north: float, height: float) -> VehicleState:
    return VehicleState(0, np.array([north, 0.0, -height]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)


def still_after(descent: Descent, status: VehicleStatus, places: list[tuple[float, float]]) -> float:
    """Looked at once a second."""
    found = 0.0
    for second, place in enumerate(places):
        found = descent.watch(status, True, at(*place), second * SECOND).still
    return found


def test_sinking_is_progress_and_hovering_is_none() -> None:
    assert still_after(Descent(), FAILSAFE, [(0.0, 10.0 - 0.7 * k) for k in range(12)]) <= 1.0
    assert still_after(Descent(), FAILSAFE, [(0.0, 3.0 + 0.3 * (-1) ** k) for k in range(21)]) == pytest.approx(19.0)
    assert still_after(Descent(), FAILSAFE, [(0.0, 3.0 + 0.7 * k) for k in range(21)]) == pytest.approx(20.0)


@pytest.mark.parametrize(("mode", "moves"), [(FlightMode.RETURN, True), (FlightMode.HOLD, False)])
def test_flying_home_is_progress_and_drifting_is_none(mode: FlightMode, moves: bool) -> None:
    still = still_after(Descent(), VehicleStatus(mode, True, True), [(100.0 - 3.0 * k, 10.0) for k in range(21)])
    assert still == pytest.approx(0.0 if moves else 20.0)


def test_without_telemetry_nothing_comes_nearer() -> None:
    descent = Descent()
    descent.watch(FAILSAFE, False, None, 0)
    assert descent.watch(FAILSAFE, False, None, 7 * SECOND).still == pytest.approx(7.0)


def test_a_mode_that_follows_the_failsafe_is_others() -> None:
    descent, pilot = Descent(), VehicleStatus(FlightMode.HOLD, True, False)
    assert not descent.watch(FAILSAFE, True, None, 0).taken_over
    assert not descent.watch(VehicleStatus(FlightMode.LAND, True, True), True, None, 1).taken_over
    assert not descent.watch(VehicleStatus(FlightMode.LAND, True, False), True, None, 2).taken_over, "its own, cleared"
    assert not descent.watch(VehicleStatus(FlightMode.EXTERNAL, True, False), True, None, 3).taken_over
    assert not descent.watch(pilot, False, None, 4).taken_over, "not current"
    assert descent.watch(pilot, True, None, 5).taken_over
