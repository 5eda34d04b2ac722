"""Reading a log while it is written."""

import mmap
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, NoReturn

from mcap.opcode import Opcode

from protocol.flightlog.chunks import DAMAGE, ChunkError, chunk_at, chunk_content
from protocol.flightlog.definitions import DEFINING, Definitions
from protocol.flightlog.mcap_format import MAGIC, RECORD_HEADER, FlightLogError
from protocol.flightlog.record_types import RecordType
from protocol.flightlog.selection import Record, Selection


class LogFollower:
    """A log that grows. Each `poll` reads what has become whole since the last one; the flight takes no notice.

    Damage is not passed over, as `LogReader` does, but ends the reading with FlightLogError. The file is kept open: at
    its end another one takes its name (see `recorder`).
    """

    def __init__(self, path: Path, is_wanted: Callable[[str], bool] = lambda topic: True) -> None:
        self.path = path
        self.ended = False
        """Whether the log was finished and all of it is read."""
        self._definitions = Definitions(self._refuse)
        self.attachments: dict[str, bytes] = self._definitions.attachments
        self.metadata: dict[str, dict[str, str]] = self._definitions.metadata
        self._is_wanted = is_wanted
        self._selection: Selection | None = None
        self._file: BinaryIO | None = None
        self._position = len(MAGIC)

    @property
    def topics(self) -> dict[str, RecordType]:
        """The type of the records on each topic read so far."""
        return {kind.topic: kind for kind in self._definitions.types.values()}

    def poll(self) -> Iterator[list[Record]]:
        """The new messages, a list for each chunk.

        Raises FlightLogError if the file can't be read or is damaged.
        """
        try:
            if self._file is None:
                self._file = self.path.open("rb")
            size = os.fstat(self._file.fileno()).st_size
            if size > self._position:
                with mmap.mmap(self._file.fileno(), size, access=mmap.ACCESS_READ) as data:
                    yield from self._read(data)
        except OSError as error:
            raise FlightLogError(f"{self.path}: {error.strerror or error}") from error

    def _read(self, data: mmap.mmap) -> Iterator[list[Record]]:
        while not self.ended and self._position + RECORD_HEADER.size <= len(data):
            opcode, length = RECORD_HEADER.unpack_from(data, self._position)
            start = self._position + RECORD_HEADER.size
            if start + length > len(data):
                return
            found: list[Record] = []
            try:
                if opcode == Opcode.CHUNK:
                    self._read_chunk(data, found)
                elif opcode in DEFINING:
                    self._definitions.take(opcode, data[start : start + length])
                self.ended = opcode == Opcode.DATA_END
            except (ChunkError, *DAMAGE) as error:
                raise FlightLogError(f"{self.path}: damaged at byte {self._position}") from error
            self._position = start + length
            if found:
                yield found

    def _read_chunk(self, data: mmap.mmap, found: list[Record]) -> None:
        chunk = chunk_at(data, self._position)
        if chunk is None:
            raise ChunkError
        if self._selection is None:
            epoch_ns = self._definitions.start_time_ns() or 0
            self._selection = Selection(self._definitions, epoch_ns, self._is_wanted, self._refuse)
        self._selection.walk(chunk_content(data, chunk), found)

    def _refuse(self, problem: str) -> NoReturn:
        raise ChunkError(problem)
