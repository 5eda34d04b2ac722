import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest

from protocol.framing import Frame, Framer
from protocol.messages import Encoder, dialect
from protocol.signing import SECOND, Memory, Refusal, Signing, timestamp, unsigned

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
NOW = timestamp(1_790_000_000 * 10**9)
MINUTE = 60 * SECOND


def plain(number: int = 1, *, system: int = 1, component: int = 1) -> bytes:
    """A frame whose payload tells it from others."""
    return Encoder(system, component).encode_fields(dialect.MAVLink_timesync_message, 0, number)


def frames(data: bytes) -> list[Frame]:
    return Framer().datagram(data)


def signed(now: int, *, key: bytes = KEY, link_id: int = 0, system: int = 1) -> Frame:
    """A frame with this timestamp."""
    (frame,) = frames(Signing(key, link_id=link_id).sign(plain(system=system), now))
    return frame


def as_one_says_it(now: int, key: bytes = KEY, link_id: int = 0) -> Any:
    """pymavlink's own sender and receiver with a key."""
    mav = dialect.MAVLink(None, 1, 1)
    mav.signing.secret_key, mav.signing.timestamp = key, now
    mav.signing.link_id, mav.signing.sign_outgoing = link_id, True
    return mav


# -- the format --------------------------------------------------------------------------------------------------------


def test_pymavlink_takes_what_is_signed_and_the_reverse() -> None:
    mav = as_one_says_it(NOW, link_id=3)
    datagram = Signing(KEY).sign(plain(1) + plain(2), NOW)
    messages = mav.parse_buffer(datagram)
    assert [message.ts1 for message in messages] == [1, 2]
    assert mav.signing.badsig_count == 0
    ours = Signing(KEY)
    for number in range(1, 5):
        (frame,) = frames(dialect.MAVLink_timesync_message(0, number).pack(mav))
        assert ours.judge(frame, NOW) is None
        assert unsigned(frame) == plain(number)
    assert ours.leased(NOW).heard.keys() == {(1, 1, 3)}


def test_pymavlink_with_another_key_refuses_it() -> None:
    mav = as_one_says_it(NOW, OTHER_KEY)
    with pytest.raises(dialect.MAVError, match="Invalid signature"):
        mav.parse_buffer(Signing(KEY).sign(plain(), NOW))


@pytest.mark.parametrize("length", [0, 1, 2, 9, 254, 255])
def test_a_frame_comes_back_without_its_signature(length: int) -> None:
    """Frames of any length, of messages that the dialect lacks too."""
    body = bytes((length, 0, 0, 7, 1, 1)) + (60_000).to_bytes(3, "little") + bytes(range(1, length + 1))
    checksum = dialect.x25crc(body + b"\x55").crc
    frame = b"\xfd" + body + checksum.to_bytes(2, "little")
    (back,) = frames(Signing(KEY).sign(frame, NOW))
    assert back.signed
    assert unsigned(back) == frame
    with_flag = back.raw[1 : 10 + length] + b"\x55"
    assert dialect.x25crc(with_flag).crc == back.checksum


def test_timestamps_only_grow() -> None:
    sender = Signing(KEY, Memory(sent=NOW + 5))
    stamps = [
        int.from_bytes(frame.raw[-12:-6], "little")
        for now in (NOW, NOW + 100, NOW - 100)
        for frame in frames(sender.sign(plain() + plain(), now))
    ]
    assert stamps == [NOW + 6, NOW + 7, NOW + 100, NOW + 101, NOW + 102, NOW + 103]


@pytest.mark.parametrize("size", [0, 31, 33])
def test_a_key_has_32_bytes(size: int) -> None:
    with pytest.raises(ValueError, match="32"):
        Signing(bytes(size))


# -- what is refused ---------------------------------------------------------------------------------------------------


