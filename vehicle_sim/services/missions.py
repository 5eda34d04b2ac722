"""The mission protocol: missions, fences and rally points are uploaded, downloaded and cleared, as PX4 does it."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from protocol.messages import dialect
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Severity
from vehicle_sim.services.identity import COMPONENT, Identity
from vehicle_sim.services.mission_items import ItemError, check, params_of, placed, to_item, zones
from vehicle_sim.services.mode_messages import mission_progress
from vehicle_sim.services.outbox import Outbox
from vehicle_sim.services.places import ON_EARTH, Geodetic, as_real, as_whole

RETRY_NS = 250_000_000
"""Time without an item after which it is requested again."""
TIMEOUT_NS = 5_000_000_000
"""Time without an answer after which a transfer is given up."""
ROOM = {
    dialect.MAV_MISSION_TYPE_MISSION: 2000,
    dialect.MAV_MISSION_TYPE_FENCE: 64,
    dialect.MAV_MISSION_TYPE_RALLY: 32,
}
"""Items that there is room for, by type."""

_ACCEPTED, _ERROR = dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_ERROR


@dataclass(slots=True)
class Transfer:
    """An upload or a download."""

    partner: tuple[int, int]
    kind: int
    """MAV_MISSION_TYPE."""
    count: int
    upload: bool
    heard_ns: int
    sent_ns: int
    next: int = 0
    """Number of the item to request, or that is expected to be requested."""

    @property
    def is_over(self) -> bool:
        """A download of which only the other side's word is missing that all has come, which MAVProxy never gives."""
        return not self.upload and self.next == self.count


