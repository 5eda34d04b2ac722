"""What the vehicle is asked for, as commands that are repeated until they have an effect."""

from typing import Any

from companion.config import Supervision
from companion.link.commands import Commander
from companion.link.firmware.firmware import Firmware
from companion.reports import CommandReport
from companion.state import FlightMode, VehicleRequest
from protocol.messages import dialect

_SET_MODE, _ARM = dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_COMPONENT_ARM_DISARM
_MODES = {
    VehicleRequest.EXTERNAL_CONTROL: FlightMode.EXTERNAL,
    VehicleRequest.HOLD: FlightMode.HOLD,
    VehicleRequest.LAND: FlightMode.LAND,
}
_COMMANDS: dict[VehicleRequest, tuple[int, tuple[float, ...]]] = {
    VehicleRequest.VERSION: (dialect.MAV_CMD_REQUEST_MESSAGE, (float(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION),)),
    VehicleRequest.HOME: (dialect.MAV_CMD_REQUEST_MESSAGE, (float(dialect.MAVLINK_MSG_ID_HOME_POSITION),)),
    VehicleRequest.STATUS: (dialect.MAV_CMD_REQUEST_MESSAGE, (float(dialect.MAVLINK_MSG_ID_HEARTBEAT),)),
    VehicleRequest.ARM: (_ARM, (1.0,)),
    VehicleRequest.DISARM: (_ARM, (0.0,)),
    VehicleRequest.RELEASE: (dialect.MAV_CMD_DO_GRIPPER, (1.0, float(dialect.GRIPPER_ACTION_RELEASE))),
}
"""The command and its parameters; those of modes depend on the firmware."""
_TITLES = {
    VehicleRequest.EXTERNAL_CONTROL: "control (DO_SET_MODE)",
    VehicleRequest.ARM: "arming",
    VehicleRequest.DISARM: "disarming",
}
"""In words, of the requests whose refusal ends the flight."""


class Requests:
    """The requests to one vehicle, whose firmware is told once it is known."""

    def __init__(self, settings: Supervision) -> None:
        self.firmware: Firmware | None = None
        self._tries = settings.command_tries
        self._commander = Commander(settings.command_interval)

    def ask(
        self, wanted: VehicleRequest, now_ns: int, target: tuple[int, int]
    ) -> tuple[type[Any], tuple[Any, ...]] | None:
        """COMMAND_LONG's class and fields if it is time to send it (again); call again and again while it is wanted."""
        command, parameters = self._command(wanted)
        return self._commander.ask(command, parameters, now_ns, target)

    def answered(self, message: Any) -> None:
        """COMMAND_ACK (77) for this companion."""
        self._commander.answered(message)

    def answer(self, wanted: VehicleRequest) -> CommandReport:
        """What has come of a request so far."""
        command, _ = self._command(wanted)
        commander = self._commander
        return CommandReport(commander.accepted(command), commander.tries(command), commander.answer(command))

    def exhausted(self, wanted: VehicleRequest | None, now_ns: int) -> str | None:
        """In words, if control, arming or disarming was asked for as often as allowed, and the answer; else None."""
        if wanted not in _TITLES:
            return None
        command, _ = self._command(wanted)
        if not self._commander.exhausted(command, self._tries, now_ns):
            return None
        return f"{_TITLES[wanted]}: {self._commander.answer(command)}"

    def forget_mode(self) -> None:
        """The mode that was asked for is not wanted any more."""
        self._commander.forget(_SET_MODE)

    def forget(self, wanted: VehicleRequest) -> None:
        """It is not wanted any more, unless it is asked for anew."""
        command, _ = self._command(wanted)
        self._commander.forget(command)

    def _command(self, wanted: VehicleRequest) -> tuple[int, tuple[float, ...]]:
        if wanted not in _MODES:
            return _COMMANDS[wanted]
        assert self.firmware is not None
        return _SET_MODE, self.firmware.mode_command(_MODES[wanted])
