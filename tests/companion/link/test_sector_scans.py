"""Scans assembled from sectors."""

import numpy as np
import pytest

from companion.link.sector_scans import SectorReport, SectorScans
from companion.state import Scan


def test_a_scan_is_complete_or_ends_where_the_next_one_begins() -> None:
    scans = SectorScans()

    def add(sector: int, range_m: float, hit: bool, boot_time_ms: int, now_ns: int) -> Scan | None:
        return scans.add(SectorReport(boot_time_ms, sector, range_m, hit, True), now_ns)

    for sector in (0, 2, 4):
        assert add(sector, 1.0 + sector, True, 100, 5) is None
    scan = add(0, 9.0, False, 200, 6)
    assert scan is not None and scan.boot_time_us == 100_000 and scan.time_ns == 6
    assert scan.known.tolist() == [True, False] * 2 + [True] + [False] * 3
    assert scan.ranges_m[[0, 2, 4]].tolist() == [1.0, 3.0, 5.0]
    assert scan.bearings_frd[2] == pytest.approx(np.pi / 2)
    whole = [add(sector, 2.0, True, 200, 7) for sector in range(1, 8)]
    assert whole[:-1] == [None] * 6 and whole[-1] is not None
    assert whole[-1].known.all() and not whole[-1].hit[0] and whole[-1].hit[1:].all()
