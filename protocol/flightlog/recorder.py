"""The flight log's writer, a process of its own: `python -m protocol.flightlog.recorder FD`.

FD is the shared memory. The pipe on its standard input tells it what to write first and then only stays open: when it
closes, by whatever death of the flying process, what is left in the ring is written and the file finished. Standard
output carries one answer, "ok" or why not; standard error is the console.

A chunk ends each tenth of a second, so that a killed recorder loses no more. Such small chunks cost a tenth of the file
and more; so a second file without a name is written beside it, in large ones, and takes the first one's place at the
end.
"""

import contextlib
import functools
import gc
import mmap
import os
import select
import signal
import struct
import sys
import time
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Self

import mcap.records as mcap_records
import msgspec
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord

from protocol import flightlog
from protocol.flightlog import DATAGRAM, DATAGRAM_CHANNEL, HEADER, TEXT, TEXT_CHANNEL, FlightLogError, RecordType, Setup
from protocol.framing import Framer
from protocol.messages import dialect, layout

POLL_MS = 5
CHUNK_AGE_NS = 80_000_000
"""A chunk is ended at this age: with a poll and a slow moment, less than 0.1 s after its first record."""
CHUNK_BYTES = 512 << 10
COMPRESSION_LEVEL = 3
"""of zstd: level 1 takes half the time, levels up to 9 save nothing more."""
LARGE_CHUNK_BYTES = 256 << 10
"""At the most so much is lost with a damaged chunk of a finished file: some 2 s of a flight."""
_SLICE = 16 << 10
"""Of a chunk, compressed so that it can be read from a file that is cut behind it."""
STATUS_INTERVAL_S = 5.0
DROPPED_INTERVAL_NS = 1_000_000_000
_MOST_TARGETS = 4096
_BATCH = 256
"""Records between two signs of life."""
_LEVELS = ("", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class McapFile:
    """An MCAP file written chunk by chunk; what is on disk ends with a whole chunk at any time.

    A chunk that can't be written is given up and its remains are cut off, so that later ones may still follow.
    `tidies`: the finished file has large chunks, whatever `end_chunk` ended. Raises OSError, and leaves no file then.
    """

    def __init__(self, path: Path, *, tidies: bool = False) -> None:
        self._path = path
        self._twin: _Twin | None = None
        self._file = self._open()
        self.size = 0
        """Bytes in the file."""
        self._crc = 0
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._parts: list[bytes] = []
        self._definitions: list[bytes] = []
        self._offset = 0
        self._indexes: dict[int, list[int]] = {}
        self._schemas: dict[tuple[str, str], mcap_records.Schema] = {}
        self._channels: list[mcap_records.Channel] = []
        self._counts: dict[int, int] = {}
        self._first_time = 0
        self._last_time = 0
        self._chunks = 0
        self._chunk_indexes = bytearray()  # encoded: there are many in a long flight
        self._attachment_indexes: list[mcap_records.AttachmentIndex] = []
        self._metadata_indexes: list[mcap_records.MetadataIndex] = []
        try:
            self._write(flightlog.MAGIC + _encoded(mcap_records.Header(profile="", library="courier")))
        except OSError:
            self.discard()
            raise
        if tidies:
            self._twin = _Twin.beside(self)

    def _open(self) -> int:
        return os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)

    def _write(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[os.write(self._file, view) :]
        except OSError:
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self.size)
                os.lseek(self._file, self.size, os.SEEK_SET)
            raise
        self._crc = zlib.crc32(data, self._crc)
        self.size += len(data)

    def add_metadata(self, name: str, table: dict[str, str]) -> None:
        data = _encoded(mcap_records.Metadata(name=name, metadata=table))
        self._write(data)
        self._metadata_indexes.append(mcap_records.MetadataIndex(self.size - len(data), len(data), name))
        self._repeat(lambda twin: twin.add_metadata(name, table))

    def add_attachment(self, name: str, time_ns: int, content: bytes) -> None:
        data = _encoded(mcap_records.Attachment(time_ns, time_ns, name, "application/octet-stream", content))
        self._write(data)
        self._attachment_indexes.append(
            mcap_records.AttachmentIndex(
                offset=self.size - len(data),
                length=len(data),
                log_time=time_ns,
                create_time=time_ns,
                data_size=len(content),
                name=name,
                media_type="application/octet-stream",
            )
        )
        self._repeat(lambda twin: twin.add_attachment(name, time_ns, content))

    def _repeat(self, what: "Callable[[_Twin], None]") -> None:
        """In the twin, if there is one; without it all goes on, too."""
        if self._twin is None:
            return
        try:
            what(self._twin)
        except OSError:
            self._part()

    def _part(self) -> None:
        """The twin's space on the disk is free again."""
        if self._twin is not None:
            self._twin.close()
            self._twin = None

    def add_channel(self, kind: RecordType) -> int:
        """The id of a new channel, from 1 on."""
        schema = self._schemas.get((kind.schema_name, kind.definition))
        definition = b""
        if schema is None:
            schema = mcap_records.Schema(
                data=kind.definition.encode(), encoding="ros1msg", id=len(self._schemas) + 1, name=kind.schema_name
            )
            self._schemas[kind.schema_name, kind.definition] = schema
            definition = _encoded(schema)
        channel = mcap_records.Channel(
            id=len(self._channels) + 1, topic=kind.topic, message_encoding="ros1", metadata={}, schema_id=schema.id
        )
        self._channels.append(channel)
        definition += _encoded(channel)
        self._definitions.append(definition)
        self._parts.append(definition)
        self._offset += len(definition)
        return channel.id

    def add_message(self, channel: int, log_time: int, message: bytes) -> None:
        """`message` is the whole record, its header with it."""
        try:
            index = self._indexes[channel]
        except KeyError:
            index = self._indexes[channel] = []
        index.append(log_time)
        index.append(self._offset)
        self._parts.append(message)
        self._offset += len(message)

    @property
    def pending_bytes(self) -> int:
        """Of messages not yet in the file."""
        return self._offset if self._indexes else 0

    def end_chunk(self) -> None:
        """Write what is pending. Raises OSError if that fails; the messages are lost then, but not their channels."""
        if not self._indexes:
            return
        indexes, content = self._indexes, b"".join(self._parts)
        try:
            try:
                self._write_chunk([content])
            except OSError:
                if self._twin is None:
                    raise
                self._part()
                self._write_chunk([content])
            self._definitions = []
        finally:
            self._parts = [*self._definitions]
            self._offset = sum(map(len, self._parts))
            self._indexes = {}
        self._repeat(lambda twin: twin.add_content(content, indexes))

    def _packed(self, pieces: list[bytes]) -> bytes:
        """One frame, each slice of each piece in whole blocks of its own."""
        compressor = self._compressor.compressobj(size=sum(map(len, pieces)))
        packed = []
        for piece in pieces:
            for start in range(0, len(piece), _SLICE):
                packed.append(compressor.compress(piece[start : start + _SLICE]))
                packed.append(compressor.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK))
        packed.append(compressor.flush())
        return b"".join(packed)

    def _write_chunk(self, pieces: list[bytes]) -> None:
        content = b"".join(pieces)
        start_time = min(min(index[::2]) for index in self._indexes.values())
        end_time = max(max(index[::2]) for index in self._indexes.values())
        packed = self._packed(pieces)
        chunk = _encoded(mcap_records.Chunk("zstd", packed, end_time, start_time, zlib.crc32(content), len(content)))
        parts = [chunk]
        offset = self.size + len(chunk)
        offsets = {}
        for channel, index in self._indexes.items():
            body = struct.pack(f"<HI{len(index)}Q", channel, 8 * len(index), *index)
            part = struct.pack("<BQ", Opcode.MESSAGE_INDEX, len(body)) + body
            offsets[channel] = offset
            offset += len(part)
            parts.append(part)
        chunk_offset = self.size
        self._write(b"".join(parts))
        if not self._counts:
            self._first_time = start_time
        self._first_time = min(self._first_time, start_time)
        self._last_time = max(self._last_time, end_time)
        for channel, index in self._indexes.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(index) // 2
        self._chunks += 1
        self._chunk_indexes += _encoded(
            mcap_records.ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=chunk_offset,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=end_time,
                message_index_length=offset - chunk_offset - len(chunk),
                message_index_offsets=offsets,
                message_start_time=start_time,
                uncompressed_size=len(content),
            )
        )

    def finish(self) -> None:
        """Write the summary and the end, see it onto the disk, and close.

        Raises OSError; the file then ends with a chunk and is still open.
        """
        self._write_summary()
        self._repeat(lambda twin: twin.take_place())
        if self._twin is None:
            os.fsync(self._file)
        self.close()

    def close(self) -> None:
        """Nothing more is written; what is on disk stays as it is."""
        self._part()
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def discard(self) -> None:
        """Close, and take the file away; nothing if it is closed."""
        if self._file >= 0:
            self.close()
            self._take_away()

    def _take_away(self) -> None:
        self._path.unlink(missing_ok=True)

    def _write_summary(self) -> None:
        end = _encoded(mcap_records.DataEnd(self._crc))
        start = self.size + len(end)
        statistics = mcap_records.Statistics(
            attachment_count=len(self._attachment_indexes),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last_time,
            message_start_time=self._first_time,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )
        groups = [
            (Opcode.SCHEMA, _encoded(*self._schemas.values())),
            (Opcode.CHANNEL, _encoded(*self._channels)),
            (Opcode.STATISTICS, _encoded(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes)),
            (Opcode.ATTACHMENT_INDEX, _encoded(*self._attachment_indexes)),
            (Opcode.METADATA_INDEX, _encoded(*self._metadata_indexes)),
        ]
        summary = b""
        offsets: list[McapRecord] = []
        for opcode, data in groups:
            if data:
                offsets.append(mcap_records.SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offsets_start = start + len(summary)
        summary += _encoded(*offsets)
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        crc = zlib.crc32(footer, zlib.crc32(summary))
        self._write(end + summary + footer + struct.pack("<I", crc) + flightlog.MAGIC)


class _Twin(McapFile):
    """The same file in large chunks, without a name (O_TMPFILE), so that nothing of it is left by a kill."""

    @classmethod
    def beside(cls, other: McapFile) -> Self | None:
        """None where the file system has no such files."""
        try:
            twin = cls(other._path)
        except OSError:
            return None
        twin._schemas, twin._channels = other._schemas, other._channels
        return twin

    def _open(self) -> int:
        return os.open(self._path.parent, os.O_WRONLY | os.O_TMPFILE | os.O_CLOEXEC, 0o644)

    def _take_away(self) -> None:
        """It has no name: it is gone when it is closed."""

    def add_content(self, content: bytes, indexes: dict[int, list[int]]) -> None:
        """Of another chunk, with its indexes. Raises OSError."""
        for channel, index in indexes.items():
            moved = index.copy()
            moved[1::2] = [offset + self._offset for offset in index[1::2]]
            self._indexes.setdefault(channel, []).extend(moved)
        self._parts.append(content)
        self._offset += len(content)
        if self._offset >= LARGE_CHUNK_BYTES:
            self.end_chunk()

    def end_chunk(self) -> None:
        if self._indexes:
            self._write_chunk(self._parts)
            self._parts, self._offset, self._indexes = [], 0, {}

    def take_place(self) -> None:
        """Finish, and be the file of that name. Raises OSError; the other one is untouched then."""
        self.end_chunk()
        self._write_summary()
        os.fsync(self._file)
        draft = f"{self._path.name}.{os.getpid()}"
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.link(f"/proc/self/fd/{self._file}", draft, dst_dir_fd=folder)  # linkat: it follows the link in /proc
            os.replace(draft, self._path.name, src_dir_fd=folder, dst_dir_fd=folder)
        finally:
            os.close(folder)


# ---------------------------------------------------------------------------------------------------------- messages


class _Target(NamedTuple):
    """Where frames of one kind from one sender go."""

    channel: int
    size: int
    """Of the full payload; shorter ones are padded with zeros."""
    convert: Callable[[bytes], bytes] | None
    """To the schema's bytes, where these aren't the payload itself."""


_ROS_TYPES = {"float": "float32", "double": "float64", "char": "uint8"}


def message_type(message_id: int, topic: str) -> tuple[RecordType, int, Callable[[bytes], bytes] | None]:
    """A MAVLink message as a type of record, its full payload's size, and how that becomes a record.

    The fields are in wire order and char arrays are strings; without any, the payload is the record (None).
    Raises KeyError for an id that the dialect doesn't have.
    """
    message = layout(message_id)
    fields: list[tuple[str, str]] = []
    cuts: list[tuple[int, int]] = []
    position = 0
    for name, kind, length in message.fields:
        ros_kind = _ROS_TYPES.get(kind, kind.removesuffix("_t"))
        size = max(length, 1) * struct.calcsize("<" + flightlog.SCALARS[ros_kind])
        if kind == "char" and length:
            fields.append((name, "string"))
            cuts.append((position, position + size))
        else:
            fields.append((name, f"{ros_kind}[{length}]" if length else ros_kind))
        position += size
    described = dialect.mavlink_map[message_id]
    units, enums = described.fieldunits_by_name, described.fieldenums_by_name
    comments = {name: " ".join(filter(None, (units.get(name), enums.get(name)))) for name, _ in fields}
    record_type = flightlog.record_type(topic, f"mavlink/{message.name}", fields, comments)
    return record_type, message.size, functools.partial(_with_strings, cuts) if cuts else None


def _with_strings(cuts: list[tuple[int, int]], payload: bytes) -> bytes:
    """`payload` with each char array, from byte to byte, up to its first zero and behind its length."""
    parts: list[bytes] = []
    position = 0
    for start, stop in cuts:
        text = payload[start:stop].partition(b"\0")[0].decode(errors="replace").encode()
        parts += payload[position:start], len(text).to_bytes(4, "little"), text
        position = stop
    return b"".join((*parts, payload[position:]))


def _with_length(payload: bytes) -> bytes:
    return len(payload).to_bytes(4, "little") + payload


class Messages:
    """The messages in the datagrams, each into the file under its own topic."""

    def __init__(self, file: McapFile, *, preserves_datagrams: bool) -> None:
        self._file = file
        self._preserves_datagrams = preserves_datagrams
        self._framers = [Framer() for _ in flightlog.Direction]
        self._targets: dict[tuple[int, int, int, bool], _Target] = {}

    def add(self, datagram: bytes, sequence: int, log_time: int) -> None:
        """`datagram` is a record of DATAGRAM."""
        direction, _, data = flightlog.datagram_of(datagram)
        framer = self._framers[direction]
        for frame in framer.datagram(data) if self._preserves_datagrams else framer.feed(data):
            known = frame.known
            key = frame.message_id, frame.system, frame.component, known
            try:
                channel, size, convert = self._targets[key]
            except KeyError:
                if len(self._targets) >= _MOST_TARGETS:
                    continue  # noise that looks like frames must not use up the file's channels, nor the memory
                channel, size, convert = self._targets[key] = self._new_target(*key)
            payload = frame.payload
            if len(payload) != size and known:
                payload = payload.ljust(size, b"\0")[:size]
            if convert is not None:
                payload = convert(payload)
            header = HEADER.pack(5, flightlog.LENGTH_OF_EMPTY + len(payload), channel, sequence, log_time, log_time)
            self._file.add_message(channel, log_time, header + payload)

    def _new_target(self, message_id: int, system: int, component: int, known: bool) -> _Target:
        folder = f"/mavlink/{system}/{component}"
        if known:
            kind, size, convert = message_type(message_id, f"{folder}/{layout(message_id).name}")
            return _Target(self._file.add_channel(kind), size, convert)
        kind = flightlog.record_type(
            f"{folder}/UNKNOWN_{message_id}", f"mavlink/UNKNOWN_{message_id}", [("payload", "uint8[]")]
        )
        return _Target(self._file.add_channel(kind), 0, _with_length)


# ----------------------------------------------------------------------------------------------------------- console


class Console:
    """Standard error: lines of text, and one line of progress below them. Never waited for."""

    def __init__(self) -> None:
        self._terminal = os.isatty(2)
        self._poller = select.poll()
        self._poller.register(2, select.POLLOUT)
        self._status = ""
        self._next_s = 0.0

    def text(self, line: str) -> None:
        if self._terminal:
            line = "\r\x1b[K" + line
        self._write(line + "\n" + (self._status if self._terminal else ""))

    def status(self, line: str) -> None:
        if self._terminal:
            self._status = line
            self._write("\r\x1b[K" + line)
        elif time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + STATUS_INTERVAL_S
            self._write(line + "\n")

    def close(self) -> None:
        if self._status:
            self._write("\n")

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError):
            if self._poller.poll(0):
                os.write(2, text.encode(errors="replace")[: select.PIPE_BUF])


