"""What a flight is made of, read from its files: settings, the vehicle's parameters, the mission."""

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from companion.config import Settings
from companion.mission.files import MissionFileError, Place
from companion.mission.geodetic import first_place, in_metres
from companion.mission.plan import Mission
from companion.renamed_settings import RENAMED_SETTINGS
from companion.runtime.station_files import is_of_station, origin_of
from protocol import toml_files
from protocol.toml_files import TomlFileError
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


def load_body(vehicle: str) -> VehicleParameters:
    """The `[body]` of a vehicle, found by name or path: all that the companion knows of it beforehand.

    Raises TomlFileError.
    """
    return toml_files.load(toml_files.find("vehicles", vehicle), _VehicleFile).body


def at_pad(mission: Mission) -> Place:
    """Where on earth the pad of the mission's world is. Raises TomlFileError."""
    return origin_of(mission.world)


def load_mission(
    name: str, overrides: Sequence[str] = (), origin: Callable[[Mission], Place] | None = at_pad
) -> tuple[Mission, Path]:
    """The mission of that name or path, changed by overrides as "speed=8", and its file. `origin` says where its
    take-off is, for waypoints by latitude and longitude; None: at the first of them. Raises TomlFileError."""
    path = toml_files.find("missions", name)
    tables = toml_files.read(path)
    try:
        place = first_place(tables)
        if place is not None:
            around_it = in_metres(tables, place)
            rough = toml_files.convert(around_it, Mission, str(path), overrides)
            tables = around_it if origin is None else in_metres(tables, origin(rough))
    except MissionFileError as error:
        raise TomlFileError(f"{path}: {error}") from error
    return toml_files.convert(tables, Mission, str(path), overrides), path


def is_geodetic(name: str) -> bool:
    """Whether the mission of that name or path has places on earth, as a ground station's has. Raises TomlFileError,
    and MissionFileError for a waypoint that is no place."""
    return is_of_station(name) or first_place(toml_files.read(toml_files.find("missions", name))) is not None
