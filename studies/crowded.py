"""Worlds with shelves, and with movers in the open; see `studies.worlds`."""

from dataclasses import replace
from typing import Any

import numpy as np

from studies.worlds import TALL, WALKING_HEIGHT, Place, Site, make_disc, make_place, make_site, make_wall

_GOAL: Place = (40.0, 0.0)
_HALF_WAY = 12.0
_OWN_SPEED = 6.0
"""m/s of the vehicle, with which it meets the movers."""
_CLEAR_M = 4.0
"""m around the start from which no mover comes."""
_GONE = 300.0
"""m: so far away a mover does not come back before the flight is over."""
_SETS_OFF_S = 6.4
"""s: when it would have begun the way at that speed."""
_ACCELERATION = 5.5
"""m/s2, about, with which it sets off."""


def warehouse(seed: int) -> Site:
    """A closed hall 12-18 m wide with two to four rows of shelves across it, 0.8-1.6 m deep and 2.5-4 m apart, each
    with one gap of 1.1-1.4 m anywhere."""
    rng = np.random.default_rng(seed)
    half, north = rng.uniform(6.0, 9.0), 5.0
    walls = []
    for _ in range(rng.integers(2, 5)):
        depth, gap, left = rng.uniform(0.8, 1.6), rng.uniform(1.1, 1.4), rng.uniform(1.0 - half, half - 2.4)
        middle = north + 0.5 * depth
        for a, b in ((-half, left), (left + gap, half)):
            walls.append({"start": [middle, a], "end": [middle, b], "thickness": depth, "height": TALL})
        north += depth + rng.uniform(2.5, 4.0)
    back, front = -4.0, north + 5.0
    walls += [make_wall((back, side), (front, side)) for side in (-half, half)]
    walls += [make_wall((end, -half), (end, half)) for end in (back, front)]
    return make_site("warehouse", seed, {"wall": walls}, (north + 2.0, 0.0))


def oncoming(seed: int) -> Site:
    """A mover of 0.6 m at 2-4 m/s comes along the way from beyond the goal."""
    rng = np.random.default_rng(seed)
    east = rng.uniform(-0.4, 0.4)
    return _mover("oncoming", seed, (rng.uniform(36.0, 60.0), east), (-30.0, east + rng.uniform(-1.0, 1.0)),
                  rng.uniform(2.0, 4.0))  # fmt: skip


def crossing(seed: int) -> Site:
    """A mover of 0.6 m at 0.7-4 m/s crosses the way."""
    rng = np.random.default_rng(seed)
    side, north, away = rng.choice([-1.0, 1.0]), rng.uniform(8.0, 30.0), rng.uniform(5.0, 15.0)
    return _mover("crossing", seed, (north + rng.uniform(-4.0, 4.0), side * away), (north, -25.0 * side),
                  rng.uniform(0.7, 4.0))  # fmt: skip


def setting_off(seed: int) -> Site:
    """A mover of 0.3-0.6 m at 0.7-3 m/s crosses the way 4-14 m after its start, about when the vehicle comes there:
    while it accelerates its scan meets the ground before it."""
    rng = np.random.default_rng(seed)
    north, speed, angle = rng.uniform(4.0, 14.0), rng.uniform(0.7, 3.0), np.radians(rng.uniform(50.0, 130.0))
    ramp = min(north, 0.5 * _OWN_SPEED**2 / _ACCELERATION)
    there = _SETS_OFF_S + np.sqrt(2.0 * ramp / _ACCELERATION) + (north - ramp) / _OWN_SPEED + rng.uniform(-0.5, 0.5)
    way = np.array([np.cos(angle), rng.choice([-1.0, 1.0]) * np.sin(angle)])
    row = _row((north, 0.0), way, speed, there, rng.uniform(0.15, 0.3))
    return make_site("settingoff", seed, {"cylinder": [row]}, _GOAL, height=WALKING_HEIGHT)


