"""Flights recorded from PX4 and ArduCopter: every frame comes out, and its values are those that pymavlink reads."""

import random
from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.framing import Framer
from protocol.messages import AvailableModes, ComponentMetadata, CurrentMode, Encoder, decode
from protocol.peer import Peer

DATA = Path(__file__).resolve().parents[1] / "data"
RECORDINGS = {"px4_offboard": 8762, "ardupilot_guided": 6210}
UNKNOWN = {"px4_offboard": {8, 380, 410, 411, 436}, "ardupilot_guided": set[int]()}
every_recording = pytest.mark.parametrize("name", RECORDINGS)


def records(name: str) -> list[tuple[int, bytes]]:
    """A telemetry log's (time in us, frame); its frames are found by their own lengths, without the framer."""
    data = (DATA / f"{name}.tlog").read_bytes()
    found = []
    at = 0
    while at < len(data):
        start = at + 8
        assert data[start] == 0xFD
        end = start + 12 + data[start + 1] + (13 if data[start + 2] & 1 else 0)
        found.append((int.from_bytes(data[at:start], "big"), data[start:end]))
        at = end
    assert at == len(data)
    return found


@every_recording
def test_every_frame_comes_out(name: str) -> None:
    recorded = [frame for _, frame in records(name)]
    assert len(recorded) == RECORDINGS[name]
    framer = Framer()
    frames = [frame for data in recorded for frame in framer.datagram(data)]
    assert [frame.raw for frame in frames] == recorded
    assert (framer.bad_bytes, framer.bad_frames) == (0, 0)
    assert {frame.message_id for frame in frames if not frame.known} == UNKNOWN[name]
    assert framer.unknown_frames == sum(not frame.known for frame in frames)


@every_recording
def test_every_frame_comes_out_of_a_stream_cut_anywhere(name: str) -> None:
    recorded = [frame for _, frame in records(name)]
    stream = b"".join(recorded)
    generator = random.Random(1)
    framer = Framer()
    frames = []
    at = 0
    while at < len(stream):
        end = at + generator.randint(1, 700)
        frames += framer.feed(stream[at:end])
        at = end
    frames += framer.flush()
    assert [frame.raw for frame in frames] == recorded
    assert framer.bad_bytes == 0


@every_recording
def test_values_are_those_that_pymavlink_reads(name: str) -> None:
    framer = Framer()
    theirs = dialect.MAVLink(None)
    compared = Counter[str]()
    for _, data in records(name):
        (frame,) = framer.datagram(data)
        message, reference = decode(frame), theirs.parse_char(data)
        if isinstance(reference, dialect.MAVLink_unknown):
            assert message is None or type(message) in (AvailableModes, ComponentMetadata, CurrentMode)
            continue
        assert message is not None
        assert type(message) is type(reference)
        assert repr(message.to_dict()) == repr(reference.to_dict())
        assert message.get_seq() == reference.get_seq()
        assert message.get_srcSystem() == reference.get_srcSystem()
        assert message.get_srcComponent() == reference.get_srcComponent()
        compared[message.get_type()] += 1
    assert {"HEARTBEAT", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "SET_ATTITUDE_TARGET"} <= compared.keys()


@every_recording
def test_encoding_again_gives_the_same_values(name: str) -> None:
    """Not always the same bytes: a sender may leave zeros that it could have cut."""
    framer = Framer()
    for _, data in records(name):
        (frame,) = framer.datagram(data)
        message = decode(frame)
        if message is None:
            continue
        encoder = Encoder(frame.system, frame.component)
        encoder.sequence = frame.sequence
        (again,) = framer.datagram(encoder.encode(message))
        assert again.payload.rstrip(b"\0") == frame.payload.rstrip(b"\0")
        assert (again.system, again.component, again.sequence) == (frame.system, frame.component, frame.sequence)


@every_recording
def test_the_senders_are_followed(name: str) -> None:
    framer = Framer()
    peers, received = {(1, 1): Peer(1, 1), (1, 191): Peer(1, 191)}, Counter[tuple[int, int]]()
    for time_us, data in records(name):
        (frame,) = framer.datagram(data)
        received.update(place for place, peer in peers.items() if peer.observe(frame, time_us * 1000))
    assert received.total() == RECORDINGS[name]
    for place, peer in peers.items():
        assert received[place] > 500
        assert (peer.lost, peer.late, peer.duplicates, peer.restarts) == (0, 0, 0, 0)
