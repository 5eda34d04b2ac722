"""Setpoints of a companion: SET_ATTITUDE_TARGET, SET_POSITION_TARGET_... and SET_ACTUATOR_CONTROL_TARGET; sticks."""

import math
from collections.abc import Callable
from typing import Any

from protocol.arrays import Quaternion
from protocol.frames import to_world
from protocol.messages import HIGHEST_FLOAT, dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Severity
from vehicle_sim.autopilot.sticks import Sticks
from vehicle_sim.autopilot.tracking import FREE, Axes, Target
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.places import ABOVE_HOME, ON_EARTH, Geodetic, horizontal

_ATTITUDE_IGNORE = dialect.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_RATES_IGNORE = (
    dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
_THRUST_IGNORE = dialect.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
_FORCE, _YAW_IGNORE, _YAW_RATE_IGNORE = (
    dialect.POSITION_TARGET_TYPEMASK_FORCE_SET,
    dialect.POSITION_TARGET_TYPEMASK_YAW_IGNORE,
    dialect.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
)
_POSITION_BIT, _VELOCITY_BIT, _ACCELERATION_BIT = 0, 3, 6
"""Bits of the type mask, those of the first axis."""


class SetpointService:
    """Hands setpoints and sticks to the autopilot. `origin` is the place of the local axes on earth."""

    def __init__(self, flight: FlightControl, identity: Identity, origin: Geodetic) -> None:
        self._flight = flight
        self._system = identity.system
        self._origin = origin
        self.capabilities: int = (
            dialect.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
            | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        )
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: self._set_attitude_target,
            dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._set_position_target_local_ned,
            dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_GLOBAL_INT: self._set_position_target_global_int,
            dialect.MAVLINK_MSG_ID_MANUAL_CONTROL: self._manual_control,
            dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._rc_channels_override,
        }
        if identity.takes_actuator_controls:
            self.capabilities |= dialect.MAV_PROTOCOL_CAPABILITY_RESERVED3  # formerly SET_ACTUATOR_TARGET
            self.handlers[dialect.MAVLINK_MSG_ID_SET_ACTUATOR_CONTROL_TARGET] = self._set_actuator_control_target

    def _set_attitude_target(self, message: Any) -> None:
        mask, now_ns = message.type_mask, self._flight.motion.time_ns
        thrust = 0.0 if mask & _THRUST_IGNORE else message.thrust
        if not mask & _ATTITUDE_IGNORE:
            self._flight.setpoints.attitude(tuple(message.q), thrust, now_ns)
        elif not mask & _RATES_IGNORE:
            rates = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
            self._flight.setpoints.rates(rates, thrust, now_ns)

    def _set_actuator_control_target(self, message: Any) -> None:
        if message.group_mlx == 0:
            self._flight.setpoints.torque(message.controls, self._flight.motion.time_ns)

    # --- position, velocity, acceleration ---

    def _set_position_target_local_ned(self, message: Any) -> None:
        if message.coordinate_frame == dialect.MAV_FRAME_LOCAL_NED:
            position = _axes(message, _POSITION_BIT, (message.x, message.y, message.z))
            velocity, acceleration = _rates(message)
        elif message.coordinate_frame == dialect.MAV_FRAME_BODY_NED:
            position = FREE
            motion, (velocity, acceleration) = self._flight.motion, _rates(message)
            velocity = _in_world(velocity, (math.cos(0.5 * motion.yaw), 0.0, 0.0, math.sin(0.5 * motion.yaw)))
            acceleration = _in_world(acceleration, motion.attitude_ned_frd)
        else:
            self._say(f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {message.coordinate_frame} unsupported")
            return
        self._set_target(message, position, velocity, acceleration)

    def _set_position_target_global_int(self, message: Any) -> None:
        position = FREE
        if not message.type_mask & 0b111:
            if message.coordinate_frame not in ON_EARTH:
                self._say(f"SET_POSITION_TARGET_GLOBAL_INT coordinate frame {message.coordinate_frame} unsupported")
                return
            place = horizontal(message.lat_int * 1e-7, message.lon_int * 1e-7, self._origin)
            if place is None:
                return
            above_home = message.coordinate_frame in ABOVE_HOME
            position = *place, _finite((self._flight.home_ned[2] if above_home else self._origin[2]) - message.alt)
        self._set_target(message, position, *_rates(message))

    def _set_target(self, message: Any, position: Axes, velocity: Axes, acceleration: Axes) -> None:
        name = message.get_type()
        if acceleration != FREE and message.type_mask & _FORCE:
            self._say(f"{name} force not supported")
        elif position == velocity == acceleration == FREE:
            self._say(f"{name} invalid")
        else:
            yaw = None if message.type_mask & _YAW_IGNORE else _finite(message.yaw)
            yaw_rate = None if message.type_mask & _YAW_RATE_IGNORE else _finite(message.yaw_rate)
            target = Target(position, velocity, acceleration, yaw, yaw_rate)
            self._flight.setpoints.target(target, self._flight.motion.time_ns)

    def _say(self, text: str) -> None:
        self._flight.announce(Severity.CRITICAL, text)

    # --- sticks ---

    def _manual_control(self, message: Any) -> None:
        if message.target in (0, self._system):
            throttle = message.z / 500.0 - 1.0 if 0 <= message.z <= 1000 else 0.0
            sticks = Sticks(_stick(message.y), _stick(message.x), throttle, _stick(message.r))
            self._flight.sticks.move(sticks, self._flight.motion.time_ns)

    def _rc_channels_override(self, message: Any) -> None:
        """Channels 1 to 4 are roll, pitch, throttle and yaw."""
        pulses = message.chan1_raw, message.chan2_raw, message.chan3_raw, message.chan4_raw
        if message.target_system in (0, self._system) and all(800 <= pulse <= 2200 for pulse in pulses):
            sticks = Sticks(*(min(max((pulse - 1500) / 500.0, -1.0), 1.0) for pulse in pulses))
            self._flight.sticks.move(sticks, self._flight.motion.time_ns)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _axes(message: Any, first_bit: int, values: tuple[float, float, float]) -> Axes:
    """The axes that the type mask does not ignore; what is not a number counts as ignored."""
    north, east, down = (
        None if message.type_mask & 1 << first_bit + axis else _finite(value) for axis, value in enumerate(values)
    )
    return north, east, down


def _rates(message: Any) -> tuple[Axes, Axes]:
    """Velocity and acceleration."""
    return (
        _axes(message, _VELOCITY_BIT, (message.vx, message.vy, message.vz)),
        _axes(message, _ACCELERATION_BIT, (message.afx, message.afy, message.afz)),
    )


def _in_world(axes: Axes, attitude_ned_frd: Quaternion) -> Axes:
    """Axes ahead, to the right and down as those of the world; all or none of them, as for PX4.

    None, too, where the largest numbers, once turned, have no room in POSITION_TARGET_LOCAL_NED.
    """
    forward, right, down = axes
    if forward is None or right is None or down is None:
        return FREE
    north, east, below = map(float, to_world(attitude_ned_frd, (forward, right, down)))
    return (north, east, below) if max(abs(north), abs(east), abs(below)) <= HIGHEST_FLOAT else FREE


def _stick(value: int) -> float:
    """-1000..1000; a stick that is left out, or beyond its range, stands in the middle, as for PX4."""
    return value / 1000.0 if abs(value) <= 1000 else 0.0
