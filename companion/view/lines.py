"""What a stream of any length comes to in bounded memory: lines for charts, spectra, stretches, gaps, rings.

Times are float seconds since the log's start, in batches that come in order; every `add` may be called any number of
times and keeps no more than its class says.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]

BUCKETS = 1500
"""Of a line, each with its least and greatest value: more than a chart has pixels."""


def thin(times: Floats, values: Floats, buckets: int) -> tuple[Floats, Floats]:
    """The least and the greatest value of each of `buckets` equal stretches of time, at their own times.

    (n,) and (n,) -> (m,) and (m,) with m <= 2 * buckets; thinning what was thinned keeps the extremes.
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
    """One curve of a chart: at most 8 * BUCKETS samples are held, of which `points` are at most 2 * BUCKETS."""

    __slots__ = ("_held", "_times", "_values")

    def __init__(self) -> None:
        self._times: list[Floats] = []
        self._values: list[Floats] = []
        self._held = 0

    def add(self, times: Floats, values: Floats) -> None:
        """(n,) each; what is not finite is left out."""
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
        """Times and values (m,)."""
        if not self._times:
            return np.empty(0), np.empty(0)
        self._settle()
        return self._times[0], self._values[0]


class Track:
    """A path in space with whatever belongs to it, thinned evenly: at most 2 * `most` rows of `columns` numbers."""

    __slots__ = ("_columns", "_held", "_last", "_most", "_parts", "_since", "_step")

    def __init__(self, columns: int, most: int = 4000) -> None:
        self._columns = columns
        self._most = most
        self._step = 0.0
        self._last = -1.0
        self._parts: list[Floats] = []
        self._held = 0
        self._since: float | None = None

    def add(self, times: Floats, rows: Floats) -> None:
        """(n,) and (n, columns - 1): the time becomes the first column."""
        if not len(times):
            return
        if self._since is None:
            self._since = float(times[0])
        table = np.column_stack((times, rows))
        self._parts.append(self._every(table))
        self._held += len(self._parts[-1])
        while self._held > 2 * self._most:
            whole = np.concatenate(self._parts)
            span = float(whole[-1, 0] - whole[0, 0])
            self._step = max(2.0 * self._step, span / self._most, 1e-3)
            self._last = -1.0
            self._parts = [self._every(whole)]
            self._held = len(self._parts[0])

    def _every(self, table: Floats) -> Floats:
        """The first row of each stretch of `_step` after the last one."""
        if not self._step:
            return table
        stretch = np.floor((table[:, 0] - (self._since or 0.0)) / self._step)
        kept: Floats = table[np.diff(stretch, prepend=self._last) != 0]
        self._last = float(stretch[-1])
        return kept

    def rows(self) -> Floats:
        """(m, columns), the time first."""
        if not self._parts:
            return np.empty((0, self._columns))
        if len(self._parts) > 1:
            self._parts = [np.concatenate(self._parts)]
        return self._parts[0]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time during which something stayed as it was."""

    start: float
    stop: float
    value: int

    @property
    def seconds(self) -> float:
        return self.stop - self.start


class Stretches:
    """A whole-numbered value over time as stretches; those beyond `most` are only counted."""

    def __init__(self, most: int = 2000) -> None:
        self._most = most
        self._open: Stretch | None = None
        self._closed: list[Stretch] = []
        self.seconds: dict[int, float] = {}
        """In total, by value."""
        self.count: dict[int, int] = {}
        """Of stretches, by value."""

    def add(self, times: Floats, values: NDArray[np.integer]) -> None:
        """(n,) each."""
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
        if len(self._closed) < self._most:
            self._closed.append(stretch)

    def finish(self) -> list[Stretch]:
        """All of them in order; nothing may be added after."""
        if self._open is not None:
            self._close(self._open)
            self._open = None
        return self._closed


_PER_DECADE = 20
_SHORTEST = 1e-5
_AT_ONCE = 0.05
"""Of the mean interval: what is shorter lies within a burst."""


class Regularity:
    """How regularly something comes: the distribution of its intervals and its longest silences."""

    def __init__(self, longest: int = 5) -> None:
        self._longest = longest
        self._counts = np.zeros(9 * _PER_DECADE, np.int64)
        self._sums = np.zeros(9 * _PER_DECADE)
        self._gaps: list[tuple[float, float]] = []
        self.count = 0
        self.first = 0.0
        self.last = 0.0

    def add(self, times: Floats) -> None:
        """(n,), in order."""
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
        bins = (np.log10(np.maximum(intervals, _SHORTEST) / _SHORTEST) * _PER_DECADE).astype(np.int64)
        bins = bins.clip(max=len(self._counts) - 1)
        self._counts += np.bincount(bins, minlength=len(self._counts))
        self._sums += np.bincount(bins, intervals, len(self._counts))
        top = np.argsort(intervals)[-self._longest :]
        found = [(float(intervals[index]), float(starts[index])) for index in top]
        self._gaps = sorted([*self._gaps, *found], reverse=True)[: self._longest]

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """The longest intervals, longest first: seconds, and when each began."""
        return self._gaps

    @property
    def usual(self) -> float:
        """s from one to the next: the median, to 12 %; the mean where several come at once. 0 for less than two."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        index = int(np.searchsorted(np.cumsum(self._counts), 0.5 * total))
        median, mean = float(self._sums[index] / self._counts[index]), (self.last - self.first) / total
        return mean if median < _AT_ONCE * mean else median

    @property
    def rate(self) -> float:
        """Mean, in Hz."""
        return (self.count - 1) / (self.last - self.first) if self.last > self.first else 0.0


