"""The records of a world file in `worlds/`: places in metres north and east of the pad, heights above the ground."""

from collections.abc import Iterator
from typing import Annotated

import msgspec

from protocol.vehicle_parameters import NotNegative, Positive
from vehicle_sim.world.wind import WindSettings

Name = Annotated[str, msgspec.Meta(min_length=1)]
Place = tuple[float, float]
"""North, east (m)."""


_MOST = 1e9
"""The largest number that can be computed with, squares included: no world has any beyond."""
_FLATTEST_M = 1e-9


def _require_computable(record: msgspec.Struct) -> None:
    """Raises ValueError, naming the key, for numbers beyond, and for nan, which TOML can write."""
    for key in record.__struct_fields__:
        for number in _numbers(getattr(record, key)):
            if not abs(number) <= _MOST:
                raise ValueError(f"{key}: {number:g} is not a number from {-_MOST:g} to {_MOST:g}")


def _numbers(value: object) -> Iterator[float]:
    """All that a value of a record has."""
    if isinstance(value, tuple):
        for each in value:
            yield from _numbers(each)
    elif isinstance(value, float):
        yield value


class OriginTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[origin]`: where on earth the take-off pad is."""

    latitude_deg: Annotated[float, msgspec.Meta(gt=-90, lt=90)]
    longitude_deg: Annotated[float, msgspec.Meta(ge=-180, le=180)]
    altitude_m: Annotated[float, msgspec.Meta(ge=-1000, le=20_000)]
    """Above mean sea level."""

    def __post_init__(self) -> None:
        _require_computable(self)


Force = Annotated[float, msgspec.Meta(ge=-1000, le=1000)]
"""N"""


class DisturbanceTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """`[disturbance]`: a force on the vehicle beside that of the wind."""

    force_ned: tuple[Force, Force, Force] = (0.0, 0.0, 0.0)
    """N, constant while the vehicle is in the air."""


class ObstacleTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The keys that every obstacle has."""

    name: Name
    height: float | tuple[float, float]
    """Bottom and top (m above the ground), or the top alone."""

    @property
    def span(self) -> tuple[float, float]:
        """Bottom, top (m above the ground)."""
        return self.height if isinstance(self.height, tuple) else (0.0, self.height)

    def __post_init__(self) -> None:
        _require_computable(self)
        bottom, top = self.span
        if bottom < 0.0:
            raise ValueError(f"height: bottom {bottom} is below the ground")
        if top <= bottom:
            raise ValueError(f"height: top {top} is not above bottom {bottom}")


class BoxTable(ObstacleTable, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[box]]`."""

    center: Place
    size: tuple[Positive, Positive]
    """Along and across the box's own axis (m)."""
    yaw_deg: float = 0.0
    """Direction of that axis, clockwise from north."""


class CylinderTable(ObstacleTable, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[cylinder]]`, upright. It may move along a route, appear late, or both."""

    center: Place
    radius: Positive
    route: tuple[Place, ...] = ()
    """It moves from `center` to these places one after the other, then from the last to the first, and so on."""
    speed: NotNegative = 0.0
    """m/s, along the route."""
    appears_within: Positive | None = None
    """The cylinder is absent until the vehicle's centre is this near (m) to its future side, seen from above."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.route) != (self.speed > 0.0):
            raise ValueError("route: what moves has a route and a speed")
        if self.route and all(place == self.route[0] for place in (self.center, *self.route)):
            raise ValueError("route: it leads nowhere")

    @property
    def is_dynamic(self) -> bool:
        """It moves or appears late."""
        return bool(self.route) or self.appears_within is not None


class WallTable(ObstacleTable, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[wall]]`: a box around the line from `start` to `end`."""

    start: Place
    end: Place
    thickness: Positive

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == self.end:
            raise ValueError("end: the same place as start")


class TreeTable(ObstacleTable, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[tree]]`: two cylinders of one name, the crown over `height` and the trunk below it."""

    center: Place
    trunk_radius: Positive
    crown_radius: Positive


class HillTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[[hill]]`: the cap of a sphere, steepest at its foot: by 2 `radius` `height` / (`radius`^2 - `height`^2)."""

    name: Name
    center: Place
    radius: Positive
    """m, of its foot."""
    height: Annotated[float, msgspec.Meta(ge=_FLATTEST_M)]
    """m, at most its radius."""

    def __post_init__(self) -> None:
        _require_computable(self)
        if self.height > self.radius:
            raise ValueError(f"height: {self.height} is more than the radius {self.radius}")


class WorldTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole world file."""

    name: Name
    origin: OriginTable
    wind: WindSettings = WindSettings()
    disturbance: DisturbanceTable = DisturbanceTable()
    box: tuple[BoxTable, ...] = ()
    cylinder: tuple[CylinderTable, ...] = ()
    wall: tuple[WallTable, ...] = ()
    tree: tuple[TreeTable, ...] = ()
    hill: tuple[HillTable, ...] = ()
