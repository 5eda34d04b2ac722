"""Ways to carry bytes: UDP, TCP, serial, and a pair in memory. Nothing else opens a socket.

URLs are those that pymavlink's users know: `udpin:HOST:PORT` (bind, answer whoever speaks), `udpout:HOST:PORT`
(send there), `tcp:HOST:PORT`, `tcpin:HOST:PORT` (wait for one caller), `serial:DEVICE:BAUD`.
"""

import collections
import contextlib
import errno
import math
import os
import select
import socket
import struct
import termios
import time
from collections.abc import Callable
from typing import Protocol

import serial

_LARGEST_DATAGRAM = 9216
"""Bytes; no MAVLink peer sends more. A longer datagram is cut."""
_BLOCKING_FROM_S = 0.1
"""A timeout from here on is the socket's own, a shorter one a call of select."""
_DONTWAIT = int(socket.MSG_DONTWAIT)
_NOT_CARRIED = frozenset(
    {
        errno.EAGAIN,
        errno.ECONNREFUSED,
        errno.EHOSTDOWN,
        errno.EHOSTUNREACH,
        errno.ENETDOWN,
        errno.ENETUNREACH,
        errno.ENOBUFS,
        errno.ENOPROTOOPT,
        errno.EPERM,
        errno.EPROTO,
    }
)
"""Errors of a UDP socket for a datagram that was lost: no cable, no route, a full queue, a firewall, nobody there. The
next one may arrive."""


_GIVEN_UP_MS = 20_000
"""A TCP connection on which what was sent is not taken for so long is gone, as that of a machine that was switched off
or lost its network. The system's own patience is a quarter of an hour, for which no other caller would be heard."""
_LOOKS_EVERY_S = 1.0
LOCKSTEP_SPIN_S = 2e-3 if (os.cpu_count() or 1) > 1 else 0.0
"""How long the two ends of a lockstep poll for a datagram before they sleep; their turns take 0.1 ms."""
_SPINS_LEFT_OUT = 100
"""Calls of `receive` without polling after one that found nothing."""


class TransportError(Exception):
    """An address that can't be used, or a link that is gone; the message names it and says why."""


class Transport(Protocol):
    """A link to one peer. `preserves_datagrams`: each `receive` returns what one `send` sent."""

    preserves_datagrams: bool

    @property
    def peer(self) -> str:
        """Address that is sent to and that the last data came from; "" while unknown."""

    def receive(self, timeout_s: float) -> bytes | None:
        """Data that arrives within the time (0: that is there already), or None.

        None comes early if the other machine says that nobody listens. Raises TransportError once the link is gone.
        """

    def send(self, data: bytes) -> None:
        """Send to the peer, whole and without waiting, or not at all.

        The data is lost without a peer, with nobody listening there, or with no room in the send buffer.
        Raises TransportError once the link is gone.
        """

    def lock(self) -> None:
        """Talk with the present peer only from now on."""

    def close(self) -> None:
        """Release the address."""


def _unusable(url: str, error: Exception) -> TransportError:
    text = f"{url}: {getattr(error, 'strerror', None) or error}"
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        text += ": another companion or a ground station listens there; end it, or take another port"
    elif number == errno.EACCES and url.startswith("udpout:"):
        text += ": a broadcast address, or a firewall forbids it; name the one machine that is meant"
    return TransportError(text)


def _push(write: Callable[[bytes], int], left_over: bytes, data: bytes) -> tuple[bytes, bool]:
    """Write what was `left_over` from last time and then `data`, without waiting; what is left over now, and whether
    `data` was taken: it is dropped whole if there is no room for its first byte, so that no frame is sent without its
    end."""
    try:
        if left_over:
            left_over = left_over[write(left_over) :]
        return (left_over, False) if left_over else (data[write(data) :], True)
    except BlockingIOError:
        return left_over, False


