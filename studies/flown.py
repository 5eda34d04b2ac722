"""A picture of one flight in each of some places: obstacles, the path with its speed, what the map knew at the end."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np

from studies.campaign import DEFAULT, Job, Setup, end_of_flight
from studies.campaigns.picture import draw_map
from studies.report import Report

_SEED = 1
_TITLE_WIDTH = 20
"""Letters in a line of a title."""


def picture(report: Report, setups: Sequence[Setup]) -> None:
    """Fly each set-up once by the default method, as fast as it is flown, and show the flights side by side."""
    from studies import style

    figure, rows = style.sheet(1, len(setups), height=4.2, width=2.6 * len(setups), squeeze=False)
    fastest = max(speed for setup in setups for speed in setup.speeds)
    for axes, setup in zip(rows[0], report.progress(setups, "pictures"), strict=True):
        lines = _draw(axes, Job(setup, DEFAULT, setup.speeds[-1], _SEED, report.choice.logs / report.name), fastest)
    figure.colorbar(lines, ax=list(rows[0]), label="speed / (m/s)", shrink=0.7)
    caption = (
        f"One flight each, seed {_SEED}: obstacles grey and green, as they stood at the end; the map at the end orange "
        "(occupied) and light grey (free)"
    )
    report.figure(figure, f"{report.name}-flown", caption)


def _draw(axes: Any, job: Job, fastest: float) -> Any:
    """Draw a flight; the lines, for their colours."""
    from matplotlib.collections import LineCollection

    from studies import style
    from studies.route import draw_world

    site, joined = end_of_flight(job)
    truth = np.array([*joined.truths, joined.vehicle.state])[::10]
    draw_world(axes, joined.vehicle.world, site.height)
    draw_map(axes, joined)
    places = truth[:, 1::-1]
    lines = LineCollection(list(np.stack([places[:-1], places[1:]], axis=1)), cmap="viridis", lw=1.6, zorder=3)
    lines.set_array(np.linalg.norm(truth[:-1, 3:6], axis=1))
    lines.set_clim(0.0, fastest)
    axes.add_collection(lines)
    axes.plot(0.0, 0.0, "^", color=style.INK, ms=5)
    for north, east in site.waypoints:
        axes.plot(east, north, "*", color=style.PALETTE[1], ms=8)
    axes.set(xlabel="east / m", ylabel="north / m", aspect="equal")
    axes.set_title(textwrap.fill(job.setup.title, _TITLE_WIDTH))
    shown = np.array([*places, *(waypoint[::-1] for waypoint in site.waypoints)])
    low, high = shown.min(axis=0), shown.max(axis=0)
    axes.set(xlim=(low[0] - 5.0, high[0] + 5.0), ylim=(low[1] - 3.0, high[1] + 3.0))
    return lines
