"""Scans from vehicles that report them in sectors, one DISTANCE_SENSOR each."""

import math

import msgspec
import numpy as np

from companion.state import Scan
from protocol.arrays import Array

SECTORS = 8
"""Of a scan that comes as DISTANCE_SENSORs. MAV_SENSOR_ORIENTATION counts them first: 0 forward, clockwise."""


class SectorReport(msgspec.Struct, frozen=True, gc=False):
    """One eighth of a scan, from a range sensor that looks to one side."""

    boot_time_ms: int
    sector: int
    """0 forward, clockwise."""
    range_m: float
    hit: bool
    """Something stands at that range; else nothing up to it."""
    known: bool


class SectorScans:
    """Sectors come one by one, and are put together to one scan after the other."""

    def __init__(self) -> None:
        self._bearings: Array = np.arange(SECTORS, dtype=np.float64) * (2.0 * math.pi / SECTORS)
        self._begin()

    def _begin(self) -> None:
        count = self._bearings.size
        self._ranges, self._hit, self._known = np.zeros(count), np.zeros(count, np.bool_), np.zeros(count, np.bool_)
        self._heard = np.zeros(count, np.bool_)
        self._boot_time_ms = 0

    def add(self, report: SectorReport, now_ns: int) -> Scan | None:
        """Take a sector in: the scan, once it is whole or, where sectors are missing, once the next one begins."""
        scan, sector = None, report.sector
        if self._heard[sector]:
            scan = self._finish(now_ns)
        self._heard[sector] = True
        self._ranges[sector], self._hit[sector] = report.range_m, report.hit and report.known
        self._known[sector] = report.known
        self._boot_time_ms = report.boot_time_ms
        return self._finish(now_ns) if self._heard.all() else scan

    def _finish(self, now_ns: int) -> Scan:
        scan = Scan(now_ns, self._boot_time_ms * 1000, self._bearings, self._ranges, self._hit, self._known)
        self._begin()
        return scan
