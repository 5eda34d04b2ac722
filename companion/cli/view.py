"""The commands that show flights: report, view, foxglove."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, NamedTuple

import typer

from companion.cli.shell import ABANDONED, UNUSABLE, exit_if_damaged, exit_on_user_error, log_file, say

LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="A flight log (.mcap), a folder with one, or a .tlog.")]


def register(app: typer.Typer) -> None:
    """Put the commands onto the program's."""
    for command in (report, view, foxglove):
        app.command()(command)


def report(
    log: LogFile,
    to: Annotated[
        Path | None, typer.Option(help="The page; otherwise report.html or NAME_report.html beside LOG.")
    ] = None,
) -> None:
    """Write one HTML file that shows a flight: findings, path, plots, events. It needs no network and no other file."""
    from companion.view.report import beside, write

    with flight_log(log) as shown:
        typer.echo(f"report: {exit_on_user_error(write, shown.path, to or beside(log_file(log)))}")


def view(
    source: Annotated[
        str | None,
        typer.Argument(metavar="[LOG|URL]", help="A log, finished or being written, or udpin:HOST:PORT; none: newest."),
    ] = None,
    port: Annotated[int, typer.Option(help="Of the page, on 127.0.0.1.", min=0, max=65535)] = 8080,
    world: Annotated[str | None, typer.Option(help="What to draw around a link's vehicle: a file in worlds/.")] = None,
    control: Annotated[
        bool, typer.Option("--control", help="Offer hold, resume, land, return and go to, sent to the vehicle at URL.")
    ] = False,
    logs: Annotated[Path, typer.Option("--log", help="The folder in which the newest flight is looked for.")] = Path(
        "logs"
    ),
) -> None:
    """Show a flight in the browser, in the air or from its log. It only looks, unless --control is given."""
    from companion.view.live import Page, serve
    from companion.view.sources import Link, Source, newest, open_log
    from protocol.clock import RealClock
    from protocol.toml_files import find
    from protocol.transport import open_url

    chosen: Source
    asked = None
    if source is not None and ":" in source and not Path(source).exists():
        drawn = exit_on_user_error(find, "worlds", world).read_bytes() if world is not None else b""
        transport = exit_on_user_error(open_url, source)
        chosen = Link(source, transport, drawn)
        if control:
            from companion.view.control import Control

            asked = Control(transport.send, RealClock().now_ns)
    else:
        if control:
            say("companion: --control needs the URL of a vehicle")
            raise typer.Exit(UNUSABLE)
        if world is not None:
            say("companion: --world is for a link; a log has its own")
            raise typer.Exit(UNUSABLE)
        log = Path(source) if source is not None else exit_on_user_error(newest, logs)
        with flight_log(log) as shown:
            chosen = exit_on_user_error(open_log, shown.path)
            chosen.name = str(log)
            serve(exit_on_user_error(Page, chosen, port, asked), typer.echo)
        return
    serve(exit_on_user_error(Page, chosen, port, asked), typer.echo)


def foxglove(
    log: LogFile,
    to: Annotated[Path | None, typer.Option(help="The file; otherwise NAME_foxglove.mcap beside LOG.")] = None,
) -> None:
    """Write a log that Foxglove draws as it is: poses, path, ring, world, places on earth, texts, beside all that was
    recorded but the bare datagrams. docs/foxglove_layout.json is a layout for it. Exit code 1 if LOG is damaged: what
    is whole of it is drawn."""
    from companion.view.foxglove import beside, convert

    try:
        with flight_log(log) as shown:
            drawn = exit_on_user_error(convert, shown.path, to or beside(log_file(log)))
    except KeyboardInterrupt:
        raise typer.Exit(ABANDONED) from None
    typer.echo(f"foxglove: {drawn.path}, {drawn.added} messages added")
    exit_if_damaged(shown.problem or drawn.problem)


class Shown(NamedTuple):
    """A log to show."""

    path: Path
    """A flight log."""
    problem: str | None
    """What is wrong with the telemetry log that it was made of."""


@contextmanager
def flight_log(log: Path) -> Iterator[Shown]:
    """The flight log that is meant; a telemetry log becomes one for as long as it is needed."""
    from companion.logs.convert.telemetry import to_flight_log
    from companion.logs.recordings import printable
    from companion.logs.traffic import open_log, traffic_of
    from protocol.flightlog import LogReader

    path = log_file(log)
    opened = exit_on_user_error(open_log, path)
    if isinstance(opened, LogReader):
        yield Shown(path, None)
        return
    with TemporaryDirectory() as folder:
        converted = Path(folder) / f"{path.stem}.mcap"
        traffic = traffic_of(opened)
        flight = {"source": printable(path)}
        if traffic.epoch_ns:
            flight["started_unix_s"] = repr(traffic.epoch_ns * 1e-9)
        exit_on_user_error(to_flight_log, traffic, converted, {"flight": flight})
        yield Shown(converted, traffic.problem)
