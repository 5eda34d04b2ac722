"""The commands that show flights: report, view, foxglove."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from companion.cli.logs import LogFile, LogOrNewest
from companion.cli.shell import (
    exit_as_unusable,
    exit_if_damaged,
    exit_on_interrupt,
    exit_on_user_error,
    log_file,
    log_or_newest,
)

if TYPE_CHECKING:
    from companion.view.control import Control
    from companion.view.sources import Source


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    for command in (report, view, foxglove):
        app.command()(command)


def report(
    log: LogOrNewest = None,
    to: Annotated[
        Path | None, typer.Option(help="The page; otherwise report.html or NAME_report.html beside LOG.")
    ] = None,
) -> None:
    """Write one HTML file that shows a flight: findings, path, plots, events. It needs no network and no other file.
    Exit code 1 if LOG is damaged or cut off: what is whole of it is shown."""
    from companion.view.report import beside, write

    log = log_or_newest(log)
    with flight_log(log) as shown:
        written = exit_on_user_error(write, shown.path, to or beside(log_file(log)))
    typer.echo(f"report: {written.path}")
    exit_if_damaged(shown.problem or written.problem)


def view(
    source: Annotated[
        str | None,
        typer.Argument(metavar="[LOG|URL]", help="A log, finished or being written, or udpin:HOST:PORT; none: newest."),
    ] = None,
    port: Annotated[int, typer.Option(help="Of the page.", min=0, max=65535)] = 8080,
    address: Annotated[str, typer.Option(help="An IPv4 address of this machine, for the page.")] = "127.0.0.1",
    remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let --address be one that other machines reach, unencrypted.")
    ] = False,
    world: Annotated[str | None, typer.Option(help="What to draw around a link's vehicle: a file in worlds/.")] = None,
    control: Annotated[
        bool, typer.Option("--control", help="Offer hold, resume, land, return and go to, sent to the vehicle at URL.")
    ] = False,
    logs: Annotated[Path, typer.Option("--log", help="The folder in which the newest flight is looked for.")] = Path(
        "logs"
    ),
) -> None:
    """Show a flight in the browser, in the air or from its log. It only looks, unless --control is given."""
    from companion.view.door import check_address

    exit_on_user_error(check_address, address, remote=remote)
    place = (port, address)
    if source is not None and ":" in source and not Path(source).exists():
        _view_link(source, place, world, control=control)
        return
    if control:
        exit_as_unusable("--control needs the URL of a vehicle")
    if world is not None:
        exit_as_unusable("--world is for a link; a log has its own")
    from companion.logs.recordings import newest
    from companion.view.sources import open_log

    log = Path(source) if source is not None else exit_on_user_error(newest, logs)
    with flight_log(log) as shown:
        opened = exit_on_user_error(open_log, shown.path)
        opened.name = str(log)
        _serve(opened, place)


def _view_link(url: str, place: tuple[int, str], world: str | None, *, control: bool) -> None:
    """Show the vehicle at a URL, in a world if one is named, with buttons if `control`."""
    from companion.view.control import Control
    from companion.view.sources import Link
    from protocol.clock import RealClock
    from protocol.toml_files import find
    from protocol.transport import open_url

    drawn = exit_on_user_error(find, "worlds", world).read_bytes() if world is not None else b""
    transport = exit_on_user_error(open_url, url)
    _serve(Link(url, transport, drawn), place, Control(transport.send, RealClock().now_ns) if control else None)


def _serve(source: "Source", place: tuple[int, str], control: "Control | None" = None) -> None:
    """Show a source at a `place`, a port and an address of this machine."""
    from companion.view.live import Page, serve

    serve(exit_on_user_error(Page, source, *place, control), typer.echo)


def foxglove(
    log: LogFile,
    to: Annotated[Path | None, typer.Option(help="The file; otherwise NAME_foxglove.mcap beside LOG.")] = None,
) -> None:
    """Write a log that Foxglove draws as it is: poses, path, ring, world, places on earth, texts, beside all that was
    recorded but the bare datagrams. docs/foxglove_layout.json is a layout for it. Exit code 1 if LOG is damaged: what
    is whole of it is drawn."""
    from companion.view.foxglove import beside, convert

    with exit_on_interrupt(), flight_log(log) as shown:
        drawn = exit_on_user_error(convert, shown.path, to or beside(log_file(log)))
    typer.echo(f"foxglove: {drawn.path}, {drawn.added} messages added")
    exit_if_damaged(shown.problem or drawn.problem)


class Shown(NamedTuple):
    """A log to show."""

    path: Path
    """A flight log."""
    problem: str | None
    """What is wrong with the telemetry log that it was made from, if anything is."""


@contextmanager
def flight_log(log: Path) -> Iterator[Shown]:
    """The flight log of a file or folder. A telemetry log is converted to one that exists as long as the block."""
    from tempfile import TemporaryDirectory

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
