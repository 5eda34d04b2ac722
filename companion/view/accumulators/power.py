"""How much energy was taken from the battery."""

import numpy as np

from companion.view.lines import Floats

_SILENCE_S = 10.0
"""Nothing is counted across an interval of this length or longer (s)."""


class Energy:
    """Electrical energy by the message that told voltage and current ("system/component/MESSAGE")."""

    def __init__(self) -> None:
        self.watt_hours: dict[str, float] = {}
        self._last: dict[str, tuple[Floats, Floats]] = {}

    def add(self, source: str, times: Floats, watts: Floats) -> None:
        """Times (n,) in s and power (n,) in W, NaN where it was not measured; by the trapezoidal rule."""
        if source in self._last:
            before = self._last[source]
            times, watts = np.concatenate((before[0], times)), np.concatenate((before[1], watts))
        self._last[source] = times[-1:], watts[-1:]
        seconds = np.diff(times)
        joules = np.where(seconds < _SILENCE_S, 0.5 * (watts[1:] + watts[:-1]) * seconds, 0.0)
        if np.isfinite(joules).any():
            self.watt_hours[source] = self.watt_hours.get(source, 0.0) + float(np.nansum(joules)) / 3600.0
