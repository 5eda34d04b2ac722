"""The autopilot: from telemetry to setpoints, one direction of flow.

`from companion import Companion` flies a vehicle from a program; see docs/api.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from companion.api import (
        Companion,
        Delivery,
        Event,
        FlightError,
        Mission,
        Outcome,
        Phase,
        State,
        Verdict,
        Waypoint,
    )

__all__ = [
    "Companion",
    "Delivery",
    "Event",
    "FlightError",
    "Mission",
    "Outcome",
    "Phase",
    "State",
    "Verdict",
    "Waypoint",
]


def __getattr__(name: str) -> Any:
    """The interface for programs is loaded when something of it is asked for: the commands do without it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("companion.api"), name)
