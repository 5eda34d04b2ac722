"""A peer's counters against a simulated link whose losses are known."""

import random

import pytest

from protocol.framing import Frame
from protocol.peer import Peer

MS = 1_000_000
S = 1000 * MS


def frame(sequence: int, system: int = 1, component: int = 1) -> Frame:
    return Frame(0, system, component, sequence % 256, b"\x01", b"", 2, False, True, 0)


def observed(sequences: list[int]) -> Peer:
    peer = Peer(1, 1)
    for now_ns, sequence in enumerate(sequences):
        peer.observe(frame(sequence), now_ns)
    return peer


def counts(peer: Peer) -> tuple[int, int, int, int]:
    return peer.lost, peer.late, peer.duplicates, peer.restarts


@pytest.mark.parametrize("first", [0, 1, 77, 255])
def test_a_perfect_link_loses_nothing(first: int) -> None:
    assert counts(observed([first + i for i in range(1000)])) == (0, 0, 0, 0)


@pytest.mark.parametrize("gap", [1, 2, 100, 127])
@pytest.mark.parametrize("last", [0, 100, 200, 255])
def test_a_gap_is_a_loss(gap: int, last: int) -> None:
    assert counts(observed([last, last + gap + 1])) == (gap, 0, 0, 0)


@pytest.mark.parametrize("back", [65, 100, 127])
@pytest.mark.parametrize("last", [0, 100, 200, 255])
def test_a_big_jump_back_is_a_restart_and_no_loss(back: int, last: int) -> None:
    peer = observed([last, last - back, last - back + 1, last - back + 3])
    assert counts(peer) == (1, 0, 0, 1)


def test_what_was_lost_before_a_restart_does_not_come_late_after_it() -> None:
    assert counts(observed([100, 110, 40, 39])) == (9, 0, 1, 1)
    peer = observed([100, 110])
    peer.observe_boot_time(9000)
    assert peer.observe_boot_time(0)
    for sequence in (5, 3):
        peer.observe(frame(sequence), 2)
    assert counts(peer) == (9, 0, 1, 0)


def test_a_late_frame_is_no_longer_lost() -> None:
    assert counts(observed([10, 12, 11, 13])) == (0, 1, 0, 0)
    assert counts(observed([250, 251 + 64, 251, 251 + 65])) == (63, 1, 0, 0)


def test_a_frame_that_comes_twice_is_a_duplicate() -> None:
    assert counts(observed([10, 10, 12, 11, 11, 10, 13])) == (0, 1, 3, 0)


@pytest.mark.parametrize("seed", range(20))
def test_a_bad_link_is_counted_exactly(seed: int) -> None:
    generator = random.Random(seed)
    arrivals: list[tuple[float, int]] = []
    total = 2000
    for sequence in range(total):
        # The ends are certain: what never had a neighbour can't be missed.
        if generator.random() < 0.1 and 0 < sequence < total - 1:
            continue
        copies = 2 if generator.random() < 0.05 else 1
        delay = generator.uniform(0.0, 20.0) if 0 < sequence < total - 21 else 0.0
        arrivals += [(sequence + delay, sequence)] * copies
    order = [sequence for _, sequence in sorted(arrivals)]
    late = 0
    arrived: set[int] = set()
    for sequence in order:
        late += sequence not in arrived and sequence < max(arrived, default=-1)
        arrived.add(sequence)
    duplicates = len(order) - len(arrived)
    assert late > 1000
    assert counts(observed(order)) == (total - len(arrived), late, duplicates, 0)


@pytest.mark.parametrize("first", [0, 200])
def test_frames_are_put_into_the_order_in_which_they_were_sent(first: int) -> None:
    """Late ones, duplicates and losses included, over the end of the sequence; after a restart all are later."""
    sent = [0, 1, 3, 2, 3, 60, 4, 61, 150, 149]
    peer, orders = Peer(1, 1), []
    for now_ns, number in enumerate(sent):
        peer.observe(frame(first + number), now_ns)
        orders.append(peer.order - sent[0])
    assert [order - orders[0] for order in orders] == sent
    peer.observe(frame(first + 150 - 100), 99)
    assert peer.restarts == 1 and peer.order > orders[-2]
    before = peer.order
    peer.observe_boot_time(100_000)
    assert peer.observe_boot_time(10)
    peer.observe(frame(7), 102)
    assert peer.order > before


def test_other_senders_are_ignored() -> None:
    peer = Peer(1, 1)
    for i in range(100):
        peer.observe(frame(i), i)
        peer.observe(frame(7 * i, component=2), i)
        peer.observe(frame(5 * i, system=2), 10**6)
    assert counts(peer) == (0, 0, 0, 0)
    assert peer.heard_ns == 99


