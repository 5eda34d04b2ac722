"""Objects that one process hands to another: their arrays lie in memory that both have, and who takes one copies
nothing."""

import ctypes
import math
import pickle
from multiprocessing.context import BaseContext
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_ALIGNED = 64


def mailbox(context: BaseContext, slots: int, slot_bytes: int) -> tuple["Inbox", "Outbox"]:
    """Both ends; the one for the other process goes among its arguments, and is closed here once it runs.

    What is taken holds until `slots` more were put, or `empty` was called for the last of these: the two sides see to
    it that this is not too early. Arrays of more than `slot_bytes` in all come through the pipe, in pieces that the
    taker waits for.
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
        places, data = self._pipe.recv()
        shared = memoryview(self._memory).cast("B")
        return pickle.loads(data, buffers=[shared[at : at + size] for at, size in places])

    def close(self) -> None:
        self._pipe.close()


class Outbox:
    """The end that puts."""

    def __init__(self, pipe: "Connection", memory: Any, slots: int, slot_bytes: int) -> None:
        self._pipe = pipe
        self._memory = memory
        self._slots = slots
        self._slot_bytes = slot_bytes
        self._slot = 0
        """Where the slot of the next `put` begins."""
        self._used = 0
        """Bytes of it."""

    def empty(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """An array for the next `put`, which has it where it goes; in memory of its own if there is no room."""
        count = math.prod(shape)
        at = self._room(4 * count)
        if at is None or not count:
            return np.empty(shape, np.float32)
        return np.frombuffer(self._memory, np.float32, count, at).reshape(shape)

    def put(self, thing: object) -> None:
        """Raises OSError if the other side is gone."""
        buffers: list[pickle.PickleBuffer] = []
        data = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
        places = [self._placed(buffer.raw()) for buffer in buffers]
        if None in places:
            places, data = [], pickle.dumps(thing, protocol=5)
        self._slot = (self._slot + self._slot_bytes) % (self._slots * self._slot_bytes)
        self._used = 0
        self._pipe.send((places, data))

    def _room(self, size: int) -> int | None:
        """Where in the memory there is room for so many bytes; None if the slot is full."""
        if self._used + size > self._slot_bytes:
            return None
        at = self._slot + self._used
        self._used += -(-size // _ALIGNED) * _ALIGNED
        return at

    def _placed(self, raw: memoryview) -> tuple[int, int] | None:
        """Where in the memory a thing's bytes lie, to which they are copied unless `empty` gave them; None if there is
        no room."""
        size = raw.nbytes
        if not size:
            return 0, 0
        at = np.frombuffer(raw, np.uint8).ctypes.data - ctypes.addressof(self._memory)
        if self._slot <= at < self._slot + self._slot_bytes:
            return at, size
        room = self._room(size)
        if room is None:
            return None
        memoryview(self._memory).cast("B")[room : room + size] = raw
        return room, size

    def close(self) -> None:
        self._pipe.close()
