from collections import deque
from collections.abc import Iterator

import pytest

from protocol.framing import Framer
from protocol.guarded_link import GuardedLink, drain, forward, is_local, refuse_exposed, stopped
from protocol.key_files import Keeper
from protocol.messages import Encoder, dialect
from protocol.transport import Memory, Transport, TransportError, Udp, open_url

KEY, OTHER_KEY = bytes(range(32)), bytes(32 * [7])
VEHICLE = Encoder(1, 1)
PATIENCE_S = 30.0


def beat() -> bytes:
    return VEHICLE.encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, 81, 0, 4, 3)


def key_setup() -> bytes:
    return Encoder(255, 190).encode_fields(dialect.MAVLink_setup_signing_message, 1, 1, list(KEY), 5)


def pair(near_key: bytes | None, far_key: bytes | None) -> tuple[GuardedLink, GuardedLink]:
    near, far = Memory.pair()
    keepers = [None if key is None else Keeper(key) for key in (near_key, far_key)]
    return GuardedLink(near, keepers[0]), GuardedLink(far, keepers[1])


@pytest.mark.parametrize("key", [None, KEY])
def test_what_is_sent_comes_out_the_same(key: bytes | None) -> None:
    near, far = pair(key, key)
    datagram = beat() + beat()
    near.send(datagram)
    assert far.receive(0.0) == datagram
    assert far.heard == near.said
    assert (near.said == datagram) == (key is None)


def test_a_stream_in_pieces_comes_out_the_same() -> None:
    sent, arrived = b"", b""
    near, far = pair(KEY, KEY)
    far.preserves_datagrams = False
    for _ in range(20):
        sent += (datagram := beat())
        near.send(datagram)
    incoming = far.inner._incoming  # type: ignore[attr-defined]
    stream = b"".join(incoming)
    incoming.clear()
    incoming += [stream[at : at + 7] for at in range(0, len(stream), 7)]
    while incoming:
        arrived += far.receive(0.0) or b""
    assert arrived == sent


@pytest.mark.parametrize(("ours", "theirs"), [(KEY, None), (KEY, OTHER_KEY)])
def test_what_is_not_signed_with_the_key_is_not_seen(ours: bytes, theirs: bytes | None) -> None:
    near, far = pair(theirs, ours)
    near.send(beat())
    near.inner.send(b"no frame \xfd\x01")
    assert far.receive(0.0) is None
    assert sum(far.refused.values()) == 1
    assert far.bad_frames + len(far.news()) >= 1
    assert far.news() == []  # it is said once


def test_a_flood_does_not_hold_up_the_loop() -> None:
    near, far = pair(None, KEY)
    for _ in range(100):
        near.send(beat())
    assert far.receive(1.0) is None and stopped(far)
    assert len(far.inner._incoming) > 50  # type: ignore[attr-defined]
    drain(far)
    assert not far.inner._incoming and not stopped(far)  # type: ignore[attr-defined]


@pytest.mark.parametrize("key", [None, KEY])
def test_a_key_is_not_handed_on(key: bytes | None) -> None:
    """What is handed on is what a log holds."""
    near, far = pair(key, key)
    datagram = beat()
    near.send(datagram + key_setup())
    assert far.receive(0.0) == datagram
    assert far.setup is not None
    assert KEY not in far.heard
    near.send(key_setup())
    assert far.receive(0.0) is None


def test_a_key_that_was_not_asked_for_changes_nothing() -> None:
    """Without the key, one that is sent is not even looked at."""
    near, far = pair(None, KEY)
    near.send(key_setup())
    assert far.receive(0.0) is None and far.setup is None


def test_another_s_frames_keep_their_signatures_and_a_log_gets_none() -> None:
    station, gate = pair(KEY, KEY)
    vehicle = GuardedLink(Memory.pair()[0], Keeper(KEY))
    frame = beat()
    station.send(frame)
    assert gate.receive(0.0) == frame
    outgoing = vehicle.inner._outgoing  # type: ignore[attr-defined]
    assert forward(vehicle, gate.heard) == frame
    assert outgoing == deque([station.said])


# -- addresses ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def bound() -> Iterator[list[Udp]]:
    """A bound end, the vehicle's and a stranger's."""
    end = Udp("127.0.0.1", 0, bind=True)
    ends = [end, *(Udp("127.0.0.1", end.port, bind=False) for _ in range(2))]
    yield ends
    for each in ends:
        each.close()


def received(link: Transport) -> bytes:
    """What comes, once it is there."""
    for _ in range(100):
        data = link.receive(PATIENCE_S)
        if data is not None:
            return data
    raise AssertionError("nothing came")


