"""Writes a flight log made from another log: whole, indexed, in chunks of half a megabyte."""

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from protocol.flightlog import DATAGRAM, Direction, FlightLogError, RecordType
from protocol.flightlog.mavlink_records import MessageWriter
from protocol.flightlog.mcap_file import CHUNK_BYTES, McapFile
from protocol.flightlog.mcap_format import message_record


class Writer:
    """A context manager that finishes the file, or removes it if the block raises.

    The constructor and the methods raise FlightLogError if the file exists already or can't be written, and leave no
    part of it then.
    """

    def __init__(self, path: Path, epoch_ns: int, metadata: Mapping[str, Mapping[str, str]]) -> None:
        self.path = path
        self.count = 0
        """Records written, without the messages found in datagrams."""
        self._epoch_ns = epoch_ns
        self._channels: dict[str, int] = {}
        try:
            self._file = McapFile(path)
        except OSError as error:
            raise FlightLogError(f"{path}: {error.strerror or error}") from error
        self._messages = MessageWriter(self._file, preserves_datagrams=True)
        with self._all_or_nothing():
            self._file.add_metadata("flightlog", {"version": "1", "epoch_ns": str(epoch_ns)})
            for name, table in metadata.items():
                self._file.add_metadata(name, dict(table))

    @contextlib.contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            self._file.discard()
            if isinstance(error, OSError):
                raise FlightLogError(f"{self.path}: {error.strerror or error}") from error
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._all_or_nothing():
            if error is not None:
                raise error
            self._file.end_chunk()
            self._file.finish()

    def attach(self, name: str, content: bytes) -> None:
        """Add a file."""
        with self._all_or_nothing():
            self._file.add_attachment(name, self._epoch_ns, content)

    def record(self, kind: RecordType, time_ns: int, sequence: int, data: bytes) -> None:
        """Add a record as `kind.pack` made it; time and sequence as in `flightlog.Record`."""
        channel = self._channels.get(kind.topic)
        if channel is None:
            channel = self._channels[kind.topic] = self._file.add_channel(kind)
        log_time = self._epoch_ns + time_ns
        self._file.add_message(channel, log_time, message_record(channel, sequence, log_time, data))
        self.count += 1
        if self._file.pending_bytes >= CHUNK_BYTES:
            with self._all_or_nothing():
                self._file.end_chunk()

    def datagram(self, time_ns: int, sequence: int, direction: Direction, address: str, data: bytes) -> None:
        """Add a datagram, and the messages in it under their own topics."""
        record = DATAGRAM.pack(direction, address, data)
        self.record(DATAGRAM, time_ns, sequence, record)
        self._messages.add(record, sequence, self._epoch_ns + time_ns)
