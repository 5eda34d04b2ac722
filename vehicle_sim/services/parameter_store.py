"""The values of the parameters, and what obeys them."""

import math
import struct
from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import NamedTuple

import msgspec

from protocol.messages import HIGHEST_FLOAT, dialect
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Trigger
from vehicle_sim.autopilot.settings import SECOND_NS
from vehicle_sim.services.checksum import crc32
from vehicle_sim.services.identity import COMPONENT
from vehicle_sim.services.parameter_table import TABLE

Value = float | int

_NO_TRANSMITTER_NEEDED = 7
_VOLATILE = frozenset({"COM_FLIGHT_UUID"})
"""Changes by itself, and does not count for the hash."""
_INT32, _FLOAT32 = (-(2.0**31), 2.0**31 - 1.0), (-HIGHEST_FLOAT, HIGHEST_FLOAT)
"""What PARAM_VALUE has room for, at the least and at the most."""
_LOSSES = ("COM_DL_LOSS_T", "COM_OBC_LOSS_T", "COM_OF_LOSS_T", "COM_RC_LOSS_T")


class Refusal(IntEnum):
    """MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    READ_ONLY = 5
    TYPE_MISMATCH = 7


class Bound(NamedTuple):
    """What obeys a parameter."""

    read: Callable[[FlightControl], Value]
    write: Callable[[FlightControl, Value], None]
    choices: tuple[int, ...] = ()
    """The values that can be obeyed; none: all within the limits."""


def _seconds(field: str, kind: type[float] | type[int] = float) -> Bound:
    """A time in nanoseconds."""
    return Bound(
        lambda flight: kind(getattr(flight.settings, field) / SECOND_NS),
        lambda flight, value: setattr(flight.settings, field, round(value * SECOND_NS)),
    )


def _number(field: str) -> Bound:
    """A value as it is."""
    return Bound(
        lambda flight: float(getattr(flight.settings, field)),
        lambda flight, value: setattr(flight.settings, field, float(value)),
    )


def _action(field: str, triggers: Mapping[int, Trigger | None]) -> Bound:
    """What a failsafe does."""
    numbers = {trigger: number for number, trigger in reversed(list(triggers.items()))}
    return Bound(
        lambda flight: numbers[getattr(flight.settings, field)],
        lambda flight, value: setattr(flight.settings, field, triggers[int(value)]),
        tuple(triggers),
    )


def _of(table: str, field: str, kind: type[float] | type[int] = float) -> Bound:
    """A field of one of the settings' tables."""

    def write(flight: FlightControl, value: Value) -> None:
        changed = msgspec.structs.replace(getattr(flight.settings, table), **{field: kind(value)})
        setattr(flight.settings, table, changed)

    return Bound(lambda flight: kind(getattr(getattr(flight.settings, table), field)), write)


def _field(field: str) -> Bound:
    """A field of the settings that has the parameter's own type."""
    return Bound(
        lambda flight: getattr(flight.settings, field), lambda flight, value: setattr(flight.settings, field, value)
    )


