"""`companion report`: one HTML file that holds a flight, to be opened, kept or sent as it is."""

import html
import importlib.util
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from companion.logs.recordings import as_date, printable, started_unix_s
from companion.logs.target import output
from companion.view.events import events
from companion.view.findings import findings
from companion.view.gather import GatheredFlight
from companion.view.report_charts import charts
from companion.view.report_page import Page
from companion.view.report_tables import bands, changed_settings, obstacles, tiles, topics, ways
from protocol.flightlog import FILE_NAME as LOG_NAME
from protocol.flightlog import FlightLogError

FILE_NAME = "report.html"
PAGE = Path(__file__).with_name("report_page.html")


class Written(NamedTuple):
    """A report that was written."""

    path: Path
    problem: str | None
    """What is wrong with the log, if anything is: the report shows what is whole of it."""


def write(log: Path, target: Path | None = None) -> Written:
    """Write the report of a log, by default beside it (`beside`). An older report is replaced.

    Raises FlightLogError if the log can't be read, or if the target can't be written or is a recording itself.
    """
    flight = GatheredFlight(log)
    target = beside(log) if target is None else target
    page = compose(flight)
    # Nothing in the text may end the script that it stands in, or begin a comment.
    data = msgspec.json.encode(page).decode().replace("<", "\\u003c")
    parts = PAGE.read_text(encoding="utf-8").split("@@")
    values = {"title": html.escape(page.title), "plotly": _plotly(), "data": data}
    with output(target, source=log, replaces=True) as draft, draft.open("w", encoding="utf-8") as file:
        for index, part in enumerate(parts):
            file.write(values[part] if index % 2 else part)
    return Written(target, flight.log.problem)


def beside(log: Path) -> Path:
    """Where a log's report goes: FILE_NAME for a flight in its own folder, otherwise with the log's name before it."""
    return log.with_name(FILE_NAME if log.name == LOG_NAME else f"{log.stem}_{FILE_NAME}")


def _plotly() -> str:
    """The library's script. Its Python side takes a second to import and is not needed."""
    found = importlib.util.find_spec("plotly")
    if found is None or found.origin is None:
        raise FlightLogError("the report needs plotly, which is not installed")
    return (Path(found.origin).parent / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def compose(flight: GatheredFlight) -> Page:
    """The page of a gathered flight."""
    flown = flight.log.metadata.get("flight", {})
    when = started_unix_s(flight.log.metadata) or as_date(flight.start_ns * 1e-9) or 0.0
    return Page(
        title=flown.get("mission", "") or printable(flight.log.path.stem),
        subtitle=" · ".join(
            filter(
                None,
                (
                    _date(when),
                    _vehicle(flight),
                    *_how(flown, flight.output),
                    flown.get("source") or printable(flight.log.path),
                ),
            )
        ),
        tiles=tiles(flight),
        findings=tuple(findings(flight)),
        events=tuple(events(flight)),
        begin=flight.begin or 0.0,
        end=flight.end,
        bands=bands(flight),
        charts=charts(flight),
        solids=obstacles(flight),
        ways=ways(flight),
        topics=topics(flight),
        changed=changed_settings(flight),
        parameters=tuple((name, f"{value:.7g}") for name, value in sorted(flight.parameters.items())),
        versions=tuple((name, value) for name, value in flown.items() if value),
    )


def _vehicle(flight: GatheredFlight) -> str:
    """What flew, with its version if the log has it."""
    name = flight.senders.names.get(flight.vehicle, "")
    version = flight.log.metadata.get("vehicle", {}).get("version", "")
    return f"{name} {version}".strip()


def _date(unix_s: float) -> str:
    return time_text(unix_s) if unix_s > 86_400.0 else ""


def time_text(unix_s: float) -> str:
    """UTC, to the minute."""
    return np.datetime_as_string(np.datetime64(int(unix_s), "s"), unit="m").replace("T", " ") + " UTC"


def _how(flown: dict[str, str], output: str) -> list[str]:
    """Output, pace and seed of a flight in words."""
    words = [f"output {output}"] if output else []
    if "pace" in flown:
        words.append("real time" if flown["pace"] == "1.0" else flown["pace"])
    return [*words, f"seed {flown['seed']}"] if flown.get("seed") else words
