"""Framing: pymavlink makes the frames, and what comes out must not depend on how the bytes were cut."""

import random
from collections.abc import Iterable, Sequence

import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.framing import Frame, Framer

LARGEST_FRAME = 280
UNKNOWN_ID = 54321


def pymavlink_frame(message: object, *, sequence: int = 0, v1: bool = False, key: bytes | None = None) -> bytes:
    mav = dialect.MAVLink(None, 7, 42)
    mav.seq = sequence
    if key is not None:
        mav.signing.secret_key = key
        mav.signing.sign_outgoing = True
        mav.signing.timestamp = 1234567
    frame: bytes = message.pack(mav, force_mavlink1=v1)  # type: ignore[attr-defined]
    return frame


def heartbeat(sequence: int = 0, *, v1: bool = False, key: bytes | None = None) -> bytes:
    message = dialect.MAVLink_heartbeat_message(2, 12, 81, 6 << 16, 4, 3)
    return pymavlink_frame(message, sequence=sequence, v1=v1, key=key)


def scan(sequence: int = 0) -> bytes:
    ranges = [(sequence * 7 + 253 * beam) % 1501 for beam in range(72)]
    message = dialect.MAVLink_obstacle_distance_message(sequence, 0, ranges, 5, 20, 1500, 5.0, 0.0, 12)
    return pymavlink_frame(message, sequence=sequence)


def handmade(payload: bytes, message_id: int, *, incompatible: int = 0, crc_extra: int = 0) -> bytes:
    """A v2 frame of anything, its checksum by pymavlink."""
    body = bytes((len(payload), incompatible, 0, 5, 7, 42)) + message_id.to_bytes(3, "little") + payload
    checksum: int = dialect.x25crc(body + bytes((crc_extra,))).crc
    return b"\xfd" + body + checksum.to_bytes(2, "little")


def raws(frames: Iterable[Frame]) -> list[bytes]:
    return [frame.raw for frame in frames]


def fed(pieces: Sequence[bytes], framer: Framer) -> list[Frame]:
    frames = [frame for piece in pieces for frame in framer.feed(piece)]
    return frames + framer.flush()


def cuts(data: bytes, seed: int) -> list[list[bytes]]:
    """The same bytes whole, byte by byte, with a tail, and cut at random places."""
    generator = random.Random(seed)
    ways = [[data], [data[at : at + 1] for at in range(len(data))], [data[:-1], data[-1:]], [data[:1], data[1:]]]
    for _ in range(20):
        places = sorted(generator.sample(range(len(data) + 1), min(len(data), generator.randint(1, 12))))
        ways.append([data[start:end] for start, end in zip([0, *places], [*places, len(data)], strict=True)])
    return ways


def counters(framer: Framer) -> tuple[int, int, int]:
    return framer.bad_bytes, framer.bad_frames, framer.unknown_frames


STREAMS = {
    "good": heartbeat(1) + scan(2) + heartbeat(3, v1=True) + heartbeat(4, key=b"k" * 32),
    "garbage": b"abc" + heartbeat(1) + b"\x00\xfe\xfd" + scan(2) + b"\xfd\xff",
    "corrupt": heartbeat(1) + scan(2)[:50] + b"?" + scan(2)[51:] + heartbeat(3),
    "truncated": scan(1)[:-1] + heartbeat(2) + heartbeat(3)[:11],
    "unknown": handmade(b"xyz", UNKNOWN_ID) + heartbeat(1) + handmade(b"x" * 255, UNKNOWN_ID),
    "unknown, then garbage": handmade(b"xyz", UNKNOWN_ID) + b"." + heartbeat(1) + handmade(b"", UNKNOWN_ID) + b"\x00",
    "flags": handmade(b"xyz", 0, incompatible=2) + heartbeat(1) + b"\xfd\x05",
    "magic bytes": b"\xfd" * 300 + heartbeat(1) + b"\xfe" * 300,
    "noise": random.Random(11).randbytes(3000) + heartbeat(1) + random.Random(12).randbytes(3000),
    "noise of few values": bytes(random.Random(13).choices(b"\xfd\xfe\x00\x01\x20", k=3000)),
}


@pytest.mark.parametrize("name", STREAMS)
def test_any_cut_gives_the_same_frames_and_counts(name: str) -> None:
    data = STREAMS[name]
    whole = Framer()
    frames = fed([data], whole)
    for pieces in cuts(data, seed=len(data)):
        framer = Framer()
        assert fed(pieces, framer) == frames
        assert counters(framer) == counters(whole)
    assert sum(map(len, raws(frames))) + whole.bad_bytes == len(data)


