"""Ways to carry bytes: UDP, TCP, serial, and a pair in memory. Nothing else opens a socket.

URLs are those that pymavlink's users know: `udpin:HOST:PORT` (bind, answer whoever speaks), `udpout:HOST:PORT`
(send there), `tcp:HOST:PORT`, `tcpin:HOST:PORT` (wait for one caller), `serial:DEVICE:BAUD`.
"""

import collections
import contextlib
import errno
import os
import select
import socket
import struct
import termios
import time
from collections.abc import Callable
from typing import Protocol

import serial

_LARGEST_DATAGRAM = 9216  # no MAVLink peer sends more; what is longer is cut, and costs little to look through
_BLOCKING_FROM_S = 0.1
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
"""What a UDP socket says of a datagram that was lost on the way or at its end: a cable out, no route, a full queue, a
firewall, nobody there. It may be otherwise for the next one."""


LOCKSTEP_SPIN_S = 2e-3 if (os.cpu_count() or 1) > 1 else 0.0
"""How long the two ends of a lockstep, which take turns of 0.1 ms, look for a datagram before they sleep."""


_SPINS_LEFT_OUT = 100
"""After one in vain."""


class TransportError(Exception):
    """An address that can't be used; the text names it and says why."""


class Transport(Protocol):
    """One peer at the other end. `preserves_datagrams`: each `receive` is what one `send` sent."""

    preserves_datagrams: bool

    @property
    def peer(self) -> str:
        """Who is sent to, and who sent what came last ("" while unknown)."""

    def receive(self, timeout_s: float) -> bytes | None:
        """What arrives within the time (0: what is there already), or None, which may come early.

        It does if the other end's machine says that nobody listens. Raises TransportError once the link is gone.
        """

    def send(self, data: bytes) -> None:
        """Send to the peer, whole and without waiting, or not at all.

        Without a peer, with nobody listening there, or with no room left on the way, it is lost as on any radio.
        Raises TransportError once the link is gone.
        """

    def lock(self) -> None:
        """From now on talk with the present peer only."""

    def close(self) -> None: ...


def _unusable(url: str, error: Exception) -> TransportError:
    return TransportError(f"{url}: {getattr(error, 'strerror', None) or error}")


def _push(write: Callable[[bytes], int], left_over: bytes, data: bytes) -> bytes:
    """Write what was `left_over` from last time and then `data`, without waiting; what of it is left over now.

    With no room at all for it, `data` is dropped whole: what is sent holds no frame without its end.
    """
    try:
        if left_over:
            left_over = left_over[write(left_over) :]
        return left_over or data[write(data) :]
    except BlockingIOError:
        return left_over


