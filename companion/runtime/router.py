"""Ground stations beside the flight: what the vehicle and the companion say goes to them, and what they say goes to the
vehicle, by MAVLink's rules (https://mavlink.io/en/guide/routing.html).

The loop hands over bytes and goes on. All else is done once a tick, after the setpoint has left, and is bounded: so
many datagrams and bytes of each station, and none of it waits.

With a key, a station's frames are verified before anything is made of them, and all frames go on with the signature of
their sender. So no station speaks to the vehicle in the companion's name, and no frame exists with two signatures, of
which a listener could send one after the other.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence

from companion.link.telemetry import FLOWN_BY
from protocol.framing import Frame, Framer
from protocol.guarded_link import GuardedLink, drain, forward
from protocol.messages import decoder_of, dialect
from protocol.routing import NOBODYS, Sender, is_for, learn, target_of
from protocol.transport import Transport, TransportError

_MOST_READS = 4
"""Datagrams of a station that are taken at a tick; the others wait in its socket, or are lost there."""
_LONGEST_WAIT_NS = 1_000_000_000
_MOST_HELD = 1 << 16
"""What a station sends beyond its share waits so long, and is so many bytes; then all that waits is dropped. A command
that comes late is worse than none: its sender has asked again, or changed its mind."""
_BURST_S = 0.5
"""So much of a second's bytes may come at once."""
_MOST_WAITING = 1 << 16
"""Bytes of the vehicle that wait for the next tick; what comes beyond is not sent on."""
_DATAGRAM = 1200
"""Bytes; passes any network whole."""
_REOPEN_NS = 1_000_000_000
_COMMANDS = (dialect.MAVLINK_MSG_ID_COMMAND_LONG, dialect.MAVLINK_MSG_ID_COMMAND_INT)
_STREAMS: dict[int, int] = {
    dialect.MAV_DATA_STREAM_ALL: dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    dialect.MAV_DATA_STREAM_POSITION: dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    dialect.MAV_DATA_STREAM_EXTRA3: dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR,
}
"""A message that is flown by, in each of ArduPilot's streams that has one."""
STATION_BYTES_PER_S = 20_000.0
"""What each station may send to the vehicle: more than parameters, missions and RTK corrections take."""