# ---------------------------------------------------------------------------------------------------------- recorder


class Recorder:
    """Takes records out of the ring until the flying process has gone."""

    def __init__(self, memory: mmap.mmap, setup: Setup, file: McapFile) -> None:
        self._memory = memory
        self._words = memoryview(memory)[: flightlog.WORDS_BYTES].cast("Q")
        self._ring_bytes = len(memory) - flightlog.RING - flightlog.RING_SLACK
        self._setup = setup
        self._file = file
        self._messages = Messages(file, preserves_datagrams=setup.preserves_datagrams)
        self._console = Console()
        self._tail = 0
        self._taken = 0
        self._chunk_start_ns = 0
        self._said_dropped = 0
        self._said_ns = 0
        self._lost = 0
        self._undecoded = 0
        self._failed = False
        for kind in (DATAGRAM, TEXT, *(RecordType(*kind) for kind in setup.types)):
            file.add_channel(kind)
        self._words[flightlog.BEAT] = time.monotonic_ns()

    def run(self) -> None:
        """Returns when the pipe has closed, the ring is empty and the file is finished."""
        poller = select.poll()
        poller.register(0, 0)
        while True:
            # Read before the wait: between seeing a new head and reading what it announces lies a system call, so
            # that on processors that reorder memory accesses the records are there, too.
            head = self._words[flightlog.HEAD]
            ended = bool(poller.poll(POLL_MS))
            self._drain(head)
            now_ns = time.monotonic_ns()
            self._words[flightlog.BEAT] = now_ns
            if not self._file.pending_bytes:
                self._chunk_start_ns = now_ns
                self._words[flightlog.WRITTEN] = self._taken - self._lost
            elif now_ns - self._chunk_start_ns > CHUNK_AGE_NS:
                self._end_chunk()
            self._say_dropped(now_ns)
            if ended and head == self._words[flightlog.HEAD]:
                break
        self._finish()

    def _drain(self, head: int) -> None:
        memory, file, messages = self._memory, self._file, self._messages
        mask = self._ring_bytes - 1
        unpack = HEADER.unpack_from
        tail = self._tail
        count = 0
        while tail < head:
            start = flightlog.RING + (tail & mask)
            opcode, length, channel, sequence, log_time, _ = unpack(memory, start)
            if opcode == 0:  # the mark of a gap
                tail += self._ring_bytes - (tail & mask)
                continue
            record = memory[start : start + 9 + length]
            tail += len(record)
            if channel == DATAGRAM_CHANNEL:
                file.add_message(channel, log_time, record)
                try:
                    messages.add(record[HEADER.size :], sequence, log_time)
                except Exception as error:  # the bytes are kept; a decoder's mistake must not end the log
                    self._mistake(error)
            elif channel < flightlog.METADATA_CHANNEL:
                file.add_message(channel, log_time, record)
                if channel == TEXT_CHANNEL and self._setup.console:
                    self._show(log_time, record[HEADER.size :])
            else:
                self._advance(count, tail)
                count = 0
                self._obey(channel, record[HEADER.size :])
            count += 1
            if count == _BATCH or file.pending_bytes >= CHUNK_BYTES:
                self._advance(count, tail)
                count = 0
                if file.pending_bytes >= CHUNK_BYTES:
                    self._end_chunk()
        self._advance(count, tail)

    def _advance(self, count: int, tail: int) -> None:
        """So many more records are taken, up to there: always before a chunk is ended, which counts them."""
        self._taken += count
        self._tail = self._words[flightlog.TAIL] = tail
        self._words[flightlog.BEAT] = time.monotonic_ns()

    def _say_dropped(self, now_ns: int) -> None:
        dropped = self._words[flightlog.DROPPED]
        if dropped > self._said_dropped and now_ns - self._said_ns > DROPPED_INTERVAL_NS:
            self._said_dropped = dropped
            self._said_ns = now_ns
            self._console.text(f"{self._setup.folder}: {dropped} records not logged so far, the ring was full")

    def _mistake(self, error: Exception) -> None:
        if not self._undecoded:
            self._console.text(f"{self._setup.folder}: the flight log left a message undecoded: {error!r}")
        self._undecoded += 1

    def _obey(self, channel: int, data: bytes) -> None:
        if channel == flightlog.STATUS_CHANNEL:
            if self._setup.console:
                self._console.status(data.decode(errors="replace"))
            return
        name, table = msgspec.msgpack.decode(data, type=tuple[str, dict[str, str]])
        self._end_chunk()
        try:
            self._file.add_metadata(name, table)
        except OSError as error:
            self._fail(error)
            self._lost += 1

    def _show(self, log_time: int, data: bytes) -> None:
        text = TEXT.unpack(data)
        time_s = (log_time - self._setup.epoch_ns) * 1e-9
        self._console.text(f"{time_s:9.3f} {_LEVELS[text['level']]:7} {text['name']}: {text['message']}")

    def _end_chunk(self) -> None:
        self._chunk_start_ns = time.monotonic_ns()
        try:
            self._file.end_chunk()
        except OSError as error:
            self._fail(error)
            self._lost += self._taken - self._lost - self._words[flightlog.WRITTEN]
        self._words[flightlog.WRITTEN] = self._taken - self._lost

    def _fail(self, error: OSError) -> None:
        if self._failed:
            return
        self._failed = True
        text = f"{self._setup.folder}: the flight log can't be written: {error.strerror}"
        room = flightlog.FAULT_TEXT.stop - flightlog.FAULT_TEXT.start
        self._memory[flightlog.FAULT_TEXT] = text.encode()[: room - 1].ljust(room, b"\0")
        self._words[flightlog.STATE] = flightlog.FAILED  # after its text
        self._console.text(text)

    def _finish(self) -> None:
        closed = bool(self._words[flightlog.CLOSING])
        dropped = self._words[flightlog.DROPPED]
        self._end_chunk()
        try:
            self._file.add_metadata(
                "flightlog end",
                {
                    "reason": "closed" if closed else "the flying process ended without closing the log",
                    "records": str(self._words[flightlog.WRITTEN]),
                    "dropped": str(dropped),
                    "lost": str(self._lost),
                    "undecoded": str(self._undecoded),
                },
            )
            self._file.finish()
        except OSError as error:
            self._fail(error)
        self._console.close()
        if not self._failed:
            self._words[flightlog.STATE] = flightlog.CLOSED


