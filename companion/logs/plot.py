"""A picture of what a replay with other settings sends instead."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from companion.logs.difference import Series
from companion.logs.recordings import printable
from companion.logs.target import output, writable
from protocol.flightlog import FlightLogError

_MOST_PANELS = 8
_NOT_DRAWN = frozenset(("time_boot_ms", "time_usec", "sequence", "tc1", "ts1"))
"""Fields that differ without meaning anything."""


def plot(series: Mapping[tuple[str, str], Series], title: str, path: Path) -> int:
    """Save a picture of the fields that differ most, relative to their variation: as recorded, as replayed, difference.

    Returns the number of fields drawn; if no number that was sent more than once differs, no file is made. Raises
    FlightLogError if the file can't be written.
    """
    pyplot = _pyplot()
    chosen = _most_different(series)
    if not chosen:
        return 0
    figure, rows = pyplot.subplots(
        len(chosen), 2, figsize=(12.0, 1.0 + 1.7 * len(chosen)), sharex=True, squeeze=False, layout="constrained"
    )
    for (left, right), (message, field) in zip(rows, chosen, strict=True):
        each = series[message, field]
        time_s = np.array(each.time_ns) * 1e-9
        recorded, replayed = np.array(each.recorded), np.array(each.replayed)
        left.plot(time_s, recorded, color="0.6", linewidth=2.0, label="sent in flight")
        left.plot(time_s, replayed, color="tab:blue", linewidth=0.8, label="sent now")
        left.set_ylabel(f"{message.lower()}\n{field}", fontsize=7)
        with np.errstate(invalid="ignore"):  # between two infinities
            difference = replayed - recorded
        right.plot(time_s, difference, color="tab:red", linewidth=0.8)
        for axes in (left, right):
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=7)
    rows[0, 0].legend(fontsize=7, loc="best")
    rows[0, 1].set_title("difference (now - then)", fontsize=8)
    for axes in rows[-1]:
        axes.set_xlabel("time, s", fontsize=8)
    figure.suptitle(printable(title), fontsize=9, parse_math=False)  # it holds a path, of any characters
    try:
        with output(path, replaces=True) as draft:
            figure.savefig(draft, dpi=130)
    finally:
        pyplot.close(figure)
    return len(chosen)


def check(path: Path) -> None:
    """Raises FlightLogError if no picture can be written to `path`."""
    kinds = _pyplot().Figure().canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".").lower() not in kinds:
        raise FlightLogError(f"{path}: which kind of picture? There are .{', .'.join(kinds)}")
    writable(path, replaces=True)


def _pyplot() -> Any:
    try:
        import matplotlib as mpl
    except ImportError:
        raise FlightLogError("a plot needs matplotlib, which is not installed: pip install matplotlib") from None
    mpl.use("Agg")
    from matplotlib import pyplot

    return pyplot


def _most_different(series: Mapping[tuple[str, str], Series]) -> list[tuple[str, str]]:
    weights = {}
    for key, each in series.items():
        recorded, replayed = np.array(each.recorded), np.array(each.replayed)
        known = np.isfinite(recorded) & np.isfinite(replayed)
        recorded = recorded[known]
        difference = np.abs(replayed[known] - recorded)
        if key[1] not in _NOT_DRAWN and len(difference) > 1 and difference.max() > 0.0:
            weights[key] = float(difference.mean() / (recorded.std() + 1e-9))
    return sorted(sorted(weights, key=lambda key: -weights[key])[:_MOST_PANELS])
