"""Places on earth, as messages give them, in the vehicle's local axes."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from protocol.frames import to_geodetic, to_local
from protocol.messages import dialect
from vehicle_sim.autopilot.plan import Place

Geodetic = tuple[float, float, float]
"""Latitude, longitude (rad), altitude above mean sea level (m)."""

UNSET_E7 = 2**31 - 1
"""A latitude or longitude that is not given (1e-7 degrees)."""
ABOVE_HOME = frozenset({dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
ON_EARTH = ABOVE_HOME | {dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT}


def horizontal(latitude_deg: float, longitude_deg: float, origin: Geodetic) -> tuple[float, float] | None:
    """North and east (m); None if there is no such place on earth, or it is not a number."""
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        return None
    local = to_local((math.radians(latitude_deg), math.radians(longitude_deg), 0.0), origin)
    return float(local[0]), float(local[1])


def on_earth(position_ned: Sequence[float], origin: Geodetic) -> tuple[int, int, float]:
    """Latitude, longitude (1e-7 degrees), altitude above mean sea level (m) of a place (m) in the local axes."""
    latitude, longitude, altitude = to_geodetic(np.array(position_ned), origin)
    return round(math.degrees(latitude) * 1e7), round(math.degrees(longitude) * 1e7), altitude


def as_whole(value: float, scale: float) -> int:
    """A coordinate of MISSION_ITEM in MISSION_ITEM_INT; unset if it is not given, or none that fits there."""
    scaled = value * scale
    return round(scaled) if abs(scaled) < UNSET_E7 else UNSET_E7


def as_real(value: int, scale: float) -> float:
    """A coordinate of MISSION_ITEM_INT in MISSION_ITEM; not a number if it is unset."""
    return math.nan if value == UNSET_E7 else value * scale


def place_of(item: Any, origin: Geodetic) -> Place | None:
    """Where a MISSION_ITEM or MISSION_ITEM_INT in a global frame is; None if there is no such place.

    Without a latitude and longitude it is not a number of metres north and east.
    """
    scale = 1e-7 if item.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT else 1.0
    above_home = item.frame in ABOVE_HOME
    height = item.z if above_home else item.z - origin[2]
    if (item.x, item.y) in ((0, 0), (UNSET_E7, UNSET_E7)):
        return Place(math.nan, math.nan, height, above_home)
    where = horizontal(item.x * scale, item.y * scale, origin)
    return None if where is None else Place(*where, height, above_home)