class Udp:
    """A UDP socket. It is connected once the peer is locked; the kernel then drops datagrams of others."""

    preserves_datagrams = True

    def __init__(self, host: str, port: int, *, bind: bool) -> None:
        self._name = f"{'udpin' if bind else 'udpout'}:{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._address: tuple[str, int] | None = None
        self._earlier: tuple[str, int] | None = None
        self._peer = ""
        self._connected = False
        self._calls = not bind
        self._looked_s = -math.inf
        """When a new way to the peer was looked for last."""
        self._before_lock: collections.deque[bytes] = collections.deque()
        self._blocking_s = 0.0
        self._no_spins = 0
        self.spin_s = 0.0
        """How long to poll for a datagram before sleeping until it comes."""
        try:
            if bind:
                self._socket.bind((host, port))
            else:
                self._connect((socket.gethostbyname(host), port))
        except (OSError, ValueError) as error:  # ValueError: malformed host name
            self._socket.close()
            raise _unusable(self._name, error) from error

    def fileno(self) -> int:
        """Readable when there is something to receive."""
        return self._socket.fileno()

    @property
    def port(self) -> int:
        """The local port (as chosen by the system when bound to 0)."""
        return int(self._socket.getsockname()[1])

    @property
    def peer(self) -> str:
        return self._peer

    def lock(self) -> None:
        if self._address is None or self._connected:
            return
        try:
            self._connect(self._address)
        except OSError as error:
            raise _unusable(self._name, error) from error
        with contextlib.suppress(BlockingIOError):  # datagrams of others from before are still queued
            while True:
                data, address = self._socket.recvfrom(_LARGEST_DATAGRAM, _DONTWAIT)
                if address == self._address:
                    self._before_lock.append(data)

    def _connect(self, address: tuple[str, int]) -> None:
        self._socket.connect(address)
        self._connected = True
        self._answer_to(address)

    def receive(self, timeout_s: float) -> bytes | None:
        if self._before_lock:
            return self._before_lock.popleft()
        flags = _DONTWAIT
        if self.spin_s and timeout_s >= _BLOCKING_FROM_S and (data := self._spin()) is not None:
            return data
        if timeout_s >= _BLOCKING_FROM_S:  # one system call; its resolution of some ms is enough here
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
        except OSError as error:
            self._forgive(error)
            return None
        self._earlier = self._address
        if address != self._address:
            self._answer_to(address)
        return data

    def turn_back(self) -> None:
        """The last datagram was a stranger's: the peer is the one before it."""
        if not self._connected and self._address != self._earlier:
            self._answer_to(self._earlier)

    def _answer_to(self, address: tuple[str, int] | None) -> None:
        self._address = address
        self._peer = "" if address is None else f"{address[0]}:{address[1]}"

    def waiting(self, timeout_s: float) -> bool:
        """Whether a datagram arrives within the time; it is not taken."""
        return bool(select.select([self._socket], [], [], timeout_s)[0])

    def _spin(self) -> bytes | None:
        """Poll instead of sleeping: a wake-up takes longer than the other end's answer."""
        if not self._connected or self._no_spins > 0:
            self._no_spins -= 1
            return None
        receive, until = self._socket.recv, time.monotonic() + self.spin_s
        while True:
            try:
                return receive(_LARGEST_DATAGRAM, _DONTWAIT)
            except OSError as error:
                if error.errno != errno.EAGAIN:
                    return None
                if time.monotonic() > until:
                    self._no_spins = _SPINS_LEFT_OUT  # the other end has no core of its own at the moment
                    return None
                os.sched_yield()  # another process, perhaps the other end, may want this core

    def send(self, data: bytes) -> None:
        try:
            if self._connected:
                self._socket.send(data, _DONTWAIT)
            elif self._address is not None:
                self._socket.sendto(data, _DONTWAIT, self._address)
        except OSError as error:
            self._forgive(error)
            if error.errno == errno.ENETUNREACH and self._calls:
                self._look_for_way()

    def _look_for_way(self) -> None:
        """A connected socket keeps the address of this machine that it began with. Where that has changed, as with
        another network, a new socket takes its place."""
        now_s = time.monotonic()
        if now_s - self._looked_s < _LOOKS_EVERY_S or self._address is None:
            return
        self._looked_s = now_s
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as fresh, contextlib.suppress(OSError):
            fresh.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
            fresh.connect(self._address)
            os.dup2(fresh.fileno(), self._socket.fileno(), inheritable=False)
            self._blocking_s = 0.0

    def _forgive(self, error: OSError) -> None:
        """Ignore the loss of a datagram; raise any other error as TransportError."""
        if error.errno not in _NOT_CARRIED:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        self._socket.close()


