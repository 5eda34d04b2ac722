"""How near the vehicle came to obstacles, by what its LiDAR showed."""

import numpy as np

from companion.runtime.summary import in_the_air
from companion.view.batches import Table
from companion.view.lines import Floats

BIN_M = 0.25
"""Width of the histogram's bins (m)."""
_BINS = 60


class Clearance:
    """Clearances of the hull in the air, whoever flew: their histogram, their least, and how many were too small."""

    def __init__(self, safe_distance: float) -> None:
        self.safe_distance = safe_distance
        """m, as in the settings that were flown."""
        self.counts = np.zeros(_BINS, np.int64)
        """(_BINS,) control steps by clearance, in bins of BIN_M; the last bin holds all that is farther."""
        self.near_steps = 0
        """Control steps with less clearance than `safe_distance`."""
        self.least: tuple[float, float] | None = None
        """The least clearance (m) and when it was measured (s); None if nothing was near."""

    def add_steps(self, times: Floats, table: Table) -> None:
        """Control steps: times (n,) in s and records of the trace (n,)."""
        counted = in_the_air(table) & np.isfinite(table["clearance"])
        times, clearance = times[counted], table["clearance"][counted]
        if not len(clearance):
            return
        bins = (clearance.clip(min=0.0) / BIN_M).astype(np.int64).clip(max=_BINS - 1)
        self.counts += np.bincount(bins, minlength=_BINS)
        self.near_steps += int((clearance < self.safe_distance).sum())
        nearest = int(clearance.argmin())
        if self.least is None or clearance[nearest] < self.least[0]:
            self.least = float(clearance[nearest]), float(times[nearest])

    @property
    def total(self) -> int:
        """Control steps with an obstacle in range."""
        return int(self.counts.sum())
