"""What goes out: the links of the vehicle, each with its own sequence numbers and streams, and what services send."""

from collections.abc import Callable, Iterator
from typing import Any

from protocol.framing import Frame, Framer
from protocol.messages import Encoder
from protocol.routing import NOBODYS, Sender, is_for, learn
from vehicle_sim.services.identity import COMPONENT
from vehicle_sim.services.telemetry import Telemetry

Payload = tuple[type[Any], bytes]
"""A message's class and its packed fields."""

_PACED_PER_TICK = 2
"""Messages at most of each long answer, 500 a second: PX4 sends parameters about as fast over UDP."""
_MOST_FORWARDED = 1 << 16
"""Bytes from other links that wait for the next tick."""


class Channel:
    """The vehicle's side of one link. `datagrams`: the bytes that come hold whole frames."""

    def __init__(self, encoder: Encoder, telemetry: Telemetry, *, datagrams: bool) -> None:
        self.encoder = encoder
        self.telemetry = telemetry
        self.heard: set[Sender] = set()
        """Who is at the other end."""
        self._framer = Framer()
        self._datagrams = datagrams
        self._frames: list[bytes] = []
        self._paced: dict[object, Iterator[Payload]] = {}
        self._forwarded_bytes = 0

    def frames(self, data: bytes) -> list[Frame]:
        """The frames in what came."""
        return self._framer.datagram(data) if self._datagrams else self._framer.feed(data)

    def append(self, frames: bytes) -> None:
        """Add frames that are already encoded, in the order of their sequence numbers."""
        self._frames.append(frames)

    def forward(self, raw: bytes) -> None:
        """Add a frame of another sender; what is too much is dropped."""
        if self._forwarded_bytes < _MOST_FORWARDED:
            self._forwarded_bytes += len(raw)
            self._frames.append(raw)

    def pace(self, key: object, answer: Iterator[Payload]) -> None:
        self._paced[key] = answer

    def take(self) -> list[bytes]:
        """What is to be sent at this tick."""
        for key, answer in list(self._paced.items()):
            for _ in range(_PACED_PER_TICK):
                payload = next(answer, None)
                if payload is None:
                    del self._paced[key]
                    break
                self._frames.append(self.encoder.encode_payload(*payload))
        frames, self._frames = self._frames, []
        self._forwarded_bytes = 0
        return frames


class Outbox:
    """What services send goes to the link whose message they handle, and at other times to all."""

    def __init__(self) -> None:
        self.channels: list[Channel] = []
        self._answering: Channel | None = None

    def answer(self, channel: Channel | None) -> None:
        """From now on the services handle this link's message; None: nobody's."""
        self._answering = channel

    @property
    def here(self) -> Channel:
        """The link whose message is handled, by default the first."""
        return self._answering or self.channels[0]

    @property
    def streams(self) -> Telemetry:
        """Those of that link."""
        return self.here.telemetry

    def _receivers(self, *, to_all: bool) -> list[Channel]:
        return self.channels if to_all or self._answering is None else [self._answering]

    def send(self, message_class: type[Any], *fields: Any, to_all: bool = False) -> None:
        """Encode a message from the arguments of its constructor."""
        for channel in self._receivers(to_all=to_all):
            channel.append(channel.encoder.encode_fields(message_class, *fields))

    def put(self, payload: Payload, *, to_all: bool = False) -> None:
        """The same from packed fields."""
        for channel in self._receivers(to_all=to_all):
            channel.append(channel.encoder.encode_payload(*payload))

    def pace(self, key: object, answer: Iterator[Payload]) -> None:
        """Send a long answer, some messages a tick; it takes the place of an unfinished one of the same key."""
        self.here.pace(key, answer)

    def pace_to_all(self, tell: Callable[[], Iterator[Payload]]) -> None:
        """Send something long to each link, some messages a tick, beside all else that is under way."""
        for channel in self.channels:
            channel.pace(object(), tell())

    def forward(self, frame: Frame, target: Sender, system: int) -> None:
        """Hand a frame of the link that is answered on to others, by MAVLink's rules. Nobody may speak as the
        vehicle."""
        learn(self.here.heard, frame)
        if frame.message_id in NOBODYS or (frame.system, frame.component) == (system, COMPONENT):
            return
        for channel in self.channels:
            if channel is not self.here and is_for(target, channel.heard):
                channel.forward(frame.raw)
