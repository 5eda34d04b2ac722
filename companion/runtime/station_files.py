"""The missions of ground stations, read from their files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from companion.config import Settings
from companion.mission.files import MissionFile, MissionFileError, Place, fence_radius, parse, to_mission
from companion.mission.plan import Mission
from protocol import toml_files
from protocol.toml_files import TomlFileError


class _Origin(msgspec.Struct, frozen=True):
    latitude_deg: float
    longitude_deg: float


class _WorldFile(msgspec.Struct, frozen=True):
    origin: _Origin


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
    planned from, or its first place. Raises TomlFileError."""
    file = read_of_station(name)

    def around(place: Place) -> Mission:
        tables = msgspec.to_builtins(to_mission(file, place, Path(name).stem))
        return toml_files.convert(tables, Mission, name, overrides)

    home = file.home or next((item.place for item in file.items if item.place is not None), None)
    if home is None:
        raise TomlFileError(f"{name}: it does not say where it was planned from, nor any place")
    try:
        place, mission = home, around(home)
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


def fenced(settings: Settings, path: Path, radius: float | None) -> Settings:
    """The settings with the fence of a file, of that radius (m), if it is the nearer one. Raises TomlFileError for a
    take-off within the margin of it."""
    fence = settings.geofence
    if radius is None or (fence.radius is not None and fence.radius <= radius):
        return settings
    if radius <= fence.margin:
        raise TomlFileError(
            f"{path}: its fence leaves {radius:.2f} m around the take-off, and geofence.margin is {fence.margin:g} m"
        )
    return msgspec.structs.replace(settings, geofence=msgspec.structs.replace(fence, radius=radius))
