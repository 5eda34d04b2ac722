"""A log's bytes, read from the file as they are asked for.

They are not mapped into memory: the recorder cuts off what a full disk left half written, and a process that reads a
mapped file beyond its end is killed (SIGBUS).
"""

import os
import struct
import weakref
import zlib
from pathlib import Path
from typing import Any, Final

from protocol.flightlog.mcap_format import FlightLogError

PIECE_BYTES: Final = 1 << 22
"""Bytes that are read at once where many are."""
_BLOCK_BYTES: Final = 1 << 16
"""Bytes that are read ahead where few are."""


class FileBytes:
    """The bytes up to `len`, which a file that has become shorter lowers as it is read: a slice may be short then.

    The file is kept open, whatever takes its name. All raise FlightLogError if it can't be opened or read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise FlightLogError(f"{path}: {error.strerror}") from error
        weakref.finalize(self, os.close, self._file)
        self.refresh()

    def refresh(self) -> None:
        """Take in how long the file is now, and what stands in it."""
        self._size = os.fstat(self._file).st_size
        self._start, self._block = 0, b""

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, place: slice) -> bytes:
        start, stop, _ = place.indices(self._size)
        at = start - self._start
        if at < 0 or stop - self._start > len(self._block):
            if stop - start > _BLOCK_BYTES:
                return self._read(start, stop)
            self._load(start)
            at = 0
        return self._block[at : at + max(stop - start, 0)]

    def unpack(self, layout: struct.Struct, position: int) -> tuple[Any, ...] | None:
        """The values there; None where the file ends within them."""
        at = position - self._start
        if at < 0 or at + layout.size > len(self._block):
            self._load(position)
            at = 0
            if len(self._block) < layout.size:
                return None
        return layout.unpack_from(self._block, at)

    def find(self, mark: bytes, start: int) -> int:
        """Offset of the first `mark` from `start` on; -1 if there is none."""
        while start + len(mark) <= self._size:
            if not self._start <= start <= self._start + len(self._block) - len(mark):
                self._load(start)
            found = self._block.find(mark, start - self._start)
            if found >= 0:
                return self._start + found
            start = max(self._start + len(self._block) - len(mark), start) + 1
        return -1

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of a part, read piece by piece."""
        crc = 0
        for piece in range(start, stop, PIECE_BYTES):
            crc = zlib.crc32(self[piece : min(piece + PIECE_BYTES, stop)], crc)
        return crc

    def _load(self, start: int) -> None:
        """Read a block from `start` on."""
        self._block, self._start = self._read(start, min(start + _BLOCK_BYTES, self._size)), start

    def _read(self, start: int, stop: int) -> bytes:
        parts = []
        while start < stop:
            try:
                part = os.pread(self._file, stop - start, start)
            except OSError as error:
                raise FlightLogError(f"{self._path}: {error.strerror}") from error
            if not part:
                self._size = min(start, os.fstat(self._file).st_size)
                break
            parts.append(part)
            start += len(part)
        return b"".join(parts)
