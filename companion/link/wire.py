"""Messages <-> state types: the only place, with `wire_ranges`, where units, frames and enums are converted.

A message is accepted whole or not at all: one value that is not finite or out of range and it is
refused (`RefusedError`).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from companion.link.refusals import RefusedError, RefusedOdometryError
from companion.reports import SYSTEM_BATTERY, AttitudeReport, BatteryReading, OdometryReport, PositionReport
from companion.state import BatteryLevel
from protocol.arrays import Array
from protocol.frames import axes_frd, from_euler
from protocol.messages import dialect

_POSITION_LIMIT_M = 1e5
_VELOCITY_LIMIT = 150.0
_RATE_LIMIT = 40.0
_OF_VELOCITY = np.array(((0, 1, 2), (1, 6, 7), (2, 7, 11)))
"""Where the covariance of velocity lies in the upper triangle, row by row, of a matrix (6, 6)."""
_UNKNOWN_MV = 65535
_HIGHEST_CELL_V = 5.0
_CHARGE_STATES = {
    dialect.MAV_BATTERY_CHARGE_STATE_LOW: (BatteryLevel.WARN, "low"),
    dialect.MAV_BATTERY_CHARGE_STATE_CRITICAL: (BatteryLevel.RETURN, "critical"),
    dialect.MAV_BATTERY_CHARGE_STATE_EMERGENCY: (BatteryLevel.LAND, "almost empty"),
    dialect.MAV_BATTERY_CHARGE_STATE_FAILED: (BatteryLevel.LAND, "failed"),
    dialect.MAV_BATTERY_CHARGE_STATE_UNHEALTHY: (BatteryLevel.RETURN, "unhealthy"),
}
_GRAVE_FAULTS = (
    dialect.MAV_BATTERY_FAULT_DEEP_DISCHARGE
    | dialect.MAV_BATTERY_FAULT_CELL_FAIL
    | dialect.MAV_BATTERY_FAULT_OVER_TEMPERATURE
)
_FAULTS = {
    bit: entry.name.removeprefix("MAV_").removeprefix("BATTERY_FAULT_").lower().replace("_", " ")
    for bit, entry in dialect.enums["MAV_BATTERY_FAULT"].items()
    if bit.bit_count() == 1
}


def _vector(name: str, limit: float, x: float, y: float, z: float) -> Array:
    # One comparison a value: false for NaN and infinities too.
    if not (-limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit):
        raise RefusedError(f"{name} is not finite or beyond {limit:g}: {x:g}, {y:g}, {z:g}")
    return np.array((x, y, z))


def _quaternion(name: str, w: float, x: float, y: float, z: float) -> Array:
    square = w * w + x * x + y * y + z * z
    if not 0.98 < square < 1.02:
        raise RefusedError(f"{name}'s length is not 1: {w:g}, {x:g}, {y:g}, {z:g}")
    scale = 1.0 / math.sqrt(square)
    return np.array((w * scale, x * scale, y * scale, z * scale))


def attitude_quaternion(message: Any, time_ns: int = 0) -> AttitudeReport:
    """ATTITUDE_QUATERNION (31). The time of arrival is not used: every handler of the link takes it."""
    attitude = _quaternion("ATTITUDE_QUATERNION", message.q1, message.q2, message.q3, message.q4)
    rates = _vector("ATTITUDE_QUATERNION's rates", _RATE_LIMIT, message.rollspeed, message.pitchspeed, message.yawspeed)
    return AttitudeReport(message.time_boot_ms, attitude, rates)


def attitude(message: Any) -> AttitudeReport:
    """ATTITUDE (30), for vehicles that send no quaternion."""
    angles = _vector("ATTITUDE's angles", 7.0, message.roll, message.pitch, message.yaw)
    rates = _vector("ATTITUDE's rates", _RATE_LIMIT, message.rollspeed, message.pitchspeed, message.yawspeed)
    return AttitudeReport(message.time_boot_ms, from_euler(angles[0], angles[1], angles[2]), rates)


def local_position(message: Any, time_ns: int = 0) -> PositionReport:
    """LOCAL_POSITION_NED (32). The time of arrival is not used."""
    return PositionReport(
        message.time_boot_ms,
        _vector("LOCAL_POSITION_NED's position", _POSITION_LIMIT_M, message.x, message.y, message.z),
        _vector("LOCAL_POSITION_NED's velocity", _VELOCITY_LIMIT, message.vx, message.vy, message.vz),
    )


def odometry(message: Any, time_ns: int = 0) -> OdometryReport | None:
    """ODOMETRY (331) of the autopilot's own estimate, whose variances and count of resets alone are read. None of that
    of another one, and if it has failed. The time of arrival is not used.

    The velocity is in the frame of the body or of the world. What is not known is not a number, as PX4's covariances
    beside its variances, or all zero. Of the horizontal axes the less certain one counts for both.
    """
    if message.estimator_type != dialect.MAV_ESTIMATOR_TYPE_AUTOPILOT or message.quality < 0:
        return None
    covariance, variance = np.array(message.velocity_covariance)[_OF_VELOCITY], None
    if covariance.any() and not np.isnan(covariance.diagonal()).any():
        covariance[np.isnan(covariance)] = 0.0
        axes = np.eye(3)
        if message.child_frame_id == dialect.MAV_FRAME_BODY_FRD:
            axes = _axes_frd(message.q)
        elif message.child_frame_id != dialect.MAV_FRAME_LOCAL_NED:
            raise RefusedOdometryError(f"ODOMETRY with a velocity in frame {message.child_frame_id}")
        if np.abs(covariance).max() > _VELOCITY_LIMIT**2:
            raise RefusedOdometryError(f"ODOMETRY with velocity variances {covariance.diagonal()}")
        north, east, down = (float(axis @ covariance @ axis) for axis in axes)
        if min(north, east, down) < 0.0:
            raise RefusedOdometryError(f"ODOMETRY with velocity variances {north:g}, {east:g}, {down:g}")
        variance = np.array((max(north, east),) * 2 + (down,))
    return OdometryReport(variance, message.reset_counter)


def _axes_frd(q: Sequence[float]) -> Array:
    """(3, 3): north, east and down in the body's frame, a row each."""
    try:
        attitude = _quaternion("ODOMETRY", *q)
    except RefusedError as refused:
        raise RefusedOdometryError(str(refused)) from None
    return axes_frd(attitude)


