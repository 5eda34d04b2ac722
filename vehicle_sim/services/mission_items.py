"""What the items of missions, fences and rally points say, and which of them the vehicle takes."""

import math
from typing import Any

from protocol.messages import dialect
from vehicle_sim.autopilot.fence import Zone
from vehicle_sim.autopilot.mission import KINDS
from vehicle_sim.autopilot.plan import Item, Place
from vehicle_sim.services.places import ON_EARTH, Geodetic, place_of

_POLYGONS = {
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {dialect.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True, dialect.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False}
"""Whether they are inclusions."""
_ANYWHERE = {dialect.MAV_CMD_NAV_TAKEOFF, dialect.MAV_CMD_NAV_LAND}
"""Items that can happen where the vehicle is."""


class ItemError(Exception):
    """An item that can't be taken; its argument is the MAV_MISSION_RESULT."""


def params_of(message: Any) -> tuple[float, float, float, float]:
    return message.param1, message.param2, message.param3, message.param4


def check(message: Any, origin: Geodetic) -> None:
    """Raises ItemError for an item that the vehicle can't fly or keep."""
    command, kind = message.command, message.mission_type
    if message.frame not in ON_EARTH and message.frame != dialect.MAV_FRAME_MISSION:
        raise ItemError(dialect.MAV_MISSION_UNSUPPORTED_FRAME)
    if kind == dialect.MAV_MISSION_TYPE_MISSION:
        to_item(message, origin)
    elif kind == dialect.MAV_MISSION_TYPE_FENCE and command in _POLYGONS:
        placed(message, origin)
        if not 3.0 <= message.param1 < math.inf:
            raise ItemError(dialect.MAV_MISSION_ERROR)
    elif kind == dialect.MAV_MISSION_TYPE_FENCE and command in _CIRCLES:
        if not message.param1 >= 0.0:
            raise ItemError(dialect.MAV_MISSION_INVALID_PARAM1)
        if not _is_nothing(message):
            placed(message, origin)
    elif kind == dialect.MAV_MISSION_TYPE_RALLY and command == dialect.MAV_CMD_NAV_RALLY_POINT:
        placed(message, origin)
    else:
        raise ItemError(dialect.MAV_MISSION_UNSUPPORTED)


def placed(message: Any, origin: Geodetic) -> Place:
    place = place_of(message, origin) if message.frame in ON_EARTH else None
    if place is None or (math.isnan(place.north) and message.command not in _ANYWHERE):
        raise ItemError(dialect.MAV_MISSION_INVALID_PARAM5_X)
    if not math.isfinite(message.z):
        raise ItemError(dialect.MAV_MISSION_INVALID_PARAM7)
    return place


_ROI = {
    dialect.MAV_ROI_LOCATION: dialect.MAV_CMD_DO_SET_ROI_LOCATION,
    dialect.MAV_ROI_NONE: dialect.MAV_CMD_DO_SET_ROI_NONE,
}
"""What DO_SET_ROI means, by its first parameter."""


def to_item(message: Any, origin: Geodetic) -> Item:
    """An item of a mission. Raises ItemError for one that can't be flown."""
    command, params = message.command, params_of(message)
    if command in (dialect.MAV_CMD_DO_SET_ROI, dialect.MAV_CMD_NAV_ROI):
        if params[0] not in _ROI:
            raise ItemError(dialect.MAV_MISSION_INVALID_PARAM1)
        command = _ROI[int(params[0])]
    row = KINDS.get(command)
    if row is None or (row.placed and message.frame not in ON_EARTH):
        raise ItemError(dialect.MAV_MISSION_UNSUPPORTED)
    if not row.placed and message.frame in ON_EARTH and command != dialect.MAV_CMD_DO_SET_ROI_NONE:
        raise ItemError(dialect.MAV_MISSION_UNSUPPORTED)
    for number in row.needs:
        if not math.isfinite(params[number - 1]):
            raise ItemError(dialect.MAV_MISSION_INVALID_PARAM1 + number - 1)
    place = placed(message, origin) if row.placed else None
    return Item(command, params, place, bool(message.autocontinue))


def _is_nothing(message: Any) -> bool:
    """A circle without a radius: MAVSDK's way to send a fence without circles."""
    return message.command in _CIRCLES and message.param1 == 0.0


def zones(messages: list[Any], origin: Geodetic) -> tuple[Zone, ...]:
    """A fence: circles, and polygons whose corners follow each other. Raises ItemError for one that is cut off."""
    found: list[Zone] = []
    rest = [message for message in messages if not _is_nothing(message)]
    while rest:
        first = rest[0]
        size = 1 if first.command in _CIRCLES else round(first.param1)
        corners, rest = rest[:size], rest[size:]
        if len(corners) < size or any((m.command, m.param1) != (first.command, first.param1) for m in corners):
            raise ItemError(dialect.MAV_MISSION_ERROR)
        places = tuple((place.north, place.east) for place in (placed(m, origin) for m in corners))
        inclusion = (_CIRCLES | _POLYGONS)[first.command]
        found.append(Zone(inclusion, places, first.param1 if first.command in _CIRCLES else 0.0))
    return tuple(found)
