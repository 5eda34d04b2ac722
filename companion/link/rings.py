"""Rings of ranges around the vehicle: from its autopilot, from another component of its system, or from a sensor on a
link of its own."""

from collections.abc import Callable
from enum import IntEnum
from typing import Any

from companion.link import wire_ranges
from companion.link.sector_scans import SectorScans
from companion.reports import RangeBelow
from companion.state import Scan
from protocol.framing import Frame, Framer
from protocol.messages import decode, dialect
from protocol.peer import Peer

OBSTACLE_DISTANCE: int = dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE
DISTANCE_SENSOR: int = dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR
RING_MESSAGES = frozenset({OBSTACLE_DISTANCE, DISTANCE_SENSOR})
_PROXIMITY: int = dialect.MAV_SYS_STATUS_SENSOR_PROXIMITY
_CLOCK_JUMP_NS = 1_000_000_000
_DRIFT_GAIN = 0.001


class Source(IntEnum):
    """Who sends a ring; a greater one is believed rather."""

    AUTOPILOT = 0
    COMPONENT = 1
    """Component of the vehicle's system."""
    SENSOR_LINK = 2


class ArrivalClock:
    """A sender's clock, known by when its messages arrive: the one that took least time sets it, and is forgotten
    slowly, since clocks drift."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def measured_ns(self, sent_ns: int, now_ns: int) -> int:
        """When it was `sent_ns` there, on the clock of `now_ns`, at which the message arrived."""
        offset_ns = now_ns - sent_ns
        if self._offset_ns is None or abs(offset_ns - self._offset_ns) > _CLOCK_JUMP_NS or offset_ns < self._offset_ns:
            self._offset_ns = offset_ns
        else:
            self._offset_ns += round((offset_ns - self._offset_ns) * _DRIFT_GAIN)
        return sent_ns + self._offset_ns


class Rings:
    """Scans of the best source that has spoken so far: when it falls silent, no other one takes its place, and the
    flight ends as without any."""

    def __init__(self, count: Callable[[int, int], None]) -> None:
        self._count = count
        self.framer = Framer()
        """Reads the sensor's own link."""
        self.silent_when_free = False
        """The vehicle sends no sector while all of them are empty."""
        self._sectors = [SectorScans() for _ in Source]
        self._clocks = [ArrivalClock() for _ in Source]
        self._best = Source.AUTOPILOT, False
        """The source, and whether it has sent a whole ring: its sectors are not needed any more."""
        self._last_us = [0 for _ in Source]

    @property
    def whole(self) -> bool:
        """Rings come as OBSTACLE_DISTANCE."""
        return self._best[1]

    @property
    def parts(self) -> tuple[int, ...]:
        """The messages that tell as much as an OBSTACLE_DISTANCE."""
        return (DISTANCE_SENSOR, dialect.MAVLINK_MSG_ID_SYS_STATUS) if self.silent_when_free else (DISTANCE_SENSOR,)

    def of_others(self, frame: Frame, source: Source, peer: Peer | None, now_ns: int) -> Scan | RangeBelow | None:
        """The scan of a sensor that is not the autopilot's; None of other messages. Raises RefusedError."""
        return self.take(decode(frame), source, peer, now_ns) if frame.message_id in RING_MESSAGES else None

    def take(self, message: Any, source: Source, peer: Peer | None, now_ns: int) -> Scan | RangeBelow | None:
        """The scan that an OBSTACLE_DISTANCE is, or that a DISTANCE_SENSOR completes; what one that looks down has
        measured, if it is the autopilot's: others have clocks of their own. None before the vehicle, `peer`, is found.
        Raises RefusedError."""
        if peer is None:
            return None
        if message.get_msgId() == OBSTACLE_DISTANCE:
            return self._whole(message, source, peer, now_ns)
        below = wire_ranges.range_below(message)
        if below is not None:
            return below if source is Source.AUTOPILOT else None
        if self._best > (source, False) or (self.whole and source is not Source.SENSOR_LINK):
            return None  # a sector of somebody is no ring of the vehicle's; whoever has a link of its own was asked for
        sector = wire_ranges.sector_distance(message)
        if sector is None:
            return None
        if sector.known:
            self._best = source, False
        return self._counted(self._sectors[source].add(sector, now_ns, peer.lost), source, peer, now_ns)

    def _whole(self, message: Any, source: Source, peer: Peer, now_ns: int) -> Scan | None:
        scan = wire_ranges.obstacle_distance(message, now_ns)
        if self._best[0] > source:
            return None
        if scan.known.any():
            self._best = source, True
        if source is not Source.AUTOPILOT:
            return self._counted(scan, source, peer, now_ns)
        return scan if scan.boot_time_us else self._related(scan, source, peer, now_ns)

    def _counted(self, scan: Scan | None, source: Source, peer: Peer, now_ns: int) -> Scan | None:
        """A scan that is no OBSTACLE_DISTANCE of the autopilot's, and does in the place of one."""
        if scan is not None:
            self._count(OBSTACLE_DISTANCE, now_ns)
            if source is not Source.AUTOPILOT:
                scan = self._related(scan, source, peer, now_ns)
        return scan

    def _related(self, scan: Scan, source: Source, peer: Peer, now_ns: int) -> Scan | None:
        """The scan of a sensor with a clock of its own, on the vehicle's; None of one that is sent once more."""
        sent_us, measured_ns = scan.boot_time_us, now_ns
        if sent_us:  # 0: the sender has no clock
            if sent_us == self._last_us[source]:
                return None
            measured_ns = self._clocks[source].measured_ns(sent_us * 1000, now_ns)
        self._last_us[source] = sent_us
        return Scan(now_ns, _vehicle_us(peer, measured_ns), scan.bearings_frd, scan.ranges_m, scan.hit, scan.known)

    def silent(self, message: Any, peer: Peer, now_ns: int) -> Scan | None:
        """The scan that nothing is around, of a vehicle that says so by silence: its SYS_STATUS calls the sensor
        healthy, and no sector comes."""
        if not self.silent_when_free:
            return None
        said = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        if not said & message.onboard_control_sensors_health & _PROXIMITY or self._best != (Source.AUTOPILOT, False):
            return None
        scan = self._sectors[Source.AUTOPILOT].free(_vehicle_us(peer, now_ns), now_ns, peer.lost)
        return self._counted(scan, Source.AUTOPILOT, peer, now_ns)


def _vehicle_us(peer: Peer, time_ns: int) -> int:
    """A time on the vehicle's clock; while that is not known, the vehicle's latest."""
    if peer.offset_ns is not None:
        return max((time_ns + peer.offset_ns) // 1000, 0)
    return (peer.boot_time_ms or 0) * 1000
