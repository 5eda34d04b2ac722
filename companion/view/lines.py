"""Summaries of streams of any length in bounded memory: lines for charts, paths, stretches of time, gaps, scans.

Times are float seconds since the log's start, in batches that come in order. Every `add` may be called any number of
times and keeps no more than its class says.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

BUCKETS = 1500
"""Stretches of time of a line, each with its least and its greatest value: more than a chart has pixels."""


def thin(times: Floats, values: Floats, buckets: int) -> tuple[Floats, Floats]:
    """The least and the greatest value of each of `buckets` equal stretches of time, at their own times.

    Times (n,) in s and values (n,) -> (m,) each with m <= 2 * buckets. Thinning again keeps the extremes.
    """
    if len(times) <= 2 * buckets:
        return times, values
    start, stop = times.min(), times.max()
    bucket = ((times - start) * (buckets / max(stop - start, 1e-9))).astype(np.int64).clip(max=buckets - 1)
    order = np.lexsort((values, bucket))
    ends = np.flatnonzero(np.diff(bucket[order], append=buckets))
    starts = np.concatenate(([0], ends[:-1] + 1))
    kept = np.zeros(len(times), np.bool_)
    kept[order[starts]] = kept[order[ends]] = True
    return times[kept], values[kept]


class Line:
    """One curve of a chart. It holds at most 8 * BUCKETS samples, and gives at most 2 * BUCKETS as `points`."""

    __slots__ = ("_held", "_times", "_values")

    def __init__(self) -> None:
        self._times: list[Floats] = []
        self._values: list[Floats] = []
        self._held = 0

    def add(self, times: Floats, values: Floats) -> None:
        """Times (n,) in s and values (n,); values that are not finite are left out."""
        finite = np.isfinite(values)
        if not finite.all():
            times, values = times[finite], values[finite]
        for start in range(0, len(times), 4 * BUCKETS):
            part = slice(start, start + 4 * BUCKETS)
            self._times.append(times[part])
            self._values.append(values[part].astype(np.float64))
            self._held += len(self._times[-1])
            if self._held > 6 * BUCKETS:
                self._settle()

    def _settle(self) -> None:
        thinned = thin(np.concatenate(self._times), np.concatenate(self._values), BUCKETS)
        self._times, self._values = [thinned[0]], [thinned[1]]
        self._held = len(thinned[0])

    def points(self) -> tuple[Floats, Floats]:
        """Times (m,) in s and values (m,)."""
        if not self._times:
            return np.empty(0), np.empty(0)
        self._settle()
        return self._times[0], self._values[0]


class Lines(dict[str, Line]):
    """Lines by a key of the caller's."""

    def add(self, key: str, times: Floats, values: Floats) -> None:
        """Add to a line: times (n,) in s and values (n,), or (n, k) for the k lines `key`.0, `key`.1 and so on."""
        if values.ndim == 2:
            for column in range(values.shape[1]):
                self.add(f"{key}.{column}", times, values[:, column])
            return
        line = self.get(key)
        if line is None:
            line = self[key] = Line()
        line.add(times, values)


