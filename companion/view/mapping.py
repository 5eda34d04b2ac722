"""The map from the scans of any MAVLink vehicle, for display: the live page, Foxglove.

It is the map that avoidance uses (`companion.perception.local_map`); a view is made only on request.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from companion.config_avoidance import Avoidance
from companion.estimate import Estimator
from companion.link import wire, wire_ranges
from companion.link.refusals import RefusedError
from companion.logs.settings import settings_or_defaults
from companion.perception.local_map import LocalMap
from companion.perception.map_view import FREE, OCCUPIED, UNKNOWN, MapView
from companion.reports import AttitudeReport
from companion.state import Scan
from companion.view.message_fields import MessageFields
from protocol.arrays import Array

NAMES = frozenset({"ATTITUDE_QUATERNION", "ATTITUDE", "LOCAL_POSITION_NED", "OBSTACLE_DISTANCE"})
"""Names of the messages that a map is made of."""

_REBOOT_MS = 1000
"""ms that the vehicle's clock goes back by, at least, when it has rebooted or when the log is played again."""
_UNKNOWN_COLOR = (90, 170, 235, 0)
_FREE_COLOR = (90, 170, 235, 70)
_OCCUPIED_COLOR = (190, 30, 60, 235)


class PosedScan(NamedTuple):
    """A scan with the pose of its own time: position (3,) m and attitude (4,)."""

    scan: Scan
    position_ned: Array
    attitude_ned_frd: Array


class Mapper:
    """Builds the map from messages in the order of their arrival, or from scans with poses."""

    def __init__(self, avoidance: Avoidance) -> None:
        self._local_map = LocalMap(avoidance)
        self._ground_down = -avoidance.ground_height
        self._estimator = Estimator()
        self._has_quaternion = False
        self.position_ned: Array | None = None
        """(3,) m: where the latest scan was taken; its height is the map's."""

    def take(self, name: str, fields: Mapping[str, Any] | np.void, time_ns: int) -> bool:
        """Take a message of the vehicle; True if it was a scan that is in the map now.

        `fields` is a dict or a row of a structured array, `time_ns` the time of arrival. A message with impossible
        values is ignored.
        """
        if name not in NAMES:
            return False
        message = MessageFields(fields)
        try:
            if name == "OBSTACLE_DISTANCE":
                return self._scan(wire_ranges.obstacle_distance(message, time_ns))
            if name == "LOCAL_POSITION_NED":
                self._estimator.position(wire.local_position(message), time_ns)
            elif name == "ATTITUDE_QUATERNION" or not self._has_quaternion:
                self._has_quaternion = name == "ATTITUDE_QUATERNION"
                read = wire.attitude_quaternion if self._has_quaternion else wire.attitude
                self._attitude(read(message), time_ns)
        except RefusedError:
            pass
        return False

    def add(self, posed: PosedScan) -> None:
        """Add a scan; scans come in the order of time."""
        scan, position, attitude = posed
        self._local_map.add(scan, (position, attitude), self._ground_down, scan.time_ns)
        self.position_ned = position

    def view(self, time_ns: int) -> MapView | None:
        """The map at a time of the same clock; None before the first scan."""
        return None if self.position_ned is None else self._local_map.look(time_ns)

    def _attitude(self, report: AttitudeReport, time_ns: int) -> None:
        taken = self._estimator.attitude(report, time_ns)
        if not taken and self._estimator.boot_time_ms - report.boot_time_ms > _REBOOT_MS:
            self._estimator.restart()
            self._estimator.attitude(report, time_ns)
        self._estimator.state()

    def _scan(self, scan: Scan) -> bool:
        pose = self._estimator.pose_at(scan.boot_time_us)
        if pose is None or not scan.known.any():
            return False
        self.add(PosedScan(scan, *pose))
        return True


class MapAt:
    """The map at any time of a recorded flight.

    Forwards it goes on from the last time; backwards it is built anew from the scans that are still remembered then.
    """

    def __init__(self, avoidance: Avoidance) -> None:
        self._avoidance = avoidance
        self._mapper = Mapper(avoidance)
        self._until = -np.inf

    def wants_from(self, time: float) -> float:
        """Time (s) from which on `at` needs the scans up to `time`; after a leap all that are remembered."""
        memory_s = self._avoidance.map.memory_s
        if not self._until <= time <= self._until + memory_s:
            self._mapper, self._until = Mapper(self._avoidance), time - memory_s
        return self._until

    def at(self, time: float, scans: Iterable[PosedScan]) -> tuple[MapView, float] | None:
        """The map at a time (s) and its height (NED, m), given the scans since `wants_from(time)`.

        None before the first scan.
        """
        for posed in scans:
            self._mapper.add(posed)
        self._until = time
        view, position = self._mapper.view(round(time * 1e9)), self._mapper.position_ned
        return None if view is None or position is None else (view, float(position[2]))


def picture(view: MapView) -> NDArray[np.uint8]:
    """(rows, columns, 4) red, green, blue, alpha; north is up, east on the right. Unknown cells are transparent."""
    colors = np.zeros((3, 4), np.uint8)
    colors[UNKNOWN], colors[FREE], colors[OCCUPIED] = _UNKNOWN_COLOR, _FREE_COLOR, _OCCUPIED_COLOR
    shown: NDArray[np.uint8] = colors[view.states[::-1]]
    return shown


def avoidance_of(settings: bytes) -> Avoidance:
    """The settings of a flight's map, from its log's attachment settings.json; the defaults if it can't be read."""
    return settings_or_defaults(settings)[0].avoidance
