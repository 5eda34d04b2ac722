"""Which topics of a log are what their names say. A log of another tool may have anything under a name of ours, and a
reader takes the fields of a name that it knows."""

from functools import cache, lru_cache
from typing import NamedTuple

from companion.records import LEGACY_REQUEST, LOGGED, LOOP, OPERATION, PLANNED, TICK, TRACE
from protocol.flightlog import DATAGRAM, TEXT, RecordType
from protocol.flightlog.record_types import Field

_Fields = frozenset[Field]

_MAVLINK = "/mavlink/"
_NUMBERS = 2
"""A message's topic has that of its system and that of its component before its name."""
_MOTION = "uint32 time_boot_ms; float32 rollspeed pitchspeed yawspeed"
_TARGET = "float32[4] q; uint8 type_mask; float32 body_roll_rate body_pitch_rate body_yaw_rate thrust"
_IMU = "int16 xacc yacc zacc xgyro ygyro zgyro | int16 temperature"
_MESSAGES = {
    "ATTITUDE": f"{_MOTION}; float32 roll pitch yaw",
    "ATTITUDE_QUATERNION": f"{_MOTION}; float32 q1 q2 q3 q4",
    "ATTITUDE_TARGET": _TARGET,
    "BATTERY_STATUS": "uint8 id; uint16[10] voltages; int16 current_battery temperature; int8 battery_remaining"
    " | uint16[4] voltages_ext",
    "DISTANCE_SENSOR": "uint32 time_boot_ms; uint16 min_distance max_distance current_distance; uint8 id orientation;"
    " float32 horizontal_fov; uint8 signal_quality",
    "EKF_STATUS_REPORT": "float32 velocity_variance pos_horiz_variance pos_vert_variance compass_variance;"
    " uint16 flags",
    "ESTIMATOR_STATUS": "float32 vel_ratio pos_horiz_ratio pos_vert_ratio mag_ratio hagl_ratio; uint16 flags",
    "GLOBAL_POSITION_INT": "int32 lat lon alt relative_alt; int16 vx vy vz",
    "GPS_RAW_INT": "uint8 satellites_visible fix_type; uint16 eph epv",
    "HEARTBEAT": "uint32 custom_mode; uint8 type autopilot base_mode system_status",
    "HIGHRES_IMU": "float32 xacc yacc zacc xgyro ygyro zgyro | float32 temperature",
    "LOCAL_POSITION_NED": "uint32 time_boot_ms; float32 x y z vx vy vz",
    "OBSTACLE_DISTANCE": "uint64 time_usec; uint16[72] distances; uint16 min_distance max_distance; uint8 increment;"
    " float32 increment_f angle_offset; uint8 frame",
    "PARAM_VALUE": "float32 param_value; string param_id; uint8 param_type",
    "POSITION_TARGET_LOCAL_NED": "uint16 type_mask; float32 x y z vx vy vz",
    "RADIO_STATUS": "uint8 rssi remrssi noise",
    "RAW_IMU": _IMU,
    "RC_CHANNELS": "uint16 chan1_raw chan2_raw chan3_raw chan4_raw chan5_raw chan6_raw chan7_raw chan8_raw; uint8 rssi",
    "SCALED_IMU": _IMU,
    "SCALED_PRESSURE": "int16 temperature",
    "SERVO_OUTPUT_RAW": "uint16 servo1_raw servo2_raw servo3_raw servo4_raw servo5_raw servo6_raw servo7_raw"
    " servo8_raw",
    "SET_ACTUATOR_CONTROL_TARGET": "uint8 target_system; float32[8] controls",
    "SET_ATTITUDE_TARGET": f"uint8 target_system; {_TARGET}",
    "SET_POSITION_TARGET_LOCAL_NED": "uint8 target_system",
    "STATUSTEXT": "uint8 severity; string text; uint16 id; uint8 chunk_seq",
    "SYS_STATUS": "uint16 voltage_battery load; int16 current_battery; int8 battery_remaining",
    "VFR_HUD": "float32 airspeed groundspeed climb; uint16 throttle",
    "VIBRATION": "float32 vibration_x vibration_y vibration_z; uint32 clipping_0 clipping_1 clipping_2",
}
"""The fields that readers take from a message; behind a bar those that some logs lack."""
_GUARD = frozenset({"guard_reason", "guard_change"})
"""What logs from before the guard lack."""
_STEP = (
    "state phase blocked limited position_ned velocity_ned attitude_ned_frd rates_frd reference_position_ned"
    " reference_velocity_ned reference_yaw target_ned lyapunov acceleration_command_ned attitude_command_ned_frd"
    " rates_command_frd torque_command thrust_command position_age speed_limit clearance"
)
"""What readers take from a step of any trace."""
_EXACT = {kind.topic: kind.fields for kind in (DATAGRAM, TICK, PLANNED, OPERATION, LEGACY_REQUEST)}
"""These never had other fields."""


class _Form(NamedTuple):
    """What a topic's records may be."""

    needed: _Fields
    others: _Fields = frozenset()
    """It has them as they are here, or none of that name."""
    without: frozenset[str] = frozenset()
    """It has no field of these names."""

    def fits(self, kind: RecordType) -> bool:
        """Whether a topic's records are of this form; they may have more fields, of other names."""
        known = self.needed | self.others
        names = self.without.union(field.name for field in known)
        told = {field for field in kind.fields if field.name in names}
        varies = any(field.is_variable for field in self.needed)
        return self.needed <= told <= known and (kind.size is None) is varies


@lru_cache(maxsize=1024)  # a page asks for each batch
def is_foreign(kind: RecordType) -> bool:
    """Whether a topic has a name that is known, and not the fields that are taken from what is called so."""
    topic = kind.topic
    if topic in _EXACT:
        return kind.fields != _EXACT[topic]
    if not topic.startswith(_MAVLINK):
        forms = _own_forms().get(topic, ())
        return bool(forms) and not any(form.fits(kind) for form in forms)
    *numbers, name = topic.removeprefix(_MAVLINK).split("/")
    if name not in _MESSAGES:
        return False
    sound = len(numbers) == _NUMBERS and all(
        each.isascii() and each.isdecimal() and len(each) <= len("255") for each in numbers
    )
    return not (sound and _message_form(name).fits(kind))


@cache
def _message_form(name: str) -> _Form:
    needed, _, others = _MESSAGES[name].partition("|")
    return _Form(_fields(needed), _fields(others))


def _fields(text: str) -> _Fields:
    """Fields from a text: a type and the names of its fields, and after a semicolon the next."""
    words = (part.split() for part in text.split(";"))
    lines = (f"{kind} {name}" for kind, *names in filter(None, words) for name in names)
    return frozenset(RecordType("", "", "\n".join(lines)).fields)


@cache
def _own_forms() -> dict[str, tuple[_Form, ...]]:
    """Those of our topics that had several, or of which readers take a part."""
    traces, names = [], _STEP.split()
    for each in (LOGGED, TRACE):
        step = frozenset(field for field in each.fields if field.name in names)
        guard = frozenset(field for field in each.fields if field.name in _GUARD)
        others = frozenset(each.fields) - step - guard
        traces += [_Form(step | guard, others), _Form(step, others, without=_GUARD)]
    return {
        TRACE.topic: tuple(traces),
        LOOP.topic: (_Form(_fields("uint32[] latency_ns")), _Form(_fields("int64 latency_ns"))),
        TEXT.topic: (_Form(_fields("uint8 level; string message name")),),
    }
