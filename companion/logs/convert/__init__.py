"""Logs in the formats of other tools, and theirs in ours."""

import tempfile
from pathlib import Path

from companion.logs.convert import telemetry
from protocol.flightlog import FlightLogError
from protocol.tlog import is_tlog

FORMS = ("mcap", "tlog", "ulog", "csv", "parquet")
_SUFFIXES = {".mcap": "mcap", ".tlog": "tlog", ".ulg": "ulog", ".ulog": "ulog"}


def convert(source: Path, target: Path, form: str | None = None) -> list[str]:
    """Write `source`, a flight log or a telemetry log, to `target` in one of FORMS (None: by its suffix); what was
    written, a line each.

    Raises FlightLogError if the one can't be read, the other can't be made, or the form isn't known.
    """
    form = form or _SUFFIXES.get(target.suffix)
    if form not in FORMS:
        raise FlightLogError(f"{target}: which form? There are --as {', '.join(FORMS)}")
    if not is_tlog(source):
        return _from_flight_log(source, target, form)
    if form == "mcap":
        return [f"{telemetry.to_flight_log(source, target)} entries: {target}"]
    if form == "tlog":
        raise FlightLogError(f"{source}: a telemetry log already")
    with tempfile.TemporaryDirectory() as folder:
        between = Path(folder) / "flight.mcap"
        telemetry.to_flight_log(source, between)
        return _from_flight_log(between, target, form)


def _from_flight_log(source: Path, target: Path, form: str) -> list[str]:
    # Each form's own imports are the form's alone.
    if form == "tlog":
        return [f"{telemetry.from_flight_log(source, target)} frames: {target}"]
    if form == "ulog":
        from companion.logs.convert.ulog import to_ulog

        return [f"{to_ulog(source, target)} records: {target}"]
    if form == "mcap":
        raise FlightLogError(f"{source}: a flight log already")
    from companion.logs.convert.tables import to_tables

    written = to_tables(source, target, "csv" if form == "csv" else "parquet")
    return [f"{rows} rows: {target / name}" for name, rows in sorted(written.items())]
