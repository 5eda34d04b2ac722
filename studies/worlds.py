"""Worlds to fly through, generated from a seed: `python -m studies worlds NAME --seed N --picture`.

All are NED with the take-off at (0, 0) and the way to the goal roughly north. Everything but a court's walls is `TALL`,
so that there is no way over it. Flights read the world from its file.
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.mission.plan import Mission, Waypoint
from protocol import toml_files
from protocol.arrays import Array
from vehicle_sim.world import World

TALL = 10.0
"""m"""
HULL = 0.36
"""m, `vehicles/paper_quad.toml`'s radius."""
JACKAL_WIDTH = 0.43
"""m, the robot of the BARN worlds."""
BARN_SCALE = 2.0 * HULL / JACKAL_WIDTH
"""Factor on the lengths of the BARN worlds, so that a passage is as many vehicles wide. Times are not scaled, so speeds
are multiplied by it, too."""
WALKING_HEIGHT = 2.0
"""m; height of flights among walkers. A walker is `TALL` as well: a tilted scan would miss a real one."""

_ORIGIN = {"latitude_deg": 47.3977, "longitude_deg": 8.5456, "altitude_m": 488.0}
_CELL_M = 0.1
_TRIES = 1000

Place = tuple[float, float]
"""North, east (m)."""
Solids = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class Site:
    """A world as the tables of its file, and the way through it."""

    name: str
    tables: dict[str, Any]
    waypoints: tuple[Place, ...]
    """The last is the goal."""
    height: float = 3.0
    """m above the ground, of the flight."""
    hold_s: float = 1.0
    """At each waypoint."""

    @property
    def goal(self) -> Place:
        return self.waypoints[-1]

    def world(self) -> World:
        return World.from_tables(self.tables, self.name)

    def mission(self, speed: float, world: Path) -> Mission:
        """Take off, go there, land; `world` is where `save` put the world."""
        points = [Waypoint(north, east, self.height, hold_s=self.hold_s) for north, east in self.waypoints]
        return Mission(self.name, points, world=str(world), takeoff_height=self.height, speed=speed, return_home=False)

    def save(self, folder: Path, speed: float = 5.0) -> tuple[Path, Path]:
        """Write NAME.toml, the world, and NAME_mission.toml, which flies through it; their paths."""
        folder.mkdir(parents=True, exist_ok=True)
        world, mission = folder / f"{self.name}.toml", folder / f"{self.name}_mission.toml"
        world.write_text(toml(self.tables), encoding="utf-8")
        mission.write_text(toml(self.plan(speed, world)), encoding="utf-8")
        return world, mission

    def plan(self, speed: float, world: Path) -> dict[str, Any]:
        """The tables of the mission's file; `world` is where the world is."""
        points = [{"north": n, "east": e, "height": self.height, "hold_s": self.hold_s} for n, e in self.waypoints]
        return {
            "name": self.name,
            "world": str(world.absolute()),
            "takeoff_height": self.height,
            "speed": speed,
            "return_home": False,
            "waypoints": points,
        }


def toml(tables: Mapping[str, Any]) -> str:
    """TOML with one level of tables and arrays of tables, which is enough for worlds, missions and campaigns."""
    lines = [f"{key} = {_value(value)}" for key, value in tables.items() if not _is_table(value)]
    for key, value in tables.items():
        if not _is_table(value):
            continue
        head = f"[{key}]" if isinstance(value, dict) else f"[[{key}]]"
        for table in [value] if isinstance(value, dict) else value:
            lines += ["", head, *(f"{name} = {_value(each)}" for name, each in table.items())]
    return "\n".join(lines) + "\n"