SEGMENT = 1024
_WIENER = 1e-3
"""Of the strongest frequency's power: below it a frequency counts less and less."""


class Segments(ABC):
    """Evenly sampled columns, handed on in segments that overlap by half; those across a gap in time are left out."""

    def __init__(self, columns: int) -> None:
        self._times = np.empty(0)
        self._values = np.empty((0, columns))
        self._window = np.hanning(SEGMENT + 1)[:-1]
        self._seconds = 0.0
        self.segments = 0

    def add(self, times: Floats, values: Floats) -> None:
        """(n,) and (n, columns)."""
        self._times = np.concatenate((self._times, times))
        self._values = np.concatenate((self._values, values))
        start = 0
        while start + SEGMENT <= len(self._times):
            self._look(self._times[start : start + SEGMENT], self._values[start : start + SEGMENT])
            start += SEGMENT // 2
        self._times, self._values = self._times[start:], self._values[start:]

    def _look(self, times: Floats, values: Floats) -> None:
        step = float((times[-1] - times[0]) / (SEGMENT - 1))
        if step <= 0.0 or np.diff(times).max() > 5.0 * step or not np.isfinite(values).all():
            return
        self._take(np.fft.rfft((values - values.mean(axis=0)) * self._window[:, None], axis=0), step)
        self._seconds += step
        self.segments += 1

    @abstractmethod
    def _take(self, spectrum: Any, step: float) -> None:
        """A segment's spectrum (SEGMENT // 2 + 1, columns), sampled each `step` s."""

    @property
    def step(self) -> float:
        """s between samples, on average."""
        return self._seconds / max(self.segments, 1)


