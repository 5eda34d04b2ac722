"""The buffer in shared memory through which the flying process hands records to the recorder, without a lock.

One process writes (`BufferWriter`), one reads (`BufferReader`). The memory starts with 64-bit words: the writer stores
the first row of them, the reader the second. HEAD, TAIL, DROPPED, WRITTEN and LOST count bytes or records since the
start and never wrap. The text of a fault follows, then the records, each an MCAP message record.

A record is never split. One that doesn't fit before the buffer's end starts again at its beginning, and a zero byte
marks the gap. There are spare bytes behind the end, so that a header can be read at any place.

msgspec is imported where it is needed: a log can be read without it.
"""

import mmap
import os
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from protocol.flightlog.mcap_format import EMPTY_MESSAGE_LENGTH, MESSAGE_HEADER, RECORD_HEADER

HEAD, DROPPED, CLOSING = 0, 1, 2
"""Words of the writer: end of the last record, records dropped, whether the log was closed."""
TAIL, HEARTBEAT, STATE, WRITTEN, LOST = 8, 9, 10, 11, 12
"""Words of the reader: end of what is taken, time when it last worked (monotonic ns), state, records in the file, and
records that could not be written."""
_WORDS_BYTES: Final = 128
_FAULT_TEXT: Final = slice(128, 1024)
_RECORDS: Final = 4096
"""Offset of the records."""
_SPARE_BYTES: Final = 64
BUFFER_BYTES: Final = 8 << 20
"""Default size of the records' part: 40 s of a flight without a disk."""

WRITING, FAILED, CLOSED = range(3)
"""States of the recorder."""

DATAGRAM_CHANNEL, TEXT_CHANNEL, FIRST_CHANNEL = 1, 2, 3
"""Channels of the file. The types given to `FlightLog.open` have those from FIRST_CHANNEL on."""
METADATA_CHANNEL, STATUS_CHANNEL = 0xFFFE, 0xFFFF
"""Requests to the recorder. They go through the buffer but are no messages of the file."""

_POLL_S: Final = 0.0002
_pack_header = MESSAGE_HEADER.pack


@dataclass(frozen=True, slots=True)
class Setup:
    """What the recorder is told at its start, through a pipe that stays open as long as the flying process lives."""

    folder: bytes
    """Its path, which on Linux may be any bytes."""
    epoch_ns: int
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    types: list[tuple[str, str, str]]
    """Topic, schema name and definition; channels from FIRST_CHANNEL on."""
    console: bool
    minimum_free_bytes: int
    preserves_datagrams: bool
    syncs: bool
    """Whether it is taken to the disk as it is written."""

    @property
    def path(self) -> Path:
        """The folder."""
        return Path(os.fsdecode(self.folder))

    @property
    def name(self) -> str:
        """The folder for texts: what is no UTF-8 is escaped."""
        return self.folder.decode(errors="backslashreplace")

    def encode(self) -> bytes:
        """For the pipe."""
        import msgspec

        return msgspec.msgpack.encode(self)

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """What `encode` made."""
        import msgspec

        return msgspec.msgpack.decode(data, type=cls)


def encode_metadata(name: str, table: Mapping[str, str]) -> bytes:
    """Data of a record on METADATA_CHANNEL."""
    import msgspec

    return msgspec.msgpack.encode((name, dict(table)))


def decode_metadata(data: bytes) -> tuple[str, dict[str, str]]:
    """Name and table of what `encode_metadata` made."""
    import msgspec

    return msgspec.msgpack.decode(data, type=tuple[str, dict[str, str]])