def _is_table(value: object) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _value(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            escaped = value.replace("\\", "\\\\").replace('"', '\\"')
            return f'"{escaped}"'
        case list() | tuple():
            return f"[{', '.join(_value(each) for each in value)}]"
        case dict():
            return f"{{ {', '.join(f'{name} = {_value(each)}' for name, each in value.items())} }}"
        case _:
            return repr(value)


def _m(value: float) -> float:
    return round(float(value), 2)


def make_place(north: float, east: float) -> list[float]:
    return [_m(north), _m(east)]


def make_site(name: str, seed: int, solids: Solids, *waypoints: Place, height: float = 3.0) -> Site:
    named = {
        kind: [{"name": f"{kind} {number}", **solid} for number, solid in enumerate(rows, start=1)]
        for kind, rows in solids.items()
        if rows
    }
    full_name = f"{name}_{seed}"
    return Site(full_name, {"name": full_name, "origin": dict(_ORIGIN), **named}, waypoints, height)


def make_disc(north: float, east: float, radius: float) -> dict[str, Any]:
    return {"center": make_place(north, east), "radius": _m(radius), "height": TALL}


def make_wall(start: Place, end: Place, thickness: float = 0.2, height: float = TALL) -> dict[str, Any]:
    return {"start": make_place(*start), "end": make_place(*end), "thickness": thickness, "height": height}


# --- kinds of worlds ---


def forest(seed: int, density: float = 1 / 25, diameter: float = 0.6, length: float = 40.0) -> Site:
    """Trunks of a Poisson process, `density` a m2, 30 m wide and from 10 m before the start to 10 m beyond the goal,
    which is `length` (m) away; 40 m after Loquercio et al. 2021. No trunk's surface is within 2.5 m of start and
    goal. Raises ValueError for a length that is not above 0."""
    if not length > 0.0:
        raise ValueError(f"length {length:g}: not above 0")
    rng = np.random.default_rng(seed)
    goal = (length, 0.0)
    count = int(rng.poisson(density * 30.0 * (length + 20.0)))
    places = np.stack((rng.uniform(-10.0, length + 10.0, count), rng.uniform(-15.0, 15.0, count)), axis=1)
    free = 2.5 + 0.5 * diameter
    kept = [p for p in places.tolist() if math.hypot(*p) > free and math.dist(p, goal) > free]
    return make_site(
        f"forest{round(1 / density)}", seed, {"cylinder": [make_disc(n, e, 0.5 * diameter) for n, e in kept]}, goal
    )


def u_trap(seed: int) -> Site:
    """Three walls open towards the start, whose middle the straight way runs into; inside 6-10 m wide, 5-9 m deep."""
    rng = np.random.default_rng(seed)
    half, depth, back = rng.uniform(3.0, 5.0), rng.uniform(5.0, 9.0), rng.uniform(16.0, 20.0)
    aside = rng.uniform(-0.6, 0.6) * half
    left, right = aside - half, aside + half
    walls = [
        make_wall((back, left), (back, right)),
        make_wall((back - depth, left), (back, left)),
        make_wall((back - depth, right), (back, right)),
    ]
    return make_site("utrap", seed, {"wall": walls}, (32.0, 0.0))


def court(seed: int) -> Site:
    """Four walls around the goal, 8-12 m apart, turned, 4-6 m high: the only way is over them."""
    rng = np.random.default_rng(seed)
    goal, half, turn, height = (22.0, 0.0), rng.uniform(4.0, 6.0), rng.uniform(0.0, math.pi / 2), rng.uniform(4.0, 6.0)
    away, angles = math.sqrt(2.0) * half, turn + 0.5 * math.pi * np.arange(5)
    corners = [(goal[0] + away * math.cos(angle), goal[1] + away * math.sin(angle)) for angle in angles.tolist()]
    walls = [make_wall(start, end, 0.3, _m(height)) for start, end in itertools.pairwise(corners)]
    return make_site("court", seed, {"wall": walls}, goal)


def gap(seed: int, width: float = 0.9) -> Site:
    """A yard 24 m wide, walled in, and a wall across it, 0.2 m thick and turned by up to 15 degrees, with one gap up to
    3 m off the straight way: there is no other way.

    `width` is the gap's free width (m), as in the set-up by Loquercio et al. (0.8-1.0 m); it is not scaled to the
    vehicle. Our hull of 0.72 m has 9 cm on either side of it in 0.9 m."""
    rng = np.random.default_rng(seed)
    north, east, turn = rng.uniform(15.0, 20.0), rng.uniform(-3.0, 3.0), math.radians(rng.uniform(-15.0, 15.0))
    half, front, back = 12.0, 39.0, -4.0

    def at(distance: float) -> list[float]:
        return [float(north - distance * math.sin(turn)), float(east + distance * math.cos(turn))]

    left, right = (-half - east) / math.cos(turn), (half - east) / math.cos(turn)
    # in full, not in whole centimetres: rounding would change the width
    across = [
        {"start": at(left), "end": at(-0.5 * width), "thickness": 0.2, "height": TALL},
        {"start": at(0.5 * width), "end": at(right), "thickness": 0.2, "height": TALL},
    ]
    yard = [make_wall((back, side), (front, side)) for side in (-half, half)]
    yard += [make_wall((end, -half), (end, half)) for end in (back, front)]
    return make_site("gap", seed, {"wall": across + yard}, (35.0, 0.0))


def pole(seed: int) -> Site:
    """A pole of 1.5 m on the way, up to 0.5 m to its side, far enough that the vehicle has reached its speed."""
    rng = np.random.default_rng(seed)
    return make_site(
        "pole", seed, {"cylinder": [make_disc(rng.uniform(24.0, 28.0), rng.uniform(-0.5, 0.5), 0.75)]}, (45.0, 0.0)
    )


def maze(seed: int, cells: int = 6, cell: float = 4.0) -> Site:
    """A maze of `cells` x `cells` rooms in a closed outer wall, to be crossed from corner to corner: a tree of ways by
    depth-first search, of whose inner walls a tenth is removed."""
    rng = np.random.default_rng(seed)
    walls = {(room, other) for room in _rooms(cells) for other in _neighbours(room, cells) if room < other}
    path, seen = [(0, 0)], {(0, 0)}
    while path:
        fresh = [room for room in _neighbours(path[-1], cells) if room not in seen]
        if not fresh:
            path.pop()
            continue
        room = fresh[rng.integers(len(fresh))]
        walls.discard((min(path[-1], room), max(path[-1], room)))
        seen.add(room)
        path.append(room)
    standing = [pair for pair in sorted(walls) if rng.random() >= 0.1]
    low, high = -0.5 * cell, (cells - 0.5) * cell
    corners = [(low, low), (low, high), (high, high), (high, low), (low, low)]
    rows = [make_wall(start, end) for start, end in itertools.pairwise(corners)]
    for (i, j), (k, m) in standing:
        north, east = 0.5 * (i + k) * cell, 0.5 * (j + m) * cell
        along = (0.0, 0.5 * cell) if i != k else (0.5 * cell, 0.0)
        rows.append(make_wall((north - along[0], east - along[1]), (north + along[0], east + along[1])))
    goal = (cells - 1) * cell
    return make_site("maze", seed, {"wall": rows}, (goal, goal))


def _rooms(cells: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(cells) for j in range(cells)]


def _neighbours(room: tuple[int, int], cells: int) -> list[tuple[int, int]]:
    i, j = room
    around = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)]
    return [(a, b) for a, b in around if 0 <= a < cells and 0 <= b < cells]


