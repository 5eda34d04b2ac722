"""What a vehicle is asked before its flight is planned: where on earth it is or took off, and its stored mission."""

from typing import Any, Protocol

from companion.config import Settings
from companion.link.mission_download import MissionDownload
from companion.link.vehicle_link import VehicleLink
from companion.mission.files import MissionFile, MissionFileError, Place, stored
from companion.outputs import Message
from protocol.clock import RealClock
from protocol.framing import Framer
from protocol.messages import decode, dialect
from protocol.transport import Transport

_WAIT_S = 0.02
_ASK_NS = 500_000_000
_POSITION = dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT
_HOME = dialect.MAVLINK_MSG_ID_HOME_POSITION


class _Question(Protocol):
    over: bool

    def ask(self, now_ns: int, target: tuple[int, int]) -> Message | None: ...

    def take(self, message: Any) -> None: ...


class _Where:
    """Asks for GLOBAL_POSITION_INT (33), or for HOME_POSITION (242)."""

    def __init__(self, message_id: int) -> None:
        self.place: Place | None = None
        self._message_id = message_id
        self.over = False
        self._ask_ns = 0

    def ask(self, now_ns: int, target: tuple[int, int]) -> Message | None:
        if now_ns < self._ask_ns:
            return None
        self._ask_ns = now_ns + _ASK_NS
        fields = *target, dialect.MAV_CMD_REQUEST_MESSAGE, 0, float(self._message_id), *(0.0,) * 6
        return dialect.MAVLink_command_long_message, fields

    def take(self, message: Any) -> None:
        if message.get_msgId() != self._message_id:
            return
        home = self._message_id == _HOME
        place = (message.latitude, message.longitude) if home else (message.lat, message.lon)
        if place != (0, 0):
            self.place, self.over = (place[0] * 1e-7, place[1] * 1e-7), True


def locate(settings: Settings, transport: Transport, *, home: bool = False) -> Place | None:
    """The place of the vehicle at the other end, or of its `home`, where it took off; None if it does not say it.
    Raises TransportError, and MissionFileError if there is no vehicle."""
    where = _Where(_HOME if home else _POSITION)
    link = _answered(where, settings, transport, gives_up=True)
    if link.firmware is None:
        raise _nobody(settings)
    return where.place


def download(settings: Settings, transport: Transport, home: Place) -> MissionFile:
    """The mission that the vehicle at the other end has stored. `home`: where it stands, or took off. Raises
    TransportError, and MissionFileError if there is none or it does not come."""
    asked = MissionDownload()
    link = _answered(asked, settings, transport, gives_up=False)
    if link.firmware is None:
        raise _nobody(settings)
    if asked.fault:
        raise MissionFileError(asked.fault)
    return stored(asked.items, home, first_is_home=link.firmware.first_item_is_home)


def _nobody(settings: Settings) -> MissionFileError:
    return MissionFileError(f"no vehicle within {settings.supervision.find_timeout:g} s")


def _answered(question: _Question, settings: Settings, transport: Transport, *, gives_up: bool) -> VehicleLink:
    """Ask until it is over. Without a vehicle it ends with the time to find one; one that `gives_up` in any case."""
    link, clock, framer = VehicleLink(settings, None), RealClock(), Framer()
    find_ns = round(settings.supervision.find_timeout * 1e9)
    while not question.over:
        now = clock.now_ns()
        if now >= find_ns and (gives_up or link.vehicle is None):
            break
        data = transport.receive(_WAIT_S)
        if data is not None:
            link.receive(data, now, whole=transport.preserves_datagrams)
            for frame in framer.feed(data):
                message = decode(frame) if (frame.system, frame.component) == link.vehicle else None
                if message is not None and (not hasattr(message, "target_system") or link.outbox.is_addressed(message)):
                    question.take(message)
        link.beat(now, asks_rates=False)
        message = None if link.vehicle is None else question.ask(now, link.vehicle)
        if message is not None:
            link.outbox.send(message[0], *message[1])
        answer = link.outbox.flush()
        if answer and transport.peer:
            transport.send(answer)
    return link
