"""Missions as people plan them, by name, with what each is read as; written by the tools' own writer, or by their
schema where the tool has no writer that runs here."""

import math
from typing import Any, NamedTuple

import numpy as np
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.mission.files import Place
from protocol.frames import to_geodetic

NAN = math.nan
TAKEOFF, WAYPOINT, LOITER, RTL, LAND, DELAY = 22, 16, 19, 20, 21, 93
YAW, SPEED, GRIPPER, JUMP, LAND_START = 115, 178, 211, 177, 189
ABSOLUTE, PLAIN, RELATIVE, TERRAIN = 0, 2, 3, 10


class Planned(NamedTuple):
    """An item; north and east of the home in m, None for none."""

    command: int
    params: tuple[float, ...] = ()
    where: tuple[float, float] | None = None
    height: float = 0.0
    frame: int = RELATIVE


class Entry(NamedTuple):
    """What a file has, and what it is read as."""

    items: tuple[Planned, ...]
    places: tuple[tuple[float, float, float], ...] = ()
    """North, east, height (m) of what is flown to."""
    refused: int | None = None
    """The number of the item that can't be flown."""


def to(north: float, east: float, height: float, *params: float, command: int = WAYPOINT) -> Planned:
    return Planned(command, params, (north, east), height)


def do(command: int, *params: float) -> Planned:
    return Planned(command, params, frame=PLAIN)


UP, BACK, DOWN = Planned(TAKEOFF, height=3.0), do(RTL), do(LAND)
A, B, C = (6.0, 0.0, 3.0), (6.0, 8.0, 4.0), (-3.0, 8.0, 2.5)
CORPUS = {
    "out and back": Entry((UP, to(*A), BACK), (A, (0, 0, 3))),
    "round": Entry((UP, to(*A), to(*B), to(*C), BACK), (A, B, C, (0, 0, 2.5))),
    "land there": Entry((UP, to(*A), to(*B, command=LAND)), (A, (6, 8, 3))),
    "land at the last": Entry((UP, to(*A), to(*B), DOWN), (A, B)),
    "hover": Entry((UP, do(DELAY, 2.0), DOWN), ((0, 0, 3),)),
    "take-off aside": Entry((to(3.0, 4.0, 3.0, command=TAKEOFF), to(*A), BACK), ((3, 4, 3), A, (0, 0, 3))),
    "take-off at home": Entry((to(0.0, 0.5, 3.0, command=TAKEOFF), to(*A), BACK), (A, (0, 0, 3))),
    "loiter at a place": Entry((UP, to(*A, 2.0, command=LOITER), BACK), (A, (0, 0, 3))),
    "loiter higher": Entry((UP, to(*A), Planned(LOITER, (2.0,), height=5.5), BACK), (A, (6, 0, 5.5), (0, 0, 5.5))),
    "twice": Entry((UP, to(*A), to(*B), do(JUMP, 2, 1), BACK), (A, B, A, B, (0, 0, 4))),
    "speed, heading, parcel": Entry(
        (UP, do(SPEED, 1, 2.0, -1), to(*A), do(YAW, 90.0), to(*B), do(GRIPPER, 1, 0), do(LAND_START), BACK),
        (A, B, (0, 0, 4)),
    ),
    "absolute": Entry((UP, to(*A)._replace(frame=ABSOLUTE), BACK), refused=2),
    "terrain": Entry((UP, to(*A), to(*B)._replace(frame=TERRAIN), BACK), refused=3),
    "picture": Entry((UP, to(*A), do(2000, 0, 0, 1), BACK), refused=3),
    "region of interest": Entry((UP, Planned(195, (), (5.0, 5.0), 0.0), to(*A), BACK), refused=2),
    "spline": Entry((UP, to(*A), to(*B, command=82), BACK), refused=3),
    "for ever": Entry((UP, to(*A), do(JUMP, 2, -1), BACK), refused=3),
    "in the air": Entry((UP, to(*A), to(*B)), refused=3),
    "second flight": Entry((UP, to(*A), DOWN, UP, BACK), refused=4),
    "no take-off": Entry((to(*A), BACK), refused=1),
}


def _numbers(item: Planned, home: Place) -> list[float]:
    params, place = [*item.params, *[0.0] * 4][:4], [0.0, 0.0]
    if item.where is not None:
        radians = math.radians(home[0]), math.radians(home[1]), 0.0
        place = np.degrees(to_geodetic(np.array([*item.where, 0.0]), radians)[:2]).tolist()
    return [*params, *place, item.height]


def loaded(entry: Entry, home: Place) -> mavwp.MAVWPLoader:
    """Items in pymavlink's loader, with the home as item 0."""
    loader = mavwp.MAVWPLoader(1, 1)
    loader.add_latlonalt(*home, 488.0)
    for number, item in enumerate(entry.items, 1):
        fields = item.frame, item.command, 0, 1, *_numbers(item, home)
        loader.add(mavlink.MAVLink_mission_item_message(1, 1, number, *fields))
    return loader


def plan(entry: Entry, home: Place) -> dict[str, Any]:
    """By the schema of QGroundControl's plans: a parameter that is left open is null, and an item with an altitude says
    what it counts from."""
    items = []
    for number, item in enumerate(entry.items, 1):
        numbers = [None if item.where is None and 4 <= n < 6 else value for n, value in enumerate(_numbers(item, home))]
        simple = {"type": "SimpleItem", "autoContinue": True, "command": item.command, "doJumpId": number}
        if item.frame != PLAIN:
            simple |= {"AMSLAltAboveTerrain": None, "Altitude": item.height, "AltitudeMode": 1}
            numbers[3] = None
        items.append({**simple, "frame": item.frame, "params": numbers})
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {
            "version": 2,
            "firmwareType": 12,
            "vehicleType": 2,
            "globalPlanAltitudeMode": 1,
            "cruiseSpeed": 15,
            "hoverSpeed": 5,
            "plannedHomePosition": [*home, 488.0],
            "items": items,
        },
    }
