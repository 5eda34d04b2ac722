"""The map that the rings of any MAVLink vehicle draw, for those who look: the page, Foxglove.

It is the one that avoidance flies over (`companion.avoidance.mapped.Surroundings`), looked at when it is asked for.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config import Avoidance, Settings
from companion.estimate import Estimator
from companion.link import wire
from companion.perception.local_map import LocalMap
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, MapView
from companion.state import AttitudeReport, Scan
from protocol.arrays import Array

NAMES = frozenset({"ATTITUDE_QUATERNION", "ATTITUDE", "LOCAL_POSITION_NED", "OBSTACLE_DISTANCE"})
"""The messages that a map is made of."""

_REBOOT_MS = 1000
"""The vehicle's clock back by more than this: it has started anew, or the log is played again."""
_UNKNOWN_COLOR = (90, 170, 235, 0)
_FREE_COLOR = (90, 170, 235, 70)
_OCCUPIED_COLOR = (190, 30, 60, 235)


class PosedScan(NamedTuple):
    """A ring with the pose of its own time."""

    scan: Scan
    position_ned: Array
    attitude_ned_frd: Array


class Mapper:
    """Takes messages in the order of their arrival, or rings that have their pose already; shows the map when asked.

    `ground_down`: NED height (m) of the ground; what returns from less than `avoidance.ground_height` above it is
    the ground.
    """

    def __init__(self, avoidance: Avoidance, ground_down: float = 0.0) -> None:
        self._surroundings = LocalMap(avoidance)
        self._ground_down = ground_down - avoidance.ground_height
        self._estimator = Estimator()
        self._has_quaternion = False
        self.position_ned: Array | None = None
        """(3,) where the latest ring was taken; its height is the map's."""

    def take(self, name: str, fields: Mapping[str, Any] | np.void, time_ns: int) -> bool:
        """A message of one vehicle by its name, its fields as a dict or as a row of a structured array; `time_ns`: of
        its arrival. True if it was a ring that is in the map now. What can't be true is passed over."""
        if name not in NAMES:
            return False
        message = _Fields(fields)
        try:
            if name == "OBSTACLE_DISTANCE":
                return self._ring(wire.obstacle_distance(message, time_ns))
            if name == "LOCAL_POSITION_NED":
                self._estimator.position(wire.local_position(message), time_ns)
            elif name == "ATTITUDE_QUATERNION" or not self._has_quaternion:
                self._has_quaternion = name == "ATTITUDE_QUATERNION"
                read = wire.attitude_quaternion if self._has_quaternion else wire.attitude
                self._attitude(read(message), time_ns)
        except wire.RefusedError:
            pass
        return False

    def add(self, posed: PosedScan) -> None:
        """A ring in, in the order of time."""
        scan, place, attitude = posed
        self._surroundings.add(scan, (place, attitude), self._ground_down, scan.time_ns)
        self.position_ned = place

    def view(self, time_ns: int) -> MapView | None:
        """The map at a time of the same clock; None before the first ring."""
        return None if self.position_ned is None else self._surroundings.look(time_ns)

    def _attitude(self, report: AttitudeReport, time_ns: int) -> None:
        taken = self._estimator.attitude(report, time_ns)
        if not taken and self._estimator.boot_time_ms - report.boot_time_ms > _REBOOT_MS:
            self._estimator.restart()
            self._estimator.attitude(report, time_ns)
        self._estimator.state()

    def _ring(self, scan: Scan) -> bool:
        pose = self._estimator.pose_at(scan.boot_time_us)
        if pose is None or not scan.known.any():
            return False
        self.add(PosedScan(scan, *pose))
        return True


class MapAt:
    """The map at any time of a flight whose rings can be had again, forwards step by step, backwards from as long ago
    as is remembered."""

    def __init__(self, avoidance: Avoidance) -> None:
        self._avoidance = avoidance
        self._mapper = Mapper(avoidance)
        self._until = -np.inf

    def wants_from(self, time: float) -> float:
        """From when on (s) the rings up to `time` are wanted; after a leap that is all that is remembered."""
        memory_s = self._avoidance.map.memory_s
        if not self._until <= time <= self._until + memory_s:
            self._mapper, self._until = Mapper(self._avoidance), time - memory_s
        return self._until

    def at(self, time: float, scans: Iterable[PosedScan]) -> tuple[MapView, float] | None:
        """The map at a time (s), given the rings since `wants_from(time)`, and its height (NED, m)."""
        for posed in scans:
            self._mapper.add(posed)
        self._until = time
        view, place = self._mapper.view(round(time * 1e9)), self._mapper.position_ned
        return None if view is None or place is None else (view, float(place[2]))


def picture(view: MapView) -> NDArray[np.uint8]:
    """(cells, cells, 4) red, green, blue, alpha; north up, east to the right. What is unknown is transparent."""
    colors = np.zeros((3, 4), np.uint8)
    colors[UNKNOWN], colors[FREE], colors[OCCUPIED] = _UNKNOWN_COLOR, _FREE_COLOR, _OCCUPIED_COLOR
    shown: NDArray[np.uint8] = colors[view.states[::-1]]
    return shown


def occupied(view: MapView) -> Array:
    """(n, 2) north and east (m) of the centres of the cells where something stands."""
    places: Array = (np.argwhere(view.states == OCCUPIED) + np.array(view.corner) + 0.5) * view.cell
    return places


def avoidance_of(settings: bytes) -> Avoidance:
    """The settings of a flight's map, from its log's attachment settings.json; the defaults if it can't be read."""
    try:
        return msgspec.json.decode(settings, type=Settings).avoidance
    except (msgspec.DecodeError, ValueError):
        return Avoidance()


class _Fields:
    """Fields as a message has them: attributes, and plain numbers."""

    __slots__ = ("_fields",)

    def __init__(self, fields: Mapping[str, Any] | np.void) -> None:
        self._fields = fields

    def __getattr__(self, name: str) -> Any:
        value = self._fields[name]
        return value.item() if isinstance(value, np.generic) else value
