"""Transports: both ways, and what happens when the other end, the address or the room is missing. Loopback only."""

import errno
import os
import random
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest

from protocol.guarded_link import GuardedLink
from protocol.transport import Memory, Serial, Tcp, Transport, TransportError, Udp, open_url

PATIENCE_S = 60.0
"""Far more than anything here takes; only a failing test waits for it."""
SHORT_TIMEOUTS_S = [-1.0, 0.0, 1e-9, 1e-6, 3e-4, 5e-4, 2e-3]

Opener = Callable[[str], Transport]


@pytest.fixture
def opened() -> Iterator[Opener]:
    """Opens URLs, and closes them at the end."""
    transports: list[Transport] = []

    def opener(url: str) -> Transport:
        transports.append(open_url(url))
        return transports[-1]

    yield opener
    for transport in transports:
        transport.close()


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    """A serial line: the descriptor of the other end, and the device."""
    other, own = os.openpty()
    device = os.ttyname(own)
    os.close(own)
    yield other, device
    os.close(other)


def udp_in(opened: Opener) -> tuple[Udp, str]:
    """A bound end, and the URL that sends to it."""
    end = opened("udpin:127.0.0.1:0")
    assert isinstance(end, Udp)
    return end, f"udpout:127.0.0.1:{end.port}"


def tcp_pair(opened: Opener) -> tuple[Tcp, Tcp]:
    """Listener and caller, connected."""
    listener = opened("tcpin:127.0.0.1:0")
    assert isinstance(listener, Tcp)
    caller = opened(f"tcp:127.0.0.1:{listener.port}")
    assert isinstance(caller, Tcp)
    caller.send(b"ring")
    assert received(listener, 4) == b"ring"
    return listener, caller


