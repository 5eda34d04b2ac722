"""The vehicle's links beside the first: any number of peers, which come and go, each with streams of its own."""

import logging
from collections.abc import Iterable
from dataclasses import dataclass

from protocol.framing import Frame
from protocol.guarded_link import GuardedLink
from protocol.key_files import Keeper
from protocol.listeners import Listener
from protocol.transport import Serial, Tcp, Transport, TransportError, Udp
from vehicle_sim.services.outbox import Channel
from vehicle_sim.services.profiles import Profile
from vehicle_sim.vehicle import Vehicle

SILENCE_S = 60.0
"""A peer that says nothing for so long has gone, unless its address was named."""

_log = logging.getLogger(__name__)
_MOST_LINKS = 32
_MOST_READS = 50
"""Datagrams of a link that are taken at once: a flood must not hold up the loop."""


@dataclass(eq=False, slots=True)
class Link:
    """One peer."""

    transport: GuardedLink
    channel: Channel
    heard_s: float
    named: bool


class Links:
    """`fixed` are there from the start, at `listeners` come others; each with the streams that it has at first.

    A link that fails is dropped, with a warning; the vehicle flies on.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        fixed: Iterable[tuple[Transport, Profile]],
        listeners: Iterable[tuple[Listener, Profile]],
        keeper: Keeper | None,
        now_s: float,
    ) -> None:
        self._vehicle = vehicle
        self._listeners = list(listeners)
        self._keeper = keeper
        self.setup: Frame | None = None
        """The last SETUP_SIGNING; whoever takes it sets it to None."""
        self.links: list[Link] = []
        for transport, profile in fixed:
            self._open(transport, profile, now_s, named=True)
        for listener, profile in self._listeners:
            for transport in listener.accept():
                self._open(transport, profile, now_s, named=True)

    @property
    def filenos(self) -> list[int]:
        """Readable when there is something to receive."""
        ends = (link.transport.inner for link in self.links)
        own = [end.fileno() for end in ends if isinstance(end, Udp | Tcp | Serial)]
        return own + [listener.fileno() for listener, _ in self._listeners]

    def use(self, keeper: Keeper | None) -> None:
        """Sign and verify with this key from now on."""
        self._keeper = keeper
        for link in self.links:
            link.transport.use(keeper)

    def _open(self, transport: Transport, profile: Profile, now_s: float, *, named: bool) -> None:
        if len(self.links) >= _MOST_LINKS:
            self._close(min(self.links, key=lambda link: (link.named, link.heard_s)))
        channel = self._vehicle.open_channel(profile, datagrams=transport.preserves_datagrams)
        self.links.append(Link(GuardedLink(transport, self._keeper), channel, now_s, named))

    def _close(self, link: Link) -> None:
        link.transport.close()
        self.links.remove(link)
        self._vehicle.close_channel(link.channel)

    def receive(self, now_s: float) -> bool:
        """Hand all that has come to the vehicle; False if nothing has."""
        for listener, profile in self._listeners:
            for transport in listener.accept():
                self._open(transport, profile, now_s, named=False)
        heard = False
        for link in list(self.links):
            try:
                for _ in range(_MOST_READS):
                    if not self._receive(link):
                        break
                    link.heard_s, heard = now_s, True
            except TransportError as error:
                self._fail(link, error)
            else:
                if not link.named and now_s - link.heard_s > SILENCE_S:
                    self._close(link)
        return heard

    def _receive(self, link: Link) -> bool:
        data = link.transport.receive(0.0)
        if link.transport.setup is not None:
            self.setup, link.transport.setup = link.transport.setup, None
        if data is None:
            return False
        self._vehicle.receive(data, link.channel)
        return True

    def send(self) -> None:
        """What the vehicle has to say at the end of a tick."""
        for link in list(self.links):
            try:
                for datagram in self._vehicle.collect(link.channel):
                    link.transport.send(datagram)
            except TransportError as error:
                self._fail(link, error)

    def _fail(self, link: Link, error: TransportError) -> None:
        _log.warning("%s", error)
        self._close(link)

    def close(self) -> None:
        """Release all addresses."""
        for link in list(self.links):
            self._close(link)
        for listener, _ in self._listeners:
            listener.close()
