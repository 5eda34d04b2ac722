"""Addresses at which any number of peers speak: each is a transport of its own."""

import collections
import contextlib
import select
import socket
from collections.abc import Sequence
from typing import Protocol

from protocol.transport import Tcp, Transport, TransportError

_LARGEST_DATAGRAM = 9216
_MOST_READ = 200
"""Datagrams or callers that are taken at once."""
_MOST_QUEUED = 400
"""Datagrams of a peer that wait to be taken; the oldest are lost then."""

Address = tuple[str, int]


def readable(filenos: Sequence[int], timeout_s: float) -> bool:
    """Wait until there is something to read on one of them."""
    return bool(select.select(filenos, [], [], timeout_s)[0])


class Listener(Protocol):
    """Where peers come from."""

    def fileno(self) -> int:
        """Readable when `accept` has something to do."""

    def accept(self) -> list[Transport]:
        """Take what has come, without waiting; the peers that are new."""

    def close(self) -> None:
        """Release the address."""


class UdpPeer:
    """Whoever sends from one address to a listener."""

    preserves_datagrams = True

    def __init__(self, listener: "UdpListener", address: Address) -> None:
        self._listener = listener
        self._address = address
        self.queued: collections.deque[bytes] = collections.deque(maxlen=_MOST_QUEUED)
        self.peer = f"{address[0]}:{address[1]}"

    def receive(self, timeout_s: float) -> bytes | None:
        """What the listener has taken; this does not wait."""
        return self.queued.popleft() if self.queued else None

    def send(self, data: bytes) -> None:
        self._listener.send(data, self._address)

    def lock(self) -> None:
        """It is one address from the start."""

    def close(self) -> None:
        self._listener.forget(self._address)


class UdpListener:
    """A bound UDP socket. `known`: an address that is a peer before it has spoken."""

    def __init__(self, host: str, port: int, known: Address | None = None) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._peers: dict[Address, UdpPeer] = {}
        self._new: list[Transport] = []
        try:
            self._socket.bind((host, port))
        except (OSError, ValueError) as error:  # ValueError: malformed host name
            self._socket.close()
            raise TransportError(f"udpin:{host}:{port}: {getattr(error, 'strerror', None) or error}") from error
        self._socket.setblocking(False)
        if known is not None:
            self._peer_at(known)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def _peer_at(self, address: Address) -> UdpPeer:
        peer = self._peers.get(address)
        if peer is None:
            peer = self._peers[address] = UdpPeer(self, address)
            self._new.append(peer)
        return peer

    def fileno(self) -> int:
        return self._socket.fileno()

    def accept(self) -> list[Transport]:
        with contextlib.suppress(OSError):  # none left, or news of a datagram that was lost
            for _ in range(_MOST_READ):
                data, address = self._socket.recvfrom(_LARGEST_DATAGRAM)
                self._peer_at(address).queued.append(data)
        new, self._new = self._new, []
        return new

    def send(self, data: bytes, address: Address) -> None:
        with contextlib.suppress(OSError):  # a datagram may be lost
            self._socket.sendto(data, address)

    def forget(self, address: Address) -> None:
        """A peer at this address is a new one from now on."""
        self._peers.pop(address, None)

    def close(self) -> None:
        self._socket.close()


class TcpListener:
    """A listening TCP socket."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._socket = socket.create_server((host, port))
        except (OSError, ValueError) as error:
            raise TransportError(f"tcpin:{host}:{port}: {getattr(error, 'strerror', None) or error}") from error
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        """The local port."""
        return int(self._socket.getsockname()[1])

    def fileno(self) -> int:
        return self._socket.fileno()

    def accept(self) -> list[Transport]:
        new: list[Transport] = []
        with contextlib.suppress(OSError):  # none left, or one that has given up
            for _ in range(_MOST_READ):
                connection, (host, port, *_) = self._socket.accept()
                new.append(Tcp.of(connection, f"{host}:{port}"))
        return new

    def close(self) -> None:
        self._socket.close()