def pop_up(seed: int, ahead: float = 2.0) -> Site:
    """A pillar of 0.2 m that appears when the vehicle is at a distance of `ahead` (m, to its surface); after IPC."""
    rng = np.random.default_rng(seed)
    pillar = {**make_disc(rng.uniform(12.0, 18.0), rng.uniform(-0.2, 0.2), 0.1), "appears_within": ahead}
    return make_site("popup", seed, {"cylinder": [pillar]}, (30.0, 0.0))


def street(seed: int, walkers: int = 10) -> Site:
    """Walkers of 0.6 m at 0.6-1.5 m/s, half of them across a street of 12 m between walls, half along it, to and fro.

    None of them comes within 4 m of start and goal. They avoid nothing and don't stop."""
    rng = np.random.default_rng(seed)
    length, half = 40.0, 6.0
    rows = []
    for number in range(walkers):
        speed = _m(rng.uniform(0.6, 1.5))
        if number % 2:
            ends = [make_place(rng.uniform(5.0, length - 5.0), side * (half - 0.5)) for side in (-1.0, 1.0)]
        else:
            north, east = rng.uniform(5.0, length - 5.0, 2), rng.uniform(0.5 - half, half - 0.5)
            ends = [make_place(each, east) for each in np.sort(north)]
        share = rng.uniform()
        (north_a, east_a), (north_b, east_b) = ends
        start = (north_a + share * (north_b - north_a), east_a + share * (east_b - east_a))
        rows.append({**make_disc(*start, 0.3), "speed": speed, "route": ends})
    walls = [make_wall((-5.0, side * half), (length + 5.0, side * half)) for side in (-1.0, 1.0)]
    return make_site("street", seed, {"wall": walls, "cylinder": rows}, (length, 0.0), height=WALKING_HEIGHT)


