"""Places of the other studies by what the vehicle senses of itself: the truth, or what its filter makes of sensors."""

import dataclasses

from studies import enclosed, forest, moving, narrow
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report

NAME = "estimated"
TITLE = "On sensors with an estimator"

LEVELS = ("perfect", "rtk", "gnss")
PLACES = {
    "forest25": (forest.SETUPS, 5.0, 100, (*LEVELS, "vio")),
    "gap": (narrow.SETUPS, 5.0, 20, LEVELS),
    "corridor": (enclosed.SETUPS, 3.0, 20, LEVELS),
    "crossing": (moving.SETUPS, 6.0, 40, LEVELS),
}
"""By the set-up's name: where it is from, commanded speed (m/s), seeds, levels."""
SUCCESS = 0.98


def _sensing(name: str, level: str) -> Setup:
    setups, speed, seeds, _ = PLACES[name]
    of_place = next(setup for setup in setups if setup.name == name)
    return dataclasses.replace(
        of_place,
        name=f"{name}-{level}",
        title=f"{of_place.title}, {level}",
        speeds=(speed,),
        seeds=seeds,
        vehicle_overrides=(*of_place.vehicle_overrides, f'estimator.sensors="{level}"'),
    )


SETUPS = tuple(_sensing(name, level) for name, (_, _, _, levels) in PLACES.items() for level in levels)
FLOORS = (Floor("forest25-gnss", SUCCESS), Floor("forest25-vio", SUCCESS))


def run(report: Report) -> None:
    report.text(
        """
The vehicle of the other sections knows where it is. Here it estimates that from its sensors, and its map and its way go
with what it believes ([vehicle-sim.md](vehicle-sim.md#sensors-and-the-estimator)): `perfect` is the truth, `rtk` a
receiver that is corrected by a base station, `gnss` one that is not and wanders by 0.4 m each way, `vio` cameras that
drift. The LiDAR is of the true place. Contacts, clearances and whether the goal was reached are true, too.
"""
    )
    fly_and_tell(report, SETUPS, FLOORS)
