"""Where a live page gets its flight from: a log, the log of a flight that is in the air, or a link. All of them give
what they have as the same batches, and none of them says a word to anybody."""

import mmap
import os
import struct
import time
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Protocol

import mcap.records
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from companion.view.batches import BATCH, Batch, batch, batches
from protocol.clock import RealClock
from protocol.flightlog import DATAGRAM, FILE_NAME, MAGIC, FlightLogError, LogReader, RecordType, decompressed
from protocol.flightlog.recorder import message_type
from protocol.framing import Framer
from protocol.messages import layout
from protocol.transport import Transport

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQHIQ")
_CHUNK = struct.Struct("<QQQII")
_LARGEST_CHUNK = 1 << 30
_DATAGRAMS_A_POLL = 5000
_MOST_KINDS = 4096
_GROWS_S = 10.0
"""A flight's log is written to each tenth of a second; one that was not for so long was cut off."""


class Source(Protocol):
    """What a page asks of a flight."""

    name: str
    world: bytes
    """The world's file, empty while it is not known."""
    settings: bytes
    """The companion's, as JSON; the same."""
    ended: bool
    """Nothing more will come."""
    problem: str | None
    """Why it is not whole."""

    def poll(self) -> Iterator[Batch]:
        """What is new, without waiting. Raises FlightLogError if it can't be read any more."""


class FinishedLog:
    """A log that nobody writes to any more, all of it at the first poll."""

    def __init__(self, log: LogReader) -> None:
        self.name = str(log.path)
        self.world = log.attachments.get("world.toml", b"")
        self.settings = log.attachments.get("settings.json", b"")
        self.ended = False
        self.problem = log.problem
        self._log = log

    def poll(self) -> Iterator[Batch]:
        if not self.ended:
            yield from batches(self._log)
            self.ended, self.problem = True, self._log.problem


