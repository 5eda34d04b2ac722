"""Chunks of an MCAP file: where they are, and their content."""

import contextlib
import struct
import zlib
from typing import Final, NamedTuple

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from protocol.flightlog.definitions import DEFINING
from protocol.flightlog.file_bytes import FileBytes
from protocol.flightlog.mcap_format import CHUNK_HEADER, RECORD_HEADER

DAMAGE: Final = (McapError, ValueError, struct.error, KeyError, OverflowError)
"""What parsing raises for bytes that are not what they seem to be."""
CHUNK_MARK: Final = b"\x04\x00\x00\x00zstd"
"""In each chunk that is compressed with zstd: its compression's name, behind the length of that."""
_MARK_OFFSET: Final = RECORD_HEADER.size + CHUNK_HEADER.size - 4
_LARGEST_CHUNK: Final = 1 << 30
"""Uncompressed bytes; a chunk that says it has more is damaged."""
_PIECE_BYTES: Final = 1 << 8
"""Decompressed at once of a truncated chunk. At most 8 MB come of it: 4 bytes of zstd hold 128 KiB at the most."""
_UNSTATED: Final = -1


class Chunk(NamedTuple):
    """One chunk, or messages outside of chunks."""

    offset: int
    """Offset of the chunk's record in the file."""
    start: int
    """Offset of its compressed content."""
    stop: int
    """Offset of that content's end."""
    compression: str
    size: int
    """Uncompressed bytes."""
    crc: int
    """Checksum of the uncompressed content; 0 if there is none."""
    truncated: bool = False
    """The file ends within it."""
    unchunked: bool = False
    """Not a chunk but successive messages outside of chunks, covered by no checksum but the file's."""


class ChunkError(Exception):
    """A chunk whose content can't be read; the message says which and why."""


def record_at(data: FileBytes, position: int) -> tuple[int, int, int] | None:
    """Opcode, start and end of the record whose header is at `position`; None where the file ends before its end."""
    header = data.unpack(RECORD_HEADER, position)
    if header is None:
        return None
    opcode, length = header
    start = position + RECORD_HEADER.size
    return None if start + length > len(data) else (opcode, start, start + length)


def chunk_at(data: FileBytes, position: int, *, truncated: bool = False) -> Chunk | None:
    """The chunk whose record starts at `position`: a whole one, or one that is `truncated`. None if there is none."""
    start = position + RECORD_HEADER.size
    record, header = data.unpack(RECORD_HEADER, position), data.unpack(CHUNK_HEADER, start)
    if record is None or header is None:
        return None
    (opcode, length), (_, _, size, crc, name_length) = record, header
    if opcode != Opcode.CHUNK or name_length > 16 or size > _LARGEST_CHUNK:
        return None
    name_start = start + CHUNK_HEADER.size
    content = name_start + name_length + 8
    name = data[name_start:content]
    if len(name) < name_length + 8:
        return None
    stop = content + int.from_bytes(name[name_length:], "little")
    if stop != start + length or (stop > len(data)) != truncated:
        return None
    name = name[:name_length]
    return Chunk(position, content, min(stop, len(data)), name.decode(errors="replace"), size, crc, truncated)


def next_chunk(data: FileBytes, position: int) -> int:
    """Offset of the next whole chunk from `position` on, or the file's end."""
    while True:
        mark = data.find(CHUNK_MARK, position + 1)
        if mark < 0:
            return len(data)
        offset = mark - _MARK_OFFSET
        if offset >= position and chunk_at(data, offset) is not None:
            return offset
        position = mark


def chunk_content(data: FileBytes, chunk: Chunk) -> bytes:
    """A chunk's uncompressed content; of a truncated chunk, the whole records in it. Raises ChunkError."""
    packed = data[chunk.start : chunk.stop]
    try:
        if chunk.truncated:
            return _beginning(packed, chunk.size)
        if chunk.compression == "zstd":
            content = decompressed(packed, chunk.size)
        elif chunk.compression == "":
            content = packed
        else:
            raise ChunkError(f"chunk at byte {chunk.offset} is packed with {chunk.compression}, which isn't read")
    except (zstandard.ZstdError, MemoryError):
        content = b""
    if len(content) != chunk.size or (chunk.crc and zlib.crc32(content) != chunk.crc):
        raise ChunkError(f"chunk at byte {chunk.offset} is damaged")
    return content


def decompressed(packed: bytes, size: int) -> bytes:
    """Content of a zstd frame, at most `size` bytes.

    Raises zstandard.ZstdError for a damaged frame, and for one that states another size, before unpacking any of it.
    """
    stated = zstandard.frame_content_size(packed)
    if stated not in (_UNSTATED, size):
        raise zstandard.ZstdError(f"a frame of {stated} bytes, not of {size}")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _beginning(packed: bytes, size: int) -> bytes:
    """The whole records in the first part of a compressed chunk of `size` bytes."""
    unpack = zstandard.ZstdDecompressor().decompressobj()
    content = bytearray()
    with contextlib.suppress(zstandard.ZstdError):
        for start in range(0, len(packed), _PIECE_BYTES):
            if len(content) >= size:
                break
            content += unpack.decompress(packed[start : start + _PIECE_BYTES])
    del content[size:]
    position = 0
    while position + RECORD_HEADER.size <= len(content):
        opcode, length = RECORD_HEADER.unpack_from(content, position)
        stop = position + RECORD_HEADER.size + length
        if stop > len(content) or (opcode != Opcode.MESSAGE and opcode not in DEFINING):
            break
        position = stop
    return bytes(content[:position])
