"""Reading a log while it is written."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

from mcap.opcode import Opcode

from protocol.flightlog.chunks import DAMAGE, ChunkError, chunk_at, chunk_content, record_at
from protocol.flightlog.definitions import DEFINING, Definitions
from protocol.flightlog.file_bytes import FileBytes
from protocol.flightlog.mcap_format import MAGIC, FlightLogError
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
        self._data: FileBytes | None = None
        self._position = len(MAGIC)

    @property
    def topics(self) -> dict[str, RecordType]:
        """The type of the records on each topic read so far."""
        return {kind.topic: kind for kind in self._definitions.types.values()}

    def poll(self) -> Iterator[list[Record]]:
        """The new messages, a list for each chunk.

        Raises FlightLogError if the file can't be read or is damaged.
        """
        if self._data is None:
            self._data = FileBytes(self.path)
        self._data.refresh()
        yield from self._read(self._data)

    def _read(self, data: FileBytes) -> Iterator[list[Record]]:
        while not self.ended and (record := record_at(data, self._position)) is not None:
            opcode, start, stop = record
            found: list[Record] = []
            try:
                if opcode == Opcode.CHUNK:
                    self._read_chunk(data, found)
                elif opcode in DEFINING:
                    self._definitions.take(opcode, data[start:stop])
                self.ended = opcode == Opcode.DATA_END
            except (ChunkError, *DAMAGE) as error:
                if stop > len(data):  # it was cut off meanwhile
                    return
                raise FlightLogError(f"{self.path}: damaged at byte {self._position}") from error
            self._position = stop
            if found:
                yield found

    def _read_chunk(self, data: FileBytes, found: list[Record]) -> None:
        chunk = chunk_at(data, self._position)
        if chunk is None:
            raise ChunkError
        if self._selection is None:
            epoch_ns = self._definitions.start_time_ns() or 0
            self._selection = Selection(self._definitions, epoch_ns, self._is_wanted, self._refuse)
        self._selection.walk(chunk_content(data, chunk), found)

    def _refuse(self, problem: str) -> NoReturn:
        raise ChunkError(problem)
