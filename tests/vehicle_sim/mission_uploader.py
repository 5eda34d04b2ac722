"""The other end of the mission protocol, made of unmodified pymavlink: uploads and downloads in a vehicle's ticks."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from protocol.frames import to_geodetic
from tests.vehicle_sim.foreign_pilot import EMPTY, ForeignPilot

RELATIVE, ON_THE_SPOT = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_FRAME_MISSION
Row = tuple[int, int, tuple[float, ...], int, int, float]
"""Command, frame, four parameters, latitude, longitude (1e-7 degrees), height (m)."""


def at(command: int, north: float, east: float, height: float, *params: float) -> Row:
    """An item at metres from the origin and above home."""
    latitude, longitude, _ = to_geodetic(np.array([north, east, 0.0]), EMPTY.origin)
    x, y = (round(math.degrees(angle) * 1e7) for angle in (latitude, longitude))
    return command, RELATIVE, (*params, *(math.nan,) * (4 - len(params))), x, y, height


def do(command: int, *params: float) -> Row:
    """An item without a place."""
    return command, ON_THE_SPOT, (*params, *(0.0,) * (4 - len(params))), 0, 0, 0.0


def message(row: Row, number: int, kind: int = 0) -> Any:
    command, frame, params, x, y, z = row
    return mavlink.MAVLink_mission_item_int_message(1, 1, number, frame, command, 0, 1, *params, x, y, z, kind)


def upload(pilot: ForeignPilot, rows: Sequence[Row], kind: int = 0) -> int:
    """The MAV_MISSION_RESULT at the end."""
    pilot.send(mavlink.MAVLink_mission_count_message(1, 1, len(rows), kind))
    for _ in range(len(rows) + 2):
        before = pilot.time_s
        pilot.fly(0.004)
        acks = pilot.all("MISSION_ACK", before)
        if acks:
            assert (acks[0].mission_type, acks[0].target_component) == (kind, 191)
            return int(acks[0].type)
        (request,) = pilot.all("MISSION_REQUEST_INT", before)
        pilot.send(message(rows[request.seq], request.seq, kind))
    raise AssertionError("no end of the upload")


def download(pilot: ForeignPilot, kind: int = 0) -> list[Any]:
    """All items, as messages."""
    before = pilot.time_s
    pilot.send(mavlink.MAVLink_mission_request_list_message(1, 1, kind))
    pilot.fly(0.004)
    (count,) = pilot.all("MISSION_COUNT", before)
    for number in range(count.count):
        pilot.send(mavlink.MAVLink_mission_request_int_message(1, 1, number, kind))
        pilot.fly(0.004)
    pilot.send(mavlink.MAVLink_mission_ack_message(1, 1, mavlink.MAV_MISSION_ACCEPTED, kind))
    return pilot.all("MISSION_ITEM_INT", before)
