"""The state of a flight as a panel of text for a terminal, drawn by rich."""

from io import StringIO

from rich.box import ROUNDED
from rich.console import Console, Group
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from protocol.flightlog.status import Status

_WIDEST = 88
"""Characters: more would not be read at one glance, and would not fit into one write."""
_NARROWEST = 24


def drawn(status: Status, columns: int) -> str:
    """The panel for a terminal that is so wide, its lines separated by newlines."""
    width = max(min(columns - 1, _WIDEST), _NARROWEST)  # a line that fills a terminal's width may wrap
    parts: list[Table | ProgressBar] = []
    if status.done is not None:
        bar = Table.grid(expand=True, padding=(0, 1))
        bar.add_column(ratio=1)
        bar.add_column(justify="right", width=4)
        done = min(max(status.done, 0.0), 1.0)
        bar.add_row(ProgressBar(1.0, done, complete_style="cyan", finished_style="green"), f"{done:.0%}")
        parts.append(bar)
    if status.figures:
        figures = Table.grid(expand=True)
        for _ in status.figures:
            figures.add_column(justify="center", ratio=1, no_wrap=True)
        figures.add_row(*(Text(value, "bold") for _, value in status.figures))
        figures.add_row(*(Text(name, "dim") for name, _ in status.figures))
        parts.append(figures)
    panel = Panel(
        Group(*parts),
        box=ROUNDED,
        title=Text(status.title, "bold"),
        title_align="left",
        subtitle=Text(status.hint, "dim") if status.hint else None,
        subtitle_align="right",
        border_style="blue",
        width=width,
    )
    console = Console(file=StringIO(), force_terminal=True, width=width, color_system="standard", legacy_windows=False)
    with console.capture() as captured:
        console.print(panel)
    return captured.get().rstrip("\n")
