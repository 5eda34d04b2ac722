"""The injector between both sides: shares by seed, order, and what is said in place of what was."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from protocol.frames import from_euler
from protocol.framing import Frame, Framer
from protocol.messages import Encoder, decode, dialect
from studies.faults import changes
from studies.faults.changes import ATTITUDE, HEARTBEAT, POSITION, RING
from studies.faults.injector import JUNK, Change, Injector, Link, Onset

MS = 1_000_000
COUNT = 4000


def beat(armed: bool) -> bytes:
    mode = dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    return Encoder(1, 1).encode_fields(dialect.MAVLink_heartbeat_message, 2, 12, mode, 0, 4, 3)


def said(time_ms: int = 1000) -> bytes:
    """What a vehicle says in one datagram: it moves and turns with the time."""
    turn, encoder = 1e-3 * time_ms, Encoder(1, 1)
    half = 0.5 * turn
    ranges = [200 + beam + time_ms // 10 for beam in range(72)]
    fields: tuple[tuple[type, tuple[object, ...]], ...] = (
        (dialect.MAVLink_heartbeat_message, (2, 12, 128, 0, 4, 3)),
        (
            dialect.MAVLink_attitude_quaternion_message,
            (time_ms, math.cos(half), 0.0, 0.0, math.sin(half), 0.0, 0.0, 1.0),
        ),
        (dialect.MAVLink_attitude_message, (time_ms, 0.0, 0.0, turn, 0.0, 0.0, 1.0)),
        (dialect.MAVLink_local_position_ned_message, (time_ms, 3.0 * turn, 0.5, -3.0, 3.0, 0.0, 0.0)),
        (dialect.MAVLink_obstacle_distance_message, (1000 * time_ms, 0, ranges, 5, 20, 4000, 5.0, 0.0, 12)),
        (dialect.MAVLink_timesync_message, (time_ms * MS, 77)),
    )
    return b"".join(encoder.encode_fields(message, *values) for message, values in fields)


def messages(data: bytes) -> list[object]:
    """The messages of a datagram that is nothing but sound frames."""
    framer = Framer()
    frames = framer.datagram(data)
    assert framer.bad_bytes == 0
    return [decode(frame) for frame in frames]


def one(data: bytes, message_id: int) -> dict[str, object]:
    (found,) = (frame for frame in Framer().datagram(data) if frame.message_id == message_id)
    values: dict[str, object] = decode(found).to_dict()  # type: ignore[union-attr]
    return values


def numbered(link: Link, seed: int = 1, back: bool = False) -> list[tuple[int, int]]:
    """COUNT datagrams, one a millisecond, over a link: when (ms) each arrived, and its number."""
    between, out = Injector(link, seed=seed), []
    for number in range(COUNT + 500):
        now_ns = number * MS
        if number < COUNT:
            send = between.to_vehicle if back else between.to_companion
            send(number.to_bytes(2, "big"), now_ns)
        arrived = between.at_vehicle(now_ns) if back else between.at_companion(now_ns)
        out += [(number, int.from_bytes(data, "big")) for data in arrived]
    return out


def share_is(found: int, share: float) -> bool:
    """Within four standard deviations."""
    return abs(found - share * COUNT) < 4.0 * math.sqrt(COUNT * share * (1.0 - share))


# --- the link ---


def test_a_perfect_link_hands_on_at_once_and_in_order() -> None:
    assert numbered(Link()) == [(number, number) for number in range(COUNT)]


@pytest.mark.parametrize("back", [False, True])
def test_each_way_has_its_delay(back: bool) -> None:
    arrived = numbered(Link(there=0.02, back=0.05), back=back)
    assert arrived == [(number + (50 if back else 20), number) for number in range(COUNT)]


def test_the_same_seed_does_the_same_harm_and_each_way_its_own() -> None:
    link = Link(there=0.05, back=0.05, jitter=0.02, loss=0.1, duplicated=0.05, reordered=0.05)
    assert numbered(link) == numbered(link)
    assert numbered(link) != numbered(link, seed=2)
    assert numbered(link) != numbered(link, back=True)


def test_so_many_are_lost() -> None:
    arrived = [number for _, number in numbered(Link(loss=0.4))]
    assert arrived == sorted(set(arrived)) and share_is(COUNT - len(arrived), 0.4)


def test_so_many_come_twice() -> None:
    arrived = [number for _, number in numbered(Link(duplicated=0.05))]
    assert sorted(set(arrived)) == list(range(COUNT)) and share_is(len(arrived) - COUNT, 0.05)


def test_so_many_are_overtaken_by_the_next_one() -> None:
    arrived = [number for _, number in numbered(Link(reordered=0.2))]
    swapped = [(one, other) for one, other in pairwise(arrived) if other < one]
    assert all(one == other + 1 for one, other in swapped)
    assert share_is(len(swapped), 0.2) and len(arrived) >= COUNT - 1


def test_jitter_spreads_evenly_and_never_before_the_sending() -> None:
    takes = np.array([at - number for at, number in numbered(Link(there=0.055, jitter=0.05))])
    assert takes.min() in (5, 6) and takes.max() in (104, 105)
    assert takes.mean() == pytest.approx(55.5, abs=2.0) and takes.std() == pytest.approx(
        100.0 / math.sqrt(12.0), abs=1.5
    )
    assert min(at - number for at, number in numbered(Link(there=0.01, jitter=0.05))) == 0


def test_so_many_are_corrupt_by_one_byte_that_its_checksum_finds() -> None:
    between, whole = Injector(Link(corrupted=0.02)), said()
    good = len(Framer().datagram(whole))
    damaged = 0
    for number in range(COUNT):
        between.to_companion(whole, number * MS)
        (heard,) = between.at_companion(number * MS)
        wrong = sum(a != b for a, b in zip(heard, whole, strict=True))
        assert wrong <= 1
        assert not wrong or len(Framer(carry_unknown=False).datagram(heard)) < good
        damaged += wrong
    assert share_is(damaged, 0.02)


def test_a_flood_stands_beside_what_is_said_and_holds_no_frame() -> None:
    between = Injector(Link(flood=2))
    between.to_companion(said(), 0)
    assert between.at_companion(0) == [said(), JUNK, JUNK]
    assert len(JUNK) == 9216 and not Framer().datagram(JUNK)
    between.to_vehicle(b"back", 0)
    assert between.at_vehicle(0) == [b"back"]


def test_the_next_arrival_is_known() -> None:
    between = Injector(Link(there=0.03, back=0.01))
    assert between.next_ns is None
    between.to_companion(b"a", 0)
    assert between.next_ns == 30 * MS
    between.to_vehicle(b"b", 5 * MS)
    assert between.next_ns == 15 * MS


# --- the onset ---


def test_a_fault_begins_so_long_after_the_vehicle_says_that_it_is_armed() -> None:
    between = Injector(onset=Onset(0.5, Link(loss=1.0)))
    assert not between.keeps_step and Injector().keeps_step
    for time_ms in range(0, 2000, 100):
        between.to_companion(beat(armed=time_ms >= 300), time_ms * MS)
    assert between.began_ns == 800 * MS
    assert len(between.at_companion(2000 * MS)) == 8


def test_what_stands_still_is_not_frozen_before_it_moves() -> None:
    between = Injector(onset=Onset(0.0, change=changes.frozen(ATTITUDE)))
    between.to_companion(beat(armed=True), 0)
    for time_ms in range(4, 1000, 4):
        between.to_companion(said(max(time_ms, 600)), time_ms * MS)
    assert between.began_ns == 604 * MS


def test_a_link_that_gets_worse_loses_nothing_that_is_under_way() -> None:
    between = Injector(Link(there=0.1))
    between.to_companion(b"a", 0)
    between.link = Link(there=0.3)
    between.to_companion(b"b", MS)
    assert between.at_companion(100 * MS) == [b"a"] and between.at_companion(301 * MS) == [b"b"]


# --- changes ---

ALL: tuple[Callable[[], Change], ...] = (
    lambda: changes.frozen(POSITION),
    lambda: changes.frozen(ATTITUDE),
    lambda: changes.frozen(RING),
    lambda: changes.random_ring(1),
    changes.impossible_ring,
    lambda: changes.turned(90.0, whole_frame=True),
    lambda: changes.turned(45.0, whole_frame=False),
    lambda: changes.shifted(north=90_000.0, down=-3.0),
    lambda: changes.swift(140.0, one=False),
    lambda: changes.late(POSITION, 0.15),
    lambda: changes.stamped_ahead(POSITION, 4.0),
    lambda: changes.clock_back(0.5),
    lambda: changes.clock_back(None),
)


@pytest.mark.parametrize("make", ALL)
def test_what_is_changed_is_sound_and_keeps_its_place(make: Callable[[], Change]) -> None:
    """All frames decode, in order, with the sequence numbers and the sender that they had."""

    def header(frame: Frame) -> tuple[int, int, int, int]:
        return frame.message_id, frame.sequence, frame.system, frame.component

    change, differs = make(), False
    for time_ms in (1000, 1100, 1200, 1300):
        before = said(time_ms)
        after = change(time_ms * MS, before)
        framer = Framer()
        assert [header(frame) for frame in framer.datagram(after)] == [header(f) for f in Framer().datagram(before)]
        assert framer.bad_bytes == 0
        differs = differs or after != before
    assert differs


def test_what_is_frozen_says_the_same_with_fresh_stamps() -> None:
    change = changes.frozen(POSITION)
    first, then = (one(change(0, said(time_ms)), POSITION[0]) for time_ms in (1000, 1500))
    assert first == one(said(1000), POSITION[0])
    assert then == {**first, "time_boot_ms": 1500}
    nearly = 2000, 3.0 + 5e-7, 0.5, -3.0, 3.0, 0.0, 0.0
    again = one(
        change(0, Encoder(1, 1).encode_fields(dialect.MAVLink_local_position_ned_message, *nearly)), POSITION[0]
    )
    assert again == {**first, "time_boot_ms": 2000}, "for ever, to the bit"
    ring = changes.frozen(RING)
    assert one(ring(0, said(1000)), RING[0])["distances"] == one(ring(0, said(1500)), RING[0])["distances"]


def test_what_is_late_has_the_stamp_of_then() -> None:
    change = changes.late(POSITION, 0.15)
    heard = [one(change(ms * MS, said(ms)), POSITION[0])["time_boot_ms"] for ms in range(1000, 1500, 50)]
    assert heard == [1000, 1000, 1000, 1000, 1050, 1100, 1150, 1200, 1250, 1300]


def test_a_reset_of_the_heading_turns_both_attitudes_and_the_frame_if_asked() -> None:
    alone, whole = (changes.turned(90.0, whole_frame=each)(0, said(0)) for each in (False, True))
    for heard in (alone, whole):
        turned = one(heard, ATTITUDE[0])
        assert [turned[f"q{n}"] for n in (1, 2, 3, 4)] == pytest.approx([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
        assert one(heard, ATTITUDE[1])["yaw"] == pytest.approx(math.pi / 2.0)
    place, moved = one(alone, POSITION[0]), one(whole, POSITION[0])
    assert (place["vx"], place["vy"]) == (3.0, 0.0)
    assert [moved["vx"], moved["vy"], moved["y"]] == pytest.approx([0.0, 3.0, 0.0], abs=1e-6)
    assert moved["x"] == pytest.approx(-0.5)


def test_a_reset_of_the_heading_keeps_roll_and_pitch() -> None:
    before = Encoder(1, 1).encode_fields(
        dialect.MAVLink_attitude_quaternion_message, 0, *from_euler(0.3, -0.2, 0.4), 0.0, 0.0, 0.0
    )
    after = one(changes.turned(45.0, whole_frame=False)(0, before), ATTITUDE[0])
    turned = [after[f"q{n}"] for n in (1, 2, 3, 4)]
    assert turned == pytest.approx(from_euler(0.3, -0.2, 0.4 + math.pi / 4.0).tolist(), abs=1e-6)


def test_one_message_alone_is_wrong() -> None:
    for change, name in (
        (changes.swift(140.0, one=True), "vx"),
        (changes.stamped_ahead(POSITION, 4.0), "time_boot_ms"),
    ):
        heard = [one(change(0, said(1000)), POSITION[0])[name] for _ in range(3)]
        true = one(said(1000), POSITION[0])[name]
        assert heard[0] != true and heard[1:] == [true, true]


@pytest.mark.parametrize(("seconds", "left_ms"), [(0.5, 1500), (None, 0)])
def test_a_clock_that_goes_back_does_so_in_all_that_has_a_time(seconds: float | None, left_ms: int) -> None:
    change = changes.clock_back(seconds)
    for later_ms in (0, 100):
        heard = change(0, said(2000 + later_ms))
        assert one(heard, POSITION[0])["time_boot_ms"] == one(heard, ATTITUDE[0])["time_boot_ms"] == left_ms + later_ms
        assert one(heard, RING[0])["time_usec"] == (left_ms + later_ms) * 1000
        answer = one(heard, dialect.MAVLINK_MSG_ID_TIMESYNC)
        assert (answer["tc1"], answer["ts1"]) == (max((left_ms + later_ms) * MS, 1), 77)


def test_what_is_missing_comes_back_after_its_time() -> None:
    change = changes.missing(HEARTBEAT, 3.2)
    counts = [len(messages(change(time_ms * MS, said(time_ms)))) for time_ms in (1000, 4100, 4200, 5000)]
    assert counts == [5, 5, 6, 6]
