"""The settings that a log's flight was flown with."""

from collections.abc import Sequence
from typing import Any

from companion.config import Settings
from companion.renamed_settings import RENAMED_SETTINGS
from protocol import toml_files

_FLOWN_WITHOUT: dict[str, dict[str, Any]] = {"rates": {"odometry": 0.0}}
"""Settings that a log may lack, since its flight's software did not have them, by table: as it flew."""


def recorded_settings(tables: dict[str, Any], source: str, overrides: Sequence[str] = ()) -> Settings:
    """The settings of a log, whose names may be old ones. Raises TomlFileError, naming `source` and key."""
    tables = toml_files.with_new_names(tables, RENAMED_SETTINGS)
    tables = tables | {name: values | tables.get(name, {}) for name, values in _FLOWN_WITHOUT.items()}
    return toml_files.convert(tables, Settings, source, overrides, RENAMED_SETTINGS)
