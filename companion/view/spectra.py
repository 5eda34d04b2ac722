"""Spectra and step responses of evenly sampled signals, from streams of any length in bounded memory.

Times are float seconds, in batches that come in order.
"""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from companion.view.lines import Floats

SEGMENT = 1024
"""Samples that are transformed together."""
_WIENER = 1e-3
"""Regularization as a fraction of the strongest frequency's power."""


class Segments(ABC):
    """Cuts evenly sampled columns into segments that overlap by half. Segments across a gap in time are left out."""

    def __init__(self, columns: int) -> None:
        self._times = np.empty(0)
        self._values = np.empty((0, columns))
        self._window = np.hanning(SEGMENT + 1)[:-1]
        self._seconds = 0.0
        self.segments = 0

    def add(self, times: Floats, values: Floats) -> None:
        """Times (n,) in s and values (n, columns)."""
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
        """Take the Fourier transform (SEGMENT // 2 + 1, columns) of a segment that was sampled every `step` s."""

    @property
    def step(self) -> float:
        """Mean interval between samples (s)."""
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
        """Frequencies (m,) in Hz and power per Hz (m, columns); empty before the first whole segment."""
        if not self.segments:
            return np.empty(0), np.empty((0, self._sum.shape[1]))
        return np.fft.rfftfreq(SEGMENT, self.step), self._sum / self.segments

    def rms_above(self, frequency: float) -> Floats:
        """(columns,) root mean square of the signal above a frequency (Hz)."""
        frequencies, density = self.density()
        if len(frequencies) < 2:
            return np.zeros(self._sum.shape[1])
        kept: Floats = np.sqrt(density[frequencies > frequency].sum(axis=0) * (frequencies[1] - frequencies[0]))
        return kept


class Response(Segments):
    """The step response from commands to answers, by Wiener deconvolution: the cross spectrum over the spectrum.

    Frequencies that the commands hardly contain count little, so that the response is smooth where little is known.
    """

    def __init__(self, axes: int) -> None:
        super().__init__(2 * axes)
        self._axes = axes
        self._cross = np.zeros((SEGMENT // 2 + 1, axes), np.complex128)
        self._power = np.zeros((SEGMENT // 2 + 1, axes))

    def add_pairs(self, times: Floats, commands: Floats, answers: Floats) -> None:
        """Times (n,) in s, commands (n, axes) and answers (n, axes)."""
        self.add(times, np.column_stack((commands, answers)))

    def _take(self, spectrum: Any, step: float) -> None:
        command, answer = spectrum[:, : self._axes], spectrum[:, self._axes :]
        self._cross += command.conj() * answer
        self._power += np.abs(command) ** 2

    def step_response(self, seconds: float) -> tuple[Floats, Floats]:
        """Times (m,) in s after a step of 1, and the response (m, axes); empty if nothing was commanded."""
        if not self.segments or not self._power.max(axis=0).all():
            return np.empty(0), np.empty((0, self._axes))
        transfer = self._cross / (self._power + _WIENER * self._power.max(axis=0))
        transfer[0] = transfer[1].real  # the means were taken off
        impulse = np.fft.irfft(transfer, SEGMENT, axis=0)
        count = min(round(seconds / self.step), SEGMENT // 2)
        return np.arange(count) * self.step, np.cumsum(impulse[:count], axis=0)


class Pairs:
    """Joins commands and answers of equal times, which come in separate batches.

    At most `most` of either wait for the other.
    """

    def __init__(self, columns: int, most: int = 20_000) -> None:
        self._most = most
        self._none: tuple[Floats, Floats] = np.empty(0), np.empty((0, columns))
        self._commands: tuple[Floats, Floats] = self._none
        self._answers: tuple[Floats, Floats] = self._none

    def commands(self, times: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Add commands: times (n,) in s, in order, and values (n, columns).

        Returns the pairs that are complete now: times (m,), commands (m, columns) and answers (m, columns).
        """
        self._commands = self._longer(self._commands, times, values)
        return self._pairs()

    def answers(self, times: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Add answers; otherwise as `commands`."""
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
