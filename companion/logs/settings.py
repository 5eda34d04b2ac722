"""The settings that a log's flight was flown with."""

from collections.abc import Sequence
from typing import Any

from companion.config import Settings
from companion.renamed_settings import RENAMED_SETTINGS
from protocol import toml_files


def recorded_settings(tables: dict[str, Any], source: str, overrides: Sequence[str] = ()) -> Settings:
    """The settings of a log, whose names may be old ones. Raises TomlFileError, naming `source` and key."""
    tables = toml_files.with_new_names(tables, RENAMED_SETTINGS)
    return toml_files.convert(tables, Settings, source, overrides, RENAMED_SETTINGS)