class Tcp:
    """A TCP connection. `listen`: wait for a caller; the first is accepted, any other refused."""

    preserves_datagrams = False

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self._name = f"{'tcpin' if listen else 'tcp'}:{host}:{port}"
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._peer = ""
        self._left_over = b""
        self.dropped = 0
        """What `send` had no room for, as a count."""
        try:
            if listen:
                self._listener = socket.create_server((host, port))
                self._listener.setblocking(False)
            else:
                self._talk(socket.create_connection((host, port), timeout=5.0), f"{host}:{port}")
        except (OSError, ValueError) as error:  # ValueError: malformed host name
            raise _unusable(self._name, error) from error

    @classmethod
    def of(cls, connection: socket.socket, peer: str) -> "Tcp":
        """A connection that a caller has made."""
        link = cls.__new__(cls)
        link._name, link._listener, link._left_over, link.dropped = f"tcpin:{peer}", None, b"", 0
        link._talk(connection, peer)
        return link

    def fileno(self) -> int:
        """Readable when there is something to receive."""
        end = self._listener or self._socket
        assert end is not None
        return end.fileno()

    def _talk(self, connection: socket.socket, peer: str) -> None:
        self._socket = connection
        self._peer = peer
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _GIVEN_UP_MS)

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
        deadline = time.monotonic() + timeout_s
        try:
            if self._listener is not None:
                self._answer(self._listener, deadline)
            if self._socket is None or not _readable(self._socket, deadline):
                return None
            data = self._socket.recv(_LARGEST_DATAGRAM)
        except BlockingIOError:
            return None
        except OSError as error:
            raise _unusable(self._name, error) from error
        if not data:
            raise TransportError(f"{self._name}: closed by the other end")
        return data

    def _answer(self, listener: socket.socket, deadline: float) -> None:
        """Wait for a caller, and stop listening once there is one."""
        if not _readable(listener, deadline):
            return
        try:
            connection, address = listener.accept()
        except (BlockingIOError, ConnectionAbortedError):  # the caller has given up
            return
        listener.close()
        self._listener = None
        self._talk(connection, f"{address[0]}:{address[1]}")

    def send(self, data: bytes) -> None:
        if self._socket is None:
            return
        try:
            self._left_over, taken = _push(self._socket.send, self._left_over, data)
            self.dropped += not taken
        except OSError as error:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        for end in (self._socket, self._listener):
            if end is not None:
                end.close()


class Serial:
    """A serial port, opened for this process alone."""

    preserves_datagrams = False

    def __init__(self, device: str, baud: int) -> None:
        self._name = f"serial:{device}:{baud}"
        self._peer = device
        self._left_over = b""
        self.dropped = 0
        """As of a connection."""
        self.bytes_per_s = baud / 10.0
        """Each way: a byte is ten bits on the line."""
        try:
            self._port = serial.Serial(device, baud, timeout=0.0, exclusive=True)
        except (OSError, ValueError, OverflowError, termios.error) as error:
            raise _unusable(self._name, error) from error

    @property
    def peer(self) -> str:
        return self._peer

    def fileno(self) -> int:
        """Readable when there is something to receive."""
        return int(self._port.fileno())

    def lock(self) -> None:
        """A serial line has one peer."""

    def receive(self, timeout_s: float) -> bytes | None:
        # pyserial leaves the descriptor non-blocking; its own read and write would wait once more, and spin when full.
        try:
            if not _readable(self._port, time.monotonic() + timeout_s):
                return None
            data = os.read(self._port.fileno(), _LARGEST_DATAGRAM)
        except BlockingIOError:
            return None
        except OSError as error:
            raise _unusable(self._name, error) from error
        if not data:
            raise TransportError(f"{self._name}: unplugged")
        return data

    def send(self, data: bytes) -> None:
        try:
            self._left_over, taken = _push(lambda part: os.write(self._port.fileno(), part), self._left_over, data)
            self.dropped += not taken
        except OSError as error:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        self._port.close()


def _readable(end: "socket.socket | serial.Serial", deadline: float) -> bool:
    """Wait until there is something to read, at the longest until `deadline` (time.monotonic)."""
    return bool(select.select([end], [], [], max(deadline - time.monotonic(), 0.0))[0])


class Memory:
    """One end of a pair of queues in one thread; `receive` never waits."""

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
        """Nothing to release."""


def bytes_per_s(transport: Transport) -> float | None:
    """What a link carries each way; None where that is not known."""
    return transport.bytes_per_s if isinstance(transport, Serial) else None


def open_url(url: str) -> Transport:
    """Open the transport that a URL names. Raises TransportError for a malformed URL and one that can't be opened."""
    scheme, _, rest = url.partition(":")
    place, separator, number = rest.rpartition(":")
    is_other_form = scheme != "serial" and rest.startswith("//")  # MAVSDK's
    if not separator or not place or is_other_form or not (number.isascii() and number.isdigit() and len(number) < 10):
        raise TransportError(
            f"{url}: write it as udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or "
            "serial:DEVICE:BAUD, without //"
        )
    if scheme in ("udpin", "udpout", "tcpin") and ":" in place:
        raise TransportError(f"{url}: addresses of IPv6 are not taken; write one of IPv4, or a name")
    value = int(number)
    if scheme != "serial" and value > 65535:
        raise TransportError(f"{url}: a port is at most 65535")
    if value == 0 and scheme in ("udpout", "tcp", "serial"):
        raise TransportError(f"{url}: the number at the end can't be 0")
    match scheme:
        case "udpin" | "udpout":
            return Udp(place, value, bind=scheme == "udpin")
        case "tcp" | "tcpin":
            return Tcp(place, value, listen=scheme == "tcpin")
        case "serial":
            return Serial(place, value)
    raise TransportError(f"{url}: unknown scheme {scheme}; there are udpin, udpout, tcp, tcpin and serial")
