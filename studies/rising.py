"""Ground that rises on the way, and low walls across it."""

import math
from functools import partial

import numpy as np

from studies import flown, style
from studies.campaign import DEFAULT, Job, Setup, end_of_flight
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


BAD_SENSORS = ('estimator.sensors="gnss"', "lidar.dropout=0.1", "lidar.noise_m=0.05", "lidar.latency_s=0.1")
SETUPS = (
    Setup("hills", "hills of up to 20 %", hills, (3.0, 5.0, 7.0), 60.0, 50, overrides=_FOLLOWS),
    Setup("hills-bad", "the same, bad sensors", hills, (5.0,), 60.0, 50, overrides=_FOLLOWS,
          vehicle_overrides=BAD_SENSORS),
    Setup("hills-steep", "hills of up to 60 %", partial(hills, steepest=0.6), (5.0,), 60.0, 50, overrides=_FOLLOWS),
    Setup("hills-flat", "hills of up to 20 %, heights from the start", hills, (5.0,), 60.0, 50),
    Setup("walls", "walls of 0.6-1.6 m", low_walls, (5.0,), 60.0, 50, overrides=_FOLLOWS),
    Setup("walls-flat", "walls, heights from the start", low_walls, (5.0,), 60.0, 50),
)  # fmt: skip
FLOORS = (Floor("hills", 0.98), Floor("hills-bad", 0.95), Floor("walls", 0.98), Floor("walls-flat", 0.98))


def run(report: Report) -> None:
    report.text(
        """
40 m to the goal at 3 m, over three hills whose feet rise by 10 to 20 % (30 to 60 % where they are steep), with trunks
of 0.6 m between and upon them, one in 60 m2; or over three walls across all of the way. With
`avoidance.ground_slope = 0.25` heights count from the ground below, which a range finder shows, and what may be ground
of such a slope is no obstacle ([missions.md](missions.md#heights-above-the-ground)). From the start on they count in
the rows that say so: there the hills are in the way. "Bad sensors": a receiver that wanders by 0.4 m each way, 10 % of
the sectors dropped, 5 cm of noise, scans 100 ms old. The clearance is that to the ground, too, of hills.
"""
    )
    flown.picture(report, SETUPS)
    report.figure(_profile(report), "rising-profile", "Heights along a flight at 5 m/s, seed 2, and the ground below")
    fly_and_tell(report, SETUPS, FLOORS)


def _profile(report: Report) -> object:
    """The vehicle and the ground, over the way to the goal."""
    job = Job(SETUPS[0], DEFAULT, 5.0, 2, report.choice.logs / report.name)
    _, joined = end_of_flight(job)
    places = np.array([*joined.truths, joined.vehicle.state])[::10, :3]
    down = np.array((0.0, 0.0, 1.0))
    ground = [-place[2] - joined.vehicle.world.range_along(place, down, 50.0) for place in places]
    figure, axes = style.sheet(height=2.4)
    axes.fill_between(places[:, 0], ground, color=style.STONE, alpha=0.5, label="ground")
    axes.plot(places[:, 0], -places[:, 2], label="vehicle")
    axes.set(xlabel="north / m", ylabel="height / m", ylim=(0.0, None))
    axes.legend(loc="lower right")
    return figure
