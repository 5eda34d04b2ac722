"""All MAVLink services of the vehicle: received frames go to them, their frames go out with the next tick."""

from collections.abc import Callable
from typing import Any

from protocol.framing import Frame
from protocol.messages import Encoder, decode
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.services.commands import CommandService
from vehicle_sim.services.link import LinkService
from vehicle_sim.services.missions import MissionService
from vehicle_sim.services.outbox import Outbox
from vehicle_sim.services.parameters import ParameterService
from vehicle_sim.services.places import Geodetic
from vehicle_sim.services.setpoints import SetpointService
from vehicle_sim.services.status_text import StatusTexts
from vehicle_sim.services.telemetry import Telemetry


class Services:
    """Each service has the table of the messages that it handles; a new service is one more entry here."""

    def __init__(
        self,
        encoder: Encoder,
        airframe: Airframe,
        flight: FlightControl,
        telemetry: Telemetry,
        origin: Geodetic,
        release: Callable[[], bool],
    ) -> None:
        self._flight = flight
        self._outbox = Outbox(encoder)
        self._status_texts = StatusTexts(self._outbox)
        self._commands = CommandService(flight, telemetry, self._outbox, origin, release)
        self._missions = MissionService(flight, self._outbox, origin)
        self._handlers: dict[int, Callable[[Any], None]] = {
            **LinkService(flight, self._outbox).handlers,
            **SetpointService(flight, origin).handlers,
            **ParameterService(airframe, self._outbox).handlers,
            **self._missions.handlers,
            **self._commands.handlers,
        }

    @property
    def ended(self) -> bool:
        """The vehicle was asked to shut down."""
        return self._commands.ended

    def handle(self, frame: Frame) -> None:
        """Handle a frame; one with an unknown message or for another vehicle is ignored."""
        handler = self._handlers.get(frame.message_id)
        if handler is not None:
            handler(decode(frame))

    def collect(self) -> list[bytes]:
        """The frames to send beside the telemetry: the services' answers, then the autopilot's texts."""
        self._missions.update()
        for severity, text in self._flight.texts:
            self._status_texts.send(severity, text)
        self._flight.texts.clear()
        return self._outbox.take()
