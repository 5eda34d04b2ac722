"""What a flight is made of, read from its files: settings, the vehicle's parameters, the mission."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from companion.config import Settings
from companion.mission.plan import Mission
from companion.renamed_settings import RENAMED_SETTINGS
from protocol import toml_files
from protocol.vehicle_parameters import VehicleParameters


class _VehicleFile(msgspec.Struct, frozen=True):
    body: VehicleParameters


def load_settings(path: Path | None, overrides: Sequence[str] = ()) -> Settings:
    """The settings of a file, or the defaults, changed by overrides as "table.key=value".

    Raises TomlFileError, naming file and key; for a key that was renamed, its new name.
    """
    if path is None:
        return toml_files.convert({}, Settings, "settings", overrides, RENAMED_SETTINGS)
    return toml_files.load(path, Settings, overrides, RENAMED_SETTINGS)


def recorded_settings(tables: dict[str, Any], source: str, overrides: Sequence[str] = ()) -> Settings:
    """The settings of a log, whose names may be old ones. Raises TomlFileError, naming `source` and key."""
    tables = toml_files.with_new_names(tables, RENAMED_SETTINGS)
    return toml_files.convert(tables, Settings, source, overrides, RENAMED_SETTINGS)


def load_body(vehicle: str) -> VehicleParameters:
    """The `[body]` of a vehicle, found by name or path: all that the companion knows of it beforehand.

    Raises TomlFileError.
    """
    return toml_files.load(toml_files.find("vehicles", vehicle), _VehicleFile).body


def load_mission(name: str, overrides: Sequence[str] = ()) -> tuple[Mission, Path]:
    """The mission of that name or path, changed by overrides as "speed=8", and its file. Raises TomlFileError."""
    path = toml_files.find("missions", name)
    return toml_files.load(path, Mission, overrides), path
