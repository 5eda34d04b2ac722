"""Obstacles and hills on flat ground. Axes are NED in metres, with the origin on the ground at the take-off pad."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from protocol import toml_files
from protocol.arrays import Array, Vector
from vehicle_sim.world.dynamic import DynamicObstacle
from vehicle_sim.world.geometry import BOX_COLUMNS, CYLINDER_COLUMNS, cast_ray, nearest_obstacle
from vehicle_sim.world.tables import BoxTable, Place, WallTable, WorldTable
from vehicle_sim.world.wind import WindSettings


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Boxes, upright cylinders and hills on flat ground, with exact distances and ray hits. It stands still: the
    dynamic obstacles are where they begin, see `scene.Scene` for the world at a later time."""

    name: str
    origin: tuple[float, float, float]
    """Latitude, longitude (rad), altitude (m) of the point (0, 0, 0)."""
    boxes: Array
    """(n, 8) of geometry.BOX_COLUMNS."""
    cylinders: Array
    """(m, 6) of geometry.CYLINDER_COLUMNS."""
    names: tuple[str, ...]
    """Names of the boxes, then of the cylinders, hills included."""
    wind: WindSettings = field(default_factory=WindSettings)
    force_ned: Vector = (0.0, 0.0, 0.0)
    """N, on the vehicle while it is in the air."""
    dynamic: tuple[DynamicObstacle, ...] = ()

    @classmethod
    def load(cls, path: Path, overrides: Sequence[str] = ()) -> "World":
        """Read a world file, with overrides as "origin.altitude_m=3".

        Raises TomlFileError, naming file and key, for a file that can't be read or a world that can't exist.
        """
        return cls.build(toml_files.load(path, WorldTable, overrides))

    @classmethod
    def from_tables(cls, tables: dict[str, Any], source: str) -> "World":
        """The same from tables that are already read; errors name `source`."""
        return cls.build(toml_files.convert(tables, WorldTable, source))

    @classmethod
    def build(cls, table: WorldTable) -> "World":
        """The obstacles of a world file as rows."""
        boxes = [_box_row(box) for box in table.box] + [_wall_row(wall) for wall in table.wall]
        cylinders = [_cylinder_row(c.center, c.radius, *c.span) for c in table.cylinder]
        names = [obstacle.name for obstacle in (*table.box, *table.wall, *table.cylinder)]
        for tree in table.tree:
            bottom, top = tree.span
            if bottom > 0.0:
                cylinders.append(_cylinder_row(tree.center, tree.trunk_radius, 0.0, bottom))
                names.append(tree.name)
            cylinders.append(_cylinder_row(tree.center, tree.crown_radius, bottom, top))
            names.append(tree.name)
        for hill in table.hill:
            sphere = 0.5 * (hill.radius**2 + hill.height**2) / hill.height
            cylinders.append(_cylinder_row(hill.center, hill.radius, 0.0, hill.height, sphere))
            names.append(hill.name)
        place = table.origin
        return cls(
            name=table.name,
            origin=(math.radians(place.latitude_deg), math.radians(place.longitude_deg), place.altitude_m),
            boxes=np.array(boxes, dtype=np.float64).reshape(-1, BOX_COLUMNS),
            cylinders=np.array(cylinders, dtype=np.float64).reshape(-1, CYLINDER_COLUMNS),
            names=tuple(names),
            wind=table.wind,
            force_ned=table.disturbance.force_ned,
            dynamic=tuple(DynamicObstacle.of(row, each) for row, each in enumerate(table.cylinder) if each.is_dynamic),
        )

    def clearance(self, position_ned: Array) -> float:
        """Distance (m) from a point (3,) to the surface of the nearest obstacle; the ground is no obstacle.

        Negative inside an obstacle: minus the depth in the one where it is deepest. inf without obstacles.
        """
        return float(nearest_obstacle(self.boxes, self.cylinders, position_ned)[1])

    def nearest(self, position_ned: Array) -> tuple[str | None, float]:
        """Name of the obstacle nearest to a point (3,), and `clearance` (m); None and inf without obstacles."""
        index, distance = nearest_obstacle(self.boxes, self.cylinders, position_ned)
        return (self.names[index] if index >= 0 else None), float(distance)

    def range_along(self, position_ned: Array, direction_ned: Array, max_range_m: float) -> float:
        """Distance (m) from a point (3,) along a unit vector (3,) to the first surface, the ground included.

        inf beyond `max_range_m`.
        """
        return float(cast_ray(self.boxes, self.cylinders, position_ned, direction_ned, max_range_m))


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


def _cylinder_row(center: Place, radius: float, bottom: float, top: float, sphere: float = 0.0) -> list[float]:
    return [*center, radius, -top, -bottom, sphere]