def barn(seed: int) -> Site:
    """Cylinders after the manner of the BARN worlds: a random 30 x 30 grid of 0.15 m cells, 15-30 % full,
    smoothed by a cellular automaton; a cylinder of 0.075 m stands in each full cell that has an empty neighbour. All
    lengths times BARN_SCALE. Drawn again until there is a way through for the hull with 5 cm to spare.

    10 m of way, 2.75 m of it before the field and after it, between two walls."""
    rng = np.random.default_rng(seed)
    cell, total = 0.15 * BARN_SCALE, 10.0 * BARN_SCALE
    share, rounds = rng.choice([0.15, 0.2, 0.25, 0.3]), int(rng.integers(2, 5))
    for _ in range(_TRIES):
        field = _automaton(rng, share, rounds)
        rows = [
            make_disc(0.275 * total + (i + 0.5) * cell, (j - 14.5) * cell, 0.5 * cell) for i, j in np.argwhere(field)
        ]
        walls = [make_wall((-1.5, side * 15.5 * cell), (total + 1.5, side * 15.5 * cell)) for side in (-1.0, 1.0)]
        walls += [make_wall((end, -15.5 * cell), (end, 15.5 * cell)) for end in (-1.5, total + 1.5)]
        site = make_site("barn", seed, {"cylinder": rows, "wall": walls}, (_m(total), 0.0))
        if math.isfinite(shortest(site, HULL + 0.05, margin=5.0)):
            return site
    raise ValueError(f"barn {seed}: no field with a way through in {_TRIES}")


def _automaton(rng: np.random.Generator, share: float, rounds: int) -> NDArray[np.bool_]:
    """(30, 30) cells with a cylinder: full cells with an empty neighbour."""
    full = rng.random((30, 30)) < share
    for _ in range(rounds):
        count = _count(full)
        full = np.where(full, count >= 2, count >= 5)
    edge: NDArray[np.bool_] = full & (_count(full) < 8)
    return edge


