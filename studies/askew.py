"""Places that lie askew to the map's cells, are bent or round: doors one after another, bent passages, zigzag alleys,
rooms of any size, a round room, rows of posts."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from studies import flown
from studies.campaign import Setup
from studies.campaign_report import Floor, fly_and_tell
from studies.report import Report
from studies.traps import PATIENT
from studies.worlds import HULL, TALL, Place, Site, make_disc, make_place, make_site, shortest

NAME = "askew"
TITLE = "Bent, round and turned places"

_MOST_TURN = 0.8
"""rad by which a place is turned about the start, at most."""
_SPARE_M = 0.08
"""m that the narrowest part of a way leaves beside the hull, on either side."""
_TRIES = 1000
_BACK = -4.0
"""m north, of the yard's near wall."""
_ROOM_SIDE, _ROOM_LEAST = 4.5, 2.2
"""m: a smaller room is not divided, and no part of one is less deep."""

Wall = tuple[Place, Place]


def _place(north: float, east: float, angle: float) -> Place:
    """A place turned about the start by an angle (rad)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return north * cos - east * sin, north * sin + east * cos


def _turned(name: str, seed: int, walls: list[Wall], goal: Place, angle: float, posts: tuple[Place, ...] = ()) -> Site:
    """A place with walls 0.1 m thick and posts of 0.16 m, turned about the start by an angle (rad)."""
    rows: list[dict[str, Any]] = [
        {"start": list(_place(*a, angle)), "end": list(_place(*b, angle)), "thickness": 0.1, "height": TALL}
        for a, b in walls
    ]
    discs = [make_disc(*_place(*post, angle), 0.08) for post in posts]
    north, east = make_place(*_place(*goal, angle))
    return make_site(name, seed, {"wall": rows, "cylinder": discs}, (north, east))


def _yard(half: float, front: float) -> list[Wall]:
    """Four walls around the start and what is up to `front` (m) ahead of it, 2 `half` (m) wide."""
    corners = [(_BACK, -half), (front, -half), (front, half), (_BACK, half), (_BACK, -half)]
    return list(pairwise(corners))


def _with_way(make: Callable[[np.random.Generator], Site], seed: int) -> Site:
    """A place, drawn again until there is a way through for the hull with room to spare."""
    rng = np.random.default_rng(seed)
    for _ in range(_TRIES):
        site = make(rng)
        if math.isfinite(shortest(site, HULL + _SPARE_M, margin=12.0)):
            return site
    raise ValueError(f"{seed}: no place with a way through in {_TRIES}")


def doors(seed: int) -> Site:
    """A yard 10-16 m wide with two or three walls across it, 2.5-4 m apart, each with a door of 1-1.15 m anywhere."""
    rng = np.random.default_rng(seed)
    half, north = rng.uniform(5.0, 8.0), 6.0
    walls: list[Wall] = []
    for _ in range(rng.integers(2, 4)):
        width = rng.uniform(1.0, 1.15)
        left = rng.uniform(0.6 - half, half - 0.6 - width)
        walls += [((north, -half), (north, left)), ((north, left + width), (north, half))]
        north += rng.uniform(2.5, 4.0)
    turn = rng.uniform(-_MOST_TURN, _MOST_TURN)
    return _turned("doors", seed, [*walls, *_yard(half, north + 5.0)], (north + 2.0, 0.0), turn)


def bend(seed: int) -> Site:
    """A yard 18 m wide, and across it a block with one passage, 1-1.15 m wide, that turns aside by a right angle for
    2.5-5 m and back."""
    rng = np.random.default_rng(seed)
    half, wide = 9.0, 0.5 * rng.uniform(1.1, 1.25)
    enters, near = rng.uniform(-4.0, 4.0), 8.0
    leaves = enters - math.copysign(rng.uniform(2.5, 5.0), enters)
    middle = near + rng.uniform(2.5, 4.0)
    far = middle + rng.uniform(2.5, 4.0)
    aside = math.copysign(wide, leaves - enters)
    turns = (near, enters - aside), (middle + wide, enters - aside), (middle + wide, leaves - aside)
    inner = (near, enters + aside), (middle - wide, enters + aside), (middle - wide, leaves + aside)
    walls = [*pairwise((*turns, (far, leaves - aside))), *pairwise((*inner, (far, leaves + aside)))]
    for north, east in ((near, enters), (far, leaves)):
        walls += [((north, -half), (north, east - wide)), ((north, east + wide), (north, half))]
    turn = rng.uniform(-_MOST_TURN, _MOST_TURN)
    return _turned("bend", seed, [*walls, *_yard(half, far + 6.0)], (far + 3.0, 0.0), turn)


def zigzag(seed: int) -> Site:
    """A yard 20 m wide, and across it an alley, 1.25-1.4 m wide, of three to five legs of 2-3.5 m that turn by 30 to 60
    degrees to either side in turn."""

    def make(rng: np.random.Generator) -> Site:
        half, wide, side = 10.0, 0.5 * rng.uniform(1.25, 1.4) + 0.05, rng.choice([-1.0, 1.0])
        bends = rng.uniform(0.5, 1.0, rng.integers(3, 6)) * side
        bends[1::2] *= -1.0
        headings = [0.0, *bends.tolist(), 0.0]
        lengths = [2.0, *rng.uniform(2.0, 3.5, len(bends)).tolist(), 2.0]
        corners = [(6.0, 0.0)]
        for heading, length in zip(headings, lengths, strict=True):
            north, east = corners[-1]
            corners.append((north + length * math.cos(heading), east + length * math.sin(heading)))
        walls: list[Wall] = []
        for off in (-wide, wide):
            row = []
            before = [0.0, *headings]
            for (north, east), a, b in zip(corners, before, [*headings, 0.0], strict=True):
                mean, reach = 0.5 * (a + b), off / math.cos(0.5 * (b - a))
                row.append((north - reach * math.sin(mean), east + reach * math.cos(mean)))
            walls += [*pairwise(row), (row[0], (row[0][0], math.copysign(half, off)))]
        front = corners[-1][0] + 6.0
        turn = rng.uniform(-_MOST_TURN, _MOST_TURN)
        return _turned("zigzag", seed, [*walls, *_yard(half, front)], (front - 3.0, corners[-1][1]), turn)

    return _with_way(make, seed)


def rooms(seed: int) -> Site:
    """A hall of 16 m by 12 m, divided up to four times by a wall anywhere with a door of 1-1.2 m anywhere in it; from
    corner to corner."""

    def make(rng: np.random.Generator) -> Site:
        low, high, wide = -1.2, 15.0, 11.0
        walls: list[Wall] = [((low, low), (high, low)), ((low, wide), (high, wide)),
                             ((low, low), (low, wide)), ((high, low), (high, wide))]  # fmt: skip
        _divide(rng, (low, high), (low, wide), 4, walls)
        turn = rng.uniform(-_MOST_TURN, _MOST_TURN)
        return _turned("rooms", seed, walls, (high - 1.2, wide - 1.2), turn)

    return _with_way(make, seed)


def _divide(rng: np.random.Generator, norths: Place, easts: Place, times: int, walls: list[Wall]) -> None:
    """Add a wall with a door across the longer side of a room, and divide both parts."""
    deep, wide = norths[1] - norths[0], easts[1] - easts[0]
    if times == 0 or min(deep, wide) < _ROOM_SIDE:
        return
    across = deep > wide
    cut, along = (norths, easts) if across else (easts, norths)
    at = rng.uniform(cut[0] + _ROOM_LEAST, cut[1] - _ROOM_LEAST)
    door = rng.uniform(1.0, 1.2)
    begin = rng.uniform(along[0] + 0.5, along[1] - 0.5 - door)
    for a, b in ((along[0], begin), (begin + door, along[1])):
        walls.append(((at, a), (at, b)) if across else ((a, at), (b, at)))
    for part in ((cut[0], at), (at, cut[1])):
        _divide(rng, *((part, easts) if across else (norths, part)), times - 1, walls)


def round_room(seed: int) -> Site:
    """The start is in a room of 11 to 15 walls, 3.2-6 m across, with one door of 1-1.2 m to any side."""
    rng = np.random.default_rng(seed)
    radius, door = rng.uniform(1.6, 3.0), rng.uniform(0.0, 2.0 * math.pi)
    half = math.asin(0.5 * rng.uniform(1.0, 1.2) / radius)
    north, east = rng.uniform(-0.3, 0.3, 2).tolist()
    angles = np.linspace(door + half, door + 2.0 * math.pi - half, rng.integers(12, 17)).tolist()
    corners = [(north + radius * math.cos(angle), east + radius * math.sin(angle)) for angle in angles]
    return _turned("roundroom", seed, list(pairwise(corners)), (18.0, 0.0), 0.0)


def posts(seed: int) -> Site:
    """A yard 18 m wide with four rows of posts of 0.16 m across it, 1.3-1.6 m apart, the rows 2-3 m apart."""
    rng = np.random.default_rng(seed)
    half, north = 9.0, 5.0
    places: list[Place] = []
    for _ in range(4):
        easts = rng.uniform(-half, 1.0 - half) + np.cumsum(rng.uniform(1.3, 1.6, 12))
        places += [(north + rng.uniform(-0.1, 0.1), east) for east in easts.tolist() if east < half]
        north += rng.uniform(2.0, 3.0)
    turn = rng.uniform(-_MOST_TURN, _MOST_TURN)
    return _turned("posts", seed, _yard(half, north + 5.0), (north + 2.0, 0.0), turn, tuple(places))


_FLOWN = (
    ("doors", "doors one after another", doors),
    ("bend", "a passage with two bends", bend),
    ("zigzag", "a zigzag alley", zigzag),
    ("rooms", "rooms of any size", rooms),
    ("roundroom", "out of a round room", round_room),
    ("posts", "rows of posts", posts),
)
SETUPS = tuple(
    Setup(name, title, site, (3.0,), 180.0, 20, has_way=True, overrides=PATIENT) for name, title, site in _FLOWN
)
FLOORS = tuple(Floor(name, 0.95) for name, _, _ in _FLOWN)


def run(report: Report) -> None:
    report.text(
        """
Nothing was tuned to these places. All but the round room are turned about the start by up to 46 degrees, so that no
wall lies along the map's cells. A yard has two or three walls across it, each with a door of 1 to 1.15 m anywhere; a
passage 1 to 1.15 m wide turns aside by a right angle, and back; an alley 1.25 to 1.4 m wide goes to and fro by 30 to 60
degrees; a hall is divided into rooms by walls with doors of 1 to 1.2 m, which other walls may narrow to 0.88 m; a room
3.2 to 6 m across has one door to any side, and the goal lies to the north; posts of 0.16 m stand in rows, 1.3 to 1.6 m
apart.
"""
    )
    flown.picture(report, SETUPS)
    fly_and_tell(report, SETUPS, FLOORS)
