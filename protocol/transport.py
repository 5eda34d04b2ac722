"""Ways to carry bytes: UDP, TCP, serial, and a pair in memory. Nothing else opens a socket.

URLs are those that pymavlink's users know: `udpin:HOST:PORT` (bind, answer whoever speaks), `udpout:HOST:PORT`
(send there), `tcp:HOST:PORT`, `tcpin:HOST:PORT` (wait for one caller), `serial:DEVICE:BAUD`.
"""

import collections
import contextlib
import select
import socket
import struct
from typing import Protocol

import serial

_LARGEST_DATAGRAM = 65535
_BLOCKING_FROM_S = 0.1
_DONTWAIT = int(socket.MSG_DONTWAIT)


class TransportError(Exception):
    """An address that can't be used; the text names it and says why."""


class Transport(Protocol):
    """One peer at the other end. `preserves_datagrams`: each `receive` is what one `send` sent."""

    preserves_datagrams: bool

    @property
    def peer(self) -> str:
        """Who is sent to, and who sent what came last ("" while unknown)."""

    def receive(self, timeout_s: float) -> bytes | None:
        """What arrives within the time (0: what is there already), or None.

        Raises TransportError once the link is gone.
        """

    def send(self, data: bytes) -> None:
        """Send to the peer; without one, or with nobody listening there, it is lost as on any radio."""

    def lock(self) -> None:
        """From now on talk with the present peer only."""

    def close(self) -> None: ...