def several(seed: int) -> Site:
    """Three movers of 0.4-1 m at 0.5-4 m/s come over the way from any side, each about when the vehicle is there."""
    rng, rows = np.random.default_rng(seed), []
    for _ in range(3):
        north, speed, angle = rng.uniform(8.0, 34.0), rng.uniform(0.5, 4.0), rng.uniform(-np.pi, np.pi)
        there = _SETS_OFF_S + north / _OWN_SPEED + rng.uniform(-2.5, 2.5)
        way, over = np.array([np.cos(angle), np.sin(angle)]), (north, rng.uniform(-0.5, 0.5))
        if np.hypot(*(over - speed * there * way)) < _CLEAR_M:  # not out of where the vehicle takes off
            way = -way
        rows.append(_row(over, way, speed, there, rng.uniform(0.2, 0.5)))
    return make_site("several", seed, {"cylinder": rows}, _GOAL, height=WALKING_HEIGHT)


def car(seed: int) -> Site:
    """A mover of 1.4-3 m at 1-8 m/s crosses the way, about when the vehicle is there."""
    rng = np.random.default_rng(seed)
    north, speed, angle = rng.uniform(8.0, 34.0), rng.uniform(1.0, 8.0), np.radians(rng.uniform(40.0, 140.0))
    there = _SETS_OFF_S + north / _OWN_SPEED + rng.uniform(-1.5, 1.5)
    way = np.array([np.cos(angle), rng.choice([-1.0, 1.0]) * np.sin(angle)])
    row = _row((north, 0.0), way, speed, there, rng.uniform(0.7, 1.5))
    return make_site("car", seed, {"cylinder": [row]}, _GOAL, height=WALKING_HEIGHT)


def _row(over: Place, way: Any, speed: float, there: float, radius: float) -> dict[str, Any]:
    """A mover that is `over` a place at `there` (s), on a straight way along a unit vector (2,)."""
    start, end = over - speed * there * way, over + _GONE * way
    route = [make_place(*start), make_place(*end)]
    return {**make_disc(start[0], start[1], radius), "speed": round(float(speed), 2), "route": route}


def overtaking(seed: int) -> Site:
    """A mover of 0.6 m at 6.5-10 m/s comes from behind along the way and reaches the vehicle on it."""
    rng = np.random.default_rng(seed)
    east, speed, north = rng.uniform(-0.5, 0.5), rng.uniform(6.5, 10.0), rng.uniform(8.0, 32.0)
    start = north - speed * (_SETS_OFF_S + north / _OWN_SPEED)
    return _mover("overtaking", seed, (start, east), (_GONE, east), speed)


def waiting(seed: int) -> Site:
    """The vehicle waits for 12 s at a waypoint, over which a mover of 0.6 m at 0.7-10 m/s comes from any side."""
    rng = np.random.default_rng(seed)
    angle, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.7, 10.0)
    there = _SETS_OFF_S + _HALF_WAY / _OWN_SPEED + rng.uniform(2.0, 10.0)
    ahead, aside = np.array([np.cos(angle), np.sin(angle)]), rng.uniform(-0.4, 0.4)
    over = np.array([_HALF_WAY, 0.0]) + aside * np.array([-ahead[1], ahead[0]])
    (start_n, start_e), (end_n, end_e) = over - speed * there * ahead, over + _GONE * ahead
    site = _mover("waiting", seed, (start_n, start_e), (end_n, end_e), speed, (_HALF_WAY, 0.0))
    return replace(site, hold_s=12.0)


def _mover(name: str, seed: int, start: Place, end: Place, speed: float, goal: Place = _GOAL) -> Site:
    row = {**make_disc(*start, 0.3), "speed": round(float(speed), 2), "route": [make_place(*start), make_place(*end)]}
    return make_site(name, seed, {"cylinder": [row]}, goal, height=WALKING_HEIGHT)