class Udp:
    """A UDP socket, blocking with a deadline; connected once the peer is certain (the kernel then drops strangers)."""

    preserves_datagrams = True

    def __init__(self, host: str, port: int, *, bind: bool) -> None:
        self._name = f"{'udpin' if bind else 'udpout'}:{host}:{port}"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._address: tuple[str, int] | None = None
        self._peer = ""
        self._connected = False
        self._before_lock: collections.deque[bytes] = collections.deque()
        self._blocking_s = 0.0
        self._no_spins = 0
        self.spin_s = 0.0
        """How long to look for a datagram before sleeping until it comes."""
        try:
            if bind:
                self._socket.bind((host, port))
            else:
                self._connect((socket.gethostbyname(host), port))
        except (OSError, ValueError) as error:  # ValueError: not even the form of a host's name
            self._socket.close()
            raise _unusable(self._name, error) from error

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
        with contextlib.suppress(BlockingIOError):  # what strangers sent before is still queued
            while True:
                data, address = self._socket.recvfrom(_LARGEST_DATAGRAM, _DONTWAIT)
                if address == self._address:
                    self._before_lock.append(data)

    def _connect(self, address: tuple[str, int]) -> None:
        self._socket.connect(address)
        self._connected = True
        self._address = address
        self._peer = f"{address[0]}:{address[1]}"

    def receive(self, timeout_s: float) -> bytes | None:
        if self._before_lock:
            return self._before_lock.popleft()
        flags = _DONTWAIT
        if self.spin_s and timeout_s >= _BLOCKING_FROM_S and (data := self._spin()) is not None:
            return data
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
        except OSError as error:
            self._forgive(error)
            return None
        if address != self._address:
            self._address = address
            self._peer = f"{address[0]}:{address[1]}"
        return data

    def waiting(self, timeout_s: float) -> bool:
        """Whether a datagram is there within the time; it stays there."""
        return bool(select.select([self._socket], [], [], timeout_s)[0])

    def _spin(self) -> bytes | None:
        """Look again and again instead of sleeping: a wake-up costs more than the other end's answer takes."""
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
                    self._no_spins = _SPINS_LEFT_OUT  # the other end has no core of its own just now
                    return None
                os.sched_yield()  # whoever else wants this core, the other end perhaps, goes first

    def send(self, data: bytes) -> None:
        try:
            if self._connected:
                self._socket.send(data, _DONTWAIT)
            elif self._address is not None:
                self._socket.sendto(data, _DONTWAIT, self._address)
        except OSError as error:
            self._forgive(error)

    def _forgive(self, error: OSError) -> None:
        """A datagram that was not carried; anything else is raised as TransportError."""
        if error.errno not in _NOT_CARRIED:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        self._socket.close()


class Tcp:
    """A TCP connection, called or (`listen`) waited for: the first caller is answered, any other refused."""

    preserves_datagrams = False

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self._name = f"{'tcpin' if listen else 'tcp'}:{host}:{port}"
        self._listener: socket.socket | None = None
        self._socket: socket.socket | None = None
        self._peer = ""
        self._left_over = b""
        try:
            if listen:
                self._listener = socket.create_server((host, port))
                self._listener.setblocking(False)
            else:
                self._talk(socket.create_connection((host, port), timeout=5.0), f"{host}:{port}")
        except (OSError, ValueError) as error:  # ValueError: not even the form of a host's name
            raise _unusable(self._name, error) from error

    def _talk(self, connection: socket.socket, peer: str) -> None:
        self._socket = connection
        self._peer = peer
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

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
        """Wait for the caller, and stop listening once there is one."""
        if not _readable(listener, deadline):
            return
        try:
            connection, address = listener.accept()
        except (BlockingIOError, ConnectionAbortedError):  # hung up before the answer
            return
        listener.close()
        self._listener = None
        self._talk(connection, f"{address[0]}:{address[1]}")

    def send(self, data: bytes) -> None:
        if self._socket is None:
            return
        try:
            self._left_over = _push(self._socket.send, self._left_over, data)
        except OSError as error:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        for end in (self._socket, self._listener):
            if end is not None:
                end.close()


class Serial:
    """A serial port, for this process alone."""

    preserves_datagrams = False

    def __init__(self, device: str, baud: int) -> None:
        self._name = f"serial:{device}:{baud}"
        self._peer = device
        self._left_over = b""
        try:
            self._port = serial.Serial(device, baud, timeout=0.0, exclusive=True)
        except (OSError, ValueError, OverflowError, termios.error) as error:
            raise _unusable(self._name, error) from error

    @property
    def peer(self) -> str:
        return self._peer

    def lock(self) -> None:
        """A wire has one peer."""

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
            self._left_over = _push(lambda part: os.write(self._port.fileno(), part), self._left_over, data)
        except OSError as error:
            raise _unusable(self._name, error) from error

    def close(self) -> None:
        self._port.close()


def _readable(end: "socket.socket | serial.Serial", deadline: float) -> bool:
    """Wait until there is something to read, at the longest until `deadline` (time.monotonic)."""
    return bool(select.select([end], [], [], max(deadline - time.monotonic(), 0.0))[0])


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
    if not separator or not place or not (number.isascii() and number.isdigit() and len(number) < 10):
        raise TransportError(
            f"{url}: write it as udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or "
            "serial:DEVICE:BAUD"
        )
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