@pytest.mark.parametrize("filler", [b"\xfe", b"\xfd", b"\xfe\x00\x01\x01\x01\x00", handmade(b"\xfe" * 34, UNKNOWN_ID)])
def test_what_a_datagram_costs_is_bounded_and_the_rest_counted(filler: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many checksums as a datagram of whole frames would need, whatever the bytes; the next datagram is unharmed."""
    checksums = 0

    def counting(data: bytes) -> int:
        nonlocal checksums
        checksums += 1
        return mcrf4xx(data)

    monkeypatch.setattr("protocol.framing.mcrf4xx", counting)
    framer, flood = Framer(), filler * (9216 // len(filler))
    frames = framer.datagram(flood)
    assert checksums <= 400
    assert sum(map(len, raws(frames))) + framer.bad_bytes == len(flood) and framer.bad_bytes > 8000
    assert framer.bad_frames > 0
    assert len(framer.datagram(heartbeat(1) * 60)) == 60


def test_fields_of_a_frame() -> None:
    plain, old, signed = Framer().datagram(heartbeat(9) + heartbeat(10, v1=True) + heartbeat(11, key=b"k" * 32))
    for frame, sequence in ((plain, 9), (old, 10), (signed, 11)):
        assert (frame.message_id, frame.system, frame.component, frame.sequence) == (0, 7, 42, sequence)
        assert frame.payload == bytes((0, 0, 6, 0, 2, 12, 81, 4, 3))
        assert frame.known
    assert [frame.version for frame in (plain, old, signed)] == [2, 1, 2]
    assert [frame.signed for frame in (plain, old, signed)] == [False, False, True]
    assert [len(frame.raw) for frame in (plain, old, signed)] == [21, 17, 34]
    assert plain.checksum == int.from_bytes(plain.raw[-2:], "little")
    assert signed.checksum == int.from_bytes(signed.raw[19:21], "little")


def test_every_message_id_of_three_bytes() -> None:
    known = {0, 255, 256, 11000, 12900} & dialect.mavlink_map.keys()
    for message_id in known | {65535, 65536, 0xFFFFFF}:
        message_class = dialect.mavlink_map.get(message_id)
        data = handmade(b"\x01", message_id, crc_extra=message_class.crc_extra if message_class else 0)
        (frame,) = Framer().datagram(data)
        assert frame.message_id == message_id
        assert frame.known == (message_class is not None)


def test_a_lying_length_costs_only_its_own_frame() -> None:
    good = [heartbeat(sequence) for sequence in range(1, 13)]
    broken = bytearray(heartbeat(0))
    for length in set(range(256)) - {broken[1]}:
        broken[1] = length
        framer = Framer()
        assert raws(framer.datagram(bytes(broken) + b"".join(good))) == good, length
        assert framer.bad_bytes == len(broken)


@pytest.mark.parametrize("stray", [0xFD, 0xFE])
def test_a_stray_magic_byte_costs_nothing(stray: int) -> None:
    for first in range(256):
        good = [heartbeat((first + i) % 256) for i in range(16)]
        assert raws(Framer().datagram(bytes((stray,)) + b"".join(good))) == good


@pytest.mark.parametrize("v1", [False, True])
def test_a_flipped_bit_costs_only_its_own_frame(v1: bool) -> None:
    before, victim, after = heartbeat(1, v1=v1), heartbeat(2, v1=v1), scan(3)
    for bit in range(8 * len(victim)):
        broken = bytearray(victim)
        broken[bit // 8] ^= 1 << bit % 8
        frames = Framer().datagram(before + bytes(broken) + after)
        assert raws(frame for frame in frames if frame.known) == [before, after]


@pytest.mark.parametrize("flags", [2, 3, 4, 0x80, 0xFF])
def test_unsupported_incompatibility_flags_are_refused(flags: int) -> None:
    framer = Framer()
    extra = dialect.MAVLink_heartbeat_message.crc_extra
    refused = handmade(b"\x00\x00\x06\x00\x02\x0c\x51\x04\x03", 0, incompatible=flags, crc_extra=extra)
    assert raws(framer.datagram(refused + heartbeat(1))) == [heartbeat(1)]
    assert framer.bad_frames == 1


def test_a_longer_payload_is_a_newer_senders() -> None:
    extra = dialect.MAVLink_heartbeat_message.crc_extra
    (frame,) = Framer().datagram(handmade(bytes(range(1, 15)), 0, crc_extra=extra))
    assert frame.known
    assert frame.payload == bytes(range(1, 15))


def test_unknown_messages_are_carried_where_a_frame_can_end() -> None:
    unknown = handmade(b"payload", UNKNOWN_ID)
    framer = Framer()
    frames = framer.datagram(unknown + heartbeat(1) + unknown)
    assert raws(frames) == [unknown, heartbeat(1), unknown]
    assert [frame.known for frame in frames] == [False, True, False]
    assert frames[0].payload == b"payload"
    assert framer.unknown_frames == 2
    assert raws(framer.datagram(unknown + b"\x00" + heartbeat(1))) == [heartbeat(1)]
    assert framer.unknown_frames == 2


def test_in_a_stream_an_unknown_message_waits_for_the_next_byte() -> None:
    unknown = handmade(b"payload", UNKNOWN_ID)
    framer = Framer()
    assert framer.feed(unknown) == []
    assert raws(framer.feed(b"\xfd")) == [unknown]
    assert framer.feed(heartbeat(1)[1:]) != []
    assert framer.feed(unknown) == []
    assert raws(framer.flush()) == [unknown]
    assert framer.flush() == []


def test_an_unknown_candidate_that_holds_a_valid_frame_is_not_believed() -> None:
    inner = heartbeat(1)
    liar = handmade(b"junk" + inner + b"junk", UNKNOWN_ID)
    assert raws(Framer().datagram(liar + heartbeat(2))) == [inner, heartbeat(2)]


def test_a_valid_frame_may_end_where_an_unknown_candidate_does() -> None:
    inner = heartbeat(1)
    liar = handmade(b"junk" + inner, UNKNOWN_ID)[: -2 - len(inner)] + inner
    assert liar[1] != len(liar) - 12
    liar = liar[:1] + bytes((len(liar) - 12,)) + liar[2:]
    assert raws(Framer().datagram(liar + heartbeat(2))) == [inner, heartbeat(2)]


def test_one_liar_does_not_discredit_other_unknown_messages() -> None:
    inner, unknown = heartbeat(1), handmade(b"payload", UNKNOWN_ID)
    liar = handmade(b"junk" + unknown + inner + b"junk", UNKNOWN_ID)
    assert raws(Framer().datagram(liar + unknown + heartbeat(2))) == [unknown, inner, unknown, heartbeat(2)]
    liar = handmade(b"junk" + inner + b"junk", UNKNOWN_ID)
    assert raws(Framer().datagram(liar + unknown + heartbeat(2))) == [inner, unknown, heartbeat(2)]


def test_a_refused_frame_holds_nothing_up() -> None:
    header = b"\xfd\xff\x02" + bytes(7)
    assert raws(Framer().feed(header + heartbeat(1))) == [heartbeat(1)]


def test_unknown_messages_can_be_refused() -> None:
    framer = Framer(carry_unknown=False)
    assert raws(framer.datagram(handmade(b"x", UNKNOWN_ID) + heartbeat(1))) == [heartbeat(1)]
    assert (framer.unknown_frames, framer.bad_frames) == (0, 1)


def test_the_end_of_a_datagram_settles_what_is_left() -> None:
    framer = Framer()
    assert framer.datagram(scan(1)[:100]) == []
    assert framer.bad_bytes == 100
    assert raws(framer.datagram(heartbeat(2))) == [heartbeat(2)]
    assert framer.datagram(b"") == []


def test_memory_is_bounded() -> None:
    framer = Framer()
    generator = random.Random(5)
    given_bytes = taken = 0
    for _ in range(3000):
        piece = bytes(generator.choices((0xFD, 0xFE, 0x00, 0x01, 0xFF, 0x40), k=generator.randint(0, 60)))
        given_bytes += len(piece)
        taken += sum(map(len, raws(framer.feed(piece))))
        assert 0 <= given_bytes - taken - framer.bad_bytes <= LARGEST_FRAME


@settings(max_examples=150)
@given(st.lists(st.tuples(st.binary(max_size=40), st.integers(0, 255), st.booleans()), max_size=8), st.binary())
def test_no_garbage_costs_a_good_frame(parts: list[tuple[bytes, int, bool]], tail: bytes) -> None:
    good = [heartbeat(sequence, v1=v1) for _, sequence, v1 in parts]
    data = b"".join(garbage + frame for (garbage, _, _), frame in zip(parts, good, strict=True)) + tail
    assert raws(Framer(carry_unknown=False).datagram(data)) == good


@settings(max_examples=150)
@given(st.lists(st.one_of(st.binary(max_size=30), st.sampled_from(list(STREAMS.values())[:7])), max_size=6))
def test_any_pieces_give_what_their_sum_gives(pieces: list[bytes]) -> None:
    pieced, whole = Framer(), Framer()
    data = b"".join(pieces)
    frames = whole.datagram(data)
    assert fed(pieces, pieced) == frames
    assert counters(pieced) == counters(whole)
    assert sum(map(len, raws(frames))) + whole.bad_bytes == len(data)
    for frame in frames:
        assert frame.raw in data
