"""A place is reached within what the vehicle's wander allows."""

import math

import msgspec
import numpy as np
import pytest

from companion.mission.navigator import Arrival
from companion.mission.plan import Phase
from companion.mission.wander import Wander
from studies.joined import Joined, mission_of
from tests.companion.mission.navigating import ALONG, at_step, target_of, vehicle
from vehicle_sim.physics.motion import Motion


def test_a_vehicle_that_follows_exactly_must_come_near() -> None:
    wander = Wander()
    for _ in range(5000):
        wander.add(np.full(6, 0.005))
    assert wander.distance(0.1) == 0.1 and wander.speed(0.2) == 0.2


def test_the_bounds_grow_with_the_wander_and_fall_again() -> None:
    wander, rng = Wander(), np.random.default_rng(1)
    for _ in range(10000):
        wander.add(rng.normal(size=6) * np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1]))
    assert wander.distance(0.1) == pytest.approx(2.5 * math.sqrt(3) * 0.05, rel=0.1)
    assert wander.speed(0.2) == pytest.approx(2.5 * math.sqrt(3) * 0.1, rel=0.1)
    for _ in range(10000):
        wander.add(np.zeros(6))
    assert wander.distance(0.1) == 0.1 and wander.speed(0.2) == 0.2


def test_the_take_off_is_no_wander() -> None:
    """Half a metre and 1 m/s behind for two seconds, and then as exactly as before."""
    wander = Wander()
    for step in range(5000):
        share = 1.0 if step < 500 else max(1.0 - (step - 500) / 250.0, 0.0)
        wander.add(share * np.array([0.1, 0.1, 0.5, 0.1, 0.1, 1.0]))
        assert wander.distance(0.1) == 0.1 and wander.speed(0.2) == 0.2


def test_who_still_climbs_has_not_taken_off() -> None:
    navigator = at_step(mission_of("hover"), Phase.TAKEOFF)
    for _ in range(700):
        navigator.tracked(np.array([0.0, 0.0, 0.3, 0.0, 0.0, 1.0]))
    climbing = vehicle(target_of(navigator), (0.0, 0.0, -0.5))
    assert navigator.advance(ALONG, climbing, 0) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(target_of(navigator)), 0) is not Arrival.NOT_YET


def test_a_manoeuvre_is_no_wander() -> None:
    """Errors of a hard turn widen the bounds only where the reference is at rest again."""
    navigator = at_step(mission_of("hover"), Phase.ROUTE)
    for _ in range(2000):
        navigator.tracked(np.array([0.3, 0.0, 0.0, 0.6, 0.0, 0.0]))
    passing = vehicle(target_of(navigator) + 0.15, (0.5, 0.0, 0.0))
    navigator.advance(ALONG, passing, 0)
    late = 60_000_000_000
    assert navigator.advance(ALONG, passing, late) is Arrival.NOT_YET, "it never arrived"
    navigator.advance(msgspec.structs.replace(ALONG, rests=True), passing, late)
    assert navigator.advance(ALONG, passing, 2 * late) is Arrival.DONE


def test_no_wander_makes_anything_an_arrival() -> None:
    wander = Wander()
    for _ in range(10000):
        wander.add(np.full(6, 10.0))
    assert wander.distance(0.1) == pytest.approx(0.5) and wander.speed(0.2) == pytest.approx(1.0)


def test_a_noisy_estimate_does_not_hold_the_mission_up() -> None:
    """The estimate wanders slowly by two decimetres, as a real one does: each step is done in the time that it takes
    without."""
    rng = np.random.default_rng(4)
    offset = np.zeros(3)
    joined = Joined(mission_of("hover"), overrides=('avoidance.method="none"',))
    estimator = joined.vehicle.estimator
    update = estimator.update

    def noisy(truth: Motion) -> tuple[Motion, Motion]:
        nonlocal offset
        offset = offset + 0.004 * (-offset / 1.0) + math.sqrt(2.0 * 0.004) * 0.15 * rng.normal(size=3)
        present, told = update(truth)
        north, east, down = (np.array(told.position_ned) + offset).tolist()
        return present, told._replace(position_ned=(north, east, down))

    estimator.update = noisy  # type: ignore[method-assign]
    joined.fly(limit_s=60.0)
    assert joined.autopilot.ended and joined.autopilot.supervisor.fault is None
