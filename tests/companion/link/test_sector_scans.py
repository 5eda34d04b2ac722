"""Scans assembled from sectors."""

import numpy as np
import pytest

from companion.link.sector_scans import SectorReport, SectorScans
from companion.state import Scan

MS = 1_000_000


def test_a_scan_is_complete_or_ends_where_the_next_one_begins() -> None:
    scans = SectorScans()

    def add(sector: int, range_m: float, hit: bool, boot_time_ms: int, now_ns: int) -> Scan | None:
        return scans.add(SectorReport(boot_time_ms, sector, range_m, hit, True), now_ns)

    for sector in (0, 2, 4):
        assert add(sector, 1.0 + sector, True, 100, 5) is None
    scan = add(0, 9.0, True, 200, 6)
    assert scan is not None and scan.boot_time_us == 100_000 and scan.time_ns == 6
    assert scan.known.tolist() == [True, False] * 2 + [True] + [False] * 3
    assert scan.ranges_m[[0, 2, 4]].tolist() == [1.0, 3.0, 5.0]
    assert scan.bearings_frd[2] == pytest.approx(np.pi / 2)
    whole = [add(sector, 2.0, True, 200, 7) for sector in range(1, 8)]
    assert whole[:-1] == [None] * 6 and whole[-1] is not None
    assert whole[-1].known.all() and whole[-1].hit.all() and whole[-1].ranges_m.tolist() == [9.0] + [2.0] * 7


def test_silence_is_a_free_scan_as_far_as_the_sensor_sees() -> None:
    scans = SectorScans()
    before = scans.free(7, 0, 0)
    assert before is not None and (before.ranges_m == 5.0).all(), "it has not said how far that is"
    scans.add(SectorReport(100, 2, 3.0, True, True, reach_m=16.0), 1000 * MS)
    assert scans.free(8, 1149 * MS, 0) is None
    assert scans.free(9, 1150 * MS, 0) is not None
    scan = scans.free(9, 1300 * MS, 0)
    assert scan is not None and scan.boot_time_us == 9 and scan.time_ns == 1300 * MS
    assert scan.known.all() and not scan.hit.any() and (scan.ranges_m == 16.0).all()


def test_a_return_that_vanishes_is_unknown_at_first() -> None:
    """ArduPilot's driver empties the sector that the beam enters, if the one before it was empty."""
    scans = SectorScans()

    def ring(now_ms: int, hit: bool) -> Scan:
        for sector in range(8):
            there = hit and sector == 3
            report = SectorReport(now_ms, sector, 2.0 if there else 16.0, there, True, reach_m=16.0)
            scan = scans.add(report, now_ms * MS)
        assert scan is not None and scan.known.sum() >= 7
        return scan

    for now_ms in range(65, 2000, 65):
        empty = now_ms % 100 < 13
        scan = ring(now_ms, not empty)
        assert scan.hit[3] != empty and scan.known[3] != empty, "never seen free while something stands there"
    assert [bool(ring(1950 + ms, False).known[3]) for ms in (100, 200, 290, 300)] == [False, False, False, True]


def test_silence_does_not_free_a_sector_sooner() -> None:
    scans = SectorScans()
    scans.add(SectorReport(100, 2, 3.0, True, True, reach_m=16.0), 1000 * MS)
    scan = scans.free(9, 1200 * MS, 0)
    assert scan is not None and scan.known.tolist() == [True, True, False] + [True] * 5
    scan = scans.free(9, 1300 * MS, 0)
    assert scan is not None and scan.known.all()


def test_where_messages_were_lost_silence_takes_longer() -> None:
    scans = SectorScans()
    scans.add(SectorReport(100, 2, 3.0, True, True), 0, lost=3)
    assert scans.free(8, 399 * MS, 4) is None
    assert scans.free(8, 400 * MS, 4) is not None


def test_what_was_seen_before_a_silence_is_no_part_of_the_scan_after_it() -> None:
    scans = SectorScans()
    scans.add(SectorReport(100, 2, 3.0, True, True), 0)
    assert scans.add(SectorReport(900, 0, 9.0, True, True), 800 * MS) is None
    scan = scans.add(SectorReport(970, 0, 9.0, True, True), 870 * MS)
    assert scan is not None and scan.known.tolist() == [True] + [False] * 7
