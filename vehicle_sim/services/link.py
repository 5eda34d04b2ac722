"""The services that keep a link alive and measure it: HEARTBEAT, TIMESYNC, PING."""

from collections.abc import Callable
from typing import Any

from protocol.messages import dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.services.outbox import Outbox


class LinkService:
    """Answers requests and takes heartbeats."""

    capabilities = dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2

    def __init__(self, flight: FlightControl, outbox: Outbox) -> None:
        self._flight = flight
        self._outbox = outbox
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: lambda _: flight.heartbeat(),
            dialect.MAVLINK_MSG_ID_TIMESYNC: self._timesync,
            dialect.MAVLINK_MSG_ID_PING: self._ping,
        }

    def _timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            self._outbox.send(dialect.MAVLink_timesync_message, self._flight.motion.time_ns, message.ts1)

    def _ping(self, message: Any) -> None:
        """A request is for all; an answer is for one."""
        if message.target_system == 0 and message.target_component == 0:
            self._outbox.send(
                dialect.MAVLink_ping_message,
                message.time_usec,
                message.seq,
                message.get_srcSystem(),
                message.get_srcComponent(),
            )