def allocate(size: int) -> tuple[int, mmap.mmap]:
    """Memory for a buffer of `size` bytes, a power of two: its file descriptor, which the caller closes, and a mapping.

    Raises ValueError for another size.
    """
    if size & (size - 1):
        raise ValueError(f"buffer_bytes: {size} is no power of two")
    descriptor = os.memfd_create("flightlog")
    try:
        os.ftruncate(descriptor, _RECORDS + size + _SPARE_BYTES)
        return descriptor, mmap.mmap(descriptor, 0, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
    except BaseException:
        os.close(descriptor)
        raise


class BufferWriter:
    """The flying process's end. `waits`: a full buffer is waited for until `is_lost()`; otherwise records are dropped.

    `put` is on the path of each datagram of a flight and costs about 1 us.
    """

    def __init__(self, memory: mmap.mmap, epoch_ns: int, *, waits: bool, is_lost: Callable[[], bool]) -> None:
        self.words = memoryview(memory)[:_WORDS_BYTES].cast("Q")
        self.waits = waits
        self._memory = memory
        self._epoch_ns = epoch_ns
        self._is_lost = is_lost
        self._size = len(memory) - _RECORDS - _SPARE_BYTES
        self._mask = self._size - 1
        self._sequence = -1
        self._head = 0
        self._free_until = self._size

    def put(self, channel: int, time_ns: int, data: bytes) -> None:
        """Append a record; where it is dropped, the sequence has a gap."""
        self._sequence = sequence = (self._sequence + 1) & 0xFFFF_FFFF
        log_time = self._epoch_ns + time_ns
        record = _pack_header(5, EMPTY_MESSAGE_LENGTH + len(data), channel, sequence, log_time, log_time) + data
        head = self._head
        start = head & self._mask
        gap = self._size - start
        if gap >= len(record):
            gap = 0
        end = head + gap + len(record)
        if end > self._free_until and not self._make_room(end):
            self.words[DROPPED] += 1
            return
        if gap:
            self._memory[_RECORDS + start] = 0
            start = 0
        self._memory[_RECORDS + start : _RECORDS + start + len(record)] = record
        # Last: what lies before the head is whole, also when this process is killed between any two instructions.
        self.words[HEAD] = self._head = end

    def _make_room(self, end: int) -> bool:
        """Whether the buffer is free up to `end`; waits for it if that is wanted and somebody empties it."""
        while True:
            self._free_until = self.words[TAIL] + self._size
            if end <= self._free_until:
                return True
            if not self.waits or end - self._head > self._size or self._is_lost():
                return False
            time.sleep(_POLL_S)

    @property
    def silent_ns(self) -> int:
        """Time since the recorder last worked."""
        return time.monotonic_ns() - self.words[HEARTBEAT]

    @property
    def fault_text(self) -> str:
        """What the recorder said when it failed."""
        text = bytes(self._memory[_FAULT_TEXT])
        return text[: text.index(0)].decode(errors="replace")


class BufferReader:
    """The recorder's end."""

    def __init__(self, memory: mmap.mmap) -> None:
        self.words = memoryview(memory)[:_WORDS_BYTES].cast("Q")
        self._memory = memory
        self._mask = len(memory) - _RECORDS - _SPARE_BYTES - 1
        self._tail = 0
        self.beat()

    def beat(self) -> int:
        """Show that the recorder works; returns the monotonic time (ns)."""
        self.words[HEARTBEAT] = now_ns = time.monotonic_ns()
        return now_ns

    def records(self, head: int) -> Iterator[tuple[int, int, int, bytes]]:
        """Channel, sequence, log time and whole message record of each record up to `head`.

        Their room is free again only after `release`.
        """
        memory, mask, unpack = self._memory, self._mask, MESSAGE_HEADER.unpack_from
        tail = self._tail
        while tail < head:
            start = _RECORDS + (tail & mask)
            opcode, length, channel, sequence, log_time, _ = unpack(memory, start)
            if opcode == 0:  # the mark of a gap
                tail += mask + 1 - (tail & mask)
                continue
            record = memory[start : start + RECORD_HEADER.size + length]
            tail += len(record)
            self._tail = tail
            yield channel, sequence, log_time, record
        self._tail = tail

    def release(self) -> None:
        """Give the room of all records read so far back to the writer."""
        self.words[TAIL] = self._tail
        self.beat()

    def fail(self, text: str) -> None:
        """Tell the writer that the log can't be written."""
        room = _FAULT_TEXT.stop - _FAULT_TEXT.start
        self._memory[_FAULT_TEXT] = text.encode()[: room - 1].ljust(room, b"\0")
        self.words[STATE] = FAILED  # after its text

    def recover(self) -> None:
        """Tell the writer that the log is written again."""
        self.words[STATE] = WRITING