class Station:
    """A ground station's link. `open_again`: of one that waits to be called, for when its caller has left."""

    def __init__(self, url: str, transport: Transport, open_again: Callable[[], Transport] | None = None) -> None:
        self.url = url
        self.seen: set[Sender] = set()
        """Who is behind it."""
        self._transport: Transport | None = transport
        self._whole = transport.preserves_datagrams
        self._open_again = open_again
        self._framer = Framer()
        self._allowance = 0.0
        """Bytes that may be sent on now."""
        self._bytes_per_s = 0.0
        self._held: deque[tuple[int, bytes]] = deque()
        """When what waits for that was taken (ns), and its bytes."""
        self._held_bytes = 0
        self._drops = self._retunes = False
        self._waiting: list[bytes] = []
        self._reopen_ns = 0
        self.trouble: str | None = None
        """What went wrong, until somebody has been told."""

    @property
    def address(self) -> str:
        """The station's address, or its URL while nobody is there."""
        return (self._transport.peer if self._transport is not None else "") or self.url

    def grant(self, seconds: float, bytes_per_s: float) -> None:
        """Time has passed."""
        self._bytes_per_s = bytes_per_s
        self._allowance = min(self._allowance + seconds * bytes_per_s, _BURST_S * bytes_per_s)

    def drain(self) -> None:
        """What has queued up before the flight, or in a gap of it, is old, and no command any more."""
        try:
            if self._transport is not None:
                drain(self._transport)
        except TransportError as error:
            self._gone(error)
        self._forget()

    def frames(self, now_ns: int) -> list[Frame]:
        """What it has sent, as much as it is allowed to."""
        found: list[Frame] = []
        end: TransportError | None = None
        if self._transport is None:
            self._reopen(now_ns)
        try:
            self._take(now_ns)
        except TransportError as error:
            end = error
        self._drop(now_ns)
        while self._held and self._allowance > 0.0:
            _, data = self._held.popleft()
            self._held_bytes -= len(data)
            self._allowance -= len(data)
            found += self._framer.datagram(data) if self._whole else self._framer.feed(data)
        if end is not None:
            self._gone(end)
        return found

    def _take(self, now_ns: int) -> None:
        """Whether it may be sent on or not: what is left in the socket grows old unseen. Raises TransportError."""
        for _ in range(_MOST_READS):
            data = None if self._transport is None else self._transport.receive(0.0)
            if data is None:
                return
            if isinstance(self._transport, GuardedLink):
                data = self._transport.heard  # with its senders' signatures, for the vehicle to verify
            self._held.append((now_ns, data))
            self._held_bytes += len(data)

    def _drop(self, now_ns: int) -> None:
        """What has come too late, with all behind it."""
        if not self._held or (now_ns - self._held[0][0] <= _LONGEST_WAIT_NS and self._held_bytes <= _MOST_HELD):
            return
        self._forget()
        if not self._drops:
            self._drops = True
            self.trouble = (
                f"ground station {self.url} sends more than the {self._bytes_per_s:.0f} bytes a second that go to the "
                "vehicle: what would come late is dropped"
            )

    def _forget(self) -> None:
        self._held.clear()
        self._held_bytes = 0
        self._framer = Framer()  # of a stream, what has begun has no end any more

    def retunes(self, message_id: int) -> None:
        """It has asked for another rate of a message that is flown by, in vain."""
        if not self._retunes:
            self._retunes = True
            name = dialect.mavlink_map[message_id].msgname
            self.trouble = f"ground station {self.url} asks for another rate of {name}: not passed on, it is flown by"

    def queue(self, raw: bytes) -> None:
        """A frame for it."""
        self._waiting.append(raw)

    def flush(self) -> None:
        """Send what waits for it."""
        if not self._waiting:
            return
        try:
            for datagram in packed(self._waiting):
                if self._transport is not None:
                    forward(self._transport, datagram)
        except TransportError as error:
            self._gone(error)
        self._waiting.clear()

    def close(self) -> None:
        """Release its address."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def _gone(self, error: Exception) -> None:
        self.trouble = f"ground station {self.url} is gone: {error}"
        self.close()
        self.seen.clear()
        self._forget()

    def _reopen(self, now_ns: int) -> None:
        if self._open_again is None or now_ns < self._reopen_ns:
            return
        self._reopen_ns = now_ns + _REOPEN_NS
        try:
            self._transport = self._open_again()
        except TransportError:  # it is tried again
            self._transport = None


class Router:
    """Stations on one side, the vehicle and the companion on the other."""

    def __init__(
        self,
        stations: Sequence[Station],
        *,
        link: Transport | None = None,
        whole: bool = True,
        bytes_per_s: float = STATION_BYTES_PER_S,
    ) -> None:
        """`link`: the vehicle's."""
        self.stations = tuple(stations)
        self.bytes_per_s = bytes_per_s
        """What each station may send."""
        self._link = link if isinstance(link, GuardedLink) else None
        self._whole = whole
        """The vehicle's transport keeps datagrams apart."""
        self._vehicle: set[Sender] = set()
        """Who has been heard on the vehicle's link."""
        self._own: set[Sender] = set()
        self._vehicle_framer, self._own_framer = Framer(), Framer()
        self._waiting: list[tuple[Framer, bytes]] = []
        self._waiting_bytes = 0
        self._last_ns: int | None = None
        self.left_out = 0
        """Bytes that no station was sent, since too many came at once."""

    def begin(self) -> None:
        """The flight begins, or goes on after a gap."""
        for station in self.stations:
            station.drain()

    def heard(self, data: bytes) -> None:
        """The vehicle has sent this."""
        self._keep(self._vehicle_framer, data if self._link is None else self._link.heard)

    def said(self, data: bytes) -> None:
        """The companion has sent this to the vehicle."""
        self._keep(self._own_framer, data if self._link is None else self._link.said)

    def _keep(self, framer: Framer, data: bytes) -> None:
        if self._waiting_bytes + len(data) > _MOST_WAITING:
            self.left_out += len(data)
            return
        self._waiting_bytes += len(data)
        self._waiting.append((framer, data))

    def pump(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Send on what has come, to the stations; for the vehicle, a station's address and its bytes."""
        for framer, data in self._waiting:
            own = framer is self._own_framer
            senders = self._own if own else self._vehicle
            for frame in framer.datagram(data) if own or self._whole else framer.feed(data):
                learn(senders, frame)
                self._to_stations(frame, None)
        self._waiting.clear()
        self._waiting_bytes = 0
        seconds = 0.0 if self._last_ns is None else max(now_ns - self._last_ns, 0) * 1e-9
        self._last_ns = now_ns
        if seconds * 1e9 > _LONGEST_WAIT_NS:  # the loop stood still
            self.begin()
        for_vehicle: list[tuple[str, bytes]] = []
        for station in self.stations:
            station.grant(seconds, self.bytes_per_s)
            frames = [frame.raw for frame in station.frames(now_ns) if self._from_station(frame, station)]
            for_vehicle += [(station.address, datagram) for datagram in packed(frames)]
        for station in self.stations:
            station.flush()
        return for_vehicle

    def _from_station(self, frame: Frame, station: Station) -> bool:
        """Send it on to the other stations that it is for; whether it is for the vehicle."""
        sender = frame.system, frame.component
        if sender in self._own or (sender[1] == dialect.MAV_COMP_ID_AUTOPILOT1 and sender in self._vehicle):
            return False  # what we sent it comes back, or somebody plays the vehicle
        learn(station.seen, frame)
        self._to_stations(frame, station)
        target = target_of(frame)
        if frame.message_id in NOBODYS or target in self._own or not is_for(target, self._vehicle):
            return False
        retuned = retuned_by(frame)
        if retuned in FLOWN_BY:  # half a second without it ends the flight
            station.retunes(retuned)
            return False
        return True

    def _to_stations(self, frame: Frame, origin: Station | None) -> None:
        if frame.message_id in NOBODYS:
            return
        target, sender = target_of(frame), (frame.system, frame.component)
        ours = origin is None and sender in self._own  # even to where another one has spoken in our name
        for station in self.stations:
            if station is not origin and (ours or sender not in station.seen) and is_for(target, station.seen):
                station.queue(frame.raw)

    def troubles(self) -> list[str]:
        """What has gone wrong since the last call."""
        found = [station.trouble for station in self.stations if station.trouble is not None]
        for station in self.stations:
            station.trouble = None
        return found

    def close(self) -> None:
        """Release all addresses."""
        for station in self.stations:
            station.close()


def retuned_by(frame: Frame) -> int:
    """A message (id) whose rate this sets, one that is flown by if there is any; -1 if it sets none."""
    if frame.message_id == dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM:
        return _STREAMS.get(decoder_of(frame.message_id)(frame).req_stream_id, -1)
    if frame.message_id not in _COMMANDS:
        return -1
    command = decoder_of(frame.message_id)(frame)
    if command.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL or not math.isfinite(command.param1):
        return -1
    return int(command.param1)


def packed(frames: Sequence[bytes]) -> list[bytes]:
    """The frames in their order, in datagrams that pass any network whole."""
    datagrams: list[bytes] = []
    part: list[bytes] = []
    size = 0
    for frame in frames:
        if part and size + len(frame) > _DATAGRAM:
            datagrams.append(b"".join(part))
            part, size = [], 0
        part.append(frame)
        size += len(frame)
    return [*datagrams, b"".join(part)] if part else datagrams
