"""Whole flights to goals that can not be reached: they are given up."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.mission.plan import Delivery
from studies.joined import Joined, mission_of
from studies.worlds import make_site, make_wall
from tests.flights.short import SMALL_MAP

COURIER = mission_of("courier")


@pytest.mark.parametrize("back", [True, False])
def test_a_goal_without_progress_is_given_up(back: bool, tmp_path: Path) -> None:
    """VFH+ alone circles around a goal that is walled in; it comes home as it went, with the parcel. Without return it
    lands there."""
    corners = [(8.5, -1.5), (11.5, -1.5), (11.5, 1.5), (8.5, 1.5)]
    walls = [make_wall(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    site = make_site("closed", 1, {"wall": walls}, (10.0, 0.0))
    mission = msgspec.structs.replace(
        site.mission(4.0, site.save(tmp_path)[0]), return_home=back, delivery=Delivery(0.5) if back else None
    )
    overrides = ('avoidance.method="vfh"', "avoidance.give_up_s=3.0", SMALL_MAP)
    joined = Joined(mission, overrides=overrides, remembers=False).fly(limit_s=100.0)
    summary = joined.vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and not summary.released
    assert ("given up" if back else "landing") in (joined.autopilot.supervisor.fault or "")
    assert joined.trace()["position_ned"][:, 0].max() > 12.0, "it was behind the walls"
    north, east, _ = summary.final_position_ned
    assert np.hypot(north, east) < 0.3 if back else north > 5.0


def test_no_progress_ends_in_a_landing() -> None:
    """A goal inside an obstacle: it holds before it, and lands when the step is overdue."""
    waypoint = msgspec.structs.replace(COURIER.waypoints[0], north=12.0, east=0.2)  # within the lamp's post
    mission = msgspec.structs.replace(COURIER, waypoints=[waypoint], delivery=None)
    joined = Joined(mission, overrides=("supervision.step_timeout=5.0", SMALL_MAP)).fly()
    assert joined.vehicle.summary().outcome == "landed" and joined.vehicle.summary().contacts == 0
    assert "no progress" in (joined.autopilot.supervisor.fault or "")
