"""The world that is flown in: boxes, upright cylinders and flat ground, with exact distances and exact ray hits.

Axes are NED with the origin on the ground at the take-off pad. Obstacles are rows of two arrays, so that compiled code
can walk them; heights become coordinates along the down axis, `down_top` < `down_bottom` <= 0 for what stands on or
above the ground.

Cylinders may move along a route or appear late: a `Scene` is a world in the course of one flight, and `Scene.at` the
world at one instant, which stands still. A world without such is its own scene at all times.
"""

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from protocol import toml_files as toml_files
from protocol.jit import compiled
from vehicle_sim.wind import Vector, WindSettings

Array = NDArray[np.float64]

BOX_COLUMNS = 8
"""north, east, half_along, half_across, cos_yaw, sin_yaw, down_top, down_bottom."""
CYLINDER_COLUMNS = 5
"""north, east, radius, down_top, down_bottom."""

_PARALLEL = 1e-12  # a direction component this small never crosses the slab within any range that is asked for

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Place = tuple[float, float]
"""North, east (m)."""


def _finite(record: msgspec.Struct) -> None:
    """TOML can write nan and inf; no place or size is either."""
    for key in record.__struct_fields__:
        value = getattr(record, key)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                raise ValueError(f"{key}: {number} is not a finite number")


class OriginTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[origin]`: where on earth the take-off pad is."""

    latitude_deg: Annotated[float, msgspec.Meta(gt=-90, lt=90)]
    longitude_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)]
    altitude_m: float

    def __post_init__(self) -> None:
        _finite(self)


class DisturbanceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[disturbance]`: what pushes the vehicle beside the wind."""

    force_ned: Vector = (0.0, 0.0, 0.0)
    """N, constant while it is in the air."""


class Solid(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What every obstacle has. `height` is [bottom, top] in m above the ground, or the top alone."""

    name: Name
    height: float | tuple[float, float]

    @property
    def span(self) -> tuple[float, float]:
        """Bottom, top (m above the ground)."""
        return self.height if isinstance(self.height, tuple) else (0.0, self.height)

    def __post_init__(self) -> None:
        _finite(self)
        bottom, top = self.span
        if bottom < 0.0:
            raise ValueError(f"height: bottom {bottom} is below the ground")
        if top <= bottom:
            raise ValueError(f"height: top {top} is not above bottom {bottom}")


class BoxTable(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[box]]`: `size` along and across its own axis, which is turned by `yaw_deg` clockwise from north."""

    center: Place
    size: tuple[Positive, Positive]
    yaw_deg: float = 0.0


class CylinderTable(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[cylinder]]`, upright. From `center` it moves at `speed` (m/s) over the places of `route`, from the last to the
    first and round again."""

    center: Place
    radius: Positive
    route: tuple[Place, ...] = ()
    speed: NotNegative = 0.0
    appears_within: Positive | None = None
    """It is not there until the vehicle's centre has come so near (m) to where its side will be, seen from above."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.route) != (self.speed > 0.0):
            raise ValueError("route: what moves has a route and a speed")
        for north, east in self.route:
            if not (math.isfinite(north) and math.isfinite(east)):
                raise ValueError(f"route: {[north, east]} is no place")
        if self.route and all(place == self.route[0] for place in (self.center, *self.route)):
            raise ValueError("route: it leads nowhere")


