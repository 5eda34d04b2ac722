"""Among walkers, 2 m above the ground, with a drag for which the vehicle leans by 31 degrees at 6 m/s: the scan meets
the ground 2.5 m ahead then."""

from pathlib import Path

import pytest

from companion.supervision.states import State
from studies import worlds
from studies.joined import Joined

SEED, SPEED, LIMIT_S = 2, 6.0, 30.0
DRAG = ("body.drag_kg_s=[1.3, 1.3, 1.3]",)


@pytest.mark.parametrize("heeded", [False, True])
def test_who_is_seen_late_is_met_unless_the_vehicle_is_slower(heeded: bool, tmp_path: Path) -> None:
    site = worlds.street(SEED)
    world, _ = site.save(tmp_path)
    overrides = () if heeded else ("avoidance.guard.sight_s=0",)
    joined = Joined(site.mission(SPEED, world), overrides=overrides, seed=SEED, vehicle_overrides=DRAG)

    def ended(now: Joined) -> bool:
        return now.vehicle.summary().contacts > 0 or now.autopilot.supervisor.state is State.LAND

    joined.fly(limit_s=LIMIT_S, until=ended)
    assert joined.vehicle.summary().contacts == (0 if heeded else 1)
    assert (joined.autopilot.supervisor.state is State.LAND) == heeded