def _count(full: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(30, 30) number of full cells among the eight around each; cells outside are empty."""
    padded = np.pad(full.astype(np.int64), 1)
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    return sum((padded[i : i + 30, j : j + 30] for i, j in shifts), np.zeros((30, 30), np.int64))


def shaft(seed: int) -> Site:
    """The start is in a shaft 1.1-1.2 m wide and up to 4 m long, closed ahead and open behind; the goal lies ahead."""
    rng = np.random.default_rng(seed)
    width, ahead, behind = rng.uniform(1.1, 1.2), rng.uniform(0.65, 1.5), rng.uniform(0.5, 4.0)
    left = rng.uniform(-0.04, 0.04) - 0.5 * width
    turn = math.radians(rng.uniform(-40.0, 40.0))

    def at(along: float, across: float) -> list[float]:
        cos, sin = math.cos(turn), math.sin(turn)
        return [along * cos - across * sin, along * sin + across * cos]

    # the walls' middles are half their thickness outside of the free width
    near, right = left - 0.1, left + width + 0.1
    ends = [((-behind, near), (ahead + 0.1, near)), ((-behind, right), (ahead + 0.1, right)),
            ((ahead + 0.1, near), (ahead + 0.1, right))]  # fmt: skip
    walls = [{"start": at(*a), "end": at(*b), "thickness": 0.2, "height": TALL} for a, b in ends]
    return make_site("shaft", seed, {"wall": walls}, (20.0, 0.0))


def corridor(seed: int) -> Site:
    """A yard as that of `gap`, and across it a block 4-8 m deep with one straight passage, 1.0-1.1 m wide, up to 3 m
    off the straight way."""
    rng = np.random.default_rng(seed)
    depth, width, aside = rng.uniform(4.0, 8.0), rng.uniform(1.0, 1.1), rng.uniform(-3.0, 3.0)
    half, front, back, middle = 12.0, 32.0, -4.0, 10.0 + 0.5 * depth
    sides = ((-half, aside - 0.5 * width), (aside + 0.5 * width, half))
    block = [{"start": [middle, a], "end": [middle, b], "thickness": depth, "height": TALL} for a, b in sides]
    yard = [make_wall((back, side), (front, side)) for side in (-half, half)]
    yard += [make_wall((end, -half), (end, half)) for end in (back, front)]
    return make_site("corridor", seed, {"wall": block + yard}, (28.0, 0.0))


def alley(seed: int) -> Site:
    """A waypoint 0.8-1 m before the end of a dead-end alley, 1.2-1.3 m wide and 4-8 m deep; the goal is where the start
    is."""
    rng = np.random.default_rng(seed)
    depth, width, aside = rng.uniform(4.0, 8.0), rng.uniform(1.2, 1.3), rng.uniform(-3.0, 3.0)
    end, half = 10.0 + depth, 0.5 * width + 0.1
    left, right = aside - half, aside + half
    walls = [make_wall((10.0, side), (end + 0.2, side)) for side in (left, right)]
    walls.append(make_wall((end + 0.1, left), (end + 0.1, right)))
    return make_site("alley", seed, {"wall": walls}, (_m(end - rng.uniform(0.8, 1.0)), _m(aside)), (0.0, 0.0))


def office(seed: int) -> Site:
    """Rooms of 5 m in three rows and four columns, a door of 1.0-1.2 m in each inner wall; from corner to corner."""
    rng = np.random.default_rng(seed)
    rows, columns, side = 4, 3, 5.0
    walls = []

    def doored(north: float, east: float, along: tuple[float, float]) -> None:
        """A wall of one room's side from a corner, with a door somewhere in it."""
        door, place = rng.uniform(1.0, 1.2), rng.uniform(0.8, side - 2.0)
        for a, b in ((0.0, place), (place + door, side)):
            start, end = ((north + k * along[0], east + k * along[1]) for k in (a, b))
            walls.append({"start": list(start), "end": list(end), "thickness": 0.1, "height": TALL})

    low = -0.5 * side
    for i in range(rows):
        for j in range(columns):
            north, east = low + i * side, low + j * side
            if i:
                doored(north, east, (0.0, 1.0))
            if j:
                doored(north, east, (1.0, 0.0))
    top, right = low + rows * side, low + columns * side
    corners = [(low, low), (low, right), (top, right), (top, low), (low, low)]
    walls += [make_wall(start, end) for start, end in itertools.pairwise(corners)]
    return make_site("office", seed, {"wall": walls}, ((rows - 1) * side, (columns - 1) * side))


def fig6(seed: int) -> Site:
    """The paper's Fig. 6 as in worlds/paper_fig6.toml; the seed is that of the noise alone."""
    import tomllib

    from companion.runtime.files import load_mission

    tables = tomllib.loads(toml_files.find("worlds", "paper_fig6").read_text(encoding="utf-8"))
    flown, _ = load_mission("paper_fig6")
    points = tuple((point.north, point.east) for point in flown.waypoints)
    return Site(f"fig6_{seed}", tables, points, flown.takeoff_height)


# --- ground truth ---


def shortest(site: Site, radius: float, margin: float = 24.0) -> float:
    """Length (m) of the shortest way of a disc of `radius` (m) from the start over all waypoints at the flight's
    height, between the obstacles that are there from the start and don't move; inf if there is none.

    On a grid of 0.1 m with moves to 16 neighbours, so up to 3 % too long, and no farther off than `margin` (m) from the
    legs' bounding boxes."""
    return float(sum(_leg(site, a, b, radius, margin) for a, b in _legs(site)))


def _legs(site: Site) -> Iterator[tuple[Place, Place]]:
    places = [(0.0, 0.0), *site.waypoints]
    return itertools.pairwise(places)


def _leg(site: Site, start: Place, goal: Place, radius: float, margin: float) -> float:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    low = np.minimum(start, goal) - margin
    shape = tuple(int(n) for n in np.ceil((np.maximum(start, goal) + margin - low) / _CELL_M))
    free = _free(site, low, shape, radius)
    numbers = np.arange(free.size).reshape(shape)
    rows, columns, lengths = [], [], []
    for i, j in ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)):
        here = (slice(0, shape[0] - i), slice(max(0, -j), shape[1] - max(0, j)))
        there = (slice(i, shape[0]), slice(max(0, j), shape[1] - max(0, -j)))
        both = free[here] & free[there]
        rows.append(numbers[here][both])
        columns.append(numbers[there][both])
        lengths.append(np.full(int(both.sum()), _CELL_M * math.hypot(i, j)))
    edges = (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns)))
    graph = coo_array(edges, shape=(free.size, free.size)).tocsr()
    first, last = (numbers[tuple(((np.array(p) - low) / _CELL_M).astype(int))] for p in (start, goal))
    return float(dijkstra(graph, directed=False, indices=first)[last])