class Spectrum(Segments):
    """Welch's averaged power spectral density (Hann window, half overlap).

    P. Welch, IEEE Trans. Audio Electroacoust. 15 (1967).
    """

    def __init__(self, columns: int) -> None:
        super().__init__(columns)
        self._sum = np.zeros((SEGMENT // 2 + 1, columns))

    def _take(self, spectrum: Any, step: float) -> None:
        power = np.abs(spectrum) ** 2 * step / (self._window**2).sum()
        power[1:-1] *= 2.0
        self._sum += power

    def density(self) -> tuple[Floats, Floats]:
        """Frequencies (m,) in Hz and power per Hz (m, columns); empty before a whole segment came."""
        if not self.segments:
            return np.empty(0), np.empty((0, self._sum.shape[1]))
        return np.fft.rfftfreq(SEGMENT, self.step), self._sum / self.segments

    def rms_above(self, frequency: float) -> Floats:
        """(columns,): root mean square of what is above so many Hz."""
        frequencies, density = self.density()
        if len(frequencies) < 2:
            return np.zeros(self._sum.shape[1])
        kept: Floats = np.sqrt(density[frequencies > frequency].sum(axis=0) * (frequencies[1] - frequencies[0]))
        return kept


class Response(Segments):
    """The step response that commands and answers imply, by deconvolution (Wiener's): cross spectrum over spectrum.

    Frequencies that the commands hardly hold count little, so that the answer is smooth where nothing is known.
    """

    def __init__(self, axes: int) -> None:
        super().__init__(2 * axes)
        self._axes = axes
        self._cross = np.zeros((SEGMENT // 2 + 1, axes), np.complex128)
        self._power = np.zeros((SEGMENT // 2 + 1, axes))

    def add_pairs(self, times: Floats, commands: Floats, answers: Floats) -> None:
        """(n,), (n, axes) and (n, axes)."""
        self.add(times, np.column_stack((commands, answers)))

    def _take(self, spectrum: Any, step: float) -> None:
        command, answer = spectrum[:, : self._axes], spectrum[:, self._axes :]
        self._cross += command.conj() * answer
        self._power += np.abs(command) ** 2

    def step_response(self, seconds: float) -> tuple[Floats, Floats]:
        """Times (m,) after a step of 1 and what follows (m, axes); empty if nothing was commanded."""
        if not self.segments or not self._power.max(axis=0).all():
            return np.empty(0), np.empty((0, self._axes))
        transfer = self._cross / (self._power + _WIENER * self._power.max(axis=0))
        transfer[0] = transfer[1].real  # the means were taken off
        impulse = np.fft.irfft(transfer, SEGMENT, axis=0)
        count = min(round(seconds / self.step), SEGMENT // 2)
        return np.arange(count) * self.step, np.cumsum(impulse[:count], axis=0)


class Pairs:
    """Commands and answers of the same times, which come in batches of their own: handed on as soon as both are there.

    At most `most` of either wait for the others.
    """

    def __init__(self, columns: int, most: int = 20_000) -> None:
        self._most = most
        self._none: tuple[Floats, Floats] = np.empty(0), np.empty((0, columns))
        self._commands: tuple[Floats, Floats] = self._none
        self._answers: tuple[Floats, Floats] = self._none

    def commands(self, times: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
        """(n,) and (n, columns), in order: times, commands and answers (m, ...) of the pairs that are whole now."""
        self._commands = self._longer(self._commands, times, values)
        return self._pairs()

    def answers(self, times: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
        """As `commands`, for the other side."""
        self._answers = self._longer(self._answers, times, values)
        return self._pairs()

    def _longer(self, known: tuple[Floats, Floats], times: Floats, values: Floats) -> tuple[Floats, Floats]:
        longer = np.concatenate((known[0], times)), np.concatenate((known[1], values))
        return longer[0][-self._most :], longer[1][-self._most :]

    def _pairs(self) -> tuple[Floats, Floats, Floats]:
        (asked, commands), (answered, answers) = self._commands, self._answers
        if not len(asked) or not len(answered):
            return self._none[0], self._none[1], self._none[1]
        times, mine, theirs = np.intersect1d(asked, answered, return_indices=True)
        until = min(asked[-1], answered[-1])
        self._commands = asked[asked > until], commands[asked > until]
        self._answers = answered[answered > until], answers[answered > until]
        return times, commands[mine], answers[theirs]


class Rings:
    """Rings of ranges over time: at most 2 * `most` rows, each the nearest of the rings that it stands for."""

    def __init__(self, most: int = 400) -> None:
        self._most = most
        self._each = 1
        self._waiting: list[tuple[float, Floats]] = []
        self._rows: list[tuple[float, Floats]] = []

    def add(self, time: float, ranges: Floats) -> None:
        """(beams,) in m, NaN where nothing was seen."""
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
        """Time of the first ring and the ranges of each row."""
        yield from self._rows
        if self._waiting:
            yield _nearest(self._waiting)


def _nearest(rings: list[tuple[float, Floats]]) -> tuple[float, Floats]:
    return rings[0][0], np.fmin.reduce([ranges for _, ranges in rings])