class Udp:
    """A UDP socket, blocking with a deadline; connected once the peer is certain (the kernel then drops strangers)."""

    preserves_datagrams = True

    def __init__(self, host: str, port: int, *, bind: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._address: tuple[str, int] | None = None
        self._peer = ""
        self._connected = False
        self._blocking_s = 0.0
        try:
            if bind:
                self._socket.bind((host, port))
            else:
                self._address = (socket.gethostbyname(host), port)
                self.lock()
        except OSError as error:
            self._socket.close()
            raise TransportError(f"{'udpin' if bind else 'udpout'}:{host}:{port}: {error.strerror or error}") from error

    @property
    def port(self) -> int:
        """The local port (as chosen by the system when bound to 0)."""
        return int(self._socket.getsockname()[1])

    @property
    def peer(self) -> str:
        return self._peer

    def lock(self) -> None:
        if self._address is not None and not self._connected:
            self._socket.connect(self._address)
            self._connected = True
            self._peer = f"{self._address[0]}:{self._address[1]}"

    def receive(self, timeout_s: float) -> bytes | None:
        flags = _DONTWAIT
        if timeout_s >= _BLOCKING_FROM_S:  # one system call; its grain of some ms does not matter here
            flags = 0
            if timeout_s != self._blocking_s:
                self._blocking_s = timeout_s
                timeval = struct.pack("ll", int(timeout_s), int(timeout_s % 1.0 * 1e6))
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)
        elif timeout_s > 0.0 and not select.select([self._socket], [], [], timeout_s)[0]:
            return None
        try:
            if self._connected:
                return self._socket.recv(_LARGEST_DATAGRAM, flags)
            data, address = self._socket.recvfrom(_LARGEST_DATAGRAM, flags)
        except (BlockingIOError, ConnectionRefusedError):
            return None
        if address != self._address:
            self._address = address
            self._peer = f"{address[0]}:{address[1]}"
        return data

    def send(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            if self._connected:
                self._socket.send(data)
            elif self._address is not None:
                self._socket.sendto(data, self._address)

    def close(self) -> None:
        self._socket.close()


class Tcp:
    """A TCP connection, called or (`listen`) waited for."""

    preserves_datagrams = False

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._peer = ""
        try:
            if listen:
                self._listener = socket.create_server((host, port))
            else:
                self._socket = socket.create_connection((host, port), timeout=5.0)
                self._peer = f"{host}:{port}"
                self._prepare(self._socket)
        except OSError as error:
            raise TransportError(f"{'tcpin' if listen else 'tcp'}:{host}:{port}: {error.strerror or error}") from error

    @staticmethod
    def _prepare(connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)

    @property
    def port(self) -> int:
        """The local port."""
        end = self._listener or self._socket
        assert end is not None
        return int(end.getsockname()[1])

    @property
    def peer(self) -> str:
        return self._peer

    def lock(self) -> None:
        """A connection has one peer from the start."""

    def receive(self, timeout_s: float) -> bytes | None:
        if self._socket is None:
            assert self._listener is not None
            if not select.select([self._listener], [], [], timeout_s)[0]:
                return None
            self._socket, address = self._listener.accept()
            self._peer = f"{address[0]}:{address[1]}"
            self._prepare(self._socket)
        if not select.select([self._socket], [], [], timeout_s)[0]:
            return None
        try:
            data = self._socket.recv(_LARGEST_DATAGRAM)
        except BlockingIOError:
            return None
        except OSError as error:
            raise TransportError(f"tcp:{self._peer}: {error.strerror or error}") from error
        if not data:
            raise TransportError(f"tcp:{self._peer}: closed by the other end")
        return data

    def send(self, data: bytes) -> None:
        if self._socket is None:
            return
        try:
            while data:
                select.select([], [self._socket], [], 1.0)
                data = data[self._socket.send(data) :]
        except OSError as error:
            raise TransportError(f"tcp:{self._peer}: {error.strerror or error}") from error

    def close(self) -> None:
        for end in (self._socket, self._listener):
            if end is not None:
                end.close()


class Serial:
    """A serial port."""

    preserves_datagrams = False

    def __init__(self, device: str, baud: int) -> None:
        self._peer = device
        try:
            self._port = serial.Serial(device, baud, timeout=0.0, write_timeout=1.0)
        except (serial.SerialException, ValueError) as error:
            raise TransportError(f"serial:{device}:{baud}: {error}") from error

    @property
    def peer(self) -> str:
        return self._peer

    def lock(self) -> None:
        """A wire has one peer."""

    def receive(self, timeout_s: float) -> bytes | None:
        if not select.select([self._port], [], [], timeout_s)[0]:
            return None
        try:
            data: bytes = self._port.read(4096)
        except serial.SerialException as error:
            raise TransportError(f"serial:{self._peer}: {error}") from error
        return data or None

    def send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except serial.SerialException as error:
            raise TransportError(f"serial:{self._peer}: {error}") from error

    def close(self) -> None:
        self._port.close()


class Memory:
    """One end of a pair in one thread; `receive` never waits."""

    preserves_datagrams = True

    def __init__(self, incoming: collections.deque[bytes], outgoing: collections.deque[bytes], peer: str) -> None:
        self._incoming = incoming
        self._outgoing = outgoing
        self.peer = peer

    @staticmethod
    def pair() -> "tuple[Memory, Memory]":
        left: collections.deque[bytes] = collections.deque()
        right: collections.deque[bytes] = collections.deque()
        return Memory(left, right, "memory:b"), Memory(right, left, "memory:a")

    def receive(self, timeout_s: float) -> bytes | None:
        return self._incoming.popleft() if self._incoming else None

    def send(self, data: bytes) -> None:
        self._outgoing.append(data)

    def lock(self) -> None:
        """A pair has one peer."""

    def close(self) -> None:
        """Nothing to give back."""


def open_url(url: str) -> Transport:
    """Open what a URL names. Raises TransportError, naming the URL."""
    scheme, _, rest = url.partition(":")
    place, separator, number = rest.rpartition(":")
    if not separator or not place or not number.isdigit():
        raise TransportError(
            f"{url}: write it as udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or "
            "serial:DEVICE:BAUD"
        )
    value = int(number)
    if scheme != "serial" and value > 65535:
        raise TransportError(f"{url}: a port is at most 65535")
    match scheme:
        case "udpin" | "udpout":
            return Udp(place, value, bind=scheme == "udpin")
        case "tcp" | "tcpin":
            return Tcp(place, value, listen=scheme == "tcpin")
        case "serial":
            return Serial(place, value)
    raise TransportError(f"{url}: unknown scheme {scheme}; there are udpin, udpout, tcp, tcpin and serial")