def _free(site: Site, low: Array, shape: tuple[int, ...], radius: float) -> NDArray[np.bool_]:
    """Cells whose centre is farther than `radius` (m) from all obstacles."""
    world = site.world()
    north = low[0] + _CELL_M * (np.arange(shape[0]) + 0.5)[:, None]
    east = low[1] + _CELL_M * (np.arange(shape[1]) + 0.5)[None, :]
    free = np.ones(shape, np.bool_)
    for box in world.boxes:
        dn, de = north - box[0], east - box[1]
        a = np.maximum(np.abs(dn * box[4] + de * box[5]) - box[2], 0.0)
        b = np.maximum(np.abs(de * box[4] - dn * box[5]) - box[3], 0.0)
        free &= a * a + b * b > radius * radius
    for cylinder in world.cylinders:
        free &= (north - cylinder[0]) ** 2 + (east - cylinder[1]) ** 2 > (cylinder[2] + radius) ** 2
    return free


def picture(site: Site) -> Any:
    """A matplotlib figure of the world from above."""
    from studies import style
    from studies.route import draw_world

    figure, axes = style.sheet(height=5.0, width=4.2)
    draw_world(axes, site.world(), site.height)
    for cylinder in site.tables.get("cylinder", ()):
        if "route" in cylinder:
            places = [*cylinder["route"], cylinder["route"][0]]
            axes.plot([e for _, e in places], [n for n, _ in places], color=style.GREY, lw=0.7, ls="--")
    places = [[0.0, 0.0], *site.waypoints]
    axes.plot([e for _, e in places], [n for n, _ in places], color=style.GREY, lw=0.8, ls=":")
    axes.plot(0.0, 0.0, "^", color=style.INK, ms=6)
    axes.plot(site.goal[1], site.goal[0], "*", color=style.PALETTE[1], ms=10)
    axes.set(xlabel="east / m", ylabel="north / m", aspect="equal", title=site.name)
    return figure
