"""All MAVLink services of the vehicle: received frames go to them, their frames go out with the next tick."""

from collections.abc import Callable
from functools import reduce
from operator import or_
from typing import Any, Protocol

from protocol.framing import Frame
from protocol.messages import decode
from protocol.routing import target_of
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.services.commands import CommandService, Geodetic
from vehicle_sim.services.files import FileService
from vehicle_sim.services.identity import Identity
from vehicle_sim.services.link import LinkService
from vehicle_sim.services.logs import LogService
from vehicle_sim.services.outbox import Channel, Outbox
from vehicle_sim.services.parameter_store import Parameters, text_of
from vehicle_sim.services.parameters import ParameterService
from vehicle_sim.services.setpoints import SetpointService
from vehicle_sim.services.status_text import StatusTexts

PARAMETER_FILE = "parameters.params"
"""The file with all parameters, for MAVLink FTP."""


class Service(Protocol):
    """A part of MAVLink. `handlers`: by message id; a message for others does not get there."""

    handlers: dict[int, Callable[[Any], None]]
    capabilities: int
    """The bits of AUTOPILOT_VERSION that say that it is served."""


class Services:
    """A new service is one more entry here."""

    def __init__(
        self,
        identity: Identity,
        outbox: Outbox,
        flight: FlightControl,
        parameters: Parameters,
        origin: Geodetic,
        release: Callable[[], bool],
    ) -> None:
        self._identity = identity
        self._flight = flight
        self._outbox = outbox
        self._status_texts = StatusTexts(outbox)
        services: tuple[Service, ...] = (
            LinkService(flight, outbox),
            SetpointService(flight, identity),
            ParameterService(parameters, outbox),
            FileService({PARAMETER_FILE: lambda: text_of(parameters).encode()}, outbox),
            LogService(outbox),
            CommandService(flight, outbox, origin, release),
        )
        self._handlers = {key: handler for service in services for key, handler in service.handlers.items()}
        self.capabilities: int = reduce(or_, (each.capabilities for each in services))

    def handle(self, frame: Frame, channel: Channel) -> None:
        """Handle a frame that came on a link, and hand it on to other links that it is for.

        One with an unknown message is ignored.
        """
        target = target_of(frame)
        self._outbox.answer(channel)
        self._outbox.forward(frame, target, self._identity.system)
        handler = self._handlers.get(frame.message_id)
        if handler is not None and self._identity.is_meant(target):
            handler(decode(frame))
        self._outbox.answer(None)

    def tell(self) -> None:
        """The autopilot's texts, to all."""
        for severity, text in self._flight.texts:
            self._status_texts.send(severity, text)
        self._flight.texts.clear()
