"""ArduPilot's copters. In GUIDED they take off by themselves once an armed vehicle on the ground gets a setpoint with
thrust, so NAV_TAKEOFF is not needed."""

import math

from companion.link.firmware.firmware import COPTERS, Firmware, Judge, Terms, Values, first_known, positive, within
from companion.reports import Finding, VehicleSettings
from companion.state import NO_FENCE, FlightMode, Output, OwnFence, Safety
from protocol.messages import dialect

_MODES = {
    0: FlightMode.MANUAL,
    2: FlightMode.MANUAL,
    3: FlightMode.MISSION,
    4: FlightMode.EXTERNAL,
    1: FlightMode.MANUAL,
    5: FlightMode.MANUAL,  # LOITER obeys the sticks
    16: FlightMode.MANUAL,
    21: FlightMode.RETURN,
    27: FlightMode.RETURN,
    6: FlightMode.RETURN,
    9: FlightMode.LAND,
    17: FlightMode.HOLD,
    20: FlightMode.EXTERNAL,
}
_COMMANDS = {FlightMode.EXTERNAL: 4, FlightMode.HOLD: 17, FlightMode.RETURN: 6, FlightMode.LAND: 9}

_HOLD_LIMIT_S = 1.0
_THRUST_AS_THRUST = 8
"""Bit 3 of GUID_OPTIONS."""
_GCS_SYSTEM = ("MAV_GCS_SYSID", "SYSID_MYGCS")
_ANGLE_MAX = ("ATC_ANGLE_MAX", "ANGLE_MAX")
"""Since 4.7, in deg; before, in 0.01 deg."""
_FENCE_UP = ("FENCE_ENABLE", "FENCE_AUTOENABLE")
"""The second puts the fence up at the arming or the take-off."""
_HIGHEST, _CIRCLE, _POLYGONS, _LOWEST = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_FENCE_SIZES = {"FENCE_ALT_MAX": _HIGHEST, "FENCE_RADIUS": _CIRCLE, "FENCE_ALT_MIN": _LOWEST}


def _mode_of(custom_mode: int) -> FlightMode:
    return _MODES.get(custom_mode, FlightMode.OTHER)


def _mode_command(mode: FlightMode) -> tuple[float, float, float]:
    return float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(_COMMANDS[mode]), 0.0


def _refusal(output: Output, version: int) -> str | None:
    if output is not Output.ACTUATORS:
        return None
    return "ArduPilot has never followed SET_ACTUATOR_CONTROL_TARGET: use --output attitude or rates"


def _audit(values: Values, terms: Terms) -> tuple[Finding, ...]:
    """Sources: ArduPilot's parameter reference and the source of its guided mode (4.7), and flights in which the
    companion was stopped."""
    judge, gcs, angle = Judge(values), first_known(_GCS_SYSTEM, values), first_known(_ANGLE_MAX, values)
    watches = values.get("FS_GCS_ENABLE", 0.0) > 0.0
    return (
        judge(
            "GUID_OPTIONS",
            "bit 3 (8) set",
            "without it thrust is taken as a climb rate",
            lambda value: bool(round(value) & _THRUST_AS_THRUST),
            Safety.REFUSED,
        ),
        judge(
            "GUID_TIMEOUT",
            f"at most {_HOLD_LIMIT_S:g} s",
            "s for which the last setpoint is followed when no more come; then the vehicle levels and drifts",
            lambda value: 0.0 < value <= _HOLD_LIMIT_S,
        ),
        judge(
            "FS_GCS_ENABLE",
            "5 (land), or another action",
            "0: nobody lands the vehicle when the companion is gone",
            lambda value: value > 0.0,
        ),
        judge(
            gcs,
            f"{terms.system}, the companion's system",
            "whose heartbeats FS_GCS_ENABLE watches; or set identity.system"
            if watches
            else "does nothing (FS_GCS_ENABLE)",
            lambda value: not watches or round(value) == terms.system,
        ),
        judge("ATC_ANGLE_BOOST", "", "1: the vehicle divides thrust by the cosine of its tilt, which is allowed for"),
        judge(
            angle,
            "",
            f"{'deg' if angle == _ANGLE_MAX[0] else '0.01 deg'}; limits the vehicle's own modes, not the companion's "
            "setpoints",
        ),
        judge("MOT_THST_HOVER", "", "the vehicle's own idea of its hover thrust"),
        *_audit_of_fence(values, judge),
    )


def _audit_of_fence(values: Values, judge: Judge) -> tuple[Finding, ...]:
    """Its sizes matter only while it is up. Older versions have no FENCE_AUTOENABLE."""
    switches = [judge(name, "", "with it the flight keeps within the vehicle's fence") for name in _FENCE_UP[:1]]
    switches += [judge(name, "", "puts the vehicle's fence up by itself") for name in _FENCE_UP[1:] if name in values]
    if not _is_up(values):
        return tuple(switches)
    kinds, polygons = int(values.get("FENCE_TYPE", 0.0)), values.get("FENCE_TOTAL", 1.0) > 0.0
    return (
        *switches,
        judge(
            "FENCE_TYPE",
            "without bit 2 (4), or no uploaded fence (FENCE_TOTAL 0)",
            "polygons and circles that were uploaded to the vehicle are not read",
            lambda value: not (polygons and kinds & _POLYGONS),
        ),
        *(judge(name, "", f"m, bit {bit} of FENCE_TYPE") for name, bit in _FENCE_SIZES.items() if kinds & bit),
        judge("FENCE_MARGIN", "", "m that the flight keeps inside, if geofence.margin is not more"),
    )


def _is_up(values: Values) -> bool:
    return any(values.get(name, 0.0) > 0.0 for name in _FENCE_UP)


def _fence(values: Values) -> OwnFence:
    if not _is_up(values):
        return NO_FENCE
    kinds = int(values.get("FENCE_TYPE", 0.0))
    return OwnFence(
        positive(values.get("FENCE_RADIUS")) if kinds & _CIRCLE else math.inf,
        positive(values.get("FENCE_ALT_MAX")) if kinds & _HIGHEST else math.inf,
        values.get("FENCE_ALT_MIN", -math.inf) if kinds & _LOWEST else -math.inf,
        max(values.get("FENCE_MARGIN", 0.0), 0.0),
    )


def _settings(values: Values) -> VehicleSettings:
    return VehicleSettings(
        setpoint_hold=within(values.get("GUID_TIMEOUT"), 0.0, 1e3),
        angle_boost=values.get("ATC_ANGLE_BOOST", 1.0) != 0.0,
        fence=_fence(values),
    )


FIRMWARE = Firmware(
    name="ArduPilot",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    kinds=COPTERS,  # planes, those that take off upright too, rovers and boats have other modes by the same numbers
    mode_of=_mode_of,
    mode_command=_mode_command,
    refusal=_refusal,
    parameters=(
        ("GUID_OPTIONS",),
        ("GUID_TIMEOUT",),
        ("FS_GCS_ENABLE",),
        _GCS_SYSTEM,
        ("ATC_ANGLE_BOOST",),
        _ANGLE_MAX,
        ("MOT_THST_HOVER",),
        *((name,) for name in (*_FENCE_UP, "FENCE_TYPE", "FENCE_TOTAL", *_FENCE_SIZES, "FENCE_MARGIN")),
    ),
    bytewise=False,
    hold_parameter="GUID_TIMEOUT",
    audit=_audit,
    settings=_settings,
    position_flags=dialect.EKF_POS_HORIZ_ABS,
    telemetry={dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: 2.0},
    first_item_is_home=True,
    silent_when_free=True,
    spools_on_ground=True,
    own_loops=True,
)
