"""The obstacles of a world's file, for drawing only; the log carries the file as it was flown."""

import tomllib
from dataclasses import dataclass
from math import atan2, ceil, cos, hypot, pi, radians, sin
from typing import Any

import numpy as np

from companion.view.lines import Floats

Place = tuple[float, float]
"""North, east (m)."""

ROOM = 0.8
"""Distance (m) that a flight should keep from obstacles, for the hull and the tracking errors."""
SIDES = 16
"""Sides with which a round obstacle is drawn."""
_HILL_STEPS = 6


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright obstacle: its outline from above, and the heights of its bottom and top (m above the ground)."""

    name: str
    outline: tuple[Place, ...]
    """Corners, clockwise from above."""
    bottom: float
    top: float
    round: bool


def solids(world: bytes) -> list[Prism]:
    """The boxes, walls, cylinders, trees and hills of a world's file. Entries that are not understood are left out, and
    so is everything in a file that is no TOML."""
    try:
        tables = tomllib.loads(world.decode())
    except (ValueError, RecursionError):
        return []
    found: list[Prism] = []
    for kind, make in _MAKERS.items():
        listed = tables.get(kind, ())
        for table in listed if isinstance(listed, list) else ():
            try:
                found += make(table)
            except (LookupError, TypeError, ValueError, ArithmeticError, RecursionError):
                continue
    return found


def origin(world: bytes) -> tuple[float, float, float] | None:
    """Latitude and longitude (rad) and altitude (m) of the take-off point; None if the file does not say."""
    try:
        table = tomllib.loads(world.decode())["origin"]
        return radians(table["latitude_deg"]), radians(table["longitude_deg"]), float(table["altitude_m"])
    except (ValueError, RecursionError, KeyError, TypeError):
        return None


def _span(table: dict[str, Any]) -> tuple[float, float]:
    height = table["height"]
    return (float(height[0]), float(height[1])) if isinstance(height, list) else (0.0, float(height))


def _turned(center: Place, along: float, across: float, yaw: float) -> tuple[Place, ...]:
    corners = ((along, across), (-along, across), (-along, -across), (along, -across))
    north, east = center
    return tuple((north + cos(yaw) * a - sin(yaw) * b, east + sin(yaw) * a + cos(yaw) * b) for a, b in corners)


def _circle(center: Place, radius: float) -> tuple[Place, ...]:
    turns = (2.0 * pi * side / SIDES for side in range(SIDES))
    return tuple((center[0] + radius * cos(turn), center[1] + radius * sin(turn)) for turn in turns)


def _box(table: dict[str, Any]) -> list[Prism]:
    along, across = table["size"]
    outline = _turned(table["center"], along / 2.0, across / 2.0, radians(table.get("yaw_deg", 0.0)))
    return [Prism(str(table["name"]), outline, *_span(table), round=False)]


def _wall(table: dict[str, Any]) -> list[Prism]:
    (north, east), (to_north, to_east) = table["start"], table["end"]
    length, yaw = hypot(to_north - north, to_east - east), atan2(to_east - east, to_north - north)
    center = ((north + to_north) / 2.0, (east + to_east) / 2.0)
    outline = _turned(center, length / 2.0, table["thickness"] / 2.0, yaw)
    return [Prism(str(table["name"]), outline, *_span(table), round=False)]


def _cylinder(table: dict[str, Any]) -> list[Prism]:
    return [Prism(str(table["name"]), _circle(table["center"], table["radius"]), *_span(table), round=True)]


def _tree(table: dict[str, Any]) -> list[Prism]:
    bottom, top = _span(table)
    name = str(table["name"])
    trunk = Prism(name, _circle(table["center"], table["trunk_radius"]), 0.0, bottom, round=True)
    return [trunk, Prism(name, _circle(table["center"], table["crown_radius"]), bottom, top, round=True)]


def _hill(table: dict[str, Any]) -> list[Prism]:
    """Steps, as high as the hill in the middle of each."""
    radius, height = float(table["radius"]), float(table["height"])
    sphere, steps = 0.5 * (radius**2 + height**2) / height, list[Prism]()
    for step in range(_HILL_STEPS):
        bottom, top = height * step / _HILL_STEPS, height * (step + 1) / _HILL_STEPS
        outline = _circle(table["center"], (sphere**2 - (sphere - height + 0.5 * (bottom + top)) ** 2) ** 0.5)
        steps.append(Prism(str(table["name"]), outline, bottom, top, round=True))
    return steps


_MAKERS = {"box": _box, "wall": _wall, "cylinder": _cylinder, "tree": _tree, "hill": _hill}
"""The solids of an entry, by the name of its table."""


def in_the_way(world: bytes, start_ned: Floats, end_ned: Floats) -> list[str]:
    """The names of the obstacles that a straight flight between two places (3,) NED (m) comes nearer to than ROOM."""
    return between(solids(world), start_ned, end_ned, ROOM)


def between(prisms: list[Prism], start_ned: Floats, end_ned: Floats, room: float) -> list[str]:
    """The names of the prisms that the line between two places (3,) NED (m) comes nearer to than `room` (m)."""
    steps = max(2, ceil(float(np.linalg.norm(end_ned - start_ned)) / (0.5 * room)))
    places = start_ned + np.linspace(0.0, 1.0, steps)[:, None] * (end_ned - start_ned)
    return list(dict.fromkeys(prism.name for prism in prisms if _is_near(prism, places, room)))


def _is_near(prism: Prism, places_ned: Floats, room: float) -> bool:
    """Whether one of the places (n, 3) NED (m) is nearer than `room` (m), or at a corner a little farther."""
    corners = np.array(prism.outline)
    edges = np.roll(corners, -1, axis=0) - corners
    outwards = np.column_stack((-edges[:, 1], edges[:, 0])) / np.linalg.norm(edges, axis=1)[:, None]
    outwards *= np.sign(((corners - corners.mean(axis=0)) * outwards).sum(axis=1))[:, None]
    beside = ((places_ned[:, None, :2] - corners) * outwards).sum(axis=2).max(axis=1) < room
    height = -places_ned[:, 2]
    return bool((beside & (height > prism.bottom - room) & (height < prism.top + room)).any())


def mesh(prism: Prism) -> tuple[list[tuple[float, float, float]], list[tuple[int, int, int]]]:
    """Corners (m, east, north, up) and triangles, which face outwards, of a prism with a convex outline."""
    count = len(prism.outline)
    corners = [(east, north, height) for height in (prism.bottom, prism.top) for north, east in prism.outline]
    faces: list[tuple[int, int, int]] = []
    for side in range(count):
        after = (side + 1) % count
        faces += [(side, side + count, after), (after, side + count, after + count)]
    for corner in range(1, count - 1):
        faces += [(0, corner, corner + 1), (count, count + corner + 1, count + corner)]
    return corners, faces
