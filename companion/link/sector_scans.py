"""Scans from vehicles that report them in sectors, one DISTANCE_SENSOR each.

A sector that had a return and has none is unknown for a while, not free. ArduPilot's driver of a spinning LiDAR resets
the sector that the beam enters instead of the one that it leaves if that was empty (AP_Proximity_RPLidarA2, 4.7): as
long as the beam is within a sector beside an empty one, the sector is empty, whatever stands in it.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.state import Scan
from protocol.arrays import Array

SECTORS = 8
"""Number of sectors of a scan that comes as DISTANCE_SENSORs. MAV_SENSOR_ORIENTATION counts them first: 0 is forward,
then clockwise."""

_SILENCE_NS = 150_000_000
"""Twice a scan's period and more; with it and a period, what is seen is not older than the guard tolerates."""
_LOSSY_SILENCE_NS = 400_000_000
_VANISHED_NS = 300_000_000
"""From the last return of a sector until nothing there is believed: more than a turn of a slow LiDAR (5.5 Hz) and a
report."""
_SHORTEST_REACH_M = 5.0
"""Reach of a sensor that has not said yet how far it sees."""


class SectorReport(msgspec.Struct, frozen=True, gc=False):
    """One eighth of a scan, from a range sensor that looks to one side."""

    boot_time_ms: int
    sector: int
    """0 forward, clockwise."""
    range_m: float
    hit: bool
    """Something stands at that range; else nothing up to it."""
    known: bool
    reach_m: float = 0.0
    """The sensor sees so far."""


class SectorScans:
    """Sectors come one by one, and are put together to one scan after the other."""

    def __init__(self) -> None:
        self._bearings: Array = np.arange(SECTORS, dtype=np.float64) * (2.0 * math.pi / SECTORS)
        self._reach_m = _SHORTEST_REACH_M
        self._heard_ns: int | None = None
        """When the last sector arrived."""
        self._lost_then = 0
        self._believed_ns: NDArray[np.int64] = np.zeros(SECTORS, np.int64)
        """From when on nothing is believed of each sector."""
        self._begin()

    def _begin(self) -> None:
        count = self._bearings.size
        self._ranges, self._hit, self._known = np.zeros(count), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._heard = np.zeros(count, np.bool_)
        self._boot_time_ms = 0

    def add(self, report: SectorReport, now_ns: int, lost: int = 0) -> Scan | None:
        """Take a sector in: the scan, once it is whole or, where sectors are missing, once the next one begins.

        `lost`: messages of the vehicle that have been lost so far.
        """
        scan, sector = None, report.sector
        if self._silent(now_ns, self._lost_then):
            self._begin()  # what is left of a scan from long ago
        self._heard_ns, self._lost_then = now_ns, lost
        self._reach_m = report.reach_m or self._reach_m
        if self._heard[sector]:
            scan = self._finish(now_ns)
        self._heard[sector] = True
        self._ranges[sector], self._hit[sector] = report.range_m, report.hit and report.known
        if self._hit[sector]:
            self._believed_ns[sector] = now_ns + _VANISHED_NS
        self._known[sector] = report.known and (report.hit or now_ns >= self._believed_ns[sector])
        self._boot_time_ms = report.boot_time_ms
        return self._finish(now_ns) if self._heard.all() else scan

    def free(self, boot_time_us: int, now_ns: int, lost: int) -> Scan | None:
        """The scan of a sensor that works and says nothing, since nothing is within its reach; None if it has said
        something just now. Where messages were lost meanwhile, these may have been its own: that takes longer."""
        if not self._silent(now_ns, lost):
            return None
        count = self._bearings.size
        ranges, nothing, known = np.full(count, self._reach_m), np.zeros(count, np.bool_), self._believed_ns <= now_ns
        return Scan(now_ns, boot_time_us, self._bearings, ranges, nothing, known)

    def _silent(self, now_ns: int, lost: int) -> bool:
        if self._heard_ns is None:
            return True
        return now_ns - self._heard_ns >= (_SILENCE_NS if lost == self._lost_then else _LOSSY_SILENCE_NS)

    def _finish(self, now_ns: int) -> Scan:
        scan = Scan(now_ns, self._boot_time_ms * 1000, self._bearings, self._ranges, self._hit, self._known)
        self._begin()
        return scan
