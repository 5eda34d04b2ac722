"""Worlds with shelves, and with a single mover in the open; see `studies.worlds`."""

import numpy as np

from studies.worlds import TALL, WALKING_HEIGHT, Place, Site, make_disc, make_place, make_site, make_wall

_GOAL: Place = (40.0, 0.0)


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


def overtaking(seed: int) -> Site:
    """A mover of 0.6 m at 3-5 m/s follows the vehicle along the way."""
    rng = np.random.default_rng(seed)
    east = rng.uniform(-0.5, 0.5)
    return _mover("overtaking", seed, (-rng.uniform(8.0, 15.0), east), (60.0, east), rng.uniform(3.0, 5.0))


def _mover(name: str, seed: int, start: Place, end: Place, speed: float) -> Site:
    row = {**make_disc(*start, 0.3), "speed": round(float(speed), 2), "route": [make_place(*start), make_place(*end)]}
    return make_site(name, seed, {"cylinder": [row]}, _GOAL, height=WALKING_HEIGHT)
