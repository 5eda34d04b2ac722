"""The commands that show flights: report, view, foxglove."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from companion.cli.logs import LogFile, LogOrNewest
from companion.cli.options import Insecure, options
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


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """The options of `companion view`."""

    source: Annotated[
        str | None,
        typer.Argument(metavar="[LOG|URL]", help="A log, finished or being written, or udpin:HOST:PORT; none: newest."),
    ] = None
    port: Annotated[int, typer.Option(help="Of the page.", min=0, max=65535)] = 8080
    address: Annotated[str, typer.Option(help="An IPv4 address of this machine, for the page.")] = "127.0.0.1"
    remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let --address be one that other machines reach, unencrypted.")
    ] = False
    insecure: Insecure = False
    world: Annotated[str | None, typer.Option(help="What to draw around a link's vehicle: a file in worlds/.")] = None
    control: Annotated[
        bool, typer.Option("--control", help="Offer hold, resume, land, return and go to, sent to the vehicle at URL.")
    ] = False
    logs: Annotated[Path, typer.Option("--log", help="The folder in which the newest flight is looked for.")] = Path(
        "logs"
    )
    wait: Annotated[bool, typer.Option("--wait", help="Show the flight that begins next, not the newest.")] = False
    opens: Annotated[bool, typer.Option("--open/--no-open", help="Open a browser, where there is a screen.")] = True


@options(ViewOptions)
def view(chosen: ViewOptions) -> None:
    """Show a flight in the browser, in the air or from its log; where there is none yet, the next one. It only looks,
    unless --control is given."""
    from companion.view.door import check_address

    exit_on_user_error(check_address, chosen.address, remote=chosen.remote)
    source = chosen.source
    if source is not None and ":" in source and not _is_there(source):
        _view_link(source, chosen)
        return
    if chosen.control:
        exit_as_unusable("--control needs the URL of a vehicle")
    if chosen.world is not None:
        exit_as_unusable("--world is for a link; a log has its own")
    from companion.logs.recordings import flights, newest
    from companion.view.sources import NextFlight, open_log

    if source is None and (chosen.wait or not exit_on_user_error(flights, chosen.logs)):
        _serve(NextFlight(chosen.logs), chosen)
        return
    log = Path(source) if source is not None else exit_on_user_error(newest, chosen.logs)
    with flight_log(log) as shown:
        opened = exit_on_user_error(open_log, shown.path)
        opened.name = str(log)
        _serve(opened, chosen)


def _is_there(source: str) -> bool:
    """Whether there is such a file, as far as one may look."""
    with suppress(OSError):
        return Path(source).exists()
    return False


def _view_link(url: str, chosen: ViewOptions) -> None:
    """Show the vehicle at a URL, in a world if one is named, with buttons if they are chosen."""
    from companion.view.control import Control
    from companion.view.sources import Link
    from protocol.clock import RealClock
    from protocol.guarded_link import refuse_exposed
    from protocol.toml_files import content, find
    from protocol.transport import open_url

    exit_on_user_error(refuse_exposed, url, signed=False, insecure=chosen.insecure)
    drawn = content(exit_on_user_error(find, "worlds", chosen.world)) if chosen.world is not None else b""
    transport = exit_on_user_error(open_url, url)
    control = Control(transport.send, RealClock().now_ns) if chosen.control else None
    _serve(Link(url, transport, drawn), chosen, control)


def _serve(source: "Source", chosen: ViewOptions, control: "Control | None" = None) -> None:
    """Show a source, in a browser too if somebody sits at this machine's screen."""
    from companion.view.live import Page, serve

    page = exit_on_user_error(Page, source, chosen.port, chosen.address, control)
    has_screen = sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ))
    serve(page, typer.echo, opens=chosen.opens and has_screen and sys.stdout.isatty())


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
