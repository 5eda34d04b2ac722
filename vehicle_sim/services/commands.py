"""The command service: COMMAND_LONG, COMMAND_INT and SET_MODE, each answered by a COMMAND_ACK."""

import math
from collections.abc import Callable
from typing import Any

from protocol.messages import ProtocolVersion, dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Result, Severity
from vehicle_sim.services.flight_commands import Actions, Command, FlightCommands, whole
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.outbox import Outbox
from vehicle_sim.services.places import Geodetic

_QUESTIONS = frozenset(
    {
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_GET_MESSAGE_INTERVAL,
        dialect.MAV_CMD_REQUEST_MESSAGE,
    }
)
"""Ground stations ask for much that may not be there. All other refusals come with a text."""


class CommandService:
    """Executes commands. `origin` is the place of the local axes on earth."""

    capabilities = (
        dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | dialect.MAV_PROTOCOL_CAPABILITY_GRIPPER
        | dialect.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    )

    def __init__(
        self,
        flight: FlightControl,
        outbox: Outbox,
        identity: Identity,
        origin: Geodetic,
        actions: Actions,
        reset_parameters: Callable[[], None],
    ) -> None:
        self._flight = flight
        self._outbox = outbox
        self._identity = identity
        self.ended = False
        """The vehicle was asked to shut down."""
        self._flying = FlightCommands(flight, origin, actions, reset_parameters)
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_COMMAND_LONG: self._command,
            dialect.MAVLINK_MSG_ID_COMMAND_INT: self._command,
            dialect.MAVLINK_MSG_ID_SET_MODE: self._set_mode,
        }
        self._commands: dict[int, Command] = {
            **self._flying.table,
            dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_message_interval,
            dialect.MAV_CMD_GET_MESSAGE_INTERVAL: lambda m: self._send_interval(whole(m.param1)),
            dialect.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _: self._send(
                dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
            ),
            dialect.MAV_CMD_REQUEST_PROTOCOL_VERSION: lambda _: self._send(ProtocolVersion.id),
            dialect.MAV_CMD_GET_HOME_POSITION: lambda _: self._send(dialect.MAVLINK_MSG_ID_HOME_POSITION),
        }

    def _command(self, message: Any) -> None:
        command, said = self._commands.get(message.command), len(self._flight.texts)
        result = Result.UNSUPPORTED if command is None else command(message)
        self._answer(message, message.command, result)
        if result is not Result.ACCEPTED and len(self._flight.texts) == said and message.command not in _QUESTIONS:
            why = "not supported" if command is None else f"{result.name.lower()}, for its parameters"
            self._flight.announce(Severity.WARNING, f"Command {message.command}: {why}")

    def _set_mode(self, message: Any) -> None:
        """SET_MODE is answered as the command for the same is, as by PX4."""
        if message.target_system == self._identity.system:
            main, sub = message.custom_mode >> 16 & 0xFF, message.custom_mode >> 24
            result = self._flying.set_mode(message.base_mode, main, sub)
            self._answer(message, dialect.MAV_CMD_DO_SET_MODE, result)

    def _answer(self, message: Any, command: int, result: Result) -> None:
        self._outbox.send(
            dialect.MAVLink_command_ack_message,
            command,
            int(result),
            0,
            0,
            message.get_srcSystem(),
            message.get_srcComponent(),
        )

    def _reboot(self, message: Any) -> Result:
        """0: nothing. 1: restart, 2: shut down; either ends the program, as it does PX4's simulation."""
        if message.param1 == 0.0:
            return Result.ACCEPTED
        if message.param1 not in (1.0, 2.0):
            return Result.DENIED
        if self._flight.armed:
            return self._flight.refuse("Shutdown rejected: armed", Result.DENIED)
        self.ended = True
        return Result.ACCEPTED

    # --- telemetry ---

    def _set_message_interval(self, message: Any) -> Result:
        if not math.isfinite(message.param2):
            return Result.DENIED
        accepted = self._outbox.streams.set_interval(whole(message.param1), round(message.param2))
        return Result.ACCEPTED if accepted else Result.DENIED

    def _request_message(self, message: Any) -> Result:
        message_id = whole(message.param1)
        if message_id == dialect.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._send_interval(whole(message.param2))
        return self._send(message_id, whole(message.param2))

    def _send(self, message_id: int, number: int = 0) -> Result:
        data = self._outbox.streams.request(message_id, number)
        if not data:  # there is no such message, or nothing to tell at present
            return Result.DENIED
        self._outbox.here.append(data)
        return Result.ACCEPTED

    def _send_interval(self, message_id: int) -> Result:
        if not 0 <= message_id <= 65535:
            return Result.DENIED
        interval_us = self._outbox.streams.interval_us(message_id)
        self._outbox.send(dialect.MAVLink_message_interval_message, message_id, interval_us)
        return Result.ACCEPTED
