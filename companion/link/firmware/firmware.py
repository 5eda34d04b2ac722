"""The questions that every make of autopilot answers differently."""

from collections.abc import Callable
from dataclasses import dataclass

from companion.state import FlightMode, Output


@dataclass(frozen=True, slots=True)
class Firmware:
    """One make of autopilot."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT"""
    mode_of: Callable[[int], FlightMode]
    """From HEARTBEAT.custom_mode."""
    mode_command: Callable[[FlightMode], tuple[float, float, float]]
    """DO_SET_MODE's three parameters; KeyError for a mode that can't be commanded."""
    refusal: Callable[[Output, int], str | None]
    """Why an output can't be used with the version (AUTOPILOT_VERSION.flight_sw_version); None if it can."""
    angle_boost: bool = False
    """The vehicle divides the thrust that it is asked for by the cosine of its tilt, unless a parameter says that it
    does not."""
    spools_on_ground: bool = False
    """While the vehicle says that it is on the ground, its motors don't follow the thrust yet."""
