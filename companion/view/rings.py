"""Rings of ranges for display, from whatever message a vehicle sends them in."""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from companion.link.refusals import RefusedError
from companion.link.sector_scans import SECTORS, SectorScans
from companion.link.wire_ranges import sector_distance
from companion.state import Scan
from companion.view.batches import Table
from companion.view.lines import Floats
from companion.view.message_fields import MessageFields
from protocol.flightlog.mavlink_records import message_type
from protocol.messages import dialect

RING, SECTOR = "OBSTACLE_DISTANCE", "DISTANCE_SENSOR"
_UNKNOWN_CM = 65535
_DTYPE = message_type(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, "")[0].dtype


class RingTables:
    """Each ring as an OBSTACLE_DISTANCE: those that come in eighths, as ArduPilot sends them, are put together.

    A vehicle that is silent while nothing is around sends none meanwhile.
    """

    def __init__(self) -> None:
        self._sectors = defaultdict[str, SectorScans](SectorScans)
        """By sender."""
        self._whole: set[str] = set()
        """Who sends whole rings: their other range sensors are no part of one."""

    def take(self, sender: str, name: str, times: Floats, table: Any) -> tuple[Floats, Table] | None:
        """Times (n,) in s and the rings (n,) that n messages make or complete; None if there are none."""
        if name == RING:
            self._whole.add(sender)
            return times, table
        if name != SECTOR or sender in self._whole:
            return None
        done = list(self._completed(self._sectors[sender], times, table))
        return (np.array([at for at, _ in done]), np.array([row for _, row in done], _DTYPE)) if done else None

    def _completed(
        self, sectors: SectorScans, times: Floats, table: Iterable[Mapping[str, Any] | np.void]
    ) -> Iterable[tuple[float, Any]]:
        for at, row in zip(times.tolist(), table, strict=True):
            try:
                report = sector_distance(MessageFields(row))
            except RefusedError:
                continue
            scan = None if report is None else sectors.add(report, round(at * 1e9))
            if scan is not None:
                yield at, _as_ring(scan)


def shows_around(rings: Any) -> Any:
    """Whether a ring, or each of a table, can be drawn: its beams look somewhere (offset and increment are numbers, and
    not 0) as seen from the vehicle's nose. The companion refuses the others, too."""
    numbers = np.isfinite(rings["increment_f"]) & np.isfinite(rings["angle_offset"])
    told = (rings["increment_f"] != 0.0) | (rings["increment"] != 0)
    return numbers & told & (rings["frame"] == dialect.MAV_FRAME_BODY_FRD)


def _as_ring(scan: Scan) -> Any:
    """The OBSTACLE_DISTANCE that says the same as a scan of SECTORS beams."""
    ring = np.zeros((), _DTYPE)
    ranges_cm = np.rint(100.0 * scan.ranges_m).astype(np.int64)
    most = int(ranges_cm[scan.known].max(initial=1))
    ring["time_usec"], ring["max_distance"] = scan.boot_time_us, most
    ring["increment_f"], ring["frame"] = 360.0 / SECTORS, dialect.MAV_FRAME_BODY_FRD
    ring["distances"] = _UNKNOWN_CM
    ring["distances"][:SECTORS] = np.where(scan.known, np.where(scan.hit, ranges_cm, most + 1), _UNKNOWN_CM)
    return ring
