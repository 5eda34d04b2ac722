"""Objects through memory that two processes have."""

import multiprocessing
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.runtime.mailbox import Inbox, Outbox, mailbox

SPAWN = multiprocessing.get_context("spawn")


def echo(inbox: Inbox, outbox: Outbox) -> None:
    """The other process: everything back, until there is nothing more."""
    try:
        while True:
            outbox.put(inbox.take())
    except EOFError:
        outbox.close()


def things() -> list[tuple[int, NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_]]]:
    random = np.random.default_rng(1)
    return [(k, random.random((200, 100 + k), np.float32), np.empty((0, 2)), random.random(k) > 0.5) for k in range(10)]


def test_what_is_put_is_taken_in_its_order_to_the_bit() -> None:
    there, outbox = mailbox(SPAWN, 4, 1 << 18)
    inbox, back = mailbox(SPAWN, 4, 1 << 18)
    process = SPAWN.Process(target=echo, args=(there, back), daemon=True)
    process.start()
    there.close()
    back.close()
    for thing in things():
        outbox.put(thing)
        number, *arrays = inbox.take()
        assert number == thing[0]
        own: list[NDArray[Any]] = [*thing[1:]]
        for mine, theirs in zip(own, arrays, strict=True):
            assert mine.dtype == theirs.dtype and mine.shape == theirs.shape and (mine == theirs).all()
            assert not theirs.flags.owndata and theirs.flags.aligned and theirs.flags.writeable
    outbox.close()
    with pytest.raises(EOFError):
        inbox.take()
    process.join(20.0)
    assert process.exitcode == 0


def test_what_was_taken_holds_until_as_many_more_as_there_are_slots() -> None:
    inbox, outbox = mailbox(SPAWN, 3, 1 << 14)
    outbox.put(np.full(1000, 0.0))
    first = inbox.take()
    for k in (1.0, 2.0):
        outbox.put(np.full(1000, k))
        inbox.take()
        assert (first == 0.0).all()
    outbox.put(np.full(1000, 3.0))
    assert (first == 3.0).all(), "it is the same memory"


def test_an_array_made_where_it_goes_is_not_copied() -> None:
    inbox, outbox = mailbox(SPAWN, 2, 1 << 14)
    for k in range(5):  # the slots come round
        ours, beside = outbox.empty((30, 40)), np.full(7, 1.0 + k)
        ours[:] = k
        outbox.put((beside, ours))
        theirs_beside, theirs = inbox.take()
        assert (theirs == k).all() and theirs.shape == ours.shape and (theirs_beside == beside).all()
        ours[3, 3] = -1.0
        assert theirs[3, 3] == -1.0 and (theirs_beside == beside).all()
    too_large, nothing = outbox.empty((100, 100)), outbox.empty((0, 5))
    too_large[:] = 7.0
    outbox.put((too_large, nothing))
    theirs, nothing = inbox.take()
    assert (theirs == 7.0).all() and nothing.shape == (0, 5)


def test_what_is_too_large_for_a_slot_comes_whole() -> None:
    inbox, outbox = mailbox(SPAWN, 2, 1 << 20)
    large = np.arange(200_000, dtype=np.float64)
    small = np.arange(3)
    pair = [small, large, small] * 2
    process = SPAWN.Process(target=put_all, args=(outbox, [pair, small]), daemon=True)
    process.start()
    outbox.close()
    assert all((mine == theirs).all() for mine, theirs in zip(pair, inbox.take(), strict=True))
    assert (inbox.take() == small).all()
    process.join(20.0)


def put_all(outbox: Outbox, what: list[object]) -> None:
    for each in what:
        outbox.put(each)
