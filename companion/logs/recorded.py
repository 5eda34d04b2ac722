"""What a flight's log says of the flight itself: everything that its autopilot was made of."""

import platform
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from companion.config import Log, Settings
from companion.logs.recordings import whole_datagrams
from companion.logs.settings import recorded_settings
from companion.logs.traffic import open_log
from companion.mission.plan import Mission
from companion.plugins import Kind, installed
from companion.renamed_settings import RENAMED_SETTINGS
from companion.runtime.files import load_settings
from companion.runtime.flight import AUTO, git_hash
from companion.state import Adoption, Output
from protocol import toml_files
from protocol.flightlog import FlightLogError, LogReader
from protocol.vehicle_parameters import VehicleParameters

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Recorded:
    """A log, and what its flight started with."""

    log: LogReader
    settings: Settings
    trace_rate: float
    """Hz, as it was flown."""
    body: VehicleParameters
    mission: Mission
    output: Output | None
    """None: what the vehicle's parameters say, as in flight."""
    adoption: Adoption | None
    """What the vehicle was taken over in flight for, if it was."""
    lockstep: bool
    whole_datagrams: bool


class _VehicleFile(msgspec.Struct, frozen=True):
    body: VehicleParameters


class _LogSettings(msgspec.Struct, frozen=True):
    log: Log = Log()


def open_flight(path: Path, settings: Path | None = None, overrides: Sequence[str] = ()) -> Recorded:
    """The flight in a log with its own settings, or those of a file, either with `overrides`: "table.key=value", with
    "mission." before it for the mission.

    Raises FlightLogError for a log that holds no flight of this companion, TomlFileError for settings that don't fit.
    """
    log = open_log(path)
    if not isinstance(log, LogReader):
        raise FlightLogError(f"{path}: a telemetry log: it does not hold what a companion decided by")
    flight = log.metadata.get("flight")
    if flight is None:
        raise FlightLogError(f"{path}: no flight of this companion, it does not say how it was flown")
    changes = toml_files.by_first_word(overrides, ("mission",))
    chosen = _own_settings(log, changes[""]) if settings is None else load_settings(settings, changes[""])
    flown_with = toml_files.by_first_word(flown_overrides(log), ("mission",))
    try:
        output = None if flight["output"] == AUTO else Output(flight["output"])
    except (KeyError, ValueError):
        raise FlightLogError(f"{path}: no flight of this companion, its output is not known") from None
    try:
        adoption = Adoption(flight["adopted"]) if flight.get("adopted") else None
    except ValueError:
        raise FlightLogError(f"{path}: it does not say what the vehicle was taken over for") from None
    return Recorded(
        log=log,
        settings=chosen,
        trace_rate=_trace_rate(log),
        body=_table(log, "vehicle.toml", _VehicleFile).body,
        mission=_table(log, "mission.toml", Mission, [*flown_with["mission"], *changes["mission"]]),
        output=output,
        adoption=adoption,
        lockstep=flight.get("pace") == "lockstep",
        whole_datagrams=whole_datagrams(log.metadata),
    )


def _own_settings(log: LogReader, overrides: Sequence[str]) -> Settings:
    """Those of the flight. Raises TomlFileError, which says what of other packages was flown and is not here."""
    source = f"{log.path}, settings.json"
    tables: dict[str, Any] = _json(source, _attachment(log, "settings.json"), dict[str, Any])
    try:
        return recorded_settings(tables, source, overrides)
    except toml_files.TomlFileError as error:
        flown = {kind: log.metadata["flight"][kind.value] for kind in Kind if kind.value in log.metadata["flight"]}
        here = {kind: [each.text for same in installed(kind).values() for each in same] for kind in flown}
        missing = [f"{kind.value} {text}" for kind, text in flown.items() if text not in here[kind]]
        if not missing:
            raise
        raise toml_files.TomlFileError(f"{error}; it was flown with the {' and the '.join(missing)}") from None


def flown_overrides(log: LogReader) -> list[str]:
    """The overrides of a flight, by the settings' present names. Raises FlightLogError if the log's are damaged."""
    text = log.metadata.get("flight", {}).get("overrides", "[]")
    recorded = _json(f"{log.path}, overrides", text, list[str])
    return [toml_files.override_with_new_name(each, RENAMED_SETTINGS) for each in recorded]


def other_versions(flight: Mapping[str, str], settings: Settings) -> list[str]:
    """What differs between the software that flew (the log's metadata "flight") and this one, a line each."""
    here = {"courier": metadata.version("courier-autopilot"), "python": platform.python_version()}
    for name in ("control", "numba", "numpy", "pymavlink", "ruckig", "scipy"):
        here[name] = metadata.version(name)
    here |= {each.kind.value: each.text for each in settings.plugins}
    return [
        f"flown with {name} {flight[name]}, this is {version}"
        for name, version in here.items()
        if flight.get(name, version) != version
    ]


def _trace_rate(log: LogReader) -> float:
    """The default where the log does not say it."""
    try:
        settings = msgspec.json.decode(log.attachments.get("settings.json", b"{}"), type=_LogSettings)
    except (msgspec.MsgspecError, RecursionError):
        settings = _LogSettings()
    return settings.log.trace_rate


def other_commit(flight: Mapping[str, str]) -> list[str]:
    """One line if what flew was another commit than this, where both are known."""
    then, now = flight.get("git", ""), git_hash()
    return [f"flown by commit {then}, this is {now}"] if then and now and then != now else []


def _attachment(log: LogReader, name: str) -> bytes:
    try:
        return log.attachments[name]
    except KeyError:
        raise FlightLogError(f"{log.path}: {name} is not attached, so the flight can't be flown again") from None


def _json(source: str, text: str | bytes, kind: type[T]) -> T:
    try:
        return msgspec.json.decode(text, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise FlightLogError(f"{source}: {error}") from error


def _table(log: LogReader, name: str, record: type[T], overrides: Sequence[str] = ()) -> T:
    source = f"{log.path}, {name}"
    try:
        tables = tomllib.loads(_attachment(log, name).decode())
    except (ValueError, RecursionError) as error:
        raise FlightLogError(f"{source}: {error}") from error
    return toml_files.convert(tables, record, source, overrides)
