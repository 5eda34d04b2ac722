"""A parcel is to be released where something stands that the LiDAR does not see from above."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from companion.mission.plan import Delivery, Phase
from studies.joined import Joined
from studies.worlds import Site
from tests.flights.short import returning

HIGH = 1.2
"""m: what stands there."""
KEEP_OUT = 0.7


def flown(folder: Path, *overrides: str) -> tuple[Joined, float]:
    """To a table with a parcel; the flight, and the least height above its top on the way down and up."""
    table = {"name": "table", "center": [8.0, 0.0], "size": [1.5, 1.5], "height": HIGH}
    origin = {"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_m": 488.0}
    site = Site("table", {"name": "table", "origin": origin, "box": [table]}, ((8.0, 0.0),), 3.0)
    mission = replace(site.mission(4.0, site.save(folder)[0]), delivery=Delivery(0.5), return_home=True)
    joined, lowest = Joined(mission, overrides=overrides, remembers=False), [9.0]

    def watch(now: Joined) -> bool:
        if now.autopilot.navigator.phase in (Phase.DESCEND, Phase.RELEASE, Phase.CLIMB):
            lowest.append(-now.vehicle.motion.position_ned[2] - HIGH)
        return returning(now)

    return joined.fly(limit_s=120.0, until=watch), min(lowest)


def test_the_descent_ends_above_it_and_the_parcel_is_released_there(tmp_path: Path) -> None:
    joined, lowest = flown(tmp_path)
    summary = joined.vehicle.summary()
    assert returning(joined) and summary.contacts == 0 and summary.released
    assert lowest == pytest.approx(KEEP_OUT, abs=0.05)
    (said,) = (line for line in joined.said if "stands below" in line)
    assert said.endswith("something stands below: the descent ends 0.7 m above it")


def test_without_it_the_vehicle_descends_onto_it(tmp_path: Path) -> None:
    joined, _ = flown(tmp_path, "avoidance.keep_out_below=0.0")
    assert joined.vehicle.summary().contact_with == "table"
