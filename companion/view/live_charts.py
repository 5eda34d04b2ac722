"""The live page's charts: attitude, clearance and speed up to the moment that is shown."""

from typing import TYPE_CHECKING, Any

import numpy as np

from companion.view.history import History

if TYPE_CHECKING:
    import viser

PLOT_S = 30.0
"""The charts show this long a time (s), up to the moment that is shown."""
_PADDING = (10, 8, 0, 0)
"""Pixels above, right of, below and left of a chart, so that no number is cut."""
_AXIS_PIXELS = 44
_POINTS = 400


class Charts:
    """Three charts over time, each in the panel's order."""

    def __init__(self, gui: "viser.GuiApi") -> None:
        self._gui = gui
        self._attitude = self._add(112, ("roll, deg", "#3b7ddd"), ("pitch, deg", "#3d8a45"), ("yaw, deg", "#8a5cc9"))
        self._clearance = self._add(92, ("clearance, m", "#3d8a45"))
        self._speed = self._add(92, ("speed, m/s", "#b06f0c"))

    def _add(self, height: int, *lines: tuple[str, str]) -> Any:
        """A chart of `height` pixels with lines of these names and colors."""
        from viser import uplot

        series = (
            uplot.Series(label="s"),
            *(uplot.Series(label=label, stroke=color, width=1.5) for label, color in lines),
        )
        return self._gui.add_uplot(
            (np.zeros(1),) * len(series),
            series,
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(), uplot.Axis(size=_AXIS_PIXELS)),
            height=height,
            padding=_PADDING,
        )

    def draw(self, history: History, time: float) -> None:
        """Show the time up to `time` (s)."""
        start = time - PLOT_S
        times, attitude = history.attitude_deg(start, time)
        pick = evenly(len(times), _POINTS)
        attitude[:, 2] = np.unwrap(attitude[:, 2], period=360.0)
        self._attitude.data = (times[pick], *attitude[pick].T.copy())
        for chart, (when, values) in (
            (self._clearance, history.clearance(start, time)),
            (self._speed, history.speed(start, time)),
        ):
            pick = evenly(len(when), _POINTS)
            chart.data = (when[pick], values[pick])


def evenly(count: int, most: int) -> Any:
    """Indices of at most `most` of `count` elements, evenly spaced, the last among them."""
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.int64)
