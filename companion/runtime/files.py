"""What a flight is made of, read from its files: settings, the vehicle's parameters, the mission."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from companion.config import Settings
from companion.mission.files import MissionFile, MissionFileError, Place, fence_radius, parse, to_mission
from companion.mission.plan import Mission
from companion.renamed_settings import RENAMED_SETTINGS
from protocol import toml_files
from protocol.toml_files import TomlFileError
from protocol.vehicle_parameters import VehicleParameters


class _VehicleFile(msgspec.Struct, frozen=True):
    body: VehicleParameters


class _Origin(msgspec.Struct, frozen=True):
    latitude_deg: float
    longitude_deg: float


class _WorldFile(msgspec.Struct, frozen=True):
    origin: _Origin


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


class FromStation(NamedTuple):
    """A mission from a ground station's file."""

    mission: Mission
    path: Path
    fence_radius: float | None
    """m around the take-off."""
    notes: tuple[str, ...]
    """What of the file plays no part."""


def is_of_station(name: str) -> bool:
    """Whether that is a ground station's file: QGroundControl's .plan, Mission Planner's .waypoints."""
    return name.endswith((".plan", ".waypoints"))


def read_of_station(name: str) -> MissionFile:
    """Such a file. Raises TomlFileError."""
    try:
        return parse(Path(name).read_text(encoding="utf-8"))
    except OSError as error:
        raise TomlFileError(f"{name}: {error.strerror}") from error
    except ValueError as error:  # a MissionFileError, or not UTF-8
        raise TomlFileError(f"{name}: {error}") from error


def load_of_station(
    name: str, overrides: Sequence[str] = (), origin: Callable[[Mission], Place] | None = None
) -> FromStation:
    """The mission of such a file, changed by overrides. `origin` says where its take-off is; left out, where it was
    planned. Raises TomlFileError."""
    file = read_of_station(name)

    def around(place: Place) -> Mission:
        tables = msgspec.to_builtins(to_mission(file, place, Path(name).stem))
        return toml_files.convert(tables, Mission, name, overrides)

    if file.home is None:
        raise TomlFileError(f"{name}: it does not say where it was planned from")
    try:
        place, mission = file.home, around(file.home)
        if origin is not None:
            place = origin(mission)
            mission = around(place)
        return FromStation(mission, Path(name), fence_radius(file, place), file.notes)
    except MissionFileError as error:
        raise TomlFileError(f"{name}: {error}") from error


def origin_of(world: str) -> Place:
    """Where on earth a world's pad is. Raises TomlFileError."""
    origin = toml_files.load(toml_files.find("worlds", world), _WorldFile).origin
    return origin.latitude_deg, origin.longitude_deg


def load_mission(name: str, overrides: Sequence[str] = ()) -> tuple[Mission, Path]:
    """The mission of that name or path, changed by overrides as "speed=8", and its file. Raises TomlFileError."""
    path = toml_files.find("missions", name)
    return toml_files.load(path, Mission, overrides), path


def fenced(settings: Settings, radius: float | None) -> Settings:
    """The settings with a fence of that radius (m), if it is the nearer one."""
    fence = settings.geofence
    if radius is None or (fence.radius is not None and fence.radius <= radius):
        return settings
    return msgspec.structs.replace(settings, geofence=msgspec.structs.replace(fence, radius=radius))
