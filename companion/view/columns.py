"""The quantities that are drawn of the companion's trace and of MAVLink messages, in SI units and degrees."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from companion.logs.recordings import FARTHEST_M
from companion.view.attitudes import euler_deg, tilt_deg
from companion.view.batches import Table
from companion.view.lines import Floats

Columns = dict[str, Floats]
"""Arrays (n,) or (n, k) by the name of their quantity."""

_NO_ATTITUDE, _NO_RATES, _NO_POSITION, _NO_VELOCITY = 0x80, 0x07, 0x07, 0x38
"""Bits of the setpoints' `type_mask` that say that a quantity is not used."""


_MILLI_G = 9.80665e-3
"""m/s2"""


def stacked(table: Table, *names: str) -> Floats:
    """(n, len(names)): fields of a table side by side."""
    return np.column_stack([table[name].astype(np.float64) for name in names])


def trace_columns(table: Table) -> Columns:
    """The quantities of n records of the companion's trace, whole (TRACE) or thinned (LOGGED)."""
    names = table.dtype.names or ()
    euler = euler_deg(table["attitude_ned_frd"])
    columns = {
        name: table[name]
        for name in ("position_ned", "velocity_ned", "reference_position_ned", "reference_velocity_ned", "lyapunov")
    }
    columns |= {
        "height": -table["position_ned"][:, 2],
        "reference_height": -table["reference_position_ned"][:, 2],
        "speed": np.linalg.norm(table["velocity_ned"], axis=1),
        "reference_speed": np.linalg.norm(table["reference_velocity_ned"], axis=1),
        "error_cm": 100.0 * largest_error(table),
        # A thinned trace has the largest value of the steps that it stands for, a whole one each step's own.
        "worst_torque": table["worst_torque" if "worst_torque" in names else "torque_command"],
        "worst_thrust": table["worst_thrust" if "worst_thrust" in names else "thrust_command"],
        "euler_deg": euler,
        "tilt_deg": tilt_deg(euler),
        "euler_command_deg": euler_deg(table["attitude_command_ned_frd"]),
        "rates_deg": np.degrees(table["rates_frd"]),
        "rates_command_deg": np.degrees(table["rates_command_frd"]),
        "torque_command": table["torque_command"],
        "thrust_command": table["thrust_command"],
        "age_ms": table["position_age"] * 1e3,
        "clearance": table["clearance"],
        "speed_limit": table["speed_limit"],
    }
    for name in names:
        if name.startswith(("guard_", "disturbance", "wind")) and table.dtype[name].base.kind == "f":
            columns[name] = table[name]
    return columns


def largest_error(table: Table) -> Floats:
    """(n,) distance from the reference (m), the largest since the record before."""
    if "worst_error" in (table.dtype.names or ()):
        worst: Floats = table["worst_error"]
        return worst
    size: Floats = np.linalg.norm(table["position_ned"] - table["reference_position_ned"], axis=1)
    return size


def message_columns(name: str, table: Table) -> Columns:
    """The quantities of n messages of that name; empty for a message of which nothing is drawn."""
    known = _MESSAGES.get(name)
    return known(table) if known else {}


def latencies(times: Floats, table: Any) -> tuple[Floats, Floats]:
    """When commands left (s) and their latencies (us), (m,) each, from n records of LOOP at `times`.

    The latencies of one record are spread evenly over the time since the record before.
    """
    if not isinstance(table, list):  # an older log: one latency in each record
        return times, table["latency_ns"] * 1e-3
    counts = np.array([len(row["latency_ns"]) for row in table])
    since = np.diff(times, prepend=times[0] - 0.1).clip(max=0.1)
    late = [(np.arange(count) + 1 - count) / max(count, 1) for count in counts]
    when = np.repeat(times, counts) + np.hstack(late) * np.repeat(since, counts)
    return when, np.hstack([row["latency_ns"] for row in table]) * 1e-3


def _rates_deg(table: Table) -> Floats:
    return np.degrees(stacked(table, "rollspeed", "pitchspeed", "yawspeed"))


def _attitude(table: Table) -> Columns:
    euler = np.degrees(stacked(table, "roll", "pitch", "yaw"))
    return {"euler_deg": euler, "tilt_deg": tilt_deg(euler), "rates_deg": _rates_deg(table)}


def _attitude_quaternion(table: Table) -> Columns:
    euler = euler_deg(stacked(table, "q1", "q2", "q3", "q4"))
    return {"euler_deg": euler, "tilt_deg": tilt_deg(euler), "rates_deg": _rates_deg(table)}


def _attitude_target(table: Table) -> Columns:
    rates = stacked(table, "body_roll_rate", "body_pitch_rate", "body_yaw_rate")
    mask = table["type_mask"]
    attitude = np.where(((mask & _NO_ATTITUDE) != 0)[:, None], np.nan, euler_deg(table["q"]))
    return {
        "euler_deg": attitude,
        "rates_deg": np.where(((mask & _NO_RATES) != 0)[:, None], np.nan, np.degrees(rates)),
        "thrust": table["thrust"].astype(np.float64),
    }


def _local_position(table: Table) -> Columns:
    motion = stacked(table, "x", "y", "z", "vx", "vy", "vz")
    motion = np.where(abs(motion) <= FARTHEST_M, motion, np.nan)
    position, velocity = motion[:, :3], motion[:, 3:]
    return {
        "position_ned": position,
        "height": -position[:, 2],
        "velocity_ned": velocity,
        "speed": np.linalg.norm(velocity, axis=1),
    }


