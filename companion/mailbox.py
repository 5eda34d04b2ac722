"""Objects that one process hands to another: their arrays lie in memory that both have, and who takes one copies
nothing."""

import pickle
from itertools import accumulate
from multiprocessing.context import BaseContext
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_ALIGNED = 64


def mailbox(context: BaseContext, slots: int, slot_bytes: int) -> tuple["Inbox", "Outbox"]:
    """Both ends; the one for the other process goes among its arguments, and is closed here once it runs.

    What is taken holds until `slots` more were put: the two sides see to it that none is put too early. Arrays of more
    than `slot_bytes` in all come through the pipe, in pieces that the taker waits for.
    """
    receiver, sender = context.Pipe(duplex=False)
    memory = context.RawArray("B", slots * slot_bytes)
    return Inbox(receiver, memory), Outbox(sender, memory, slots, slot_bytes)


class Inbox:
    """The end that takes."""

    def __init__(self, pipe: "Connection", memory: Any) -> None:
        self._pipe = pipe
        self._memory = memory

    def fileno(self) -> int:
        """Ready for reading when there is something, or the other side is gone."""
        return self._pipe.fileno()

    def take(self) -> Any:
        """The next, which is waited for. Raises EOFError or OSError if the other side is gone."""
        start, sizes, data = self._pipe.recv()
        shared = memoryview(self._memory).cast("B")
        return pickle.loads(data, buffers=[shared[at : at + size] for at, size in _places(start, sizes)])

    def close(self) -> None:
        self._pipe.close()


class Outbox:
    """The end that puts."""

    def __init__(self, pipe: "Connection", memory: Any, slots: int, slot_bytes: int) -> None:
        self._pipe = pipe
        self._memory = memory
        self._slots = slots
        self._slot_bytes = slot_bytes
        self._next = 0

    def put(self, thing: object) -> None:
        """Raises OSError if the other side is gone."""
        buffers: list[pickle.PickleBuffer] = []
        data = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
        views = [memoryview(buffer) for buffer in buffers]
        start, sizes = self._next * self._slot_bytes, [view.nbytes for view in views]
        if sum(_padded(size) for size in sizes) > self._slot_bytes:
            self._pipe.send((0, [], pickle.dumps(thing, protocol=5)))
            return
        shared = memoryview(self._memory).cast("B")
        for view, (at, size) in zip(views, _places(start, sizes), strict=True):
            if size:
                shared[at : at + size] = view.cast("B")
        self._next = (self._next + 1) % self._slots
        self._pipe.send((start, sizes, data))

    def close(self) -> None:
        self._pipe.close()


def _padded(size: int) -> int:
    return -(-size // _ALIGNED) * _ALIGNED


def _places(start: int, sizes: list[int]) -> list[tuple[int, int]]:
    """Where each of the buffers begins, and its size."""
    starts = accumulate((_padded(size) for size in sizes), initial=start)
    return list(zip(starts, sizes, strict=False))
