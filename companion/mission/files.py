"""Missions as ground stations write them: QGroundControl's .plan, and the .waypoints of Mission Planner and MAVProxy
(QGC WPL 110), and as vehicles store them. Read into items, and made into a `Mission` around the place where the vehicle
stands.

Formats: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html,
https://mavlink.io/en/file_formats/. What can't be flown as it is meant is refused with the item's number.
"""

import json
import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import msgspec

from companion.config_types import FARTHEST_M
from companion.mission.plan import Mission, Waypoint
from protocol.frames import to_local
from protocol.messages import dialect

Place = tuple[float, float]
"""Latitude, longitude (deg)."""

_ABOVE_HOME = frozenset({dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_ON_EARTH = _ABOVE_HOME | {
    dialect.MAV_FRAME_GLOBAL,
    dialect.MAV_FRAME_GLOBAL_INT,
    dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT,
    dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT,
}
_NO_PLACE = 2**31 - 1
"""In an item's x or y: wherever the vehicle is."""
_MOST_ITEMS = 1000
_HEAD = "QGC WPL 110"
_PLAN_VERSIONS = 1, 2
"""Versions of the plan and of the mission in it."""
_AT_HOME_M = 1.0
"""A take-off from so near is from its place."""
_NOT_ABOVE_HOME = "altitudes count from the take-off (frame 3), not as in frame {}"
_PLACE = frozenset({"north", "east", "height"})


class MissionFileError(ValueError):
    """A file that is none, or an item that can't be flown; the message has its number."""


class Item(msgspec.Struct, frozen=True):
    """A mission item, with MAVLink's numbers for frame and command; NaN for a parameter that is left open."""

    number: int
    """In the file."""
    frame: int
    command: int
    params: tuple[float, float, float, float, float, float, float]

    @property
    def place(self) -> Place | None:
        """Where it is; None: wherever the vehicle is."""
        latitude, longitude = self.params[4:6]
        if math.isnan(latitude) or math.isnan(longitude) or (latitude == 0.0 and longitude == 0.0):
            return None
        return latitude, longitude


class Circle(msgspec.Struct, frozen=True):
    """A fence that is kept within."""

    center: Place
    radius: float


class MissionFile(msgspec.Struct, frozen=True):
    """What a file says."""

    items: tuple[Item, ...]
    home: Place | None = None
    """Where it was planned from."""
    speed: float | None = None
    """m/s"""
    fences: tuple[Circle, ...] = ()
    notes: tuple[str, ...] = ()
    """What of it plays no part in a flight."""


def parse(text: str) -> MissionFile:
    """Read a file of either kind, with or without a byte order mark. Raises MissionFileError."""
    text = text.removeprefix("\ufeff")
    if text.startswith("QGC WPL"):
        return _waypoints(text)
    try:
        tables = json.loads(text)
    except (ValueError, RecursionError) as error:  # not JSON, a number or a nesting without end
        raise MissionFileError(f"neither {_HEAD} nor JSON: {error}") from None
    try:
        return _plan(tables)
    except MissionFileError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise MissionFileError(f"no plan of QGroundControl: {error!r}") from None


# -- .waypoints --------------------------------------------------------------------------------------------------------


def _waypoints(text: str) -> MissionFile:
    head, *lines = text.splitlines()
    if head.strip() != _HEAD:
        raise MissionFileError(f"{head.strip()}: the version that is read is {_HEAD}")
    items = []
    for line in lines:
        if not line.strip() or line.startswith("#"):
            continue
        cells = line.split()
        try:
            number, _, frame, command = map(int, cells[:4])
            one, two, three, four, x, y, z = map(float, cells[4:11])
            int(cells[11])
        except (ValueError, IndexError):
            raise MissionFileError(f"item {cells[0]}: not 12 numbers: {line.strip()}") from None
        items.append(Item(number, frame, command, (one, two, three, four, x, y, z)))
    home = items[0].place if items else None  # the first line is the home, whatever command it has
    return MissionFile(tuple(items[1:]), home)


def to_waypoints(file: MissionFile) -> str:
    """The text of a .waypoints file."""
    latitude, longitude = file.home or (0.0, 0.0)
    home = Item(0, 0, dialect.MAV_CMD_NAV_WAYPOINT, (0.0, 0.0, 0.0, 0.0, latitude, longitude, 0.0))
    lines = [_HEAD]
    for item in (home, *file.items):
        numbers = "\t".join(f"{0.0 if math.isnan(value) else value:.8f}" for value in item.params)
        lines.append(f"{item.number}\t{int(item is home)}\t{item.frame}\t{item.command}\t{numbers}\t1")
    return "\n".join(lines) + "\n"


# -- stored in a vehicle -----------------------------------------------------------------------------------------------


def stored(messages: Sequence[Any], home: Place, *, first_is_home: bool) -> MissionFile:
    """The items MISSION_ITEM_INT (73) of a vehicle that stands at `home`. `first_is_home`: the first is no item."""
    return MissionFile(tuple(map(_stored_item, messages[1:] if first_is_home else messages)), home)


def _stored_item(message: Any) -> Item:
    x, y = (math.nan if value == _NO_PLACE else float(value) for value in (message.x, message.y))
    if message.frame in _ON_EARTH:
        x, y = x * 1e-7, y * 1e-7
    params = message.param1, message.param2, message.param3, message.param4, x, y, message.z
    return Item(message.seq, message.frame, message.command, params)


# -- .plan -------------------------------------------------------------------------------------------------------------


def _plan(tables: dict[str, Any]) -> MissionFile:
    if tables["fileType"] != "Plan":
        raise MissionFileError(f"a file of the type {tables['fileType']}, not a Plan")
    if "mission" not in tables:
        raise MissionFileError("there is no mission in it")
    mission, items = tables["mission"], []
    versions = tables["version"], mission["version"]
    if versions != _PLAN_VERSIONS:
        raise MissionFileError(
            f"a plan of version {versions[0]}, its mission of version {versions[1]}: 1 and 2 are read"
        )
    for index, table in enumerate(mission["items"], 1):
        number = int(table.get("doJumpId", index))
        if table["type"] != "SimpleItem":
            kind = table.get("complexItemType", table["type"])
            raise MissionFileError(f"item {number}: a pattern ({kind}) is not flown: plan its waypoints one by one")
        one, two, three, four, x, y, z = (math.nan if value is None else float(value) for value in table["params"])
        items.append(Item(number, int(table["frame"]), int(table["command"]), (one, two, three, four, x, y, z)))
    latitude, longitude, *_ = mission["plannedHomePosition"]
    fence = tables.get("geoFence", {})
    for polygon in fence.get("polygons", ()):
        corners = len(polygon["polygon"])
        raise MissionFileError(
            f"a fence of {corners} corners is not kept to: use a circle, or [geofence] of the settings"
        )
    fences = []
    for each in fence.get("circles", ()):
        if not each["inclusion"]:
            raise MissionFileError("a circle that is kept out of is not kept to: draw the mission around it")
        center, radius = each["circle"]["center"], each["circle"]["radius"]
        circle = Circle((float(center[0]), float(center[1])), float(radius))
        if not all(map(math.isfinite, (*circle.center, circle.radius))):
            raise MissionFileError(f"a circle of {circle.radius:g} m around {circle.center} is no fence")
        fences.append(circle)
    rally = len(tables.get("rallyPoints", {}).get("points", ()))
    notes = (f"{rally} rally points play no part: the way home is the way it came",) if rally else ()
    home = float(latitude), float(longitude)
    return MissionFile(tuple(items), home, float(mission["hoverSpeed"]), tuple(fences), notes)


# -- a mission ---------------------------------------------------------------------------------------------------------


def offset(place: Place, origin: Place) -> tuple[float, float]:
    """m north and east of `origin`, to the millimetre."""
    there, around = ((math.radians(latitude), math.radians(longitude), 0.0) for latitude, longitude in (place, origin))
    north, east, _ = to_local(there, around).tolist()
    return round(north, 3), round(east, 3)


def too_far(metres: tuple[float, float], origin: Place) -> str:
    """In words, of a place beyond FARTHEST_M."""
    return (
        f"{math.hypot(*metres) / 1000.0:.0f} km from the take-off, which is at {origin[0]:.5f}, {origin[1]:.5f}: it is "
        f"flown up to {FARTHEST_M / 1000.0:g} km along an axis"
    )


class _Maker:
    """Flies the items in mind, one after the other."""

    def __init__(self, file: MissionFile, origin: Place) -> None:
        self.waypoints: list[dict[str, Any]] = []
        self.takeoff_height: float | None = None
        self.speed: float | None = None
        self.ended = False
        self._origin = origin
        self._items = {item.number: index for index, item in enumerate(file.items)}
        self._jumps: dict[int, int] = {}

    def offset(self, place: Place) -> Place:
        """m north and east of the origin. Raises MissionFileError for a place that is too far to be flown to."""
        metres = offset(place, self._origin)
        if not max(map(abs, metres)) <= FARTHEST_M:
            raise MissionFileError(too_far(metres, self._origin))
        return metres

    def take(self, item: Item) -> int | None:
        """Take an item in; the index of the item that follows if it is not the next. Raises MissionFileError."""
        handler = _HANDLERS.get(item.command)
        if handler is None:
            raise MissionFileError(f"{_name(item.command)} is not flown")
        if self.ended:
            raise MissionFileError("it comes after the landing")
        first = self.takeoff_height is None
        if first and item.command not in _BEFORE_TAKEOFF:
            raise MissionFileError("the mission does not begin with a take-off (NAV_TAKEOFF)")
        return handler(self, item)

    def _add(self, item: Item, hold_s: float = 0.0) -> None:
        if item.frame not in _ABOVE_HOME:
            raise MissionFileError(_NOT_ABOVE_HOME.format(item.frame))
        if item.place is None:
            raise MissionFileError("it has no latitude and longitude")
        height = item.params[6]
        if not 0.0 < height < math.inf:
            raise MissionFileError(f"{height:g} m above the take-off is no altitude to fly at")
        self._fly_to(self.offset(item.place), height, hold_s)

    def _fly_to(self, place: Place, height: float, hold_s: float = 0.0) -> None:
        waypoint = {"north": place[0], "east": place[1], "height": height, "hold_s": hold_s}
        self.waypoints.append(waypoint | ({} if self.speed is None else {"speed": self.speed}))

    @property
    def _last(self) -> dict[str, Any]:
        if not self.waypoints:  # over the take-off
            assert self.takeoff_height is not None
            self._fly_to((0.0, 0.0), self.takeoff_height)
        return self.waypoints[-1]

    def take_off(self, item: Item) -> None:
        if self.takeoff_height is not None:
            raise MissionFileError("a second take-off")
        height = item.params[6]
        if item.frame not in _ABOVE_HOME or not 0.0 < height < math.inf:
            raise MissionFileError(f"a take-off to {height:g} m in frame {item.frame}: give a height above the ground")
        self.takeoff_height = height
        if item.place is not None and math.hypot(*self.offset(item.place)) > _AT_HOME_M:
            self._fly_to(self.offset(item.place), height)

    def waypoint(self, item: Item) -> None:
        self._add(item, _time(item.params[0]))
        if not math.isnan(item.params[3]) and item.params[3] != 0.0:
            self._last["yaw_deg"] = _heading(item.params[3])

    def loiter(self, item: Item) -> None:
        if item.place is None:
            last, height = self._last, item.params[6]
            if item.frame in _ON_EARTH - _ABOVE_HOME and height > 0.0:
                raise MissionFileError(_NOT_ABOVE_HOME.format(item.frame))
            if item.frame in _ABOVE_HOME and height > 0.0 and height != last["height"]:
                self._fly_to((last["north"], last["east"]), height)
            self._last["hold_s"] += _time(item.params[0])
        else:
            self._add(item, _time(item.params[0]))

    def delay(self, item: Item) -> None:
        if item.params[0] < 0.0 or math.isnan(item.params[0]):
            raise MissionFileError("a delay until a time of the day is not flown: give seconds")
        self._last["hold_s"] += _time(item.params[0])

    def turn(self, item: Item) -> None:
        if item.params[3] == 1.0:
            raise MissionFileError("a turn by an angle is not flown: give a heading")
        self._last["yaw_deg"] = _heading(item.params[0])

    def change_speed(self, item: Item) -> None:
        if item.params[0] not in (0.0, 1.0):
            raise MissionFileError(f"a speed of type {item.params[0]:g} is not flown: give one over ground")
        if item.params[1] > 0.0:
            self.speed = item.params[1]

    def gripper(self, item: Item) -> None:
        if item.params[1] != 0.0:
            raise MissionFileError("the gripper is opened alone: the parcel is in it at the start")
        if any(waypoint.get("release") for waypoint in self.waypoints):
            raise MissionFileError("the parcel was released before")
        self._last["release"] = True

    def jump(self, item: Item) -> int | None:
        target, times = item.params[:2]
        if math.isnan(times):
            raise MissionFileError("it does not say how many times it jumps")
        if times < 0.0 or times == math.inf:
            raise MissionFileError("it jumps for ever")
        if target not in self._items:
            raise MissionFileError(f"it jumps to item {target:g}, which is not there")
        left = self._jumps.setdefault(item.number, round(times))
        self._jumps[item.number] = left - 1
        if left > 0:
            return self._items[round(target)]
        del self._jumps[item.number]
        return None

    def go_home(self, item: Item) -> None:
        self._fly_to((0.0, 0.0), self._last["height"])
        self.ended = True

    def land(self, item: Item) -> None:
        if item.place is not None:
            self._fly_to(self.offset(item.place), self._last["height"])
        assert self._last
        self.ended = True

    def mark(self, item: Item) -> None:
        """Nothing to be flown."""


_HANDLERS: dict[int, Callable[[_Maker, Item], int | None]] = {
    dialect.MAV_CMD_NAV_TAKEOFF: _Maker.take_off,
    dialect.MAV_CMD_NAV_WAYPOINT: _Maker.waypoint,
    dialect.MAV_CMD_NAV_LOITER_TIME: _Maker.loiter,
    dialect.MAV_CMD_NAV_DELAY: _Maker.delay,
    dialect.MAV_CMD_CONDITION_YAW: _Maker.turn,
    dialect.MAV_CMD_DO_CHANGE_SPEED: _Maker.change_speed,
    dialect.MAV_CMD_DO_GRIPPER: _Maker.gripper,
    dialect.MAV_CMD_DO_JUMP: _Maker.jump,
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: _Maker.go_home,
    dialect.MAV_CMD_NAV_LAND: _Maker.land,
    dialect.MAV_CMD_DO_LAND_START: _Maker.mark,
}
_BEFORE_TAKEOFF = frozenset({dialect.MAV_CMD_NAV_TAKEOFF, dialect.MAV_CMD_DO_CHANGE_SPEED})


def to_mission(file: MissionFile, origin: Place, name: str) -> Mission:
    """The mission for a take-off from `origin`. `name`: any text. Raises MissionFileError."""
    maker, index, taken = _Maker(file, origin), 0, 0
    while index < len(file.items):
        item, taken = file.items[index], taken + 1
        try:
            if taken > _MOST_ITEMS:
                raise MissionFileError(f"more than {_MOST_ITEMS} items to fly, with its jumps")
            follows = maker.take(item)
        except MissionFileError as error:
            raise MissionFileError(f"item {item.number}: {error}") from None
        index = index + 1 if follows is None else follows
    if maker.takeoff_height is None:
        raise MissionFileError("there is no item to fly")
    if not maker.ended:
        raise MissionFileError(
            f"item {file.items[-1].number}: the mission ends in the air: add a return (NAV_RETURN_TO_LAUNCH) or a "
            "landing (NAV_LAND)"
        )
    tables = {
        "name": re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or "mission",
        "takeoff_height": maker.takeoff_height,
        "return_home": False,
        "waypoints": maker.waypoints,
        **({} if file.speed is None else {"speed": file.speed}),
    }
    try:
        return msgspec.convert(tables, Mission)
    except msgspec.ValidationError as error:
        raise MissionFileError(str(error)) from None


def fence_radius(file: MissionFile, origin: Place) -> float | None:
    """Radius (m) around `origin` of what is inside of all the file's fences; None without one. Raises
    MissionFileError if the origin is outside."""
    rooms = [fence.radius - math.hypot(*offset(fence.center, origin)) for fence in file.fences]
    if rooms and min(rooms) <= 0.0:
        raise MissionFileError("the take-off is outside of the fence")
    return min(rooms, default=None)


def to_toml(mission: Mission) -> str:
    """The text of a file in `missions/`, without what is as it is left out."""
    tables = msgspec.to_builtins(mission)
    waypoints = tables.pop("waypoints")
    defaults = {**msgspec.to_builtins(Mission("x", waits=True)), "waits": False}
    del defaults["name"]  # it has none, whatever the mission's is
    lines = _lines(tables, defaults)
    plain = msgspec.to_builtins(Waypoint(0.0, 0.0, 1.0))
    for waypoint in waypoints:
        lines += ["", "[[waypoints]]", *_lines(waypoint, {name: plain[name] for name in plain if name not in _PLACE})]
    return "\n".join(lines) + "\n"


def _lines(table: dict[str, Any], defaults: dict[str, Any]) -> list[str]:
    kept = {name: value for name, value in table.items() if name not in defaults or value != defaults[name]}
    return [f"{name} = {_value(value)}" for name, value in kept.items()]


def _value(value: Any) -> str:
    if not isinstance(value, dict):  # TOML has no pairs of surrogates, and no delete as it is
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return "{ " + ", ".join(f"{name} = {_value(each)}" for name, each in value.items() if each is not None) + " }"


def _time(seconds: float) -> float:
    if seconds == math.inf:
        raise MissionFileError("it waits for ever")
    return 0.0 if math.isnan(seconds) else max(seconds, 0.0)


def _heading(degrees: float) -> float:
    if not math.isfinite(degrees):
        raise MissionFileError(f"{degrees:g} is no heading")
    return degrees


def _name(command: int) -> str:
    found = dialect.enums["MAV_CMD"].get(command)
    return f"command {command}" if found is None else str(found.name).removeprefix("MAV_CMD_")
