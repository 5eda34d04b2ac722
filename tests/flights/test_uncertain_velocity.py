"""A gap of 0.9 m, for a hull of 0.72 m on sensors by which the vehicle's velocity is off by 0.07 m/s (RMS)."""

import math
from pathlib import Path

import pytest

from companion.supervision.states import State
from studies import worlds
from studies.joined import Joined

SEED, SPEED, PAST_THE_WALL_S = 1, 3.0, 25.0


@pytest.mark.parametrize("heeded", [False, True])
def test_what_is_too_narrow_for_an_uncertain_vehicle_is_not_entered(heeded: bool, tmp_path: Path) -> None:
    site = worlds.gap(SEED)
    world, _ = site.save(tmp_path)
    overrides = () if heeded else ("avoidance.velocity_error_s=0",)
    sensors = ('estimator.sensors="px4_sih"',)
    joined = Joined(site.mission(SPEED, world), overrides=overrides, seed=SEED, vehicle_overrides=sensors)
    joined.fly(limit_s=PAST_THE_WALL_S, until=lambda flying: flying.vehicle.summary().contacts > 0)
    summary = joined.vehicle.summary()
    told = [line for line in joined.said if "velocity is uncertain" in line]
    if not heeded:
        assert summary.least_clearance_m is not None and summary.least_clearance_m < 0.05 and not told
        assert math.dist(joined.vehicle.motion.position_ned[:2], site.goal) < 2.0, "it is through the gap, by luck"
        return
    assert told, joined.said
    assert summary.contacts == 0 and summary.least_clearance_m is not None and summary.least_clearance_m > 0.03
    assert joined.autopilot.supervisor.state is State.FLY
    assert math.dist(joined.vehicle.motion.position_ned[:2], site.goal) > 10.0, "it is before the wall still"