def create(setup: Setup) -> McapFile:
    """Make the folder and the file, with what is known before the first record. Raises FlightLogError."""
    folder = Path(setup.folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        space = os.statvfs(folder)
        free = space.f_bavail * space.f_frsize
        if free < setup.minimum_free_bytes:
            raise FlightLogError(
                f"{folder}: {free / 1e6:.0f} MB free, a flight log needs {setup.minimum_free_bytes / 1e6:.0f} MB"
            )
        file = McapFile(folder / flightlog.FILE_NAME, tidies=True)
        file.add_metadata("flightlog", {"version": "1", "epoch_ns": str(setup.epoch_ns)})
        for name, table in setup.metadata.items():
            file.add_metadata(name, table)
        for name, content in setup.attachments.items():
            file.add_attachment(name, setup.epoch_ns, content)
    except OSError as error:
        raise FlightLogError(f"{folder}: the flight log can't be written: {error.strerror}") from error
    return file


def main() -> None:
    """Serve one flight."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when the flying process has ended, not before
    memory = mmap.mmap(int(sys.argv[1]), 0)
    os.close(int(sys.argv[1]))
    with os.fdopen(os.dup(0), "rb") as pipe:
        size = int.from_bytes(pipe.read(8), "little")
        setup = msgspec.msgpack.decode(pipe.read(size), type=Setup)
    try:
        recorder = Recorder(memory, setup, create(setup))
    except FlightLogError as error:
        os.write(1, str(error).encode())
        raise SystemExit(1) from None
    os.write(1, b"ok")
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)
    gc.freeze()
    recorder.run()


if __name__ == "__main__":
    main()
