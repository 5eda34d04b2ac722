"""Converts logs to the formats of other tools, and telemetry logs to flight logs."""

import tempfile
from pathlib import Path
from typing import NamedTuple

from companion.logs.convert import telemetry
from companion.logs.target import output
from companion.logs.traffic import open_log, traffic_of
from protocol.flightlog import FlightLogError, LogReader

FORMS = ("mcap", "tlog", "ulog", "csv", "parquet")
_SUFFIXES = {".mcap": "mcap", ".tlog": "tlog", ".ulg": "ulog", ".ulog": "ulog"}


class Converted(NamedTuple):
    """What a conversion came to."""

    written: list[str]
    """The files written, a line each."""
    problem: str | None
    """What is wrong with the source, whose whole part was written."""


def convert(source: Path, target: Path, form: str | None = None) -> Converted:
    """Write `source`, a flight log or a telemetry log, to `target` in one of FORMS (None: by the target's suffix).

    Raises FlightLogError if `source` can't be read, `target` can't be made or exists, or the form is unknown.
    """
    form = form or _SUFFIXES.get(target.suffix)
    if form not in FORMS:
        raise FlightLogError(f"{target}: which form? There are --as {', '.join(FORMS)}")
    log = open_log(source)
    if form == ("mcap" if isinstance(log, LogReader) else "tlog"):
        raise FlightLogError(f"{source}: a {'flight' if form == 'mcap' else 'telemetry'} log already")
    with output(target, parents=form in ("csv", "parquet")) as draft:
        if isinstance(log, LogReader):
            written = _from_flight_log(log, draft, target, form)
        elif form == "mcap":
            written = [f"{telemetry.to_flight_log(traffic_of(log), draft)} entries: {target}"]
        else:
            with tempfile.TemporaryDirectory() as folder:
                between = Path(folder) / "flight.mcap"
                telemetry.to_flight_log(traffic_of(log), between)
                written = _from_flight_log(LogReader(between), draft, target, form)
    return Converted(written, log.problem)


def _from_flight_log(log: LogReader, draft: Path, target: Path, form: str) -> list[str]:
    # Imported here: no form needs the imports of another one.
    if form == "tlog":
        return [f"{telemetry.from_flight_log(log, draft)} frames: {target}"]
    if form == "ulog":
        from companion.logs.convert.ulog import to_ulog

        return [f"{to_ulog(log, draft)} records: {target}"]
    from companion.logs.convert.tables import to_tables

    rows = to_tables(log, draft, "csv" if form == "csv" else "parquet")
    return [f"{count} rows: {target / name}" for name, count in sorted(rows.items())]