OBEYED: dict[str, Bound] = {
    "BAT_CRIT_THR": _of("battery", "critical"),
    "BAT_EMERGEN_THR": _of("battery", "emergency"),
    "BAT_LOW_THR": _of("battery", "low"),
    "CBRK_FLIGHTTERM": _field("circuit_breaker"),
    "COM_DISARM_LAND": _seconds("disarm_landed_ns"),
    "COM_DISARM_PRFLT": _seconds("disarm_preflight_ns"),
    "COM_DL_LOSS_T": _seconds("link_loss_ns", int),
    "COM_FAIL_ACT_T": _seconds("failsafe_hold_ns"),
    "COM_LOW_BAT_ACT": _of("battery", "action", int),
    "COM_OBL_RC_ACT": _action("stream_loss", {3: Trigger.STILL_LOST_RETURN, 4: Trigger.STILL_LOST, 5: None}),
    "COM_OF_LOSS_T": _seconds("stream_loss_ns"),
    "COM_RC_LOSS_T": _seconds("stick_loss_ns"),
    "FD_FAIL_P": _field("pitch_failure_deg"),
    "FD_FAIL_R": _field("roll_failure_deg"),
    "GF_ACTION": _action(
        "fence_breach",
        {
            0: None,
            2: Trigger.FENCE_BREACHED,
            3: Trigger.FENCE_BREACHED_RETURN,
            4: Trigger.FENCE_BREACHED_TERMINATE,
            5: Trigger.FENCE_BREACHED_LAND,
        },
    ),
    "GF_MAX_HOR_DIST": _of("fence", "radius_m"),
    "GF_MAX_VER_DIST": _of("fence", "max_height_m"),
    "MIS_TAKEOFF_ALT": _of("auto", "takeoff_height_m"),
    "MPC_LAND_SPEED": _of("auto", "land_speed_m_s"),
    "MPC_MANTHR_MIN": _number("least_thrust"),
    "MPC_MAN_TILT_MAX": _number("stick_tilt_deg"),
    "MPC_MAN_Y_MAX": _number("stick_yaw_rate_deg_s"),
    "MPC_TKO_SPEED": _of("auto", "climb_speed_m_s"),
    "MPC_XY_CRUISE": _of("auto", "cruise_speed_m_s"),
    "MPC_XY_VEL_MAX": _number("max_speed_m_s"),
    "MPC_YAWRAUTO_MAX": _number("yaw_rate_deg_s"),
    "MPC_Z_VEL_MAX_DN": _number("max_sink_m_s"),
    "MPC_Z_VEL_MAX_UP": _number("max_climb_m_s"),
    "MPC_Z_V_AUTO_DN": _of("auto", "descent_speed_m_s"),
    "NAV_ACC_RAD": _number("acceptance_m"),
    "NAV_DLL_ACT": _action("link_loss", {0: None, 2: Trigger.LINK_LOST_RETURN, 3: Trigger.LINK_LOST}),
    "NAV_MC_ALT_RAD": _number("height_acceptance_m"),
    "RTL_RETURN_ALT": _of("auto", "return_height_m"),
    "SYS_FAILURE_EN": _field("failures_allowed"),
}


def _told(value: Value) -> Value:
    """A value as PARAM_VALUE and PARAM_SET have it: what is no integer as a float of 32 bits."""
    if isinstance(value, int) or not abs(value) <= HIGHEST_FLOAT:
        return value
    told: float = struct.unpack("<f", struct.pack("<f", value))[0]
    return told


def _facts(airframe: Airframe) -> dict[str, Value]:
    """What is so about this vehicle, and can't be changed."""
    return {
        "COM_RCL_EXCEPT": _NO_TRANSMITTER_NEEDED,
        "MPC_THR_HOVER": airframe.body.hover_thrust,
        "MPC_TILTMAX_AIR": math.degrees(math.atan(airframe.auto.acceleration_limit_m_s2 / GRAVITY)),
    }