def test_any_changed_bit_is_refused() -> None:
    receiver, good = Signing(KEY), signed(NOW)
    for bit in range(8 * len(good.raw)):
        raw = bytearray(good.raw)
        raw[bit // 8] ^= 1 << bit % 8
        for frame in Framer().datagram(bytes(raw)):
            assert receiver.judge(frame, NOW) in (Refusal.FORGED, Refusal.UNSIGNED)
    assert receiver.leased(NOW) == Memory()
    assert receiver.judge(good, NOW) is None


@pytest.mark.parametrize(
    ("stamp", "refusal"),
    [
        (NOW + MINUTE, None),
        (NOW + MINUTE + 1, Refusal.AHEAD),
        (NOW - MINUTE, None),
        (NOW - MINUTE - 1, Refusal.BEHIND),
        (2**48 - 1, Refusal.AHEAD),
    ],
)
def test_a_new_stream_begins_within_a_minute(stamp: int, refusal: Refusal | None) -> None:
    receiver = Signing(KEY)
    assert receiver.judge(signed(stamp), NOW) is refusal
    assert receiver.judge(signed(NOW + MINUTE), NOW) is (Refusal.REPLAYED if stamp == NOW + MINUTE else None)


def test_a_forged_future_shuts_nobody_out() -> None:
    """pymavlink takes over the timestamp before it compares the signature."""
    receiver = Signing(KEY)
    assert receiver.judge(signed(NOW), NOW) is None
    forged = [signed(NOW + ahead, key=OTHER_KEY) for ahead in (1, SECOND, MINUTE, 2**47 - NOW)]
    assert [receiver.judge(frame, NOW) for frame in forged] == [Refusal.FORGED] * 4
    assert receiver.judge(signed(NOW + 1), NOW) is None


def test_a_frame_that_was_overtaken_is_taken_once() -> None:
    receiver, stamps = Signing(KEY), [NOW + 10 * index for index in range(60)]
    late = stamps[20:50:3]
    for stamp in (*(each for each in stamps if each not in late), *late):
        assert receiver.judge(signed(stamp), NOW) is None
    for stamp in stamps:
        assert receiver.judge(signed(stamp), NOW) is Refusal.REPLAYED
    assert receiver.judge(signed(NOW + SECOND + 600), NOW) is None
    assert receiver.judge(signed(NOW + 599), NOW) is Refusal.REPLAYED  # never heard, but too old


def test_unsigned_is_taken_of_radios_only_and_not_under_a_signers_name() -> None:
    receiver = Signing(KEY)

    def status(system: int) -> Frame:
        return frames(Encoder(system, 1).encode_fields(dialect.MAVLink_radio_status_message, 1, 1, 1, 1, 1, 1, 1))[0]

    assert receiver.judge(status(51), NOW) is None
    assert receiver.judge(frames(plain())[0], NOW) is Refusal.UNSIGNED
    assert receiver.judge(signed(NOW), NOW) is None
    assert receiver.judge(status(1), NOW) is Refusal.UNSIGNED
    one = dialect.MAVLink(None, 1, 1)
    (frame,) = frames(dialect.MAVLink_timesync_message(0, 1).pack(one, force_mavlink1=True))
    assert frame.version == 1
    assert receiver.judge(frame, NOW) is Refusal.UNSIGNED


def test_what_was_recorded_on_another_link_is_refused() -> None:
    receiver = Signing(KEY)
    other = [signed(NOW + each, link_id=1) for each in range(100)]
    assert receiver.judge(signed(NOW + 200), NOW) is None
    assert {receiver.judge(frame, NOW) for frame in other} == {Refusal.OTHER_LINK}
    assert receiver.judge(signed(NOW + 201), NOW) is None
    assert receiver.judge(signed(NOW + 300, link_id=1), NOW) is None  # a second link of the sender's own
    assert receiver.judge(signed(NOW + 202), NOW) is None  # is none that shuts out the first
    later = NOW + 10 * SECOND
    assert receiver.judge(signed(later), NOW) is None
    assert receiver.judge(signed(NOW + 400, link_id=1), NOW) is Refusal.OTHER_LINK


def test_streams_are_bounded_and_old_ones_make_room() -> None:
    receiver = Signing(KEY)
    for system in range(1, 65):
        assert receiver.judge(signed(NOW + system, system=system), NOW) is None
    assert receiver.judge(signed(NOW + 65, system=65), NOW) is Refusal.CROWDED
    later = NOW + 2 * MINUTE
    assert receiver.judge(signed(later, system=65), later) is None
    assert receiver.judge(signed(NOW + 1), later) in (Refusal.BEHIND, Refusal.OTHER_LINK)
    assert len(receiver.leased(NOW).heard) == 64


# -- restarts ----------------------------------------------------------------------------------------------------------


@dataclass
class Side:
    """A program that is killed and starts again; `apart`: its wall clock, against true time."""

    apart: int
    link_id: int = 0
    disk: Memory = field(default_factory=Memory)
    signing: Signing = field(init=False)

    def __post_init__(self) -> None:
        self.start(NOW)

    def start(self, true: int) -> None:
        """The clock never goes back, as of a `Keeper`."""
        self._ahead = max(true + self.apart, self.disk.sent) - true
        self.signing = Signing(KEY, self.disk, true + self._ahead, link_id=self.link_id)

    def settle(self) -> None:
        if self.signing.due:
            self.disk = self.disk.merged(self.signing.leased(self._now))

    def says(self, true: int, number: int) -> Frame:
        self._now = true + self._ahead
        data = self.signing.sign(plain(number), self._now)
        self.settle()
        return frames(data)[0]

    def takes(self, frame: Frame, true: int) -> bool:
        self._now = true + self._ahead
        accepted = self.signing.accepts(frame, self._now)
        self.settle()
        return accepted


def attacks(draw: random.Random, heard: list[Frame], elsewhere: list[Frame]) -> Iterator[Frame]:
    """Forged, replayed, unsigned, damaged, and recorded on another link of the sender."""
    while True:
        match draw.randrange(6):
            case 0:
                yield signed(NOW + draw.randrange(-MINUTE, 2**46), key=OTHER_KEY, link_id=draw.randrange(2))
            case 1 | 2:
                yield draw.choice(heard)
            case 3:
                yield frames(plain(draw.getrandbits(30)))[0]
            case 4:
                raw = draw.choice(heard).raw  # a later timestamp under an old signature
                later = int.from_bytes(raw[-12:-6], "little") + draw.randrange(1, MINUTE)
                yield from frames(raw[:-12] + later.to_bytes(6, "little") + raw[-6:])
            case 5:
                yield draw.choice(elsewhere)


@pytest.mark.parametrize(("sender_apart", "receiver_apart"), [(0, 0), (55 * SECOND, 0), (0, 55 * SECOND), (-9, -9)])
def test_no_attack_passes_and_the_sender_always_does(sender_apart: int, receiver_apart: int) -> None:
    """25,000 attacks a pair of clocks, through kills of either side whose walls then fall back by an hour."""
    draw = random.Random(18)
    sender, receiver = Side(sender_apart), Side(receiver_apart)
    true, taken, passed, lost = NOW, [], 0, 0
    elsewhere = [signed(NOW + sender_apart - each, link_id=1) for each in range(1, 200)]
    first = sender.says(true, 0)
    assert receiver.takes(first, true)
    taken.append(first)
    attack = attacks(draw, taken, elsewhere)
    for number in range(1, 1001):
        true += SECOND // 50
        if number % 97 == 0:  # a restart takes longer than a second
            true += SECOND + draw.randrange(10 * SECOND)
            restarted = draw.choice((sender, receiver))
            restarted.apart = draw.choice((restarted.apart, restarted.apart - 3600 * SECOND))
            restarted.start(true)
        passed += sum(receiver.takes(next(attack), true) for _ in range(25))
        frame = sender.says(true, number)
        lost += not receiver.takes(frame, true)
        taken.append(frame)
    assert (passed, lost) == (0, 0)
    seen = {reason for reason, count in receiver.signing.refused.items() if count}
    assert seen >= {Refusal.FORGED, Refusal.REPLAYED, Refusal.UNSIGNED}


def test_nothing_is_taken_or_sent_twice_however_a_program_dies() -> None:
    """It is killed after any frame; what is on the disk is all that it knows then."""
    side, stamps, taken = Side(0), [], []
    for number in range(500):
        true = NOW + number * SECOND // 20
        frame = signed(true)
        if side.takes(frame, true):
            taken.append(frame)
        stamps.append(int.from_bytes(side.says(true, number).raw[-12:-6], "little"))
        if number % 7 == 0:
            side.start(true)
            assert not any(side.takes(each, true) for each in taken[-50:])
    assert stamps == sorted(set(stamps))


def test_a_restart_in_vain_raises_no_limit() -> None:
    side = Side(0)
    assert side.takes(signed(NOW), NOW)
    kept = side.disk
    for _ in range(100):
        side.start(NOW)
        assert side.signing.leased(NOW) == kept
