"""What reading and writing share: the file's name, errors, and the layouts of MCAP records (https://mcap.dev/spec).

An MCAP file is a sequence of records, each with an opcode (1 byte), a length (8 bytes) and that many bytes of content.
All numbers are little-endian.
"""

import struct
from enum import IntEnum
from typing import Final

FILE_NAME: Final = "flight.mcap"
MAGIC: Final = b"\x89MCAP0\r\n"
"""First and last bytes of a file."""

RECORD_HEADER: Final = struct.Struct("<BQ")
"""Opcode and length of any record."""
MESSAGE_HEADER: Final = struct.Struct("<BQHIQQ")
"""A message record without its data: opcode, length, channel, sequence, log time, publish time (ns)."""
EMPTY_MESSAGE_LENGTH: Final = MESSAGE_HEADER.size - RECORD_HEADER.size
"""Length field of a message record without data."""
CHUNK_HEADER: Final = struct.Struct("<QQQII")
"""Start of a chunk record's content: start time, end time (ns), uncompressed size, CRC, length of the compression's
name."""
INDEX_HEADER: Final = struct.Struct("<BQHI")
"""Start of a message index record: opcode, length, channel, bytes of the (log time, offset) pairs that follow."""
FOOTER: Final = struct.Struct("<BQQQI")
"""A whole footer record: opcode, length, offset of the summary, offset of its offset table, CRC."""
UINT32: Final = struct.Struct("<I")


class FlightLogError(Exception):
    """A log that can't be written or read. The message is one sentence that names the folder or file."""


class Direction(IntEnum):
    """Direction of a datagram, as the companion sees it."""

    IN = 0
    """From the vehicle."""
    OUT = 1
    """To the vehicle, from the companion."""
    FORWARDED = 2
    """To the vehicle, from a ground station whose address it has."""
    SENSOR = 3
    """From a sensor on a link of its own."""


def message_record(channel: int, sequence: int, log_time: int, data: bytes) -> bytes:
    """A whole message record; `log_time` in ns since 1970."""
    return MESSAGE_HEADER.pack(5, EMPTY_MESSAGE_LENGTH + len(data), channel, sequence, log_time, log_time) + data
