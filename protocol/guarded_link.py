"""A transport behind which nothing is seen that was refused: forged frames, keys, senders that are not the peer.

With a key, what `receive` returns are the verified frames without their signatures, and `send` signs. Verification sits
here, in front of the log and of all else, since it needs the wall's clock and a file: the frames that pass are the
events, the log holds them as plain frames, and a replay needs neither key nor clock to come out the same to the byte.
No signature and no key (SETUP_SIGNING) reaches a log. What is sent on between links keeps its sender's signature (see
`forward`): a signature of ours under others' frames would make copies that pass as new.
"""

import re
from collections.abc import Callable
from ipaddress import ip_address

from protocol.framing import Frame, Framer
from protocol.key_files import Keeper
from protocol.routing import Sender
from protocol.signing import IN_WORDS, REFUSED, Refusal, unsigned
from protocol.transport import Serial, Tcp, Transport, TransportError, Udp

SETUP_SIGNING = 256
_gives_key = re.compile(rb"\xfd.{6}\x00\x01\x00", re.DOTALL).search
_MOST_REFUSED = 8
"""Datagrams in one call of `receive`: a flood must not hold up the loop."""
_MOST_DRAINED = 3_000
"""Reads: more than a socket's buffer has room for. Who sends on and on holds up nobody for long."""


def refuse_exposed(url: str, *, signed: bool, insecure: bool) -> None:
    """Raises TransportError for an address that others than this machine's users can send to, without a key.

    One that is not written as an address is left to `open_url`, which says how it is written."""
    scheme, _, rest = url.partition(":")
    host = rest.rpartition(":")[0]
    written = host != "" and ":" not in host and not rest.startswith("//")
    if signed or insecure or not written or scheme not in ("udpin", "tcpin") or is_local(url):
        return
    raise TransportError(
        f"{url}: who can reach this machine could command the vehicle. Give both sides a key (companion key FILE, then "
        "--signing-key FILE), or bind to 127.0.0.1; --insecure only on a network that nobody else can write to"
    )


def is_local(url: str) -> bool:
    """Both ends are on this machine."""
    scheme, _, rest = url.partition(":")
    host = rest.rpartition(":")[0]
    try:
        return scheme != "serial" and (host == "localhost" or ip_address(host).is_loopback)
    except ValueError:
        return False  # a name, of whatever address


def inmost(link: Transport) -> Transport:
    """The transport itself."""
    return link.inner if isinstance(link, GuardedLink) else link


def forward(link: Transport, data: bytes) -> bytes:
    """Send another's frames with the signatures that they have; returns what a log may hold of them."""
    inmost(link).send(data)
    return b"".join(map(unsigned, Framer().datagram(data))) if isinstance(link, GuardedLink) and link.signed else data


def drain(link: Transport) -> None:
    """Take what has queued up, and drop it."""
    for _ in range(_MOST_DRAINED):
        if link.receive(0.0) is None and not stopped(link):
            return


def stopped(link: Transport) -> bool:
    """The last `receive` ended at its bound on what is refused, and not for want of data or time."""
    return isinstance(link, GuardedLink) and link.stopped


def news(link: Transport) -> list[str]:
    """What is to be told of a link."""
    return link.news() if isinstance(link, GuardedLink) else []


def refused_with(keeper: Keeper | None) -> dict[str, int]:
    """Frames that were refused, by reason, of all links of a key; empty without one."""
    counts = {} if keeper is None else keeper.signing.refused
    return {REFUSED + reason.value: count for reason, count in counts.items()}