class Track:
    """Rows of numbers over time, such as a path, thinned evenly: at most 2 * `most` rows of `columns` numbers.

    The last `recent` rows, at most half of `most`, are kept as they came. Batches may come in any order of time, as
    those of two messages that tell the same do.
    """

    __slots__ = (
        "_columns",
        "_held",
        "_last",
        "_most",
        "_newest",
        "_ordered",
        "_parts",
        "_recent",
        "_since",
        "_step",
        "_thinned",
    )

    def __init__(self, columns: int, most: int = 4000, recent: int = 0) -> None:
        self._columns = columns
        self._most = most
        self._recent = recent
        self._step = 0.0
        self._last = -1.0
        self._parts: list[Floats] = []
        self._held = self._thinned = 0
        self._since: float | None = None
        self._newest = -np.inf
        self._ordered = True

    def add(self, times: Floats, rows: Floats) -> None:
        """Times (n,) in s and values (n, columns - 1); the time becomes the first column."""
        if not len(times):
            return
        if self._since is None:
            self._since = float(times[0])
        self._ordered = self._ordered and bool(times[0] >= self._newest and (np.diff(times) >= 0.0).all())
        self._newest = max(self._newest, float(times.max()))
        table = np.column_stack((times, rows))
        self._parts.append(table if self._recent else self._every(table))
        self._held += len(self._parts[-1])
        while self._held > 2 * self._most:
            self._thin()

    def _thin(self) -> None:
        """Thin what is not recent, more than before if that leaves too much."""
        older, newer = np.split(self.rows(), [self._held - self._recent])
        self._last = -1.0
        kept = self._every(older)
        if len(kept) > self._most:
            span = float(older[-1, 0] - older[0, 0])
            self._step, self._last = max(2.0 * self._step, span / self._most, 1e-3), -1.0
            kept = self._every(older)
        self._parts, self._thinned, self._held = [kept, newer], len(kept), len(kept) + len(newer)

    def _every(self, table: Floats) -> Floats:
        """The first row of each stretch of `_step` after the last one."""
        if not self._step:
            return table
        stretch = np.floor((table[:, 0] - (self._since or 0.0)) / self._step)
        kept: Floats = table[np.diff(stretch, prepend=self._last) != 0]
        self._last = float(stretch[-1])
        return kept

    def rows(self) -> Floats:
        """(m, columns) with the time (s) in the first column."""
        if not self._parts:
            return np.empty((0, self._columns))
        if len(self._parts) > 1:
            self._parts = [np.concatenate(self._parts)]
        if not self._ordered:
            self._parts, self._ordered = [self._parts[0][np.argsort(self._parts[0][:, 0], kind="stable")]], True
        return self._parts[0]

    def at(self, time: float) -> tuple[Floats, float] | None:
        """The last row at or before a time (s), without its own time, and how long before (s) there was one at least:
        among the older rows there may have been later ones, which were left out. None without any."""
        rows = self.rows()
        index = int(np.searchsorted(rows[:, 0], time, side="right")) - 1
        if index < 0:
            return None
        left_out = self._step if index < self._thinned else 0.0
        return rows[index, 1:], max(time - float(rows[index, 0]) - left_out, 0.0)


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of time (s) during which a value stayed the same."""

    start: float
    stop: float
    value: int

    @property
    def seconds(self) -> float:
        return self.stop - self.start


_MOST_STRETCHES = 2000


class Stretches:
    """A whole-numbered value over time as stretches. Those beyond the first so many are only counted."""

    def __init__(self) -> None:
        self._open: Stretch | None = None
        self._closed: list[Stretch] = []
        self.seconds: dict[int, float] = {}
        """Total time (s) by value."""
        self.count: dict[int, int] = {}
        """Number of stretches by value."""

    def add(self, times: Floats, values: NDArray[np.integer]) -> None:
        """Times (n,) in s and values (n,)."""
        if not len(times):
            return
        changes = np.flatnonzero(np.diff(values)) + 1
        for first, last in zip([0, *changes], [*changes, len(values)], strict=True):
            start, value = float(times[first]), int(values[first])
            stop = float(times[last]) if last < len(times) else float(times[-1])
            if self._open is not None and self._open.value == value:
                self._open = Stretch(self._open.start, stop, value)
            else:
                if self._open is not None:
                    self._close(Stretch(self._open.start, start, self._open.value))
                self._open = Stretch(start, stop, value)

    def _close(self, stretch: Stretch) -> None:
        self.seconds[stretch.value] = self.seconds.get(stretch.value, 0.0) + stretch.seconds
        self.count[stretch.value] = self.count.get(stretch.value, 0) + 1
        if len(self._closed) < _MOST_STRETCHES:
            self._closed.append(stretch)

    def finish(self) -> list[Stretch]:
        """All stretches in order. Nothing may be added afterwards."""
        if self._open is not None:
            self._close(self._open)
            self._open = None
        return self._closed


_PER_DECADE = 20
"""Bins of intervals in a factor of ten."""
_SHORTEST_S = 1e-5
_BURST = 0.05
"""Fraction of the mean interval: messages whose median interval is shorter come in bursts."""


_LONGEST = 5
"""So many of the longest intervals are kept."""


class Regularity:
    """How regularly messages come: the distribution of their intervals, and the longest of them."""

    def __init__(self) -> None:
        self._counts = np.zeros(9 * _PER_DECADE, np.int64)
        self._sums = np.zeros(9 * _PER_DECADE)
        self._gaps: list[tuple[float, float]] = []
        self.count = 0
        self.first = 0.0
        self.last = 0.0

    def add(self, times: Floats) -> None:
        """Times (n,) in s, in order."""
        if not len(times):
            return
        if self.count == 0:
            self.first = float(times[0])
            intervals = np.diff(times)
            starts = times[:-1]
        else:
            starts = np.concatenate(([self.last], times[:-1]))
            intervals = times - starts
        self.count += len(times)
        self.last = float(times[-1])
        if not len(intervals):
            return
        bins = (np.log10(np.maximum(intervals, _SHORTEST_S) / _SHORTEST_S) * _PER_DECADE).astype(np.int64)
        bins = bins.clip(max=len(self._counts) - 1)
        self._counts += np.bincount(bins, minlength=len(self._counts))
        self._sums += np.bincount(bins, intervals, len(self._counts))
        top = np.argsort(intervals)[-_LONGEST:]
        found = [(float(intervals[index]), float(starts[index])) for index in top]
        self._gaps = sorted([*self._gaps, *found], reverse=True)[:_LONGEST]

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """The longest intervals, longest first: (length in s, start in s)."""
        return self._gaps

    @property
    def usual(self) -> float:
        """The usual interval (s): the median, to 12 %, or the mean if messages come in bursts; 0 for less than two. A
        silence of more than half of the time counts for no mean."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        index = int(np.searchsorted(np.cumsum(self._counts), 0.5 * total))
        median, span = float(self._sums[index] / self._counts[index]), self.last - self.first
        silence = self._gaps[0][0] if total > 1 and self._gaps[0][0] > 0.5 * span else 0.0
        mean = (span - silence) / (total - (silence > 0.0))
        return mean if median < _BURST * mean else median

    @property
    def rate(self) -> float:
        """Mean rate (Hz)."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0


class ScanRows:
    """LiDAR scans over time: at most 2 * `most` rows, each with the nearest ranges of the scans that it stands for."""

    def __init__(self, most: int = 400) -> None:
        self._most = most
        self._each = 1
        """Scans that a row stands for."""
        self._waiting: list[tuple[float, Floats]] = []
        self._rows: list[tuple[float, Floats]] = []

    def add(self, time: float, ranges: Floats) -> None:
        """Time (s) and ranges (beams,) in m, NaN where nothing was seen. A scan with another number of beams than the
        first is left out."""
        if self._rows and self._rows[0][1].shape != ranges.shape:
            return
        self._waiting.append((time, ranges))
        if len(self._waiting) < self._each:
            return
        self._rows.append(_nearest(self._waiting))
        self._waiting = []
        if len(self._rows) >= 2 * self._most:
            self._rows = [_nearest(self._rows[index : index + 2]) for index in range(0, len(self._rows), 2)]
            self._each *= 2

    def rows(self) -> Iterator[tuple[float, Floats]]:
        """The time (s) of each row's first scan, and its ranges (beams,) in m."""
        yield from self._rows
        if self._waiting:
            yield _nearest(self._waiting)


def _nearest(scans: list[tuple[float, Floats]]) -> tuple[float, Floats]:
    return scans[0][0], np.fmin.reduce([ranges for _, ranges in scans])
