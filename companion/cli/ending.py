"""What the commands that fly print after a flight: the verdict, a short table, and what can be done next."""

import json
import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from companion.cli.shell import note, say

if TYPE_CHECKING:
    from companion.runtime.flight import Result
    from companion.runtime.summary import Summary


def print_end(result: "Result", *, as_json: bool, verbose: bool = False) -> None:
    """How a flight ended, for people or as JSON; with all figures if `verbose`."""
    from companion.runtime.flight import end_table
    from companion.runtime.summary import summarize

    summary = summarize(result.log)
    values = end_table(result, summary)
    if as_json:
        typer.echo(json.dumps({**values, "log": str(result.log)}))
        return
    from rich.box import ROUNDED
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    outcome, console = result.verdict.outcome, Console()
    color = "green" if outcome.succeeded else "yellow" if outcome.wanted else "red"
    console.print(Text(result.verdict.sentence, f"bold {color}"))
    rows = {name.replace("_", " "): value for name, value in values.items()} if verbose else figures(result, summary)
    table = Table(show_header=False, box=ROUNDED, border_style="dim")
    for name, value in rows.items():
        table.add_row(name, ", ".join(map(str, value)) if isinstance(value, list) else str(value))
    console.print(table)


def print_next(log: Path, *, report: bool) -> None:
    """Write the report of a flight, if that is wanted, and say how to look at the flight, unless its log has gone; on
    standard error."""
    if not log.exists():
        note(f"{log}: No such file or directory: the flight has no log any more")
        return
    target = shlex.quote(str(log))
    steps = [f"companion view {target}", f"companion info {target}"]
    if report:
        from companion.view.report import write
        from protocol.flightlog import FlightLogError

        try:
            say(f"report: {write(log).path}")
        except FlightLogError as error:  # how the flight came out counts for the exit code, not this
            note(str(error))
    else:
        steps.insert(1, f"companion report {target}")
    say("\n  ".join((f"log: {log}; look at it with", *steps)))


def figures(result: "Result", summary: "Summary") -> dict[str, str]:
    """At most eight figures of a flight in the units that people use; none that has no meaning for it."""
    from companion.runtime.progress import clock_text

    faster = result.duration_s / result.wall_s if result.wall_s else 0.0
    pace = f", {faster:.0f} times as fast as real time" if faster > 1.5 else ""
    rows: dict[str, str] = {"flight time": clock_text(result.duration_s) + pace}
    if summary.distance_m:
        rows["distance"] = f"{summary.distance_m:.0f} m"
    if result.delivered is not None:
        rows["parcel"] = "delivered" if result.delivered else "not delivered"
    if summary.rmse_m is not None:
        rows["off the path"] = f"{100.0 * math.hypot(*summary.rmse_m):.1f} cm (rms)"
    told = result.testimony
    if told is not None and told.least_clearance_m is not None:
        touched = f"hit {told.contact_with}" if told.contacts else "no contact"
        rows["nearest obstacle"] = f"{told.least_clearance_m:.2f} m, {touched}"
    elif summary.seen_clearance_m is not None:
        rows["nearest obstacle"] = f"{summary.seen_clearance_m:.2f} m, as the LiDAR saw it"
    lost = result.traffic.messages_lost
    rows["link"] = f"{summary.messages_in} messages from the vehicle, {lost or 'none'} lost"
    if summary.latency_p50_us is not None:
        late = result.missed_deadlines
        rows["loop"] = f"{summary.latency_p50_us * 1e-3:.1f} ms from attitude to command, {late or 'no'} late ticks"
    trouble = result.log_fault or (f"{result.records_dropped} records dropped" if result.records_dropped else None)
    if trouble:
        rows["log"] = trouble
    return rows