class WallTable(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[wall]]`: a box around the line from `start` to `end`."""

    start: Place
    end: Place
    thickness: Positive

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == self.end:
            raise ValueError("end: the same place as start")


class TreeTable(Solid, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[tree]]`: a trunk up to the crown, and the crown over `height`; two cylinders of one name."""

    center: Place
    trunk_radius: Positive
    crown_radius: Positive


class WorldTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file in `worlds/`."""

    name: Name
    origin: OriginTable
    wind: WindSettings = WindSettings()
    disturbance: DisturbanceTable = DisturbanceTable()
    box: tuple[BoxTable, ...] = ()
    cylinder: tuple[CylinderTable, ...] = ()
    wall: tuple[WallTable, ...] = ()
    tree: tuple[TreeTable, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """Places one after the other, at one speed; after the last leg again from the second place, which is the last."""

    places: tuple[Place, ...]
    speed: float
    _at_m: tuple[float, ...] = field(init=False, repr=False)
    """Way to each place."""

    def __post_init__(self) -> None:
        legs = itertools.starmap(math.dist, itertools.pairwise(self.places))
        object.__setattr__(self, "_at_m", tuple(itertools.accumulate(legs, initial=0.0)))

    def at(self, time_s: float) -> Place:
        """After so long on the way."""
        way, first, whole = self.speed * time_s, self._at_m[1], self._at_m[-1]
        if way > whole:
            way = first + (way - first) % (whole - first) if whole > first else whole
        leg = min(max(bisect.bisect_right(self._at_m, way), 1), len(self._at_m) - 1)
        begin, end = self._at_m[leg - 1], self._at_m[leg]
        share = (way - begin) / (end - begin) if end > begin else 1.0
        (north, east), (to_north, to_east) = self.places[leg - 1], self.places[leg]
        return north + share * (to_north - north), east + share * (to_east - east)


@dataclass(frozen=True, slots=True, eq=False)
class Restless:
    """A cylinder that moves or appears late; `row` is its number among the world's cylinders."""

    row: int
    route: Route | None
    appears_within: float | None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Obstacles on flat ground. `names` holds the boxes' names, then the cylinders'."""

    name: str
    origin: tuple[float, float, float]
    """Latitude, longitude (rad), altitude (m) of the point (0, 0, 0)."""
    boxes: Array  # (n, 8), BOX_COLUMNS
    cylinders: Array  # (m, 5), CYLINDER_COLUMNS
    names: tuple[str, ...]
    wind: WindSettings = field(default_factory=WindSettings)
    force_ned: Vector = (0.0, 0.0, 0.0)
    """N, on the vehicle while it is in the air."""
    restless: tuple[Restless, ...] = ()

    @classmethod
    def load(cls, path: Path, overrides: Sequence[str] = ()) -> "World":
        """With overrides as "origin.altitude_m=3". Raises DataFileError with file and key for what can't be read or
        can't exist."""
        return cls.build(toml_files.load(path, WorldTable, overrides))

    @classmethod
    def from_tables(cls, tables: dict[str, Any], source: str) -> "World":
        """The same from tables that are read already; `source` is named in errors."""
        return cls.build(toml_files.convert(tables, WorldTable, source))

    @classmethod
    def build(cls, table: WorldTable) -> "World":
        boxes = [_box_row(box) for box in table.box] + [_wall_row(wall) for wall in table.wall]
        cylinders = [_cylinder_row(c.center, c.radius, *c.span) for c in table.cylinder]
        names = [solid.name for solid in (*table.box, *table.wall, *table.cylinder)]
        for tree in table.tree:
            bottom, top = tree.span
            if bottom > 0.0:
                cylinders.append(_cylinder_row(tree.center, tree.trunk_radius, 0.0, bottom))
                names.append(tree.name)
            cylinders.append(_cylinder_row(tree.center, tree.crown_radius, bottom, top))
            names.append(tree.name)
        place = table.origin
        return cls(
            name=table.name,
            origin=(math.radians(place.latitude_deg), math.radians(place.longitude_deg), place.altitude_m),
            boxes=np.array(boxes, dtype=np.float64).reshape(-1, BOX_COLUMNS),
            cylinders=np.array(cylinders, dtype=np.float64).reshape(-1, CYLINDER_COLUMNS),
            names=tuple(names),
            wind=table.wind,
            force_ned=table.disturbance.force_ned,
            restless=tuple(_restless(row, each) for row, each in enumerate(table.cylinder) if _is_restless(each)),
        )

    def clearance(self, position_ned: Array) -> float:
        """Distance (m) from a point (3,) to the nearest obstacle's surface, the ground left out.

        Negative inside of an obstacle (minus the depth in the one it is deepest in), inf without obstacles.
        """
        return float(_nearest(self.boxes, self.cylinders, position_ned)[1])

    def nearest(self, position_ned: Array) -> tuple[str | None, float]:
        """Whose surface `clearance` measures, and the same distance (m); None and inf without obstacles."""
        index, distance = _nearest(self.boxes, self.cylinders, position_ned)
        return (self.names[index] if index >= 0 else None), float(distance)

    def range_along(self, position_ned: Array, direction_ned: Array, max_range_m: float) -> float:
        """Distance (m) along a unit vector (3,) to the first surface, the ground included; inf beyond `max_range_m`."""
        return float(cast_ray(self.boxes, self.cylinders, position_ned, direction_ned, max_range_m))


class Scene:
    """A world in the course of one flight; time runs from the vehicle's boot."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._waiting = [each for each in world.restless if each.appears_within is not None]
        self._appeared_ns: dict[int, int] = {}
        self._last: tuple[int, World] | None = None

    def watch(self, time_ns: int, position_ned: Sequence[float]) -> None:
        """The vehicle is here now: what has waited for it appears, from this time on."""
        for each in self._waiting.copy():
            north, east, radius = self.world.cylinders[each.row, :3].tolist()
            distance = math.hypot(position_ned[0] - north, position_ned[1] - east) - radius
            if each.appears_within is not None and distance <= each.appears_within:
                self._waiting.remove(each)
                self._appeared_ns[each.row] = time_ns
                self._last = None

    def at(self, time_ns: int) -> World:
        """The world at a time up to now, standing still."""
        world = self.world
        if not world.restless:
            return world
        if self._last is None or self._last[0] != time_ns:
            self._last = time_ns, self._still(time_ns)
        return self._last[1]

    def _still(self, time_ns: int) -> World:
        world = self.world
        cylinders, absent = world.cylinders.copy(), []
        for each in world.restless:
            since_ns: int | None = 0
            if each.appears_within is not None:
                since_ns = self._appeared_ns.get(each.row)
            if since_ns is None or time_ns < since_ns:
                absent.append(each.row)
            elif each.route is not None:
                cylinders[each.row, :2] = each.route.at((time_ns - since_ns) * 1e-9)
        if not absent:
            return replace(world, cylinders=cylinders, restless=())
        gone = {len(world.boxes) + row for row in absent}
        names = tuple(name for number, name in enumerate(world.names) if number not in gone)
        return replace(world, cylinders=np.delete(cylinders, absent, axis=0), names=names, restless=())


def _is_restless(cylinder: CylinderTable) -> bool:
    return bool(cylinder.route) or cylinder.appears_within is not None


def _restless(row: int, cylinder: CylinderTable) -> Restless:
    """The way from the centre to the route's first place is gone once, the round over the route again and again."""
    route = None
    if cylinder.route:
        route = Route((cylinder.center, *cylinder.route, cylinder.route[0]), cylinder.speed)
    return Restless(row, route, cylinder.appears_within)


def _box_row(box: BoxTable) -> list[float]:
    yaw = math.radians(box.yaw_deg)
    bottom, top = box.span
    return [*box.center, 0.5 * box.size[0], 0.5 * box.size[1], math.cos(yaw), math.sin(yaw), -top, -bottom]


def _wall_row(wall: WallTable) -> list[float]:
    north, east = wall.end[0] - wall.start[0], wall.end[1] - wall.start[1]
    length = math.hypot(north, east)
    center = (wall.start[0] + 0.5 * north, wall.start[1] + 0.5 * east)
    bottom, top = wall.span
    return [*center, 0.5 * length, 0.5 * wall.thickness, north / length, east / length, -top, -bottom]


def _cylinder_row(center: Place, radius: float, bottom: float, top: float) -> list[float]:
    return [*center, radius, -top, -bottom]


@compiled
def _signed_norm(a: float, b: float, c: float) -> float:
    """Distance to a solid from the signed distances to its faces along three (two: pass -inf) orthogonal axes."""
    deepest = max(a, b, c)
    if deepest <= 0.0:
        return deepest
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return math.sqrt(a * a + b * b + c * c)


@compiled
def _nearest(boxes: Array, cylinders: Array, position_ned: Array) -> tuple[int, float]:
    """Row (boxes first, then cylinders; -1: none) and signed distance (m) of the nearest obstacle."""
    north, east, down = position_ned[0], position_ned[1], position_ned[2]
    index, nearest = -1, math.inf
    for i in range(boxes.shape[0]):
        box = boxes[i]
        dn, de = north - box[0], east - box[1]
        distance = _signed_norm(
            abs(dn * box[4] + de * box[5]) - box[2],
            abs(de * box[4] - dn * box[5]) - box[3],
            max(box[6] - down, down - box[7]),
        )
        if distance < nearest:
            index, nearest = i, distance
    for i in range(cylinders.shape[0]):
        cylinder = cylinders[i]
        dn, de = north - cylinder[0], east - cylinder[1]
        distance = _signed_norm(
            math.sqrt(dn * dn + de * de) - cylinder[2], -math.inf, max(cylinder[3] - down, down - cylinder[4])
        )
        if distance < nearest:
            index, nearest = boxes.shape[0] + i, distance
    return index, nearest


@compiled
def _slab(origin: float, direction: float, low: float, high: float) -> tuple[float, float]:
    """Where a ray is between two parallel planes: from, to (m along the ray); from > to if never."""
    if abs(direction) < _PARALLEL:
        return (-math.inf, math.inf) if low <= origin <= high else (math.inf, -math.inf)
    a, b = (low - origin) / direction, (high - origin) / direction
    return (a, b) if a <= b else (b, a)


@compiled
def _disc(north: float, east: float, dn: float, de: float, radius: float) -> tuple[float, float]:
    """The same inside an endless upright cylinder; `north`, `east` count from its axis."""
    square = dn * dn + de * de
    excess = north * north + east * east - radius * radius
    if square < _PARALLEL * _PARALLEL:
        return (-math.inf, math.inf) if excess <= 0.0 else (math.inf, -math.inf)
    along = -(north * dn + east * de) / square
    discriminant = along * along - excess / square
    if discriminant < 0.0:
        return math.inf, -math.inf
    half = math.sqrt(discriminant)
    return along - half, along + half


@compiled
def _entry(enter: float, leave: float) -> float:
    """First point of a ray's stretch inside a solid that is ahead; 0 from inside, inf if there is none."""
    return max(enter, 0.0) if enter <= leave and leave >= 0.0 else math.inf


@compiled
def ray_box(box: Array, origin: Array, dn: float, de: float, dd: float) -> float:
    """Distance (m) from `origin` (3,) along the unit vector (dn, de, dd), all NED, to a box; 0 inside, inf past it."""
    north, east = origin[0] - box[0], origin[1] - box[1]
    a = _slab(north * box[4] + east * box[5], dn * box[4] + de * box[5], -box[2], box[2])
    b = _slab(east * box[4] - north * box[5], de * box[4] - dn * box[5], -box[3], box[3])
    c = _slab(origin[2], dd, box[6], box[7])
    return _entry(max(a[0], b[0], c[0]), min(a[1], b[1], c[1]))


@compiled
def ray_cylinder(cylinder: Array, origin: Array, dn: float, de: float, dd: float) -> float:
    """The same for a cylinder's row, side and caps."""
    a = _disc(origin[0] - cylinder[0], origin[1] - cylinder[1], dn, de, cylinder[2])
    b = _slab(origin[2], dd, cylinder[3], cylinder[4])
    return _entry(max(a[0], b[0]), min(a[1], b[1]))


@compiled
def ray_ground(origin: Array, dd: float) -> float:
    """Distance (m) along a unit vector with the down component `dd` to the ground; 0 from below it, inf if upward."""
    return max(-origin[2] / dd, 0.0) if dd > _PARALLEL else math.inf


@compiled
def cast_ray(boxes: Array, cylinders: Array, origin: Array, direction: Array, max_range: float) -> float:
    """Distance (m) from `origin` (3,) along the unit vector `direction` (3,), both NED, to the first surface.

    0 from inside an obstacle, inf if nothing is hit within `max_range`.
    """
    dn, de, dd = direction[0], direction[1], direction[2]
    nearest = ray_ground(origin, dd)
    for i in range(boxes.shape[0]):
        nearest = min(nearest, ray_box(boxes[i], origin, dn, de, dd))
    for i in range(cylinders.shape[0]):
        nearest = min(nearest, ray_cylinder(cylinders[i], origin, dn, de, dd))
    return nearest if nearest <= max_range else math.inf