def test_with_a_key_no_stranger_is_answered_or_shuts_out_the_vehicle(bound: list[Udp]) -> None:
    end, vehicle, stranger = bound
    companion, signed = GuardedLink(end, Keeper(KEY)), GuardedLink(vehicle, Keeper(KEY))
    for round_ in range(3):
        stranger.send(beat())
        stranger.send(signed.said or beat())  # recorded before
        signed.send(beat())
        stranger.send(beat())
        assert received(companion)
        companion.lock()
        companion.send(beat())
        stranger.send(beat())
        assert companion.receive(0.05) is None
        companion.send(beat())
        assert received(signed) and received(signed), round_
    assert stranger.receive(0.0) is None


def test_with_a_key_the_vehicle_is_answered_though_others_with_the_key_speak(bound: list[Udp]) -> None:
    end, vehicle, scanner = bound
    companion = GuardedLink(end, Keeper(KEY))
    flown, other = GuardedLink(vehicle, Keeper(KEY)), GuardedLink(scanner, Keeper(KEY))
    flown.send(beat())
    assert received(companion)
    companion.lock()
    other.send(Encoder(1, 196).encode_fields(dialect.MAVLink_heartbeat_message, 18, 8, 0, 0, 4, 3))
    assert received(companion), "it is heard"
    companion.send(beat())
    assert received(flown) and other.receive(0.0) is None
    other.send(beat())
    assert received(companion), "the vehicle, at another address"
    companion.send(beat())
    assert received(other)


def test_without_a_key_only_who_is_admitted_is_answered(bound: list[Udp]) -> None:
    end, vehicle, stranger = bound
    address = f"127.0.0.1:{vehicle.port}"
    companion = GuardedLink(end, admits=lambda sender, data: sender == address)
    stranger.send(b"me first")
    assert companion.receive(0.05) is None
    companion.send(b"hello")
    assert companion.peer == ""
    vehicle.send(beat())
    assert received(companion)
    assert companion.peer == address
    stranger.send(b"and now")
    companion.send(b"hello")
    assert received(vehicle) == b"hello"
    assert companion.receive(0.05) is None
    assert stranger.receive(0.0) is None


@pytest.mark.parametrize(
    ("url", "local"),
    [
        ("udpin:127.0.0.1:14540", True),
        ("udpin:127.9.9.9:14540", True),
        ("tcpin:localhost:5760", True),
        ("udpin:0.0.0.0:14540", False),
        ("tcpin:192.168.1.2:5760", False),
        ("udpin:courier.example:14540", False),
    ],
)
def test_an_address_beyond_this_machine_needs_a_key(url: str, local: bool) -> None:
    assert is_local(url) is local
    refuse_exposed(url, signed=True, insecure=False)
    refuse_exposed(url, signed=False, insecure=True)
    if local:
        refuse_exposed(url, signed=False, insecure=False)
    else:
        with pytest.raises(TransportError, match=r"--signing-key.*127\.0\.0\.1.*--insecure"):
            refuse_exposed(url, signed=False, insecure=False)


@pytest.mark.parametrize(
    "url", ["udpin:127.0.0.1", "tcpin:0.0.0.0", "udpin::14540", "udpin:", "udpin", "udpin://127.0.0.1:14540"]
)
def test_what_is_no_address_is_told_how_one_is_written(url: str) -> None:
    with pytest.raises(TransportError, match="write it as udpin:HOST:PORT"):
        refuse_exposed(url, signed=False, insecure=False)
        open_url(url)


@pytest.mark.parametrize("url", ["udpin:::1:14540", "udpin:[::1]:14540", "tcpin:[::]:5760", "udpout:[::1]:14540"])
def test_an_address_of_ipv6_is_called_one(url: str) -> None:
    """It was called exposed, or a name that nobody knows."""
    with pytest.raises(TransportError, match=r"IPv6 are not taken"):
        refuse_exposed(url, signed=False, insecure=False)
        open_url(url)


@pytest.mark.parametrize("url", ["udpout:10.0.0.1:14540", "tcp:10.0.0.1:5760", "serial:/dev/ttyACM0:921600"])
def test_only_what_is_bound_is_exposed(url: str) -> None:
    refuse_exposed(url, signed=False, insecure=False)
    assert not is_local(url)


def test_only_whole_frames_are_in_a_guarded_datagram() -> None:
    near, far = pair(KEY, KEY)
    near.send(beat())
    raw = far.inner._incoming.pop()  # type: ignore[attr-defined]
    far.inner._incoming.append(b"\xfd\x00junk" + raw + raw + b"\xfe")  # type: ignore[attr-defined]
    data = far.receive(0.0)
    assert data is not None and len(Framer().datagram(data)) == 1
    assert far.refused["signing_replayed"] == 1
