"""Ranges around the vehicle and below it: OBSTACLE_DISTANCE and DISTANCE_SENSOR -> state types.

A message is accepted whole or not at all, as in `wire`. What reads logs for people needs no more than this.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from companion.link.refusals import RefusedRingError
from companion.link.sector_scans import SECTORS, SectorReport
from companion.reports import RangeBelow
from companion.state import Scan
from protocol.arrays import Array
from protocol.messages import dialect

_NOTHING = 65535
_SLACK = 1e-3
"""Part of a beam: 360 degrees over an increment in single precision may be so much more than the beams of a turn."""
_HALF_SECTOR = math.pi / SECTORS
_ARDUPILOT_RING = 10
"""PROXIMITY_SENSOR_ID_START"""
_OLDEST_SECTOR_MS = 100
"""So long before it is sent a sector of ArduPilot's may have been seen: a turn of its LiDAR."""


def obstacle_distance(message: Any, time_ns: int) -> Scan:
    """OBSTACLE_DISTANCE (330), in the body's frame: cm -> m.

    `max_distance` + 1 means nothing there, 65535 not measured.
    """
    increment = message.increment_f or float(message.increment)
    if message.frame != dialect.MAV_FRAME_BODY_FRD:
        raise RefusedRingError(f"OBSTACLE_DISTANCE in frame {message.frame}, not BODY_FRD")
    if not 0.0 < abs(increment) <= 360.0 or not math.isfinite(message.angle_offset):
        raise RefusedRingError(
            f"OBSTACLE_DISTANCE with increment {increment:g} and offset {message.angle_offset:g} deg"
        )
    if message.max_distance <= message.min_distance:
        raise RefusedRingError(f"OBSTACLE_DISTANCE from {message.min_distance} to {message.max_distance} cm")
    distances = np.array(message.distances, dtype=np.float64)
    known = distances != _NOTHING
    around = abs(increment) * int(known.nonzero()[0].max(initial=0))
    if around >= 360.0:
        raise RefusedRingError(f"OBSTACLE_DISTANCE with beams over {around:g} deg")
    count = beams_of_turn(increment, distances.size)
    distances, known = distances[:count], known[:count]
    bearings = _bearings(message.angle_offset, increment, count)
    if increment < 0.0:  # clockwise, as all others
        distances, bearings, known = (each[::-1].copy() for each in (distances, bearings, known))
    beyond = distances[known & (distances > message.max_distance + 1)]
    if beyond.size and beyond.min() < beyond.max():
        raise RefusedRingError(f"OBSTACLE_DISTANCE with distances beyond {message.max_distance} cm")
    hit = known & (distances <= message.max_distance)
    ranges = np.minimum(distances, message.max_distance) * 0.01
    return Scan(time_ns, message.time_usec, bearings, ranges, hit, known)


def beams_of_turn(increment_deg: float, most: int) -> int:
    """How many of the message's beams, `most`, a turn has at an increment that is not 0: the rest is unused."""
    return min(most, max(2, math.ceil(360.0 / abs(increment_deg) - _SLACK)))


@lru_cache(maxsize=8)
def _bearings(offset_deg: float, increment_deg: float, count: int) -> Array:
    """(count,) rad; the same from ring to ring."""
    bearings: Array = np.radians(offset_deg + increment_deg * np.arange(count))
    return bearings


def sector_distance(message: Any) -> SectorReport | None:
    """DISTANCE_SENSOR (132), in the body's frame: cm -> m. None of one that does not cover its eighth of the ring: up
    and down, and narrow beams, beside which the vehicle may hit what they miss.

    ArduPilot reports its rings so, with ids from 10 on and no field of view, and an empty sector as `max_distance`; of
    others, that is the farthest hit. Its stamp is when it was sent.
    """
    is_ardupilot = message.horizontal_fov == 0.0 and message.id >= _ARDUPILOT_RING
    if message.orientation >= SECTORS or not (is_ardupilot or message.horizontal_fov > _HALF_SECTOR):
        return None
    near, far, distance = message.min_distance, message.max_distance, message.current_distance
    if far <= near:
        raise RefusedRingError(f"DISTANCE_SENSOR from {near} to {far} cm")
    return SectorReport(
        max(message.time_boot_ms - _OLDEST_SECTOR_MS, 0) if is_ardupilot else message.time_boot_ms,
        message.orientation,
        min(distance, far) * 0.01,
        hit=distance < far if is_ardupilot else distance <= far,
        known=message.signal_quality != 1,
        reach_m=far * 0.01,
    )


def range_below(message: Any) -> RangeBelow | None:
    """DISTANCE_SENSOR (132) of a sensor that looks down: cm -> m. None of another one, and of a bad measurement."""
    near, far, distance = message.min_distance, message.max_distance, message.current_distance
    if message.orientation != dialect.MAV_SENSOR_ROTATION_PITCH_270:
        return None
    if message.signal_quality == 1 or not near < distance:
        return None
    return RangeBelow(message.time_boot_ms, distance * 0.01 if distance <= far else math.inf)
