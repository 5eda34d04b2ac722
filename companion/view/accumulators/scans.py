"""The LiDAR scans that the vehicles sent, thinned for a chart."""

from dataclasses import dataclass, field

import numpy as np

from companion.view.batches import Table
from companion.view.lines import Floats, ScanRows


@dataclass(slots=True)
class Scans:
    """The scans (OBSTACLE_DISTANCE) of one sender."""

    rows: ScanRows = field(default_factory=ScanRows)
    offset_deg: float = 0.0
    """Bearing of the first beam."""
    increment_deg: float = 5.0
    """Between two beams, clockwise."""

    def add(self, times: Floats, table: Table) -> Floats:
        """Times (n,) in s and fields (n,); returns the nearest range of each scan (n,) in m, NaN if nothing is seen."""
        distances = table["distances"].astype(np.float64)
        ranges = np.where(distances <= table["max_distance"][:, None], distances * 0.01, np.nan)
        for at, row in zip(times.tolist(), ranges, strict=True):
            self.rows.add(at, row)
        last = table[-1]
        self.increment_deg = float(last["increment_f"]) or float(last["increment"])
        self.offset_deg = float(last["angle_offset"])
        with np.errstate(all="ignore"):
            nearest: Floats = np.fmin.reduce(ranges, axis=1)
        return nearest