@pytest.fixture
def deaf() -> Iterator[socket.socket]:
    """A UDP port that nobody else gets and at which nobody listens, until it is connected to somebody.

    The system refuses what others send to a socket that is connected, here to itself.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        holder.connect(holder.getsockname())
        holder.settimeout(PATIENCE_S)
        yield holder


def received(end: Transport, size: int) -> bytes:
    """The next `size` bytes, in however many pieces they come."""
    data, give_up = b"", time.monotonic() + PATIENCE_S
    while len(data) < size:
        assert time.monotonic() < give_up, f"{len(data)} of {size} bytes came"
        data += end.receive(0.2) or b""
    return data


def assert_nothing_comes(end: Transport) -> None:
    """A `receive` that waited for more than its time would wait for ever."""
    for timeout_s in SHORT_TIMEOUTS_S:
        assert end.receive(timeout_s) is None


# --- UDP --------------------------------------------------------------------------------------------------------------


def test_udp_both_ways(opened: Opener) -> None:
    listening, url = udp_in(opened)
    calling = opened(url)
    assert isinstance(calling, Udp)
    assert (listening.peer, calling.peer) == ("", f"127.0.0.1:{listening.port}")
    calling.send(b"hello")
    assert listening.receive(PATIENCE_S) == b"hello"
    assert listening.peer == f"127.0.0.1:{calling.port}"
    listening.send(b"good day")
    assert calling.receive(PATIENCE_S) == b"good day"


def test_datagrams_stay_whole_and_apart(opened: Opener) -> None:
    listening, url = udp_in(opened)
    calling = opened(url)
    for datagram in [b"", b"\xfd", bytes(range(256)), random.Random(1).randbytes(9216)]:
        calling.send(datagram)
        calling.send(b"next")
        assert listening.receive(PATIENCE_S) == datagram
        assert listening.receive(0.0) == b"next"
    assert listening.preserves_datagrams


def test_a_datagram_too_large_is_an_error_that_names_the_url(opened: Opener) -> None:
    _, url = udp_in(opened)
    with pytest.raises(TransportError, match=f"^{url}: .*too long"):
        opened(url).send(bytes(70000))


@pytest.mark.parametrize("locked", [False, True])
def test_short_timeouts_do_not_block(opened: Opener, locked: bool) -> None:
    listening, url = udp_in(opened)
    calling = opened(url)
    calling.send(b"hello")
    assert listening.receive(PATIENCE_S) == b"hello"
    if locked:
        listening.lock()
    assert_nothing_comes(listening)
    assert listening.receive(0.11) is None  # the other way of waiting
    assert_nothing_comes(listening)
    calling.send(b"in time")
    assert listening.waiting(PATIENCE_S)
    assert listening.receive(3e-4) == b"in time"


def test_the_last_to_speak_is_answered_until_it_is_locked(opened: Opener) -> None:
    listening, url = udp_in(opened)
    first, second = opened(url), opened(url)
    listening.send(b"to nobody yet")
    listening.lock()  # without a peer: nothing to lock
    for speaking in (first, second):
        speaking.send(b"hello")
        assert listening.receive(PATIENCE_S) == b"hello"
        listening.send(b"you")
        assert speaking.receive(PATIENCE_S) == b"you"
    listening.lock()
    peer = listening.peer
    first.send(b"a stranger now")
    assert_nothing_comes(listening)
    second.send(b"still here")
    assert listening.receive(PATIENCE_S) == b"still here"
    listening.send(b"you alone")
    assert second.receive(PATIENCE_S) == b"you alone"
    assert first.receive(0.0) is None
    assert listening.peer == peer


def test_strangers_that_spoke_before_the_lock_are_not_heard_after_it(opened: Opener) -> None:
    listening, url = udp_in(opened)
    vehicle, stranger = opened(url), opened(url)
    vehicle.send(b"0")
    assert listening.receive(PATIENCE_S) == b"0"
    for number in (b"1", b"2", b"3"):
        stranger.send(b"forged")
        vehicle.send(number)
    listening.lock()
    vehicle.send(b"4")
    assert [listening.receive(PATIENCE_S) for _ in range(4)] == [b"1", b"2", b"3", b"4"]
    assert_nothing_comes(listening)


def test_nobody_listening_is_a_loss_and_no_error(opened: Opener, deaf: socket.socket) -> None:
    calling = opened(f"udpout:127.0.0.1:{deaf.getsockname()[1]}")
    assert isinstance(calling, Udp)
    for _ in range(3):  # each is refused, and says so at the next call
        calling.send(b"anybody?")
        calling.send(b"anybody?")
        assert_nothing_comes(calling)
    calling.send(b"anybody?")
    assert calling.receive(0.11) is None
    deaf.connect(("127.0.0.1", calling.port))
    calling.send(b"hello")
    assert deaf.recv(64) == b"hello"


def test_a_locked_peer_that_has_left_may_come_back(opened: Opener, deaf: socket.socket) -> None:
    listening, _ = udp_in(opened)
    itself, vehicle = deaf.getsockname(), deaf
    vehicle.connect(("127.0.0.1", listening.port))
    vehicle.send(b"hello")
    assert listening.receive(PATIENCE_S) == b"hello"
    listening.lock()
    vehicle.connect(itself)
    for _ in range(3):
        listening.send(b"anybody?")
        assert_nothing_comes(listening)
    vehicle.connect(("127.0.0.1", listening.port))
    listening.send(b"anybody?")
    assert vehicle.recv(64) == b"anybody?"


def test_a_broadcast_address_is_no_mere_lack_of_permission() -> None:
    with pytest.raises(TransportError, match=r"^udpout:127\.255\.255\.255:14550: .*a broadcast address"):
        open_url("udpout:127.255.255.255:14550")


class NoWay:
    """A socket whose machine has another address by now."""

    def __init__(self, real: socket.socket) -> None:
        self._real = real

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)

    def send(self, data: bytes, flags: int) -> int:
        raise OSError(errno.ENETUNREACH, "Network is unreachable")


def test_after_a_change_of_networks_another_socket_speaks(opened: Opener) -> None:
    listener, url = udp_in(opened)
    caller = opened(url)
    assert isinstance(caller, Udp)
    assert caller.receive(0.11) is None  # with a timeout of the old socket's own
    real, port = caller._socket, caller.port
    caller._socket = cast(socket.socket, NoWay(real))
    caller.send(b"lost")
    caller._socket = real
    caller.send(b"hello")
    assert received(listener, 5) == b"hello"
    assert listener.peer == f"127.0.0.1:{caller.port}" and caller.port != port
    listener.send(b"good day")
    assert received(caller, 8) == b"good day"
    assert caller.receive(0.11) is None


# --- TCP --------------------------------------------------------------------------------------------------------------


def test_tcp_both_ways(opened: Opener) -> None:
    listener, caller = tcp_pair(opened)
    listener.lock()
    caller.lock()
    caller.send(b"hello")
    assert received(listener, 5) == b"hello"
    listener.send(b"good day")
    assert received(caller, 8) == b"good day"
    assert caller.peer == f"127.0.0.1:{listener.port}"
    assert listener.peer == f"127.0.0.1:{caller.port}"
    assert not listener.preserves_datagrams
    assert_nothing_comes(listener)
    assert_nothing_comes(caller)


def test_a_listener_without_a_caller_waits_and_loses_what_is_sent(opened: Opener) -> None:
    listener = opened("tcpin:127.0.0.1:0")
    assert isinstance(listener, Tcp)
    assert_nothing_comes(listener)
    listener.send(b"to nobody yet")
    assert listener.peer == ""
    caller = opened(f"tcp:127.0.0.1:{listener.port}")
    assert_nothing_comes(listener)  # a caller that says nothing
    listener.send(b"good day")
    assert received(caller, 8) == b"good day"


def test_a_second_caller_is_refused(opened: Opener) -> None:
    listener, _ = tcp_pair(opened)
    url = f"tcp:127.0.0.1:{listener.port}"
    with pytest.raises(TransportError, match=f"^{url}: .*refused"):
        opened(url)


@pytest.mark.parametrize("who", ["listener", "caller"])
def test_closed_by_the_other_end(opened: Opener, who: str) -> None:
    listener, caller = tcp_pair(opened)
    leaving, staying = (listener, caller) if who == "listener" else (caller, listener)
    leaving.send(b"bye")
    leaving.close()
    assert received(staying, 3) == b"bye"
    with pytest.raises(TransportError, match=r"^tcp(in)?:127\.0\.0\.1:\d+: closed by the other end"):
        staying.receive(PATIENCE_S)
    with pytest.raises(TransportError, match=r"^tcp(in)?:127\.0\.0\.1:\d+: "):
        keep_sending(staying)


def test_who_takes_nothing_any_more_is_given_up(opened: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ground station that was switched off, or whose network is gone: else the next caller is refused meanwhile."""
    monkeypatch.setattr("protocol.transport._GIVEN_UP_MS", 100)
    listener, _ = tcp_pair(opened)
    with pytest.raises(TransportError, match=r"^tcpin:127\.0\.0\.1:\d+: .*timed out"):
        keep_sending(listener)


