"""The download of the mission that a vehicle has stored, by MAVLink's mission protocol: each item is asked for, and
asked for again until it comes.

Protocol: https://mavlink.io/en/services/mission.html#download_mission
"""

from typing import Any

from companion.outputs import Message
from protocol.messages import dialect

INTERVAL_NS = 1_000_000_000
"""Between two questions for the same thing."""
TRIES = 6
_MISSION = dialect.MAV_MISSION_TYPE_MISSION
_LATE = frozenset({dialect.MAV_MISSION_ACCEPTED, dialect.MAV_MISSION_INVALID_SEQUENCE})
"""Answers to a question that was asked twice."""


class MissionDownload:
    """One download. `ask` and `take` are called in turn until it is `over`."""

    def __init__(self) -> None:
        self.items: list[Any] = []
        """MISSION_ITEM_INT (73), in order."""
        self.count: int | None = None
        self.fault = ""
        """Why there is no mission, in words."""
        self.over = False
        self._tries, self._asked_ns = 0, -INTERVAL_NS

    def ask(self, now_ns: int, target: tuple[int, int]) -> Message | None:
        """What is to be sent to the vehicle (system, component) now."""
        if self.over:
            return None
        if self.fault or len(self.items) == self.count:
            self.over = True
            result = dialect.MAV_MISSION_OPERATION_CANCELLED if self.fault else dialect.MAV_MISSION_ACCEPTED
            return dialect.MAVLink_mission_ack_message, (*target, result, _MISSION)
        if now_ns - self._asked_ns < INTERVAL_NS:
            return None
        if self._tries == TRIES:
            what = "for its mission" if self.count is None else f"for item {len(self.items)} of its {self.count}"
            self.fault = f"the vehicle did not answer, asked {TRIES} times {what}"
            return self.ask(now_ns, target)
        self._tries, self._asked_ns = self._tries + 1, now_ns
        if self.count is None:
            return dialect.MAVLink_mission_request_list_message, (*target, _MISSION)
        return dialect.MAVLink_mission_request_int_message, (*target, len(self.items), _MISSION)

    def take(self, message: Any) -> None:
        """A message of the vehicle's to this companion; what is no part of the download is ignored."""
        kind = message.get_msgId()
        if self.over or self.fault or getattr(message, "mission_type", None) != _MISSION:
            return
        if kind == dialect.MAVLINK_MSG_ID_MISSION_COUNT and self.count is None:
            self.count = message.count
            self._go_on()
            if message.count == 0:
                self.fault = "the vehicle has no mission stored"
        elif kind == dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT and self.count is not None:
            if message.seq == len(self.items) < self.count:
                self.items.append(message)
                self._go_on()
        elif kind == dialect.MAVLINK_MSG_ID_MISSION_ACK and message.type not in _LATE:
            known = dialect.enums["MAV_MISSION_RESULT"].get(message.type)
            self.fault = f"the vehicle does not give its mission: {known.name if known else message.type}"

    def _go_on(self) -> None:
        self._tries, self._asked_ns = 0, -INTERVAL_NS
