"""Three flights that seldom fail, in batched physics: what a search for failures is measured on.

Each is a vehicle by its own control laws, without companion and MAVLink, in steady wind and in gusts that a seed draws.
Numbers within ranges say how it is flown. A flight fails when the hull touches something.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.toml_files import find
from protocol.vehicle_parameters import GRAVITY
from studies.batch import Fleet
from studies.worlds import HULL
from vehicle_sim.airframe import Airframe

FAR_M = 1000.0
GUST_S = 0.5
"""How long a gust lasts."""
GUST_N = 0.15
"""Standard deviation of a gust's force along each axis."""

Values = Mapping[str, Array]
"""By name, (n,): one a flight."""
Seeds = NDArray[np.int64]
Ranges = Mapping[str, tuple[float, float]]

WEATHER: Ranges = {"along": (-5.0, 5.0), "across": (-5.0, 5.0), "load": (-0.1, 0.1), "lag": (1.0, 1.6)}
"""Wind to the north and east (m/s), weight that the laws don't know (share), and the rotors' lag (share)."""


@dataclass(frozen=True)
class Drill:
    """A kind of flight."""

    title: str
    ranges: Ranges
    clearance: Callable[[Values, Seeds], Array]
    """(n,) least distance (m) from hull to obstacle; at most 0 is a failure."""


@cache
def _airframe() -> Airframe:
    return Airframe.load(find("vehicles", "paper_quad"))


def _fleet(values: Values) -> Fleet:
    fleet = Fleet.hovering(_airframe(), len(values["load"]))
    p = fleet.parameters
    p["wind_ned"][:, 0], p["wind_ned"][:, 1] = values["along"], values["across"]
    p["rotor_lag_share"] = values["lag"][:, None]
    return fleet


def _fly(fleet: Fleet, values: Values, gusts: Array) -> Array:
    """(n, ticks, 3) positions (m, NED), a gust (n, 2) of `gusts` (n, k, 2) after the other."""
    force, way = fleet.parameters["force_ned"], []
    force[:, 2] = fleet.parameters["mass_kg"] * GRAVITY * values["load"]
    for k in range(gusts.shape[1]):
        force[:, :2] = gusts[:, k]
        way.append(fleet.fly(GUST_S))
    return np.concatenate(way, axis=1)


def _gusts(seeds: Seeds, seconds: float) -> Array:
    """(n, k, 2) N, to the north and east."""
    return np.array(
        [GUST_N * np.random.default_rng(seed).standard_normal((round(seconds / GUST_S), 2)) for seed in seeds]
    )


def past_a_post(values: Values, seeds: Seeds) -> Array:
    """The vehicle flies 12 m to the north, past a post of 0.6 m that stands `aside` (m) to the east of its way."""
    fleet = _fleet(values)
    fleet.commands["position_ned"][:, 0] = 12.0
    fleet.commands["speed_limits"][:, 0] = values["speed"]
    way = _fly(fleet, values, _gusts(seeds, 6.0))
    away: Array = np.hypot(way[:, :, 0] - 6.0, way[:, :, 1] - values["aside"][:, None]).min(axis=1)
    return away - 0.3 - HULL


def before_a_wall(values: Values, seeds: Seeds) -> Array:
    """The vehicle flies to the north and is told to stay, `late` (s) after a wall is in sight, `sight` (m) away."""
    fleet = _fleet(values)
    gusts = _gusts(seeds, 6.0)
    fleet.commands["position_ned"][:, 0] = FAR_M
    fleet.commands["speed_limits"][:, 0] = values["speed"]
    _fly(fleet, values, gusts[:, :6])
    seen, speed = fleet.states[:, 0].copy(), fleet.states[:, 3].copy()
    fleet.commands["position_ned"][:, 0] = seen + speed * values["late"]
    way = _fly(fleet, values, gusts[:, 6:])
    nearest: Array = seen + values["sight"] - way[:, :, 0].max(axis=1) - HULL
    return nearest


def through_a_gate(values: Values, seeds: Seeds) -> Array:
    """The vehicle flies 12 m to the north, through a gate of `width` (m) in a thin wall: either side can be touched."""
    fleet = _fleet(values)
    fleet.commands["position_ned"][:, 0] = 12.0
    fleet.commands["speed_limits"][:, 0] = values["speed"]
    way = _fly(fleet, values, _gusts(seeds, 6.0))
    half = 0.5 * values["width"][:, None]
    away: Array = np.hypot(way[:, :, 0] - 6.0, np.maximum(half - np.abs(way[:, :, 1]), 0.0)).min(axis=1)
    return away - HULL


DRILLS = {
    "post": Drill("past a post", {**WEATHER, "speed": (2.0, 5.0), "aside": (1.95, 2.95)}, past_a_post),
    "wall": Drill(
        "a stop before a wall",
        {**WEATHER, "speed": (2.0, 6.0), "sight": (5.0, 12.0), "late": (0.0, 0.3)},
        before_a_wall,
    ),
    "gate": Drill("through a gate", {**WEATHER, "speed": (2.0, 5.0), "width": (3.4, 4.8)}, through_a_gate),
}