class GrowingLog:
    """A log that is being written, chunk by chunk; each poll gives the chunks that have become whole since.

    Reading takes nothing from the flight but a look at its file. What is damaged ends it, with an error.
    """

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self.world = self.settings = b""
        self.ended = False
        self.problem: str | None = None
        self._path = path
        self._file: BinaryIO | None = None
        """Kept open: at its end another file takes the place of the one that was written (see recorder.py)."""
        self._position = len(MAGIC)
        self._epoch_ns = 0
        self._schemas: dict[int, mcap.records.Schema] = {}
        self._channels: dict[int, RecordType] = {}
        self._held: dict[int, tuple[list[int], list[bytes]]] = {}

    def poll(self) -> Iterator[Batch]:
        try:
            if self._file is None:
                self._file = self._path.open("rb")
            size = os.fstat(self._file.fileno()).st_size
            if size > self._position:
                with mmap.mmap(self._file.fileno(), size, access=mmap.ACCESS_READ) as data:
                    yield from self._read(data, size)
        except OSError as error:
            raise FlightLogError(f"{self._path}: {error.strerror or error}") from error
        except (McapError, ValueError, KeyError, struct.error, zstandard.ZstdError) as error:
            raise FlightLogError(f"{self._path}: damaged at byte {self._position}") from error

    def _read(self, data: mmap.mmap, size: int) -> Iterator[Batch]:
        while not self.ended and self._position + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(data, self._position)
            start = self._position + _RECORD.size
            if start + length > size:
                break
            if opcode == Opcode.CHUNK:
                self._walk(_content(data, start))
            elif opcode == Opcode.DATA_END:
                self.ended = True
            else:
                self._take(opcode, data[start : start + length])
            self._position = start + length
            if any(len(times) >= BATCH for times, _ in self._held.values()):
                yield from self._give()
        yield from self._give()

    def _give(self) -> Iterator[Batch]:
        held, self._held = self._held, {}
        for channel, (times, parts) in held.items():
            yield from batch(self._channels[channel], times, parts)

    def _walk(self, content: bytes) -> None:
        position = 0
        while position < len(content):
            opcode, length, channel, _, log_time = _MESSAGE.unpack_from(content, position)
            stop = position + _RECORD.size + length
            if opcode == Opcode.MESSAGE:
                if self._channels[channel].topic != DATAGRAM.topic:
                    times, parts = self._held.setdefault(channel, ([], []))
                    times.append(log_time - self._epoch_ns)
                    parts.append(content[position + 31 : stop])
            else:
                self._take(opcode, content[position + _RECORD.size : stop])
            position = stop

    def _take(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = mcap.records.Schema.read(stream)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = mcap.records.Channel.read(stream)
            kind = self._schemas[channel.schema_id]
            self._channels[channel.id] = RecordType(channel.topic, kind.name, kind.data.decode())
        elif opcode == Opcode.METADATA:
            metadata = mcap.records.Metadata.read(stream)
            if metadata.name == "flightlog":
                self._epoch_ns = int(metadata.metadata["epoch_ns"])
        elif opcode == Opcode.ATTACHMENT:
            attachment = mcap.records.Attachment.read(stream)
            if attachment.name == "world.toml":
                self.world = attachment.data
            elif attachment.name == "settings.json":
                self.settings = attachment.data


def _content(data: mmap.mmap, start: int) -> bytes:
    """Of the chunk whose record's content starts there."""
    _, _, size, _, name_length = _CHUNK.unpack_from(data, start)
    name_start = start + _CHUNK.size
    packed_start = name_start + name_length + 8
    (packed,) = struct.unpack_from("<Q", data, packed_start - 8)
    content = data[packed_start : packed_start + packed]
    if data[name_start : name_start + name_length] != b"zstd":
        return content
    if size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes")
    return decompressed(content, size)


class Link:
    """A vehicle's telemetry over a transport, as it arrives; times are seconds since the page's start."""

    def __init__(self, url: str, transport: Transport, world: bytes) -> None:
        self.name = url
        self.world = world
        self.settings = b""
        self.ended = False
        self.problem: str | None = None
        self._transport = transport
        self._clock = RealClock()
        self._framer = Framer()
        self._kinds: dict[tuple[int, int, int], tuple[RecordType, int, Callable[[bytes], bytes] | None] | None] = {}

    def poll(self) -> Iterator[Batch]:
        held: dict[str, tuple[RecordType, list[int], list[bytes]]] = {}
        feed = self._framer.datagram if self._transport.preserves_datagrams else self._framer.feed
        for _ in range(_DATAGRAMS_A_POLL):
            data = self._transport.receive(0.0)
            if data is None:
                break
            now = self._clock.now_ns()
            for frame in feed(data):
                known = self._kind(frame.message_id, frame.system, frame.component) if frame.known else None
                if known is None:
                    continue
                kind, size, convert = known
                payload = frame.payload.ljust(size, b"\0")[:size]
                _, times, parts = held.setdefault(kind.topic, (kind, [], []))
                times.append(now)
                parts.append(convert(payload) if convert else payload)
        for kind, times, parts in held.values():
            yield from batch(kind, times, parts)

    def _kind(
        self, message: int, system: int, component: int
    ) -> tuple[RecordType, int, Callable[[bytes], bytes] | None] | None:
        key = message, system, component
        if key not in self._kinds:
            topic = f"/mavlink/{system}/{component}/{layout(message).name}"
            self._kinds[key] = message_type(message, topic) if len(self._kinds) < _MOST_KINDS else None
        return self._kinds[key]


def newest(logs: Path) -> Path:
    """The log in a folder of flights that was written to last. Raises FlightLogError if there is none."""
    found = max(logs.glob(f"*/{FILE_NAME}"), key=lambda path: path.stat().st_mtime, default=None)
    if found is None:
        raise FlightLogError(f"{logs}: there is no flight in it")
    return found


def open_log(path: Path) -> Source:
    """A log as it is, or as one that is being written if it has no end yet and was written to lately. Raises
    FlightLogError."""
    log = LogReader(path)
    written_s = time.time() - path.stat().st_mtime
    return GrowingLog(path) if not log.complete and written_s < _GROWS_S else FinishedLog(log)
