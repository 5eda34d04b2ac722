"""A log's bytes, mapped into memory and given back as they are read."""

import mmap
import os
import zlib
from pathlib import Path
from typing import Final

from protocol.flightlog.chunks import CHUNK_MARK
from protocol.flightlog.mcap_format import MAGIC, FlightLogError

PIECE_BYTES: Final = 1 << 22
"""Bytes that are read before memory is given back; the system maps what is around, too."""
_SEARCHED_BYTES: Final = 1 << 20
"""A damaged file whose first bytes, up to here, hold no chunk is no log."""


class MappedFile:
    """`data` has the bytes. Raises FlightLogError if the file can't be opened or is no MCAP file."""

    def __init__(self, path: Path) -> None:
        self.data: mmap.mmap | bytes = b""
        self._given_back = 0
        try:
            with path.open("rb") as file:
                if os.fstat(file.fileno()).st_size:
                    self.data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise FlightLogError(f"{path}: {error.strerror or error}") from error
        start = self.data[: len(MAGIC)]
        if not MAGIC.startswith(start) and CHUNK_MARK not in self.data[:_SEARCHED_BYTES]:
            raise FlightLogError(f"{path}: not an MCAP file")

    def crc(self, start: int, stop: int) -> int:
        """CRC-32 of the file's bytes, read piece by piece."""
        crc = 0
        for piece in range(start, stop, PIECE_BYTES):
            end = min(piece + PIECE_BYTES, stop)
            crc = zlib.crc32(self.data[piece:end], crc)
            self._give_back(piece, end)
        return crc

    def read_to(self, position: int) -> None:
        """Give back the memory up to `position`, once that is some way on."""
        if abs(position - self._given_back) >= PIECE_BYTES:
            self._give_back(min(position, self._given_back), max(position, self._given_back))
            self._given_back = position

    def _give_back(self, start: int, stop: int) -> None:
        if isinstance(self.data, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            page = start & ~(mmap.PAGESIZE - 1)
            self.data.madvise(mmap.MADV_DONTNEED, page, stop - page)
