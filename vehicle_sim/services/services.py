"""All MAVLink services of the vehicle: received frames go to them, their frames go out with the next tick."""

from collections import ChainMap
from collections.abc import Callable
from functools import reduce
from operator import or_
from typing import Any, Protocol

from protocol.framing import Frame
from protocol.messages import Encoder, decode
from protocol.routing import target_of
from vehicle_sim.airframe import Airframe
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.services.commands import CommandService
from vehicle_sim.services.component_metadata import (
    GENERAL_FILE,
    PARAMETER_FILE,
    checksum,
    general_metadata,
    parameter_metadata,
)
from vehicle_sim.services.files import FileService
from vehicle_sim.services.flight_commands import Actions
from vehicle_sim.services.flight_logs import FlightLogs
from vehicle_sim.services.identity import COMPONENT, Identity
from vehicle_sim.services.link import LinkService
from vehicle_sim.services.logs import LogService
from vehicle_sim.services.missions import MissionService
from vehicle_sim.services.outbox import Channel, Outbox
from vehicle_sim.services.parameter_store import Parameters, text_of
from vehicle_sim.services.parameters import ParameterService
from vehicle_sim.services.places import Geodetic
from vehicle_sim.services.profiles import Profile
from vehicle_sim.services.refusals import RefusalService
from vehicle_sim.services.sensor_messages import Senses
from vehicle_sim.services.setpoints import SetpointService
from vehicle_sim.services.shell import ShellService
from vehicle_sim.services.snapshot import Snapshot
from vehicle_sim.services.status_text import StatusTexts
from vehicle_sim.services.telemetry import Source, Telemetry

VALUE_FILE = "parameters.params"
"""The file with all parameters, for MAVLink FTP."""


class Service(Protocol):
    """A part of MAVLink. `handlers`: by message id; a message for others does not get there."""

    handlers: dict[int, Callable[[Any], None]]
    capabilities: int
    """The bits of AUTOPILOT_VERSION that say that it is served."""


class Services:
    """The services of one vehicle, on all its links. `origin` is the place of the local axes on earth.

    A new service is one more entry here.
    """

    def __init__(
        self,
        identity: Identity,
        airframe: Airframe,
        flight: FlightControl,
        parameters: Parameters,
        senses: Senses,
        origin: Geodetic,
        actions: Actions,
    ) -> None:
        self._identity = identity
        self._flight = flight
        self.outbox = outbox = Outbox()
        self._status_texts = StatusTexts(outbox)
        values = ParameterService(parameters, outbox)
        self._commands = commands = CommandService(flight, outbox, identity, origin, actions, values.reset)
        self._missions = missions = MissionService(flight, outbox, identity, origin)
        described = parameter_metadata(parameters)
        general = general_metadata(described)
        self._logs = FlightLogs(parameters, flight, identity)
        files: dict[str, Callable[[], bytes]] = {
            VALUE_FILE: lambda: text_of(parameters).encode(),
            GENERAL_FILE: lambda: general,
            PARAMETER_FILE: lambda: described,
        }
        services: tuple[Service, ...] = (
            RefusalService(flight, outbox, identity),  # first: the others take what they serve from it
            LinkService(flight, outbox),
            SetpointService(flight, identity, origin),
            values,
            FileService(ChainMap(self._logs.files, files), outbox),
            LogService(self._logs, outbox),
            ShellService(parameters, identity, outbox, values.tell),
            commands,
            missions,
        )
        self._handlers = {key: handler for service in services for key, handler in service.handlers.items()}
        capabilities: int = reduce(or_, (each.capabilities for each in services))
        self._source = Source(airframe, senses, flight, origin, identity.version, capabilities, checksum(general))

    @property
    def ended(self) -> bool:
        """The vehicle was asked to shut down."""
        return self._commands.ended

    def open_channel(self, profile: Profile, tick: int, now: Snapshot, *, datagrams: bool) -> Channel:
        """One link more, from a tick on."""
        encoder = Encoder(self._identity.system, COMPONENT)
        channel = Channel(encoder, Telemetry(encoder, self._source, now, profile), datagrams=datagrams)
        channel.telemetry.begin(tick)
        self.outbox.channels.append(channel)
        return channel

    def close_channel(self, channel: Channel) -> None:
        """Its peer has gone."""
        self.outbox.channels.remove(channel)

    def handle(self, frame: Frame, channel: Channel) -> None:
        """Handle a frame that came on a link, and hand it on to other links that it is for.

        One with an unknown message is ignored.
        """
        target = target_of(frame)
        self.outbox.answer(channel)
        self.outbox.forward(frame, target, self._identity.system)
        handler = self._handlers.get(frame.message_id)
        if handler is not None and self._identity.is_meant(target):
            handler(decode(frame))
        self.outbox.answer(None)

    def tell(self, now: Snapshot) -> None:
        """How the mission goes and the autopilot's texts, to all, and to the log."""
        self._missions.update()
        self._logs.update(now)
        for severity, text in self._flight.texts:
            self._status_texts.send(severity, text)
        self._flight.texts.clear()
