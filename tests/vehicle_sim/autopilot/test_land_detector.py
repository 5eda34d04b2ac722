"""When the vehicle counts as landed, decided from single motions."""

import numpy as np
import pytest

from tests.vehicle_sim.foreign_pilot import AIRFRAME
from vehicle_sim.autopilot.land_detector import LANDED_AFTER_NS, LandDetector
from vehicle_sim.physics.motion import FEEDBACK, Motion
from vehicle_sim.physics.rigid_body import STATES
from vehicle_sim.timing import TICK_NS

FOOT_M = AIRFRAME.ground.foot_height_m
TICKS = LANDED_AFTER_NS // TICK_NS


def motion(tick: int, *, touching: bool, height_m: float = FOOT_M, speed: float = 0.0) -> Motion:
    state, feedback = np.zeros(STATES), np.zeros(1, FEEDBACK)
    state[2], state[3], state[6] = -height_m, speed, 1.0
    feedback["touching"] = float(touching)
    return Motion.of(tick * TICK_NS, state, feedback)


def landed_after(*, idle: bool = True, speed: float = 0.0, lost_at: int | None = None) -> int | None:
    """The tick of the landing of a vehicle that touches the ground from tick 0 on, but not at tick `lost_at`."""
    detector = LandDetector(FOOT_M)
    for tick in range(4 * TICKS):
        now = motion(tick, touching=tick != lost_at, speed=speed)
        if detector.update(now, landed=False, idle=idle):
            return tick
    return None


def test_half_a_second_of_rest_without_thrust_is_a_landing() -> None:
    assert landed_after() == TICKS


def test_thrust_or_speed_prevent_it() -> None:
    assert landed_after(idle=False) is None
    assert landed_after(speed=0.4) is None


def test_a_hop_starts_the_time_again() -> None:
    assert landed_after(lost_at=50) == 51 + TICKS


def test_a_landed_vehicle_is_in_the_air_once_its_feet_are_clear_of_the_ground() -> None:
    detector = LandDetector(FOOT_M)
    assert detector.update(motion(0, touching=True), landed=True, idle=False)
    assert detector.update(motion(1, touching=False, height_m=FOOT_M + 0.04), landed=True, idle=False)
    assert not detector.update(motion(2, touching=False, height_m=FOOT_M + 0.06), landed=True, idle=False)


@pytest.mark.parametrize("drift_m", [-0.8, 0.8])
def test_a_height_that_drifted_on_the_ground_makes_no_difference(drift_m: float) -> None:
    detector, stands_m = LandDetector(FOOT_M), FOOT_M + drift_m
    assert detector.update(motion(0, touching=True, height_m=stands_m), landed=True, idle=False)
    assert detector.update(motion(1, touching=False, height_m=stands_m + 0.04), landed=True, idle=False)
    assert not detector.update(motion(2, touching=False, height_m=stands_m + 0.06), landed=True, idle=False)
