"""One style for all pictures: readable in print, units on the axes, the same bytes from the same numbers."""

import io
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from protocol.arrays import Array

INK, GREY = "#222222", "#8a8a8a"
PALETTE = ("#1f5fbf", "#d1495b", "#2f8f5b", "#e09f3e", "#6d4c9f", "#3aa6b9")
"""Colours of lines in order; they differ in lightness too, for print without colour."""
PUBLISHED: dict[str, Any] = {"color": INK, "marker": "x", "ms": 7, "mew": 1.6, "ls": "none", "zorder": 5}
"""Marker of a value that the paper prints."""
STONE, GREEN = "#b8aca0", "#7fb069"
"""Boxes and trees of a world."""
WIDTH = 7.2
"""inches"""
_COMMAND_PT, _LETTER_IN, _LINE_IN = 6.0, 0.0502, 0.1
"""Size of a command's letters (points), and how wide one and how high a line of them is (inches)."""

_RC = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Arial"],
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.5,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "courier",
    "path.simplify_threshold": 0.5,
}
_DPI = 130
_COLOURS = 256


def blank(width: float = WIDTH, height: float = 3.2) -> Any:
    """An empty figure (inches) in the house style."""
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.rcsetup import cycler

    matplotlib.rcParams.update({**_RC, "axes.prop_cycle": cycler(color=PALETTE)})
    return Figure(figsize=(width, height), layout="constrained")


def sheet(rows: int = 1, columns: int = 1, *, height: float = 3.2, width: float = WIDTH, **options: Any) -> Any:
    """A figure (inches) and its axes, as matplotlib's `Figure.subplots` gives them; `options` go there."""
    figure = blank(width, height)
    return figure, figure.subplots(rows, columns, **options)


def save(figure: Any, stem: Path, command: str) -> None:
    """Write `stem`.png and `stem`.svg with the command that made them in the corner, in as many lines as it takes."""
    from PIL import Image

    lines = textwrap.wrap(command, int(figure.get_figwidth() / _LETTER_IN) - 2, break_on_hyphens=False)
    share = (0.06 + _LINE_IN * len(lines)) / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0.0, share, 1.0, 1.0 - share))
    said = "\n".join(f"{line} " for line in lines)
    figure.text(1.0, 0.0, said, ha="right", va="bottom", fontsize=_COMMAND_PT, color=GREY, family="monospace")
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=_DPI, format="png", metadata={"Software": None})
    picture = Image.open(buffer).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    picture.save(stem.with_suffix(".png"), optimize=True)
    figure.savefig(stem.with_suffix(".svg"), metadata={"Date": None, "Creator": None})


def step_marks(time: Array, path: Array, rise: float, settling: float) -> tuple[list[float], list[float]]:
    """Times (s) and values at which a step response (n,) over time (n,) would reach 90 % and be settled, for a given
    rise (10-90 %) and settling time (s): the rise time after its own 10 %, and the edge of the 2 % band through which
    it last came in."""
    final = float(path[-1])
    start = float(time[np.argmax(path >= 0.1 * final)])
    outside = np.flatnonzero(np.abs(path - final) > 0.02 * abs(final))
    edge = 1.02 if path[outside[-1]] > final else 0.98
    return [start + rise, settling], [0.9 * final, edge * final]
