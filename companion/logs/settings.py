"""The settings that a log's flight was flown with."""

from collections.abc import Sequence
from typing import Any

import msgspec

from companion.config import Settings
from companion.renamed_settings import RENAMED_SETTINGS
from protocol import toml_files

_FLOWN_WITHOUT = (
    {"rates": {"odometry": 0.0}},
    {"control": {"estimation": {"torque_bandwidth": 0.0, "velocity_settling": 0.0, "climb_uncertainty": 0.0}}},
    {"avoidance": {"plan": {"switch_growth": 1.0}, "keep_out_below": 0.0, "course": {"smooth_from": 1e9}}},
    {"avoidance": {"tracks": {"hidden_scans": 0}}},
    {"avoidance": {"plan": {"switch_growth_tight": 1.0}}},
    {"control": {"prediction": {"overdue": 0.0, "attitudes_beyond": 60.0}}},
    {"avoidance": {"course": {"adapts": True, "max_yield": 1e9}, "guard": {"emergency_braking": 0.0}}},
    {"avoidance": {"map": {"memory_cells": 0}}},
    {"avoidance": {"map": {"beyond_window": False}}},
    {"avoidance": {"altitude_search": {"edge_distance": 1e9, "patience_s": 1e9, "short_detour": 1e9}}},
    {"avoidance": {"map": {"keeps_free": False}}},
    {"supervision": {"stray_distance": 1e9}},
    {"trajectory": {"max_lead": 1e9}},
    {"avoidance": {"velocity_error_s": 0.0}},
    {"trajectory": {"height_drift": 0.0}},
    {"avoidance": {"guard": {"sight_s": 0.0}}},
    {"avoidance": {"guard": {"evasion_stops": False}}},
    {"avoidance": {"plan": {"turn_scans": 1}}},
    {"supervision": {"level_before": 0.0}, "control": {"prediction": {"told_every": 0.0}}},
    {"supervision": {"listen_before_adopting": 0.0}},
)
"""Settings that a log may lack, since its flight's software did not have them: as it flew."""


def recorded_settings(tables: dict[str, Any], source: str, overrides: Sequence[str] = ()) -> Settings:
    """The settings of a log, whose names may be old ones. Raises TomlFileError, naming `source` and key."""
    try:
        tables = toml_files.with_new_names(tables, RENAMED_SETTINGS)
    except RecursionError as error:
        raise toml_files.TomlFileError(f"{source}: {error}") from error
    for missing in _FLOWN_WITHOUT:
        tables = _completed(tables, missing)
    return toml_files.convert(tables, Settings, source, overrides, RENAMED_SETTINGS)


def settings_or_defaults(attachment: bytes) -> tuple[Settings, str | None]:
    """The settings in a log's settings.json, or the defaults and why they stand for it. Another's log has `{}`."""
    try:
        return recorded_settings(msgspec.json.decode(attachment, type=dict[str, Any]), "settings.json"), None
    except (msgspec.MsgspecError, RecursionError, toml_files.TomlFileError) as error:
        return Settings(), str(error)


def _completed(tables: dict[str, Any], by: dict[str, Any]) -> dict[str, Any]:
    """With the entries of `by` that it lacks, in tables of tables; what is no table there stays, to be refused."""
    found = dict(tables)
    for key, value in by.items():
        there = found.setdefault(key, {} if isinstance(value, dict) else value)
        if isinstance(value, dict) and isinstance(there, dict):
            found[key] = _completed(there, value)
    return found
