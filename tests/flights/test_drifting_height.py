"""The vehicle's estimate of its height drifts on a low flight among walkers: a leaning scan shows the ground where none
should be, and no farther than it."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from companion.mission.plan import Delivery, Phase
from companion.supervision.states import State
from studies import worlds
from studies.joined import Joined
from studies.worlds import Site
from tests.flights.short import SMALL_MAP
from vehicle_sim.estimation.delayed_truth import DelayedTruth
from vehicle_sim.physics.motion import Motion

SEED, SPEED, LIMIT_S = 2, 5.0, 30.0
FROM_S, RATE, MOST_M = 8.0, 0.3, 1.1


class Drifting(DelayedTruth):
    """The truth, but for the height that is told: from some time on it rises though the vehicle does not."""

    from_s = FROM_S

    def update(self, truth: Motion) -> tuple[Motion, Motion]:
        present, told = super().update(truth)
        drifted = min(max(RATE * (1e-9 * told.time_ns - self.from_s), 0.0), MOST_M)
        climb = RATE if 0.0 < drifted < MOST_M else 0.0
        (north, east, down), (vn, ve, vd) = told.position_ned, told.velocity_ned
        return present, told._replace(position_ned=(north, east, down - drifted), velocity_ned=(vn, ve, vd - climb))


@pytest.mark.parametrize("heeded", [False, True])
def test_the_range_finder_shows_how_low_it_is(heeded: bool, tmp_path: Path) -> None:
    site = worlds.street(SEED)
    world, _ = site.save(tmp_path)
    overrides = () if heeded else ("trajectory.height_drift=0",)
    joined = Joined(site.mission(SPEED, world), overrides=overrides, seed=SEED)
    joined.vehicle.estimator = Drifting(0.0, joined.vehicle.motion)

    def ended(now: Joined) -> bool:
        return now.vehicle.summary().contacts > 0 or now.autopilot.supervisor.state is State.LAND

    joined.fly(limit_s=LIMIT_S, until=ended)
    told = [line for line in joined.said if "nearer than the vehicle's height says" in line]
    if not heeded:
        assert joined.vehicle.summary().contacts == 1 and not told
        return
    assert joined.vehicle.summary().contacts == 0 and joined.autopilot.supervisor.state is State.LAND
    assert len(told) == 1
    height = -joined.vehicle.motion.position_ned[2]
    assert site.height - 0.4 < height < site.height, "but for what there is room for"
    navigator, rings = joined.autopilot.navigator, joined.autopilot.sensing.ring_check
    assert rings.ground_down == navigator.lowest_return < navigator.ground_down - 1.0, "rings are judged by it, too"


def test_a_parcel_is_released_as_low_as_asked(tmp_path: Path) -> None:
    """Flat ground that seems to be higher than that of the start is nothing that stands there."""
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}
    site = Site("flat", {"name": "flat", "origin": origin}, ((20.0, 0.0),), 3.0)
    mission = replace(site.mission(4.0, site.save(tmp_path)[0]), delivery=Delivery(0.5))
    joined = Joined(mission, overrides=(SMALL_MAP,), remembers=False)
    joined.vehicle.estimator = drifting = Drifting(0.0, joined.vehicle.motion)
    drifting.from_s = 5.0
    joined.fly(limit_s=60.0, until=lambda now: now.autopilot.navigator.phase is Phase.CLIMB)
    released = joined.vehicle.summary().released_at_ned
    assert released is not None and 0.2 < -released[2] < 0.75
    assert not any("stands below" in line for line in joined.said)