def test_heartbeat_age() -> None:
    peer = Peer(1, 1)
    assert peer.heartbeat_age_ns(5 * S) is None
    peer.heartbeat(5 * S)
    assert peer.heartbeat_age_ns(5 * S) == 0
    assert peer.heartbeat_age_ns(8 * S) == 3 * S


def test_boot_time_going_back_is_a_reboot_and_reordering_is_none() -> None:
    peer = Peer(1, 1)
    times_ms = [0, 4, 8, 5000, 4996, 5004, 4004, 6000]
    assert not any(map(peer.observe_boot_time, times_ms))
    assert not peer.observe_boot_time(5000)
    assert peer.observe_boot_time(4999)
    assert not peer.observe_boot_time(5003)
    assert peer.reboots == 1


def test_small_steps_back_do_not_add_up_to_a_hidden_reboot() -> None:
    peer = Peer(1, 1)
    assert not peer.observe_boot_time(10_000)
    assert not peer.observe_boot_time(9_400)
    assert peer.observe_boot_time(8_800)


def test_boot_time_wraps_after_49_days() -> None:
    peer = Peer(1, 1)
    assert not any(peer.observe_boot_time(time_ms) for time_ms in (2**32 - 10, 2**32 - 1, 3, 2**32 - 2, 7))
    assert peer.reboots == 0


def test_a_reboot_forgets_the_sequence_and_the_clock() -> None:
    peer = observed([100])
    peer.observe_boot_time(60_000)
    peer.timesync_request(0)
    assert peer.timesync_reply(5 * S, 0, 0)
    peer.timesync_request(1)
    assert peer.observe_boot_time(100)
    assert peer.offset_ns is None
    assert not peer.timesync_reply(5 * S, 1, 2)
    peer.observe(frame(180), 2 * S)
    assert counts(peer) == (0, 0, 0, 0)


def answered(peer: Peer, sent_ns: int, offset_ns: int, there_ns: int, back_ns: int) -> bool:
    """A request that takes `there_ns` and an answer that takes `back_ns`, by a clock `offset_ns` ahead of ours."""
    tc1, ts1 = peer.timesync_request(sent_ns)
    assert (tc1, ts1) == (0, sent_ns)
    return peer.timesync_reply(sent_ns + there_ns + offset_ns, ts1, sent_ns + there_ns + back_ns)


@pytest.mark.parametrize("offset_ns", [0, 123 * S, -45 * S, 1_800_000_000 * S])
def test_a_symmetric_link_gives_the_offset_exactly(offset_ns: int) -> None:
    peer = Peer(1, 1)
    assert peer.offset_ns is None
    for i in range(20):
        assert answered(peer, (i + 60) * S, offset_ns, 2 * MS, 2 * MS)
        assert peer.offset_ns == offset_ns
    assert peer.clock.round_trip_ns == 4 * MS


def test_only_answers_to_own_requests_are_taken_and_once() -> None:
    peer = Peer(1, 1)
    assert not peer.timesync_reply(9 * S, 8 * S, 8 * S + MS)
    _, ts1 = peer.timesync_request(10 * S)
    assert not peer.timesync_reply(0, ts1, 10 * S + MS)  # a request of theirs
    assert peer.timesync_reply(11 * S, ts1, 10 * S + MS)
    assert not peer.timesync_reply(99 * S, ts1, 10 * S + MS)
    _, old = peer.timesync_request(11 * S)
    for i in range(100):
        peer.timesync_request(12 * S + i)
    assert not peer.timesync_reply(12 * S, old, 11 * S + MS)


def test_a_clock_that_was_set_is_followed_at_once() -> None:
    peer = Peer(1, 1)
    for i in range(50):
        answered(peer, (i + 1) * S, 77 * S, MS, MS)
    assert answered(peer, 60 * S, 5 * S, MS, MS)
    assert peer.offset_ns == 5 * S


def test_its_own_questions_bound_the_offset_from_below() -> None:
    """A way back of 8 ms and none out: half the round trip errs by 4 ms, a faster question shows half of the rest."""
    peer = Peer(1, 1)
    peer.timesync_asked(78 * S, S)
    assert peer.offset_ns is None  # a bound is not a value
    assert answered(peer, 2 * S, 77 * S, 0, 8 * MS)
    assert peer.offset_ns == 77 * S - 4 * MS
    peer.timesync_asked(80 * S - MS, 3 * S)  # 1 ms on its way
    assert peer.offset_ns == 77 * S - MS // 2
    peer.timesync_asked(80 * S - 3 * MS, 3 * S)  # a slower one says nothing new
    peer.timesync_asked(99 * S, 3 * S)  # nor does one of another clock
    assert peer.offset_ns == 77 * S - MS // 2
