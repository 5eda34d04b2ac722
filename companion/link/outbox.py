"""All that the companion says on the link: messages in, the bytes of one datagram out."""

from collections.abc import Iterable
from typing import Any

from companion.config import Settings
from companion.link import wire
from companion.outputs import encoders
from companion.state import Announcement, Output, Setpoint
from protocol.messages import Encoder, dialect


class Outbox:
    """What waits to be sent to one vehicle, in order."""

    def __init__(self, settings: Settings, output: Output) -> None:
        """Raises PluginError."""
        identity = settings.identity
        self.vehicle: tuple[int, int] | None = None
        """(system, component) of whom it is meant for, once it was found."""
        self._identity = identity
        self._encoder = Encoder(identity.system or 1, identity.component)
        self._encoders = encoders(settings.control)
        self.carries_any = settings.control.output.plugin is None
        """The message of another package may be made for one output alone."""
        self.use(output)
        self._waiting: list[bytes] = []

    def address(self, vehicle: tuple[int, int]) -> None:
        """The vehicle was found; without a system of its own, the companion belongs to the vehicle's."""
        self.vehicle = vehicle
        self._encoder = Encoder(self._identity.system or vehicle[0], self._identity.component)

    @property
    def system(self) -> int:
        """The sender's."""
        return self._encoder.system

    @property
    def own(self) -> tuple[int, int]:
        """(system, component) of the sender."""
        return self._encoder.system, self._encoder.component

    def is_addressed(self, message: Any) -> bool:
        """A message with a target is for this companion, or for all."""
        encoder = self._encoder
        return message.target_system in (0, encoder.system) and message.target_component in (0, encoder.component)

    def use(self, output: Output) -> None:
        """Setpoints go out on this layer from now on."""
        self.output = output
        self._encode_setpoint = self._encoders(output)

    # -- messages in ---------------------------------------------------------------------------------------------------

    def setpoint(self, setpoint: Setpoint, boot_time_ms: int) -> None:
        """A setpoint, on the layer of this flight's output."""
        assert self.vehicle is not None
        message, fields = self._encode_setpoint(setpoint, boot_time_ms, self.vehicle)
        self._waiting.append(self._encoder.encode_fields(message, *fields))

    def send(self, message: type[Any], *fields: Any) -> None:
        """A message of this class."""
        self._waiting.append(self._encoder.encode_fields(message, *fields))

    def heartbeat(self, *, active: bool) -> None:
        """The companion's own HEARTBEAT (0), which goes out before a vehicle is found too. `active`: from the first
        setpoint on."""
        self.send(
            dialect.MAVLink_heartbeat_message,
            dialect.MAV_TYPE_ONBOARD_CONTROLLER,
            dialect.MAV_AUTOPILOT_INVALID,
            0,
            0,
            dialect.MAV_STATE_ACTIVE if active else dialect.MAV_STATE_STANDBY,
            3,
        )

    def say(self, announcement: Announcement) -> None:
        """STATUSTEXT to the ground station, once a vehicle is there to pass it on."""
        if self.vehicle is not None:
            for fields in wire.statustext_fields(announcement.severity, announcement.text):
                self.send(dialect.MAVLink_statustext_message, *fields)

    def command(self, command: int, *parameters: float) -> None:
        """COMMAND_LONG (76) that is sent once; parameters that are left out are 0."""
        assert self.vehicle is not None
        padded = parameters + (0.0,) * (7 - len(parameters))
        self.send(dialect.MAVLink_command_long_message, *self.vehicle, command, 0, *padded)

    def ask_for_intervals(self, intervals: Iterable[tuple[int, float]]) -> None:
        """Messages (by id) in intervals (us)."""
        for message_id, interval_us in intervals:
            self.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), interval_us)

    def ask_for_parameters(self, names: Iterable[str]) -> None:
        """PARAM_REQUEST_READ (20) for each."""
        assert self.vehicle is not None
        for name in names:
            self.send(dialect.MAVLink_param_request_read_message, *self.vehicle, name.encode(), -1)

    # -- bytes out -----------------------------------------------------------------------------------------------------

    def last_word(self, announcement: Announcement) -> bytes:
        """This alone, in place of all that waits to be sent."""
        self._waiting.clear()
        self.say(announcement)
        return self.flush()

    def flush(self) -> bytes:
        """All that is to be sent now, as one datagram; empty if there is nothing."""
        if not self._waiting:
            return b""
        datagram = b"".join(self._waiting)
        self._waiting.clear()
        return datagram
