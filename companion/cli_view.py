"""The commands that show flights: report, view, foxglove."""

from pathlib import Path
from typing import Annotated

import typer

from companion.shell import usable

LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="A flight log (.mcap) or a folder with one.")]


def register(app: typer.Typer) -> None:
    """Put the commands onto the program's."""
    app.command()(report)


def report(
    log: LogFile,
    to: Annotated[Path | None, typer.Option(help="The page; otherwise report.html beside LOG.")] = None,
) -> None:
    """Write one HTML file that shows a flight: findings, path, plots, events. It needs no network and no other file."""
    from companion.view.report import write

    typer.echo(f"report: {usable(write, file_of(log), to)}")


def file_of(log: Path) -> Path:
    """The log that is meant: a folder stands for the log in it."""
    from protocol.flightlog import FILE_NAME

    return log / FILE_NAME if log.is_dir() else log
