"""The questions that every make of autopilot answers differently."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from companion.link.parameters import Question
from companion.reports import Finding, VehicleSettings
from companion.state import FlightMode, Output, Safety
from protocol.messages import dialect

COPTERS = frozenset(
    {
        dialect.MAV_TYPE_GENERIC,
        dialect.MAV_TYPE_QUADROTOR,
        dialect.MAV_TYPE_COAXIAL,
        dialect.MAV_TYPE_HELICOPTER,
        dialect.MAV_TYPE_HEXAROTOR,
        dialect.MAV_TYPE_OCTOROTOR,
        dialect.MAV_TYPE_TRICOPTER,
        dialect.MAV_TYPE_DODECAROTOR,
        dialect.MAV_TYPE_DECAROTOR,
        43,  # MAV_TYPE_GENERIC_MULTIROTOR, which older dialects lack
    }
)
"""MAV_TYPE of what hovers; a vehicle that does not say what it is may."""

Values = Mapping[str, float]
"""Parameters of the vehicle by name; those that it does not have are left out."""


@dataclass(frozen=True, slots=True)
class Terms:
    """What the vehicle's parameters are judged by."""

    output: Output | None
    """None: whichever the vehicle is flown more safely on."""
    system: int
    """The companion's own."""
    tilt_deg: float
    """The companion's limit."""
    gap: float = 0.0
    """s of a gap of the companion's own after which no setpoint leaves before the vehicle says what it does."""


@dataclass(frozen=True, slots=True)
class Firmware:
    """One make of autopilot."""

    name: str
    autopilot: int
    """MAV_AUTOPILOT"""
    kinds: frozenset[int]
    """MAV_TYPE of the vehicles that have these modes and can be flown."""
    mode_of: Callable[[int], FlightMode]
    """From HEARTBEAT.custom_mode."""
    mode_command: Callable[[FlightMode], tuple[float, float, float]]
    """DO_SET_MODE's three parameters; KeyError for a mode that can't be commanded."""
    refusal: Callable[[Output, int], str | None]
    """Why an output can't be used with the version (AUTOPILOT_VERSION.flight_sw_version); None if it can."""
    parameters: tuple[Question, ...]
    """What is read before a flight."""
    bytewise: bool
    """Integer parameters are sent byte by byte in place of the float (see `parameters.value_of`)."""
    hold_parameter: str
    """Says for how long (s) the last setpoint is followed when no more come."""
    audit: Callable[[Values, Terms], tuple[Finding, ...]]
    """Each parameter that was read, judged."""
    settings: Callable[[Values], VehicleSettings]
    """What the parameters say."""
    position_flags: int
    """Flags of EKF_STATUS_REPORT and ESTIMATOR_STATUS, which have the same: any of them tells of a position."""
    telemetry: Mapping[int, float]
    """Rates (Hz) by message, of what is good to have in the log and for the words of a refusal."""
    first_item_is_home: bool = False
    """The item 0 of a stored mission is where it was planned from."""
    silent_when_free: bool = False
    """A ring of sectors is not sent while all of them are empty."""
    spools_on_ground: bool = False
    """While the vehicle says that it is on the ground, its motors don't follow the thrust yet."""
    own_loops: bool = False
    """Its rate loops are its own, whatever the vehicle's file says, and slow about the yaw axis."""
    reasons: str = ""
    """Where it tells why it refuses a command, to stand behind a sentence; empty where it tells the companion."""


class Judge:
    """Makes findings of values; what is not known is as bad as what is wrong."""

    def __init__(self, values: Values) -> None:
        self._values = values

    def __call__(
        self,
        parameter: str,
        wanted: str,
        why: str,
        is_right: Callable[[float], bool] = lambda value: True,
        otherwise: Safety = Safety.UNSAFE,
    ) -> Finding:
        """The finding on a parameter, which is safe if `is_right`."""
        value = self._values.get(parameter)
        safe = value is not None and is_right(value)
        return Finding(parameter, value, wanted, why, Safety.SAFE if safe else otherwise)


def first_known(question: Question, values: Values) -> str:
    """The name that a parameter was found under; the first of its names if it was not found."""
    return next((name for name in question if name in values), question[0])


def positive(value: float | None) -> float:
    """A size; infinite where 0 stands for none, or it is not known."""
    return math.inf if value is None or value <= 0.0 else value


def within(value: float | None, least: float, most: float) -> float | None:
    """The value if it is in a range; None for one that can't be true."""
    return value if value is not None and least <= value <= most else None
