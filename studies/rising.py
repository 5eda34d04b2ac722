"""Ground that rises on the way, and low walls across it."""

import math

import numpy as np

from studies import flown
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report
from studies.worlds import Place, Site, Solids, make_disc, make_place, make_site, make_wall

NAME = "rising"
TITLE = "Hills and low walls"

_GOAL: Place = (40.0, 0.0)
_HALF_WIDTH = 15.0
_FREE_M = 2.5
_FOLLOWS = ("avoidance.ground_slope=0.25",)


def hills(seed: int, steepest: float = 0.2, density: float = 1 / 60) -> Site:
    """Three hills with slopes up to `steepest` at their feet, and trunks between and upon them."""
    rng = np.random.default_rng(seed)
    solids: Solids = {"hill": [], "cylinder": []}
    while len(solids["hill"]) < 3:
        radius, slope = float(rng.uniform(10.0, 30.0)), float(rng.uniform(0.5, 1.0)) * steepest
        north, east = float(rng.uniform(5.0, 45.0)), float(rng.uniform(-_HALF_WIDTH, _HALF_WIDTH))
        if math.hypot(north, east) < radius + _FREE_M:  # the vehicle takes off from flat ground
            continue
        height = radius * (math.sqrt(1.0 + slope**2) - 1.0) / slope
        solids["hill"].append({"center": make_place(north, east), "radius": radius, "height": height})
    for _ in range(rng.poisson(density * 2.0 * _HALF_WIDTH * 60.0)):
        north, east = float(rng.uniform(-10.0, 50.0)), float(rng.uniform(-_HALF_WIDTH, _HALF_WIDTH))
        if min(math.hypot(north, east), math.dist((north, east), _GOAL)) > _FREE_M:
            solids["cylinder"].append(make_disc(north, east, 0.3) | {"height": 20.0})
    return make_site("hills", seed, solids, _GOAL)


def low_walls(seed: int) -> Site:
    """Three walls, lower than the flight by more than the hull, across all of the way."""
    rng = np.random.default_rng(seed)
    rows = np.cumsum(rng.uniform(8.0, 11.0, 3))
    walls = [
        make_wall((float(north), -40.0), (float(north), 40.0), 0.3, round(float(height), 2))
        for north, height in zip(rows, rng.uniform(0.6, 1.6, 3), strict=True)
    ]
    return make_site("low_walls", seed, {"wall": walls}, _GOAL)


SETUPS = (
    Setup("hills", "hills of up to 20 %, trunks on them", hills, (3.0, 5.0), 60.0, 50, overrides=_FOLLOWS),
    Setup("walls", "walls of 0.6-1.6 m", low_walls, (3.0, 5.0), 60.0, 50, overrides=_FOLLOWS),
)
FLOORS = (Floor("hills", 0.95), Floor("walls", 0.95))


def run(report: Report) -> None:
    report.text("")
    flown.picture(report, SETUPS)
    fly_and_tell(report, SETUPS, FLOORS)