class MissionService:
    """One transfer at a time. What is uploaded counts when it is complete."""

    capabilities = (
        dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    )

    def __init__(self, flight: FlightControl, outbox: Outbox, identity: Identity, origin: Geodetic) -> None:
        self._flight = flight
        self._system = identity.system
        self._outbox = outbox
        self._origin = origin
        self._stored: dict[int, list[Any]] = {kind: [] for kind in ROOM}
        """Messages of the items, by type."""
        self._received: list[Any] = []
        self._transfer: Transfer | None = None
        self._complete: tuple[Transfer, int] | None = None
        """The latest upload and what was answered to it: its last item may come again."""
        self._said_current: int | None = None
        self.handlers: dict[int, Callable[[Any], None]] = {
            dialect.MAVLINK_MSG_ID_MISSION_COUNT: self._for_vehicle(self._count),
            dialect.MAVLINK_MSG_ID_MISSION_ITEM: self._for_vehicle(self._item),
            dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT: self._for_vehicle(self._item),
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._for_vehicle(self._list),
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST: self._for_vehicle(self._request),
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT: self._for_vehicle(self._request),
            dialect.MAVLINK_MSG_ID_MISSION_ACK: self._for_vehicle(self._ack),
            dialect.MAVLINK_MSG_ID_MISSION_CLEAR_ALL: self._for_vehicle(self._clear),
            dialect.MAVLINK_MSG_ID_MISSION_SET_CURRENT: self._for_vehicle(self._set_current),
        }

    def _for_vehicle(self, handler: Callable[[Any], None]) -> Callable[[Any], None]:
        def handle(message: Any) -> None:
            components = (0, COMPONENT, dialect.MAV_COMP_ID_MISSIONPLANNER)
            if message.target_system == self._system and message.target_component in components:
                handler(message)

        return handle

    @property
    def _now_ns(self) -> int:
        return self._flight.motion.time_ns

    def update(self) -> None:
        """Once a tick: ask again for what was lost, give up what nobody answers, and say how the mission goes."""
        transfer, now_ns = self._transfer, self._now_ns
        if transfer is not None and now_ns - transfer.heard_ns > TIMEOUT_NS:
            if not transfer.is_over:
                self._say("Operation timeout")
            self._transfer = None
        elif transfer is not None and transfer.upload and now_ns - transfer.sent_ns > RETRY_NS:
            self._ask(transfer)
        mission = self._flight.mission
        for number in mission.reached:
            self._outbox.send(dialect.MAVLink_mission_item_reached_message, number)
        mission.reached.clear()
        if mission.items and mission.current != self._said_current:
            self._said_current = mission.current
            self._send_current()

    def _send_current(self) -> None:
        self._outbox.send(dialect.MAVLink_mission_current_message, *mission_progress(self._flight))

    # --- upload ---

    def _count(self, message: Any) -> None:
        partner, kind = _sender(message), message.mission_type
        transfer = self._transfer
        if transfer is not None and not transfer.is_over:
            again = transfer.upload and transfer.partner == partner and transfer.next == 0
            if not again:
                self._say("Mission upload rejected: busy")
                self._answer(partner, kind, _ERROR)
                return
        if kind not in ROOM:
            self._say(f"Mission upload rejected: type {kind}")
            self._answer(partner, kind, dialect.MAV_MISSION_INVALID)
        elif message.count > ROOM[kind]:
            self._say(f"Mission upload rejected: {message.count} items, room for {ROOM[kind]}")
            self._answer(partner, kind, dialect.MAV_MISSION_NO_SPACE)
        elif message.count == 0:
            self._transfer = None
            self._store(kind, [])
            self._answer(partner, kind, _ACCEPTED)
        else:
            self._received = []
            self._transfer = Transfer(partner, kind, message.count, True, self._now_ns, self._now_ns)
            self._ask(self._transfer)

    def _ask(self, transfer: Transfer) -> None:
        transfer.sent_ns = self._now_ns
        self._outbox.send(dialect.MAVLink_mission_request_int_message, *transfer.partner, transfer.next, transfer.kind)

    def _item(self, message: Any) -> None:
        partner, transfer = _sender(message), self._transfer
        if transfer is None:
            self._answer_late_item(message, partner)
            return
        if partner != transfer.partner or not transfer.upload or message.mission_type != transfer.kind:
            self._answer(partner, message.mission_type, _ERROR)
            return
        transfer.heard_ns = self._now_ns
        if message.seq != transfer.next:
            return
        try:
            check(message, self._origin)
        except ItemError as error:
            self._say(f"Mission item {message.seq} rejected: command {message.command}, frame {message.frame}")
            self._answer(partner, transfer.kind, error.args[0])
            self._transfer = None
            return
        self._received.append(message)
        transfer.next += 1
        if transfer.next < transfer.count:
            self._ask(transfer)
            return
        result = _ACCEPTED if self._store(transfer.kind, self._received) else _ERROR
        self._transfer, self._complete = None, (transfer, result)
        self._answer(partner, transfer.kind, result)

    def _answer_late_item(self, message: Any, partner: tuple[int, int]) -> None:
        """The last item once more: its answer was lost. Any other one belongs to no transfer."""
        if self._complete is not None:
            done, result = self._complete
            last = done.partner, done.kind, done.count - 1
            if (partner, message.mission_type, message.seq) == last:
                self._answer(partner, done.kind, result)
                return
        self._say("Mission item ignored: no transfer")
        self._answer(partner, message.mission_type, _ERROR)

    def _store(self, kind: int, messages: list[Any]) -> bool:
        """Put an upload into effect; False if its items don't belong together. The same once more changes nothing."""
        flight = self._flight
        if kind == dialect.MAV_MISSION_TYPE_MISSION:
            if _digest(messages) != _digest(self._stored[kind]) or not messages:
                flight.mission.load(tuple(to_item(message, self._origin) for message in messages))
                current = next((message.seq for message in messages if message.current), 0)
                flight.mission.go_to(current)
                self._said_current = None
        elif kind == dialect.MAV_MISSION_TYPE_FENCE:
            try:
                flight.limits.zones = zones(messages, self._origin)
            except ItemError:
                self._say("Fence rejected: a polygon is cut off")
                return False
        else:
            flight.limits.rally = tuple(placed(message, self._origin) for message in messages)
        self._stored[kind] = messages
        return True

    # --- download ---

    def _list(self, message: Any) -> None:
        partner, kind, transfer = _sender(message), message.mission_type, self._transfer
        if kind not in ROOM:
            self._answer(partner, kind, dialect.MAV_MISSION_UNSUPPORTED)
            return
        others = transfer is not None and (transfer.upload or (transfer.partner, transfer.kind) != (partner, kind))
        if transfer is not None and others and not transfer.is_over:
            self._say("Mission download rejected: busy")
            self._answer(partner, kind, _ERROR)
            return
        count = len(self._stored[kind])
        self._transfer = Transfer(partner, kind, count, False, self._now_ns, self._now_ns) if count else None
        self._outbox.send(dialect.MAVLink_mission_count_message, *partner, count, kind)

    def _request(self, message: Any) -> None:
        partner, transfer = _sender(message), self._transfer
        if transfer is None or transfer.upload or partner != transfer.partner or message.mission_type != transfer.kind:
            self._answer(partner, message.mission_type, _ERROR)
            return
        transfer.heard_ns = self._now_ns
        if message.seq not in (transfer.next, transfer.next - 1) or not 0 <= message.seq < transfer.count:
            self._say(f"Mission item {message.seq} was not expected to be requested")
            self._answer(partner, transfer.kind, _ERROR)
            self._transfer = None
            return
        transfer.next = message.seq + 1
        whole = message.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_REQUEST_INT
        self._send_item(partner, self._stored[transfer.kind][message.seq], whole=whole)

    def _send_item(self, partner: tuple[int, int], item: Any, *, whole: bool) -> None:
        """As it was uploaded, in the form (with whole or real numbers) that is asked for."""
        x, y, was_whole = item.x, item.y, item.get_msgId() == dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT
        if was_whole != whole:
            convert, scale = (as_whole, 1e7) if whole else (as_real, 1e-7)
            x, y = (convert(value, scale if item.frame in ON_EARTH else 1.0) for value in (x, y))
        self._outbox.send(
            dialect.MAVLink_mission_item_int_message if whole else dialect.MAVLink_mission_item_message,
            *partner,
            item.seq,
            item.frame,
            item.command,
            int(item.mission_type == 0 and item.seq == self._flight.mission.current),
            item.autocontinue,
            *params_of(item),
            x,
            y,
            item.z,
            item.mission_type,
        )

    # --- the rest ---

    def _ack(self, message: Any) -> None:
        """The end of a download, or of a transfer that the other side cancels."""
        transfer = self._transfer
        if transfer is None or _sender(message) != transfer.partner:
            return
        if not transfer.upload or message.type == dialect.MAV_MISSION_OPERATION_CANCELLED:
            self._transfer = None

    def _clear(self, message: Any) -> None:
        kind = message.mission_type
        if self._transfer is not None and not self._transfer.is_over:
            self._say("Mission clear rejected: busy")
            self._answer(_sender(message), kind, _ERROR)
            return
        self._transfer = None  # of what is gone no item is left to be requested again
        kinds = list(ROOM) if kind == dialect.MAV_MISSION_TYPE_ALL else [kind]
        for each in kinds:
            if each in ROOM:
                self._store(each, [])
        self._answer(_sender(message), kind, _ACCEPTED if kinds[0] in ROOM else dialect.MAV_MISSION_UNSUPPORTED)

    def _set_current(self, message: Any) -> None:
        if not self._flight.mission.go_to(message.seq):
            self._say(f"Mission item {message.seq} is not in the list")
        self._send_current()

    def _answer(self, partner: tuple[int, int], kind: int, result: int) -> None:
        self._outbox.send(dialect.MAVLink_mission_ack_message, *partner, result, kind)

    def _say(self, text: str) -> None:
        self._flight.announce(Severity.CRITICAL, text)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _digest(messages: list[Any]) -> int:
    return zlib.crc32(
        repr([(m.command, m.frame, *params_of(m), m.x, m.y, m.z, m.autocontinue) for m in messages]).encode()
    )