def home_position(message: Any) -> Array:
    """HOME_POSITION (242): (3,) m, NED, in the frame of LOCAL_POSITION_NED."""
    return _vector("HOME_POSITION's position", _POSITION_LIMIT_M, message.x, message.y, message.z)


def battery_status(message: Any, time_ns: int) -> BatteryReading | None:
    """BATTERY_STATUS (147): mV -> V, % -> 1. None of a battery of the payload's own.

    A vehicle that does not know its cells gives the voltage of the whole battery as that of the first, and of the
    second what is above 65.5 V. A battery of 0 V is not there, whatever its charge is said to be.
    """
    if message.battery_function == dialect.MAV_BATTERY_FUNCTION_PAYLOAD:
        return None
    cells = [each * 1e-3 for each in message.voltages if each != _UNKNOWN_MV]
    cells += [each * 1e-3 for each in message.voltages_ext if 0 < each != _UNKNOWN_MV]
    volts = sum(cells) if cells else None
    level, words = _CHARGE_STATES.get(message.charge_state, (BatteryLevel.FINE, ""))
    faults = message.fault_bitmask
    if faults:
        level = max(level, BatteryLevel.RETURN if faults & _GRAVE_FAULTS else BatteryLevel.WARN)
        words = ", ".join([words] * bool(words) + [name for bit, name in _FAULTS.items() if faults & bit])
    return BatteryReading(
        message.id,
        time_ns,
        None if volts == 0.0 else _charge(message.battery_remaining),
        volts or None,
        min(cells) if len(cells) > 1 and 0.0 < max(cells) < _HIGHEST_CELL_V else None,
        level,
        words or ("fault" if faults else ""),
    )


def system_battery(message: Any, time_ns: int) -> BatteryReading:
    """What SYS_STATUS (1) says of the battery: mV -> V, % -> 1."""
    bit = dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    used = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled & bit
    ill = bool(used & ~message.onboard_control_sensors_health)
    volts = None if message.voltage_battery == _UNKNOWN_MV else message.voltage_battery * 1e-3
    return BatteryReading(
        SYSTEM_BATTERY,
        time_ns,
        None if volts == 0.0 else _charge(message.battery_remaining),
        volts or None,
        None,
        BatteryLevel.WARN if ill else BatteryLevel.FINE,
        "unhealthy" if ill else "",
    )


def _charge(percent: int) -> float | None:
    """-1: the vehicle does not estimate it."""
    return percent * 0.01 if 0 <= percent <= 100 else None


def statustext_fields(severity: int, text: str) -> list[tuple[int, bytes, int, int]]:
    """STATUSTEXT's fields, cut to its 50 bytes (the whole sentence is in the log)."""
    return [(severity, text.encode("ascii", "replace")[:50], 0, 0)]
