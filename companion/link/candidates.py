"""Who may be the vehicle, where anybody can send to the companion's address and there is no key."""

from typing import Any

from companion.link.firmware import firmware_of
from protocol.framing import Frame, Framer
from protocol.messages import decode, dialect

VEHICLE_COMPONENT = 1
"""MAV_COMP_ID_AUTOPILOT1, the component that flies."""
_HEARTBEAT = dialect.MAVLINK_MSG_ID_HEARTBEAT
_ENOUGH = 3
"""Heartbeats of one sender from one address, of one make of vehicle and in one version of MAVLink."""
_MOST = 32
"""Candidates at a time; the one that has waited longest gives way."""


def may_be_vehicle(frame: Frame, wanted: int | None) -> Any | None:
    """The message, if this is the heartbeat of an autopilot that is known, of the system that is `wanted` (None: any).
    No vehicle is system 0, which addresses all systems."""
    if frame.message_id != _HEARTBEAT or frame.component != VEHICLE_COMPONENT or frame.system == 0:
        return None
    if wanted is not None and frame.system != wanted:
        return None
    heartbeat: Any = decode(frame)
    return None if firmware_of(heartbeat.autopilot) is None else heartbeat


class Candidates:
    """Those who have said that they are a vehicle."""

    def __init__(self, wanted: int | None) -> None:
        self._wanted = wanted
        self._heard: dict[tuple[str, int], tuple[tuple[int, int, int], int]] = {}
        """By address and system: version, make and type, and how often these came in a row."""

    def admits(self, address: str, datagram: bytes) -> bool:
        """Take a datagram; whether its sender is the vehicle from now on."""
        return any(self._admits(address, frame) for frame in Framer().datagram(datagram))

    def _admits(self, address: str, frame: Frame) -> bool:
        heartbeat = may_be_vehicle(frame, self._wanted)
        if heartbeat is None:
            return False
        who, claim = (address, frame.system), (frame.version, heartbeat.autopilot, heartbeat.type)
        before, count = self._heard.get(who, (claim, 0))
        if who not in self._heard and len(self._heard) >= _MOST:
            del self._heard[next(iter(self._heard))]
        count = count + 1 if before == claim else 1
        self._heard[who] = claim, count
        return count >= _ENOUGH