class GuardedLink:
    """One link. Without a key it hands on what comes, except keys; those of a stream only where one comes in one piece.

    `admits`: whether a sender, by its address and this datagram, is the peer; until one is, nothing is sent or handed
    on, and from then on that address is locked. With a key there is no lock, since addresses can be forged: what
    is sent goes where the last verified frame came from, once it is locked, of those senders alone whom it was locked
    to; before the first, to whoever speaks, since a vehicle that does not know the time takes ours.
    """

    def __init__(
        self, inner: Transport, keeper: Keeper | None = None, admits: Callable[[str, bytes], bool] | None = None
    ) -> None:
        self.inner = inner
        self.preserves_datagrams = inner.preserves_datagrams
        self.heard = b""
        """What the last `receive` returned, with signatures."""
        self.said = b""
        """What the last `send` was given, with signatures."""
        self.setup: Frame | None = None
        """The last SETUP_SIGNING; whoever takes it sets it to None."""
        self.stopped = False
        """The last `receive` ended at its bound; there may be more."""
        self._keeper = keeper
        self._admits = admits
        self._framer = Framer()
        self._verified_any = False
        self._senders: set[Sender] = set()
        """Whose the last verified frames are."""
        self._locked_to: set[Sender] = set()
        self._named: set[Refusal] = set()
        self._fault: str | None = None
        self._full = False

    @property
    def signed(self) -> bool:
        """There is a key."""
        return self._keeper is not None

    @property
    def bad_frames(self) -> int:
        """Pieces that were no frame; nobody behind the link sees them."""
        return self._framer.bad_frames

    @property
    def refused(self) -> dict[str, int]:
        """Frames by reason, of all links of the key; empty without one."""
        return refused_with(self._keeper)

    @property
    def peer(self) -> str:
        return "" if self._admits is not None else self.inner.peer

    def use(self, keeper: Keeper | None) -> None:
        """Sign and verify with this key from now on; None: without any."""
        self._keeper = keeper

    def receive(self, timeout_s: float) -> bytes | None:
        self.stopped = False
        for _ in range(_MOST_REFUSED):
            data = self.inner.receive(timeout_s)
            if data is None:
                return None
            timeout_s = 0.0
            if self._keeper is not None:
                data = self._verified(data, self._keeper)
            else:
                if _gives_key(data):
                    data = self._without_keys(data)
                self.heard = data
            if data and (self._admits is None or self._admit(self._admits, data)):
                if self._locked_to and self._locked_to.isdisjoint(self._senders) and isinstance(self.inner, Udp):
                    self.inner.turn_back()
                return data
            if isinstance(self.inner, Udp) and (self._keeper is None or self._verified_any):
                self.inner.turn_back()
        self.stopped = True
        return None

    def _verified(self, data: bytes, keeper: Keeper) -> bytes:
        now, accepts = keeper.now(), keeper.signing.accepts
        frames = self._framer.datagram(data) if self.preserves_datagrams else self._framer.feed(data)
        passed = [frame for frame in frames if accepts(frame, now) and not self._is_key(frame)]
        keeper.settle()
        self._verified_any = self._verified_any or bool(passed)
        self._senders = {(frame.system, frame.component) for frame in passed}
        self.heard = b"".join([frame.raw for frame in passed])
        return b"".join(map(unsigned, passed))

    def _without_keys(self, data: bytes) -> bytes:
        return b"".join([frame.raw for frame in Framer().datagram(data) if not self._is_key(frame)])

    def _is_key(self, frame: Frame) -> bool:
        if frame.message_id == SETUP_SIGNING:
            self.setup = frame
            return True
        return False

    def _admit(self, admits: Callable[[str, bytes], bool], data: bytes) -> bool:
        if not admits(self.inner.peer, data):
            return False
        self._admits = None
        self.lock()
        return True

    def send(self, data: bytes) -> None:
        if self._admits is not None:
            return
        if self._keeper is not None:
            data = self._keeper.signing.sign(data, self._keeper.now())
            self._keeper.settle()
        self.said = data
        self.inner.send(data)

    def news(self) -> list[str]:
        """What is to be told: the first refusal for each reason, trouble with the key's file, and a full line."""
        found = []
        if isinstance(self.inner, Tcp | Serial) and self.inner.dropped and not self._full:
            self._full = True
            found.append("the link takes no more: its send buffer is full, and what is sent meanwhile is lost")
        if self._keeper is None:
            return found
        for reason, count in self._keeper.signing.refused.items():
            if count and reason not in self._named:
                self._named.add(reason)
                found.append(f"a message was refused: {IN_WORDS[reason]}")
        if self._keeper.fault != self._fault:
            self._fault = self._keeper.fault
            found += [self._fault] if self._fault is not None else []
        return found

    def lock(self) -> None:
        if self._keeper is None:
            self.inner.lock()
        self._locked_to = self._senders

    def close(self) -> None:
        self.inner.close()
