"""What an MCAP file defines beside its messages: schemas, channels, metadata, attachments."""

import zlib
from collections.abc import Callable
from io import BytesIO
from typing import Final

import mcap.records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from protocol.flightlog.mcap_format import UINT32
from protocol.flightlog.record_types import RecordType

_READERS: Final[dict[int, Callable[[ReadDataStream], mcap.records.McapRecord]]] = {
    Opcode.SCHEMA: mcap.records.Schema.read,
    Opcode.CHANNEL: mcap.records.Channel.read,
    Opcode.METADATA: mcap.records.Metadata.read,
    Opcode.ATTACHMENT: mcap.records.Attachment.read,
}
DEFINING: Final = frozenset(_READERS)
"""Opcodes of the records that define something."""


class Definitions:
    """Collected from records as they are read. `report` is told of damage; each call names it in a few words."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.types: dict[int, RecordType] = {}
        """By channel."""
        self.unsupported: set[int] = set()
        """Channels without a schema, or with one that is not of ROS 1's plain ones."""
        self._schemas: dict[int, mcap.records.Schema] = {}
        self._report = report

    def take(self, opcode: int, content: bytes) -> None:
        """Take in a record of one of the DEFINING opcodes.

        Raises McapError, ValueError, struct.error, KeyError or OverflowError for content that isn't such a record.
        """
        if opcode == Opcode.ATTACHMENT and UINT32.unpack(content[-4:])[0] not in (0, zlib.crc32(content[:-4])):
            self._report("an attachment is damaged")  # with a checksum of 0 it has none
            return
        record = _READERS[opcode](ReadDataStream(BytesIO(content)))
        if isinstance(record, mcap.records.Schema):
            self._schemas[record.id] = record
        elif isinstance(record, mcap.records.Channel):
            self._take_channel(record)
        elif isinstance(record, mcap.records.Metadata):
            self.metadata[record.name] = record.metadata
        elif isinstance(record, mcap.records.Attachment):
            self.attachments[record.name] = record.data

    def _take_channel(self, channel: mcap.records.Channel) -> None:
        schema = self._schemas.get(channel.schema_id)
        if channel.schema_id == 0 or (schema is not None and schema.encoding != "ros1msg"):
            self.unsupported.add(channel.id)
        elif schema is not None:  # otherwise it is lost with a damaged chunk, and so are this channel's messages
            known = self.types.get(channel.id)
            try:
                definition = schema.data.decode()
                if known is None or known.topic != channel.topic or known.definition != definition:
                    self.types[channel.id] = RecordType(channel.topic, schema.name, definition)
            except ValueError:
                self.unsupported.add(channel.id)

    def start_time_ns(self) -> int | None:
        """log_time of the log's time 0 (ns since 1970, at most 63 bits); None where it is missing or damaged."""
        text = self.metadata.get("flightlog", {}).get("epoch_ns", "")
        if text.isascii() and text.isdigit() and len(text) <= 19 and int(text) < 1 << 63:
            return int(text)
        return None
