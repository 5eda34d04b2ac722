"""Writing an MCAP file chunk by chunk, and a second copy of it in larger chunks."""

import contextlib
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

import mcap.records as mcap_records
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import McapRecord

from protocol.flightlog.mcap_format import MAGIC, RECORD_HEADER, UINT32
from protocol.flightlog.record_types import RecordType

COMPRESSION_LEVEL: Final = 3
"""Level of zstd: level 1 takes half the time, levels up to 9 save nothing more."""
CHUNK_BYTES: Final = 512 << 10
"""Uncompressed size at which a writer ends a chunk, however young it is."""
LARGE_CHUNK_BYTES: Final = 256 << 10
"""Uncompressed size of a finished file's chunks, some 2 s of a flight: what is lost with a damaged one."""
_SLICE_BYTES: Final = 16 << 10
"""A chunk is compressed in slices of this size; those before a cut in the file can be read."""


def _encoded(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


class McapFile:
    """An MCAP file written chunk by chunk; the file on disk ends with a whole chunk at any time.

    A chunk that can't be written is given up and its remains are cut off, so that later ones can follow.
    `with_large_chunks`: the finished file has chunks of LARGE_CHUNK_BYTES, wherever `end_chunk` ended one. The
    constructor raises OSError if the file can't be made or exists already, and leaves no part of it then.
    """

    def __init__(self, path: Path, *, with_large_chunks: bool = False) -> None:
        self._path = path
        self._copy: _LargeChunkCopy | None = None
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
        self._chunk_indexes = bytearray()  # encoded, since a long flight has many
        self._attachment_indexes: list[mcap_records.AttachmentIndex] = []
        self._metadata_indexes: list[mcap_records.MetadataIndex] = []
        try:
            self._write(MAGIC + _encoded(mcap_records.Header(profile="", library="courier")))
        except OSError:
            self.discard()
            raise
        if with_large_chunks:
            self._copy = _LargeChunkCopy.beside(self)

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
        self._repeat(lambda copy: copy.add_metadata(name, table))

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
        self._repeat(lambda copy: copy.add_attachment(name, time_ns, content))

    def _repeat(self, what: "Callable[[_LargeChunkCopy], None]") -> None:
        """Do the same with the copy, if there is one. A copy that can't be written is given up."""
        if self._copy is None:
            return
        try:
            what(self._copy)
        except OSError:
            self._drop_copy()

    def _drop_copy(self) -> None:
        """Give up the copy, so that its space on the disk is free again."""
        if self._copy is not None:
            self._copy.close()
            self._copy = None

    def add_channel(self, kind: RecordType) -> int:
        """Add a channel; returns its id. Ids count from 1."""
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
        """Add a message to the pending chunk; `message` is the whole record with its header."""
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
        """Bytes of the chunk that is not yet in the file, 0 without a message."""
        return self._offset if self._indexes else 0

    def end_chunk(self) -> None:
        """Write the pending chunk. If that raises OSError, its messages are lost, but not its channels."""
        if not self._indexes:
            return
        indexes, content = self._indexes, b"".join(self._parts)
        try:
            try:
                self._write_chunk([content])
            except OSError:
                if self._copy is None:
                    raise
                self._drop_copy()
                self._write_chunk([content])
            self._definitions = []
        finally:
            self._parts = [*self._definitions]
            self._offset = sum(map(len, self._parts))
            self._indexes = {}
        self._repeat(lambda copy: copy.add_content(content, indexes))

    def _packed(self, pieces: list[bytes]) -> bytes:
        """One zstd frame; each slice of each piece is in whole blocks of its own."""
        compressor = self._compressor.compressobj(size=sum(map(len, pieces)))
        packed = []
        for piece in pieces:
            for start in range(0, len(piece), _SLICE_BYTES):
                packed.append(compressor.compress(piece[start : start + _SLICE_BYTES]))
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
            part = RECORD_HEADER.pack(Opcode.MESSAGE_INDEX, len(body)) + body
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

    @property
    def deleted(self) -> bool:
        """The file has no name any more: what is written to it is gone when it is closed."""
        return os.fstat(self._file).st_nlink == 0

    def sync(self) -> None:
        """Wait until what was written is on the disk. Raises OSError if it can't be brought there."""
        os.fdatasync(self._file)

    def finish(self) -> None:
        """Write the summary and the end, sync the file to the disk, and close it.

        If that raises OSError, the file ends with a chunk and is still open.
        """
        self._write_summary()
        self._repeat(lambda copy: copy.replace_original())
        if self._copy is None:
            os.fsync(self._file)
        self.close()

    def close(self) -> None:
        """Close the file as it is on the disk; without `finish` it has no summary."""
        self._drop_copy()
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def discard(self) -> None:
        """Close and remove the file; does nothing if it is closed."""
        if self._file >= 0:
            self.close()
            self._remove()

    def _remove(self) -> None:
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
        self._write(end + summary + footer + UINT32.pack(crc) + MAGIC)


class _LargeChunkCopy(McapFile):
    """The same file in large chunks. It has no name (O_TMPFILE) until it is finished: a kill leaves nothing of it."""

    @classmethod
    def beside(cls, other: McapFile) -> Self | None:
        """A copy of `other`, which is still empty; None where the file system has no files without a name."""
        try:
            copy = cls(other._path)
        except OSError:
            return None
        copy._schemas, copy._channels = other._schemas, other._channels
        return copy

    def _open(self) -> int:
        return os.open(self._path.parent, os.O_WRONLY | os.O_TMPFILE | os.O_CLOEXEC, 0o644)

    def _remove(self) -> None:
        """Nothing: a file without a name is gone when it is closed."""

    def add_content(self, content: bytes, indexes: dict[int, list[int]]) -> None:
        """Append the content of one more chunk, with its indexes. Raises OSError."""
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

    def replace_original(self) -> None:
        """Finish, and take the name of the original. If that raises OSError, the original is untouched."""
        self.end_chunk()
        self._write_summary()
        os.fsync(self._file)
        draft = f"{self._path.name}.{os.getpid()}"
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.link(f"/proc/self/fd/{self._file}", draft, dst_dir_fd=folder)  # linkat: it follows the link in /proc
            os.replace(draft, self._path.name, src_dir_fd=folder, dst_dir_fd=folder)
            os.fsync(folder)
        finally:
            os.close(folder)