class Parameters:
    """All parameters of a vehicle. What a parameter of `OBEYED` says is read from and written to the autopilot."""

    def __init__(self, airframe: Airframe, flight: FlightControl, system: int) -> None:
        self._flight = flight
        self._facts = _facts(airframe) | {"MAV_SYS_ID": system}
        self._kept: dict[str, Value] = {name: entry.default for name, entry in TABLE.items()}
        self._kept |= self._facts
        self._first = {name: self[name] for name in TABLE}
        self._pace = 1.0
        self._real: dict[str, tuple[Value, Value]] = {}
        """What the times that are scaled were before and after that."""
        self.names = list(TABLE)
        """In the order of their indices."""
        self.on_change: Callable[[], None] = lambda: None
        """Called after each change."""

    def __getitem__(self, name: str) -> Value:
        bound = OBEYED.get(name)
        return self._kept[name] if bound is None else bound.read(self._flight)

    def __contains__(self, name: str) -> bool:
        return name in self._kept

    def is_integer(self, name: str) -> bool:
        return TABLE[name].is_integer

    def is_fact(self, name: str) -> bool:
        """It says what the vehicle is, and can't be changed."""
        return name in self._facts

    def parse(self, name: str, text: str) -> Value:
        """What a text says, whole for an integer parameter. Raises ValueError and OverflowError."""
        value = float(text)
        whole = name in self and self.is_integer(name) and value == int(value)
        return int(value) if whole else value

    def set(self, name: str, value: Value) -> Refusal | None:
        """Change a value (int for an integer parameter), or say why not.

        Unlike PX4, which takes any number, it refuses what is outside the limits or could not be obeyed.
        """
        entry = TABLE.get(name)
        if entry is None:
            return Refusal.DOES_NOT_EXIST
        if isinstance(value, int) is not entry.is_integer:
            return Refusal.TYPE_MISMATCH
        told = _told(value)
        if name in self._facts:
            return None if told == _told(self[name]) else Refusal.READ_ONLY
        bound = OBEYED.get(name)
        lowest, highest = _INT32 if entry.is_integer else _FLOAT32
        least = lowest if entry.least is None else entry.least
        most = highest if entry.most is None else entry.most
        if not entry.is_integer:
            least, most = _told(least), _told(most)
        if not least <= told <= most:  # NaN neither
            return Refusal.VALUE_OUT_OF_RANGE
        if bound is not None and bound.choices and value not in bound.choices:
            return Refusal.VALUE_OUT_OF_RANGE
        self._write(name, value)
        self.on_change()
        return None

    def _write(self, name: str, value: Value) -> None:
        bound = OBEYED.get(name)
        if bound is None:
            self._kept[name] = value
        else:
            bound.write(self._flight, value)

    def reset(self) -> list[str]:
        """All of them as they were at first, at this pace, beyond the limits, too; the names of those that change."""
        changed = [name for name, value in self._first.items() if self[name] != value]
        for name in changed:
            self._write(name, self._first[name])
        self.on_change()
        return changed

    def scale_losses(self, factor: float) -> None:
        """Let the times after which a peer counts as lost pass as fast as at real time, as PX4's start in SITL does."""
        self._pace = factor
        for name in _LOSSES:
            real = self[name]
            self._first[name] = _scaled(name, self._first[name], factor)
            self.set(name, _scaled(name, real, factor))
            self._real[name] = real, self[name]

    def at_real_time(self, name: str) -> Value:
        """The value that `scale_losses` makes this one of; of a parameter that it leaves alone the value itself."""
        value = self[name]
        real, scaled = self._real.get(name, (value, value))
        return real if value == scaled else _scaled(name, value, 1.0 / self._pace)

    def packed(self, name: str) -> bytes:
        """The four bytes of a value, as PARAM_VALUE and PX4's hash have them."""
        return struct.pack("<i" if self.is_integer(name) else "<f", self[name])

    def checksum(self) -> bytes:
        """`_HASH_CHECK` as PX4 computes it, over all names and values."""
        return crc32(b"".join(name.encode() + self.packed(name) for name in self.names if name not in _VOLATILE))


def _scaled(name: str, value: Value, factor: float) -> Value:
    """A time at another pace, within its limits."""
    entry = TABLE[name]
    time = min(max(value * factor, entry.least or 0.0), entry.most or math.inf)
    return round(time) if entry.is_integer else time


def text_of(parameters: Parameters, *, at_real_time: bool = False) -> str:
    """All of them as a file of QGroundControl's form, with the values of now or with those that a start takes."""
    value_of = parameters.at_real_time if at_real_time else parameters.__getitem__
    lines = ["# Vehicle-Id Component-Id Name Value Type"]
    for name in parameters.names:
        kind = dialect.MAV_PARAM_TYPE_INT32 if parameters.is_integer(name) else dialect.MAV_PARAM_TYPE_REAL32
        lines.append(f"{parameters['MAV_SYS_ID']}\t{COMPONENT}\t{name}\t{value_of(name)!r}\t{kind}")
    return "\n".join(lines) + "\n"
