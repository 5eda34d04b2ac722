"""Whole flights to goals that the route's height does not lead to."""

from pathlib import Path

import numpy as np

from protocol.arrays import Array, BoolArray
from studies.joined import Joined
from studies.worlds import Site
from tests.flights.short import SMALL_MAP, landing

GOAL = (12.0, 0.0)
HEIGHT = 4.9
"""m: 10 cm below the first height that is tried, over the route's 3 m."""


def inside(places: Array, half: float = 4.0) -> BoolArray:
    """(n,) of places (n, 2) or more: in the court."""
    result: BoolArray = (np.abs(places[:, 0] - GOAL[0]) < half) & (np.abs(places[:, 1]) < half)
    return result


def joined_to(folder: Path, height: object, *overrides: str, route_height: float = 3.0, half: float = 4.0) -> Joined:
    """To the middle of a court with walls on all four sides, over `height`."""
    north, east = GOAL
    court = [(north + half * a, east + half * b) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    walls = [
        {"name": f"wall {k}", "start": court[k], "end": court[(k + 1) % 4], "thickness": 0.3, "height": height}
        for k in range(4)
    ]
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}
    site = Site("court", {"name": "court", "origin": origin, "wall": walls}, (GOAL,), route_height)
    mission = site.mission(4.0, site.save(folder)[0])
    changes = (
        "avoidance.give_up_s=2.0",
        SMALL_MAP,
        *(f"avoidance.altitude_search.{each}" for each in overrides),
    )
    return Joined(mission, overrides=changes, remembers=False)


def test_over_the_walls_of_a_court_and_down_to_the_goal(tmp_path: Path) -> None:
    joined = joined_to(tmp_path, HEIGHT, "max_climb=8.0").fly(limit_s=150.0)
    summary = joined.vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and joined.autopilot.supervisor.fault is None
    assert np.hypot(summary.final_position_ned[0] - GOAL[0], summary.final_position_ned[1]) < 0.5
    path = joined.trace()["position_ned"]
    entered = np.flatnonzero(inside(path))[0]
    assert path[entered, 2] < -HEIGHT - 0.7
    assert summary.least_clearance_m is not None and summary.least_clearance_m > 0.3


def test_under_walls_that_hang(tmp_path: Path) -> None:
    joined = joined_to(tmp_path, [3.6, 12.0], "max_descent=4.0", route_height=6.0).fly(limit_s=150.0)
    summary = joined.vehicle.summary()
    assert summary.outcome == "landed" and summary.contacts == 0 and joined.autopilot.supervisor.fault is None
    assert np.hypot(summary.final_position_ned[0] - GOAL[0], summary.final_position_ned[1]) < 0.5


def test_heights_that_do_not_help_are_left_and_the_goal_given_up(tmp_path: Path) -> None:
    joined = joined_to(tmp_path, 30.0, "max_climb=4.0", half=2.5).fly(limit_s=150.0, until=landing)
    assert landing(joined) and joined.vehicle.summary().contacts == 0
    assert not inside(joined.trace()["position_ned"], 2.5).any()
    assert "given up" in (joined.autopilot.supervisor.fault or "")
    assert any("trying: 5.0 m" in text for text in joined.said)
    assert joined.trace()["position_ned"][:, 2].min() > -7.3, "no higher than allowed"