def keep_sending(end: Transport) -> None:
    give_up = time.monotonic() + PATIENCE_S
    while time.monotonic() < give_up:
        end.send(b"anybody?")


# --- streams that are full --------------------------------------------------------------------------------------------

FRAME_SIZE = 8_000


def frame(number: int) -> bytes:
    return number.to_bytes(4, "little") * (FRAME_SIZE // 4)


def assert_only_whole_frames_are_lost(sending: Transport, read: Callable[[int], bytes], count: int) -> None:
    """Send more than the way holds, read slowly, then read it all: what is missing, is missing from its first byte to
    its last. `read` returns some of what is there, at most so many bytes if it can. A `send` that waited for room
    would wait for ever."""
    stream = bytearray()
    for number in range(count):
        sending.send(frame(number))
        if number > count - 200:
            stream += read(300)
    give_up = time.monotonic() + PATIENCE_S
    while frame(count) not in stream[-4 * FRAME_SIZE :]:
        assert time.monotonic() < give_up
        arrived = read(65536)
        stream += arrived
        if not arrived:
            sending.send(frame(count))
    numbers = []
    for begin in range(0, len(stream) - FRAME_SIZE + 1, FRAME_SIZE):
        number = int.from_bytes(stream[begin : begin + 4], "little")
        assert stream[begin : begin + FRAME_SIZE] == frame(number)
        numbers.append(number)
    before_the_last = [number for number in numbers if number < count]
    assert before_the_last == sorted(set(before_the_last))
    assert 0 < len(before_the_last) < count, "it was not full"


def test_a_full_connection_loses_whole_frames_and_does_not_block(opened: Opener) -> None:
    listener, caller = tcp_pair(opened)
    assert_only_whole_frames_are_lost(caller, lambda _: listener.receive(0.0) or b"", 2_500)


def test_a_full_serial_line_loses_whole_frames_and_does_not_block(opened: Opener, pty: tuple[int, str]) -> None:
    other, device = pty

    def read(size: int) -> bytes:
        return os.read(other, size) if select.select([other], [], [], 0.0)[0] else b""

    port = opened(f"serial:{device}:57600")
    link = GuardedLink(port)
    assert link.news() == []
    assert_only_whole_frames_are_lost(port, read, 400)
    (told,) = link.news()
    assert "takes no more" in told and link.news() == []


# --- serial -----------------------------------------------------------------------------------------------------------


def test_serial_carries_every_byte_both_ways(opened: Opener, pty: tuple[int, str]) -> None:
    other, device = pty
    port = opened(f"serial:{device}:921600")
    assert isinstance(port, Serial)
    assert port.peer == device
    port.lock()
    every_byte = bytes(range(256))
    os.write(other, every_byte)
    assert received(port, 256) == every_byte
    port.send(every_byte)
    arrived = b""
    while len(arrived) < 256:
        assert select.select([other], [], [], PATIENCE_S)[0]
        arrived += os.read(other, 256)
    assert arrived == every_byte
    assert_nothing_comes(port)


def test_an_unplugged_serial_port_is_an_error_that_names_it(opened: Opener) -> None:
    other, own = os.openpty()
    url = f"serial:{os.ttyname(own)}:57600"
    port = opened(url)
    os.close(own)
    os.close(other)
    with pytest.raises(TransportError, match=f"^{url}: "):
        port.receive(PATIENCE_S)
    with pytest.raises(TransportError, match=f"^{url}: "):
        port.send(b"anybody?")


def test_a_serial_port_has_one_user(opened: Opener, pty: tuple[int, str]) -> None:
    url = f"serial:{pty[1]}:57600"
    opened(url)
    with pytest.raises(TransportError, match=f"^{url}: .*lock"):
        opened(url)


# --- memory -----------------------------------------------------------------------------------------------------------


def test_a_pair_in_memory() -> None:
    a, b = Memory.pair()
    for datagram in (b"1", b"", b"3"):
        a.send(datagram)
    b.send(b"back")
    assert [b.receive(0.0) for _ in range(4)] == [b"1", b"", b"3", None]
    assert a.receive(PATIENCE_S) == b"back"
    assert a.receive(PATIENCE_S) is None
    assert a.preserves_datagrams
    assert {a.peer, b.peer} == {"memory:a", "memory:b"}
    a.lock()
    a.close()


# --- addresses that can't be used -------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["udpin", "tcpin"])
def test_a_port_in_use(opened: Opener, scheme: str) -> None:
    holder = opened(f"{scheme}:127.0.0.1:0")
    assert isinstance(holder, Udp | Tcp)
    url = f"{scheme}:127.0.0.1:{holder.port}"
    with pytest.raises(TransportError, match=f"^{url}: .*in use"):
        opened(url)


def test_nobody_at_a_tcp_port(opened: Opener) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as holder:  # nobody else gets the port; it does not listen
        holder.bind(("127.0.0.1", 0))
        url = f"tcp:127.0.0.1:{holder.getsockname()[1]}"
        with pytest.raises(TransportError, match=f"^{url}: .*refused"):
            open_url(url)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "udpin",
        "udpin:",
        "udpin:127.0.0.1",
        "udpin::14540",
        "udpin:127.0.0.1:",
        "udpin:127.0.0.1:-1",
        "udpin:127.0.0.1:14540 ",
        "udpin:127.0.0.1:²",
        "udpin:127.0.0.1:" + "9" * 5000,
        "udpin:127.0.0.1:65536",
        "tcp:127.0.0.1:65536",
        "udpout:127.0.0.1:0",
        "tcp:127.0.0.1:0",
        "udp:127.0.0.1:14540",
        "/dev/ttyACM0",
        "udpin:a..b:14540",
        "udpout:a..b:14540",
        "tcp:a..b:14540",
        "tcpin:a..b:14540",
        "udpin:192.0.2.1:14540",  # of no interface
        "serial:/dev/ttyACM0",
        "serial:/dev/does-not-exist:57600",
        "serial:/dev/null:57600",
        "serial:/dev:57600",
    ],
)
def test_bad_urls_are_errors_that_name_them(url: str) -> None:
    with pytest.raises(TransportError) as refused:
        open_url(url)
    text = str(refused.value)
    assert text.startswith(f"{url}: ")
    assert len(text) > len(url) + 5
    assert "\n" not in text


@pytest.mark.parametrize("baud", ["0", "999999999999", "115200.0"])
def test_impossible_bauds(pty: tuple[int, str], baud: str) -> None:
    url = f"serial:{pty[1]}:{baud}"
    with pytest.raises(TransportError, match=f"^{url}: "):
        open_url(url)


def test_bauds_too_large_for_the_system(pty: tuple[int, str]) -> None:
    with pytest.raises(TransportError, match=f"^serial:{pty[1]}:{10**12}: "):
        Serial(pty[1], 10**12)
