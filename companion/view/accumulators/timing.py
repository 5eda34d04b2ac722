"""How punctual the companion's loop was and how fast it answered."""

from typing import Any

import numpy as np

from companion.view.accumulators.exceedances import Exceedances
from companion.view.batches import Table
from companion.view.columns import latencies
from companion.view.lines import Floats, Line

_LATE_S = 2e-3
"""A tick that is later than this counts as late (s)."""
_PER_DECADE = 20
_BINS = 120


class Timing:
    """Lateness of the loop's ticks, and latency from the receipt of an attitude to the departure of its command."""

    def __init__(self) -> None:
        self.late_ticks = Exceedances()
        """s"""
        self.late_ms = Line()
        self.latency_us = Line()
        self.latency_counts = np.zeros(_BINS, np.int64)
        """(_BINS,) commands by latency, 20 bins a decade from 1 us; `latency_of_bin` has their middles."""

    def add_ticks(self, times: Floats, table: Table) -> None:
        """Ticks of the loop: times (n,) in s and records of TICK (n,)."""
        self.late_ms.add(times, table["late_ns"] * 1e-6)
        self.late_ticks.add(times, table["late_ns"] * 1e-9, _LATE_S)

    def add_latencies(self, times: Floats, table: Any) -> None:
        """Times (n,) in s and n records of LOOP."""
        when, latency_us = latencies(times, table)
        self.latency_us.add(when, latency_us)
        bins = (_PER_DECADE * np.log10(latency_us.clip(min=1.0))).astype(np.int64)
        self.latency_counts += np.bincount(bins.clip(max=_BINS - 1), minlength=_BINS)

    def latency_quantile(self, share: float) -> float | None:
        """Latency (us) that this share of the commands did not exceed, to 12 %; None if nothing was measured."""
        total = int(self.latency_counts.sum())
        if not total:
            return None
        return float(latency_of_bin(int(np.searchsorted(np.cumsum(self.latency_counts), share * total))))


def latency_of_bin(number: Any) -> Any:
    """The middle (us) of a bin of `Timing.latency_counts`, or of an array of bins."""
    return 10 ** ((number + 0.5) / _PER_DECADE)
