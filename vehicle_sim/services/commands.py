"""The command service: COMMAND_LONG and COMMAND_INT, each answered by a COMMAND_ACK."""

import math
from collections.abc import Callable
from typing import Any

from protocol.arrays import Vector
from protocol.frames import to_local
from protocol.messages import dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode, Result, Severity
from vehicle_sim.services.outbox import Outbox

Geodetic = tuple[float, float, float]
"""Latitude, longitude (rad), altitude above mean sea level (m)."""
Command = Callable[[Any, float | None], Result]
"""A message and its height (m) above home, None if it gives none -> the result for the COMMAND_ACK."""

FORCE = 21196
"""param2 of an arming command that skips the checks."""

_UNSET_E7 = 2**31 - 1
"""A latitude or longitude that is not given (1e-7 degrees)."""
_ABOVE_HOME = frozenset({dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_ON_EARTH = _ABOVE_HOME | {dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT}


def _altitude(message: Any) -> float:
    value: float = message.z if message.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_INT else message.param7
    return value


def _whole(value: float) -> int:
    """A parameter that must be a whole number; -2 for any other value, also for NaN, which means that it is unset."""
    return int(value) if math.isfinite(value) and value == int(value) else -2


class CommandService:
    """Executes commands. `origin` is the place of the local axes on earth, `release` drops the parcel, if any."""

    capabilities = dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT | dialect.MAV_PROTOCOL_CAPABILITY_GRIPPER

    def __init__(
        self,
        flight: FlightControl,
        outbox: Outbox,
        origin: Geodetic,
        release: Callable[[], bool],
    ) -> None:
        self._flight = flight
        self._outbox = outbox
        self._origin = origin
        self._release = release
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_COMMAND_LONG: self._command_long,
            dialect.MAVLINK_MSG_ID_COMMAND_INT: self._command_int,
        }
        self._commands: dict[int, Command] = {
            dialect.MAV_CMD_NAV_TAKEOFF: lambda _, height: flight.take_off(height),
            dialect.MAV_CMD_NAV_LAND: lambda *_: flight.set_mode(Mode.LAND),
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda *_: flight.set_mode(Mode.RETURN),
            dialect.MAV_CMD_DO_SET_MODE: self._do_set_mode,
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_DO_REPOSITION: self._do_reposition,
            dialect.MAV_CMD_DO_GRIPPER: self._do_gripper,
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_message_interval,
            dialect.MAV_CMD_GET_MESSAGE_INTERVAL: lambda m, _: self._send_interval(_whole(m.param1)),
            dialect.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda *_: self._send(
                dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ),
            dialect.MAV_CMD_GET_HOME_POSITION: lambda *_: self._send(dialect.MAVLINK_MSG_ID_HOME_POSITION),
        }

    def _command_long(self, message: Any) -> None:
        self._execute(message, self._height_above_home(message.param7))

    def _command_int(self, message: Any) -> None:
        height = (
            message.z
            if message.frame in _ABOVE_HOME and math.isfinite(message.z)
            else self._height_above_home(message.z)
        )
        self._execute(message, height)

    def _height_above_home(self, altitude_m: float) -> float | None:
        """From an altitude above mean sea level; None if it is unset."""
        if not math.isfinite(altitude_m):
            return None
        return altitude_m - self._origin[2] + self._flight.home_ned[2]

    def _execute(self, message: Any, height_m: float | None) -> None:
        command = self._commands.get(message.command)
        result = Result.UNSUPPORTED if command is None else command(message, height_m)
        self._outbox.send(
            dialect.MAVLink_command_ack_message,
            message.command,
            int(result),
            0,
            0,
            message.get_srcSystem(),
            message.get_srcComponent(),
        )

    # --- flight ---

    def _do_set_mode(self, message: Any, _: float | None) -> Result:
        if not _whole(message.param1) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Result.DENIED
        main, sub = _whole(message.param2), _whole(message.param3)
        for mode in Mode:
            if mode.value == (main, sub) or (mode is Mode.OFFBOARD and main == mode.value[0]):
                return self._flight.set_mode(mode)
        self._flight.announce(Severity.CRITICAL, f"Mode {main}/{sub} is not available")
        return Result.DENIED

    def _arm_disarm(self, message: Any, _: float | None) -> Result:
        force = message.param2 == FORCE
        match message.param1:
            case 1.0:
                return self._flight.arm(force=force)
            case 0.0:
                return self._flight.disarm(force=force)
        return Result.DENIED

    def _do_reposition(self, message: Any, height_m: float | None) -> Result:
        """Fly to a place on earth and hold there. A value that is unset stays as it is. As for PX4, the flag to change
        the mode must be set, and no other."""
        if _whole(message.param2) != dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
            return Result.UNSUPPORTED
        here = self._flight.motion.position_ned
        place = self._place(message, here)
        if place is None or (height_m is None and not math.isnan(_altitude(message))):
            self._flight.announce(Severity.CRITICAL, "Reposition rejected: no such place")
            return Result.DENIED
        north, east = place
        down = here[2] if height_m is None else self._flight.home_ned[2] - height_m
        speed = message.param1 if math.isfinite(message.param1) and message.param1 > 0.0 else None
        yaw = message.param4 if math.isfinite(message.param4) else None
        return self._flight.reposition((north, east, down), yaw, speed)

    def _place(self, message: Any, here_ned: Vector) -> tuple[float, float] | None:
        """North and east (m) of a command's latitude and longitude, those of `here_ned` if both are unset.

        None if there is no such place.
        """
        if message.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_INT:
            if message.frame not in _ON_EARTH:
                return None
            given = tuple(math.nan if value == _UNSET_E7 else value * 1e-7 for value in (message.x, message.y))
        else:
            given = message.param5, message.param6
        if all(map(math.isnan, given)):
            return here_ned[0], here_ned[1]
        if not (abs(given[0]) <= 90.0 and abs(given[1]) <= 180.0):
            return None
        local = to_local((math.radians(given[0]), math.radians(given[1]), 0.0), self._origin)
        return float(local[0]), float(local[1])

    def _do_gripper(self, message: Any, _: float | None) -> Result:
        if _whole(message.param2) != dialect.GRIPPER_ACTION_RELEASE:
            self._flight.announce(Severity.WARNING, "Gripper: release is all it can do")
            return Result.DENIED
        self._flight.announce(Severity.INFO, "Parcel released" if self._release() else "Gripper: no parcel left")
        return Result.ACCEPTED  # also the second time: it may be the same command, sent again for lack of an answer

    # --- telemetry ---

    def _set_message_interval(self, message: Any, _: float | None) -> Result:
        if not math.isfinite(message.param2):
            return Result.DENIED
        accepted = self._outbox.streams.set_interval(_whole(message.param1), round(message.param2))
        return Result.ACCEPTED if accepted else Result.DENIED

    def _request_message(self, message: Any, _: float | None) -> Result:
        message_id = _whole(message.param1)
        if message_id == dialect.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._send_interval(_whole(message.param2))
        return self._send(message_id)

    def _send(self, message_id: int) -> Result:
        data = self._outbox.streams.request(message_id)
        if data is None:
            return Result.DENIED
        self._outbox.here.append(data)
        return Result.ACCEPTED

    def _send_interval(self, message_id: int) -> Result:
        if not 0 <= message_id <= 65535:
            return Result.DENIED
        interval_us = self._outbox.streams.interval_us(message_id)
        self._outbox.send(dialect.MAVLink_message_interval_message, message_id, interval_us)
        return Result.ACCEPTED
