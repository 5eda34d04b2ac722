"""Waypoints by latitude and longitude in a mission's own file, made into metres around the take-off."""

from typing import Any

from companion.config_types import FARTHEST_M
from companion.mission.files import MissionFileError, Place, offset, too_far

_BOUNDS = {"latitude": 90.0, "longitude": 180.0}
_METRES = "north", "east"


def first_place(tables: dict[str, Any]) -> Place | None:
    """The first waypoint by latitude and longitude in a mission's tables; None without one. Raises MissionFileError
    for one that is neither that nor by north and east."""
    places = [_place(table, number) for number, table in enumerate(_waypoints(tables), 1)]
    return next((place for place in places if place is not None), None)


def in_metres(tables: dict[str, Any], origin: Place) -> dict[str, Any]:
    """The same tables with all waypoints by north and east of `origin`. Raises MissionFileError."""
    waypoints = [_moved(table, number, origin) for number, table in enumerate(_waypoints(tables), 1)]
    return {**tables, "waypoints": waypoints}


def _waypoints(tables: dict[str, Any]) -> list[Any]:
    waypoints = tables.get("waypoints")
    return waypoints if isinstance(waypoints, list) else []


def _moved(table: Any, number: int, origin: Place) -> Any:
    place = _place(table, number)
    if place is None:
        return table
    metres = offset(place, origin)
    if max(map(abs, metres)) > FARTHEST_M:
        raise MissionFileError(f"waypoint {number}: {too_far(metres, origin)}")
    return dict(zip(_METRES, metres, strict=True)) | {key: table[key] for key in table if key not in _BOUNDS}


def _place(table: Any, number: int) -> Place | None:
    if not isinstance(table, dict) or not _BOUNDS.keys() & table.keys():
        return None
    if not _BOUNDS.keys() <= table.keys() or set(_METRES) & table.keys():
        raise MissionFileError(f"waypoint {number}: give latitude and longitude, or north and east")
    for name, most in _BOUNDS.items():
        value = table[name]
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
            raise MissionFileError(f"waypoint {number}: {name} {value!r}: a number from -{most:g} to {most:g} (deg)")
    return float(table["latitude"]), float(table["longitude"])
