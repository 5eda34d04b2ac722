"""Setpoints of a companion: SET_ATTITUDE_TARGET and SET_ACTUATOR_CONTROL_TARGET."""

from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.services.identity import Identity

_ATTITUDE_IGNORE = dialect.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_RATES_IGNORE = (
    dialect.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    | dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
_THRUST_IGNORE = dialect.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE


class SetpointService:
    """Hands setpoints to the autopilot."""

    def __init__(self, flight: FlightControl, identity: Identity) -> None:
        self._flight = flight
        self.capabilities: int = dialect.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: self._set_attitude_target,
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
