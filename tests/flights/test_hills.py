"""Over a hill to deliver on its top: heights count from the ground, which only the range finder shows."""

import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from companion.mission.plan import Delivery, Phase
from protocol.messages import dialect
from studies.faults.changes import missing
from studies.joined import Joined
from studies.worlds import Site

FOLLOWS = "avoidance.ground_slope=0.25"
SMALL_MAP = "avoidance.map.cells=192"
"""24 m."""
HILL = {"name": "hill", "center": [34.0, 0.0], "radius": 30.0, "height": 3.6}
TREES = [
    {"name": f"tree {k}", "center": [14.0 + 9.0 * k, 0.3 * (-1) ** k], "radius": 0.3, "height": 12.0} for k in range(2)
]
HEIGHT = 3.0


def joined_over(folder: Path, *overrides: str, lost_after_s: float | None = None) -> Joined:
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}
    site = Site("hill", {"name": "hill", "origin": origin, "hill": [HILL], "cylinder": TREES}, ((32.0, 0.0),), HEIGHT)
    mission = replace(site.mission(4.0, site.save(folder)[0]), delivery=Delivery(0.5), return_home=True)
    joined = Joined(mission, overrides=(SMALL_MAP, *overrides), remembers=False)
    if lost_after_s is not None:
        lose, after_ns = missing((dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR,)), round(lost_after_s * 1e9)
        joined.meddle = lambda now_ns, data: data if now_ns < after_ns else lose(now_ns, data)
    return joined


def test_the_flight_keeps_its_height_above_the_ground_and_delivers_on_the_hill(tmp_path: Path) -> None:
    joined, above = joined_over(tmp_path, FOLLOWS), {phase: list[float]() for phase in Phase}

    def watch(now: Joined) -> bool:
        place = np.array(now.vehicle.motion.position_ned)
        ground = now.vehicle.world.range_along(place, np.array((0.0, 0.0, 1.0)), 50.0)
        above[now.autopilot.navigator.phase].append(ground)
        return False

    summary = joined.fly(limit_s=120.0, until=watch).vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and summary.released
    for phase in (Phase.ROUTE, Phase.RETURN):
        assert min(above[phase]) > HEIGHT - 0.6 and max(above[phase]) < HEIGHT + 0.6
    assert min(above[Phase.RELEASE]) == pytest.approx(0.5, abs=0.15)


def test_a_hill_is_in_the_way_once_the_range_finder_is_lost(tmp_path: Path) -> None:
    """It is neither flown into nor over: the goal is given up in time, and the parcel comes home."""
    joined = joined_over(tmp_path, FOLLOWS, "avoidance.give_up_s=5", lost_after_s=8.5)
    summary = joined.fly(limit_s=200.0).vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and not summary.released
    assert math.dist(summary.final_position_ned[:2], (0.0, 0.0)) < 1.0
    assert any("the ground below is not seen any more" in line for line in joined.said)


def test_without_a_range_finder_the_flight_does_not_begin(tmp_path: Path) -> None:
    joined = joined_over(tmp_path, FOLLOWS, lost_after_s=0.0).fly(limit_s=5.0)
    assert not joined.vehicle.flight.armed
    assert "DISTANCE_SENSOR arrives at 0" in (joined.autopilot.supervisor.waiting_for or "")