def _global_position(table: Table) -> Columns:
    velocity = stacked(table, "vx", "vy", "vz") * 0.01
    return {
        "height": table["relative_alt"] * 1e-3,
        "velocity_ned": velocity,
        "speed": np.linalg.norm(velocity, axis=1),
    }


def _battery(table: Table) -> Columns:
    cells = [table[name] for name in ("voltages", "voltages_ext") if name in (table.dtype.names or ())]
    volts = sum(np.where(each == 65535, 0, each).sum(axis=1) for each in cells) * 1e-3
    return {
        "volts": np.where(volts > 0.0, volts, np.nan),
        "amperes": np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 0.01),
        "remaining": np.where(table["battery_remaining"] < 0, np.nan, table["battery_remaining"]).astype(np.float64),
        "temperature": np.where(table["temperature"] == 32767, np.nan, table["temperature"] * 0.01),
    }


def _system(table: Table) -> Columns:
    volts = table["voltage_battery"]
    remaining = table["battery_remaining"]
    return {
        "volts": np.where((volts == 65535) | (volts == 0), np.nan, volts * 1e-3),
        "amperes": np.where(table["current_battery"] < 0, np.nan, table["current_battery"] * 0.01),
        "remaining": np.where(remaining < 0, np.nan, remaining).astype(np.float64),
        "load": table["load"] * 0.1,
    }


def _servos(table: Table) -> Columns:
    outputs = stacked(table, *(f"servo{number}_raw" for number in range(1, 9)))
    return {"outputs": np.where(outputs == 0.0, np.nan, outputs)}


def _position_target(table: Table) -> Columns:
    mask = table["type_mask"]
    position = np.where(((mask & _NO_POSITION) != 0)[:, None], np.nan, stacked(table, "x", "y", "z"))
    velocity = np.where(((mask & _NO_VELOCITY) != 0)[:, None], np.nan, stacked(table, "vx", "vy", "vz"))
    return {"position_ned": position, "height": -position[:, 2], "velocity_ned": velocity}


def _satellites(table: Table) -> Columns:
    return {
        "satellites": np.where(table["satellites_visible"] == 255, np.nan, table["satellites_visible"]),
        "fix": table["fix_type"].astype(np.float64),
        "hdop": np.where(table["eph"] == 65535, np.nan, table["eph"] * 0.01),
        "vdop": np.where(table["epv"] == 65535, np.nan, table["epv"] * 0.01),
    }


def _vibration(table: Table) -> Columns:
    clips = stacked(table, "clipping_0", "clipping_1", "clipping_2").sum(axis=1)
    return {"vibration": stacked(table, "vibration_x", "vibration_y", "vibration_z"), "clips": clips}


def _centidegrees(name: str, unknown: int) -> Callable[[Table], Columns]:
    return lambda table: {"temperature": np.where(table[name] == unknown, np.nan, table[name] * 0.01)}


def _imu(acceleration: float, rate: float) -> Callable[[Table], Columns]:
    """`acceleration` and `rate`: what one unit of the message is in m/s2 and deg/s."""
    return lambda table: {
        "acceleration": acceleration * stacked(table, "xacc", "yacc", "zacc"),
        "gyro_deg": rate * stacked(table, "xgyro", "ygyro", "zgyro"),
        "temperature": _imu_temperature(table),
    }


def _imu_temperature(table: Table) -> Floats:
    """°C; HIGHRES_IMU has it as a float, the others in hundredths, where 0 is unknown."""
    if "temperature" not in (table.dtype.names or ()):
        return np.full(len(table), np.nan)
    told: Floats = table["temperature"]
    known = told if told.dtype.kind == "f" else told * 0.01
    return np.where(told == 0, np.nan, known)


def _channels(table: Table) -> Columns:
    pulses = stacked(table, *(f"chan{number}_raw" for number in range(1, 9)))
    strength = table["rssi"]
    return {
        "pulses": np.where((pulses == 0.0) | (pulses == 65535.0), np.nan, pulses),
        "strength": np.where(strength == 255, np.nan, strength / 2.54),
    }


def _fields(*names: str) -> Callable[[Table], Columns]:
    return lambda table: {name: table[name].astype(np.float64) for name in names}


_MESSAGES: dict[str, Callable[[Table], Columns]] = {
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "ATTITUDE_TARGET": _attitude_target,
    "SET_ATTITUDE_TARGET": _attitude_target,
    "LOCAL_POSITION_NED": _local_position,
    "GLOBAL_POSITION_INT": _global_position,
    "POSITION_TARGET_LOCAL_NED": _position_target,
    "VFR_HUD": _fields("airspeed", "groundspeed", "throttle", "climb"),
    "SERVO_OUTPUT_RAW": _servos,
    "BATTERY_STATUS": _battery,
    "SYS_STATUS": _system,
    "GPS_RAW_INT": _satellites,
    "VIBRATION": _vibration,
    "HIGHRES_IMU": _imu(1.0, math.degrees(1.0)),
    "RAW_IMU": _imu(_MILLI_G, math.degrees(1e-3)),
    "SCALED_IMU": _imu(_MILLI_G, math.degrees(1e-3)),
    "SCALED_PRESSURE": _centidegrees("temperature", 0),
    "RC_CHANNELS": _channels,
    "EKF_STATUS_REPORT": _fields(
        "velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "flags"
    ),
    "ESTIMATOR_STATUS": _fields("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio", "hagl_ratio", "flags"),
    "RADIO_STATUS": _fields("rssi", "remrssi", "noise"),
}
