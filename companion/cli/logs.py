"""The commands for logs: replay, play, info, digest, repair, convert, logs."""

import json
import sys
from collections.abc import Iterable, Sequence
from contextlib import closing
from datetime import datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from companion.cli.options import Insecure
from companion.cli.shell import (
    FAILED,
    exit_as_unusable,
    exit_if_damaged,
    exit_on_interrupt,
    exit_on_user_error,
    log_file,
    log_or_newest,
    note,
    say,
)

if TYPE_CHECKING:
    from companion.logs.info import Info
    from companion.logs.replay import Replay

LogFile = Annotated[Path, typer.Argument(metavar="LOG", help="A flight log (.mcap), a folder with one, or a .tlog.")]
LogOrNewest = Annotated[
    Path | None,
    typer.Argument(metavar="[LOG]", help="A flight log (.mcap), a folder with one, or a .tlog; none: newest in logs/."),
]
FlightLogOrNewest = Annotated[
    Path | None,
    typer.Argument(metavar="[LOG]", help="A flight log (.mcap), or a folder with one; none: newest in logs/."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
_RARE_FAULTS = frozenset(
    {
        "frames_bad",
        "duplicates",
        "sequence_restarts",
        "reboots",
        "messages_late",
        "motion_implausible",
        "rings_implausible",
    }
)
_TOLD = frozenset({"outcome", "cause", "fault"})
"""Values of a flight's result that the outcome has said already."""
_MOST_SHOWN = 40
_BLANKS = dict.fromkeys((*range(32), *range(127, 160)), " ")
"""For control characters, which would break a line of a table, or be obeyed by a terminal."""
_FASTEST = 1e6


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    for command in (replay, play, info, digest, repair, convert, logs):
        app.command()(command)


def replay(
    log: FlightLogOrNewest = None,
    settings: Annotated[Path | None, typer.Option("--settings", help="Settings instead of the recorded ones.")] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one setting: what would it have sent if."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Where the picture of the difference goes; what-if: replay.png beside LOG.")
    ] = None,
    trace: Annotated[
        Path | None, typer.Option(help="A new .mcap: the log with the trace of every control step, not of some.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Feed a flight's recorded events into the same autopilot again and compare what it sends with what was sent, bit
    for bit. Exit code 1 and a table of the fields that differ if it does not come out the same; 1, too, if LOG is
    damaged, which is flown again as far as it goes."""
    from companion.logs.replay import replay as fly_again

    path = log_file(log_or_newest(log))
    what_if = settings is not None or bool(overrides)
    if what_if and plot is None:
        plot = path.with_name("replay.png")
    if plot is not None:
        from companion.logs.plot import check
        from companion.logs.plot import plot as draw

        exit_on_user_error(check, plot)
    result = exit_on_user_error(fly_again, path, settings, overrides or [], keeps_series=plot is not None, trace=trace)
    for line in result.notes:
        note(line)
    if as_json:
        typer.echo(json.dumps(_replay_table(result)))
    else:
        _show_replay(result)
    if trace is not None:
        say(f"log: {trace}")
    if plot is not None:
        changed = " ".join(
            [f"--settings {settings}"] * (settings is not None) + [f"--set {each}" for each in overrides or []]
        )
        if exit_on_user_error(draw, result.series, f"{path} {changed}", plot):
            say(f"plot: {plot}")
        else:
            differs = "what differs makes no curve" if result.differences else "nothing differs in what is sent"
            say(f"plot: {differs}, so there is none")
    if result.differences or result.problem is not None:  # which is among the notes
        raise typer.Exit(FAILED)


def _show_replay(result: "Replay") -> None:
    compared = f"{result.datagrams} datagrams ({result.bytes} bytes) and {result.traces} records of the trace"
    speed = f"{result.flown_s:.1f} s in {result.wall_s:.2f} s, {result.times_real_time:.0f} times real time"
    if not result.differences:
        typer.echo(f"the same to the bit: {compared}; {speed}")
        return
    rows = [
        (
            each.message,
            each.field,
            f"{each.first_ns * 1e-9:.3f}",
            str(each.count),
            "" if each.largest is None else f"{each.largest:.6g}",
        )
        for each in result.differences[:_MOST_SHOWN]
    ]
    table(("message", "field", "first at, s", "count", "largest difference"), rows)
    if len(result.differences) > _MOST_SHOWN:
        typer.echo(f"and {len(result.differences) - _MOST_SHOWN} fields more")
    typer.echo(f"not the same; compared: {compared}; {speed}")


def _replay_table(result: "Replay") -> dict[str, object]:
    return {
        "same": not result.differences,
        "datagrams": result.datagrams,
        "bytes": result.bytes,
        "trace_records": result.traces,
        "flown_s": result.flown_s,
        "wall_s": result.wall_s,
        "times_real_time": result.times_real_time,
        "notes": result.notes,
        "differences": [
            {
                "message": each.message,
                "field": each.field,
                "first_s": each.first_ns * 1e-9,
                "count": each.count,
                # JSON has no infinity
                "largest": each.largest if each.largest is not None and isfinite(each.largest) else None,
            }
            for each in result.differences
        ],
    }


def info(
    log: LogOrNewest = None,
    check: Annotated[bool, typer.Option("--check", help="Read all of it and check every CRC.")] = False,
    as_json: AsJson = False,
) -> None:
    """Say what a log is: when, how long, which mission, how it ended, which messages. Exit code 1 if it is damaged or
    cut off, as far as was looked."""
    from companion.logs.info import info as describe

    found = exit_on_user_error(describe, log_file(log_or_newest(log)), check=check)
    if as_json:
        typer.echo(json.dumps(_info_table(found)))
    else:
        _show_info(found)
    exit_if_damaged(found.problem)


def _info_table(found: "Info") -> dict[str, Any]:
    return {
        "log": str(found.path),
        "kind": found.kind,
        "size_bytes": found.size_bytes,
        "started_unix_s": found.started_unix_s,
        "duration_s": round(found.duration_s, 3),
        "complete": found.complete,
        "problem": found.problem,
        "outcome": None if found.verdict is None else found.verdict.text,
        "flight": found.flight,
        "result": found.result,
        "vehicle": found.vehicle,
        "attachments": found.attachments,
        "topics": found.topics,
    }


def _show_info(found: "Info") -> None:
    from companion.logs.message_names import with_name

    started = "unknown"
    if found.started_unix_s is not None:
        started = datetime.fromtimestamp(found.started_unix_s).astimezone().isoformat(" ", "seconds")
    head = [
        ("log", str(found.path)),
        ("kind", found.kind + ("" if found.complete else ", not complete")),
        ("size", f"{found.size_bytes / 1e6:.2f} MB"),
        ("started", started),
        ("duration", f"{found.duration_s:.3f} s"),
        *([("outcome", found.verdict.text)] if found.verdict is not None else []),
        *((name.replace("_", " "), value) for name, value in found.flight.items() if value),
        *((name.replace("_", " "), value) for name, value in found.result.items() if _is_worth_saying(name, value)),
        *((f"vehicle's {name}", value) for name, value in found.vehicle.items() if value),
        *((name, f"{size} bytes") for name, size in found.attachments.items()),
    ]
    table(None, head)
    rate = 1.0 / found.duration_s if found.duration_s > 0.0 else 0.0
    rows = [(with_name(topic), str(count), f"{count * rate:.1f}") for topic, count in found.topics.items()]
    table(("topic", "messages", "a second"), rows)


def _is_worth_saying(name: str, value: str) -> bool:
    """Whether a value of a flight's result is listed: the counters of the link's rarer faults are not if they are 0."""
    from protocol.signing import REFUSED

    return (
        bool(value) and name not in _TOLD and not ((name in _RARE_FAULTS or name.startswith(REFUSED)) and value == "0")
    )


def digest(log: LogFile) -> None:
    """Print one hash over all datagrams of each direction: two flights with the same hashes were the same to the
    byte."""
    from companion.logs.traffic import digest as digest_of

    found = exit_on_user_error(digest_of, log_file(log))
    for direction, value in found.hashes.items():
        typer.echo(f"{direction.name.lower():3} {value}")
    exit_if_damaged(found.problem)


def repair(
    log: LogFile,
    to: Annotated[Path | None, typer.Option(help="The whole file; otherwise NAME_repaired beside LOG.")] = None,
) -> None:
    """Make a log that was cut off or damaged whole again, in a new file, and say what of it is lost."""
    from companion.logs.repair import repair as mend

    result = exit_on_user_error(mend, log_file(log), to)
    for line in result.lost:
        typer.echo(f"lost: {line}")
    if result.target is None:
        typer.echo(f"nothing to repair: {result.kept} messages up to {result.last_s:.3f} s, all whole")
    else:
        typer.echo(f"kept: {result.kept} messages up to {result.last_s:.3f} s")
        typer.echo(f"log: {result.target}")


def play(
    log: LogFile,
    to: Annotated[str, typer.Option(help="Who is told: udpout:HOST:PORT, or another URL as of fly.")] = (
        "udpout:127.0.0.1:14550"
    ),
    speed: Annotated[float, typer.Option(help="How many times as fast as it was.")] = 1.0,
    start: Annotated[float, typer.Option("--from", help="Seconds of the log to leave out.", min=0.0)] = 0.0,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until Ctrl-C.")] = False,
    insecure: Insecure = False,
) -> None:
    """Send the recorded vehicle's traffic again with its own timing, so that a ground station or the viewer sees the
    flight."""
    from companion.logs.play import play as send_again
    from protocol.guarded_link import refuse_exposed
    from protocol.transport import open_url

    path = log_file(log)
    if not 0.0 < speed <= _FASTEST:
        exit_as_unusable(f"--speed {speed:g}: not a positive number up to {_FASTEST:g}")
    exit_on_user_error(refuse_exposed, to, signed=False, insecure=insecure)
    with closing(exit_on_user_error(open_url, to)) as transport, exit_on_interrupt(""):
        played = exit_on_user_error(
            send_again,
            path,
            transport,
            speed=speed,
            start_s=start,
            loop=loop,
            progress=lambda time_s: typer.echo(f"\r{time_s:9.1f} s", err=True, nl=False),
            pausing=lambda wait_s: say(f"\rcompanion: {path}: the next datagram comes in {wait_s:.0f} s"),
        )
    say("")
    typer.echo(f"{played.datagrams} datagrams ({played.bytes} bytes), {played.played_s:.1f} s of the log, to {to}")


def convert(
    log: LogFile,
    to: Annotated[Path, typer.Argument(help="A new file .mcap, .tlog or .ulg; a new folder for --as csv or parquet.")],
    form: Annotated[
        str | None, typer.Option("--as", help="mcap, tlog, ulog, csv or parquet, where TO's name does not say it.")
    ] = None,
) -> None:
    """Write a log in another form: telemetry logs (.tlog) to flight logs (.mcap) and back, a CSV or Parquet file for
    each kind of message, ULog. Exit code 1 if LOG is damaged: what is whole of it is written."""
    from companion.logs.convert import convert as write

    converted = exit_on_user_error(write, log_file(log), to, form)
    for line in converted.written:
        typer.echo(line)
    exit_if_damaged(converted.problem)


def logs(
    folder: Annotated[Path, typer.Argument(help="Where to look, folders in it included.")] = Path("logs"),
    as_json: AsJson = False,
) -> None:
    """List the logs in a folder: date, mission, outcome, duration, distance, least clearance, faults. What it finds is
    kept in an index in your cache, and looked up again only for logs that have changed."""
    from companion.logs.index import listing

    rows = exit_on_user_error(listing, folder)
    if as_json:
        typer.echo(json.dumps([row.table() for row in rows]))
        return
    headers = ("log", "date", "mission", "result", "duration, s", "distance, m", "clearance, m", "faults")
    table(headers, [row.cells() for row in rows])


def table(headers: Sequence[str] | None, rows: Iterable[Sequence[str]]) -> None:
    """Print columns: framed and folded to the width of a terminal, bare and never folded for other programs."""
    cells = [[cell.translate(_BLANKS) for cell in row] for row in rows]
    if not sys.stdout.isatty():
        _plain_table([*([headers] if headers is not None else []), *cells])
        return
    from rich.box import ROUNDED
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    framed = Table(show_header=headers is not None, box=ROUNDED)
    for header in headers or ():
        framed.add_column(header, overflow="fold")
    for row in cells:
        framed.add_row(*map(Text, row))
    Console().print(framed)


def _plain_table(rows: Sequence[Sequence[str]]) -> None:
    """Written without rich, which takes longer to load than a log's summary to read."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        typer.echo(f" {'  '.join(cells)} ")
