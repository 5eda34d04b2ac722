"""Where on earth a vehicle stands, asked before its flight is planned."""

from companion.config import Settings
from companion.link.vehicle_link import VehicleLink
from companion.mission.files import Place
from protocol.clock import RealClock
from protocol.framing import Framer
from protocol.messages import decode, dialect
from protocol.transport import Transport

_WAIT_S = 0.02
_ASK_NS = 500_000_000
_POSITION = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT


def locate(settings: Settings, transport: Transport) -> Place | None:
    """The place of the vehicle at the other end; None if it does not say it. Raises TransportError."""
    link, clock, framer, ask_ns = VehicleLink(settings, None), RealClock(), Framer(), 0
    give_up_ns = round(settings.supervision.find_timeout * 1e9)
    while (now := clock.now_ns()) < give_up_ns:
        data = transport.receive(_WAIT_S)
        if data is not None:
            link.receive(data, now, whole=transport.preserves_datagrams)
            for frame in framer.feed(data):
                if frame.message_id == _POSITION and (frame.system, frame.component) == link.vehicle:
                    message = decode(frame)
                    if message is not None and (message.lat, message.lon) != (0, 0):
                        return message.lat * 1e-7, message.lon * 1e-7
        link.beat(now, asks_rates=False)
        if link.vehicle is not None and now >= ask_ns:
            ask_ns = now + _ASK_NS
            link.outbox.command(dialect.MAV_CMD_REQUEST_MESSAGE, float(_POSITION))
        answer = link.outbox.flush()
        if answer and transport.peer:
            transport.send(answer)
    return None
