"""The messages of chosen topics, from the contents of chunks."""

import struct
from collections.abc import Callable
from typing import NamedTuple

from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode

from protocol.flightlog.chunks import Chunk
from protocol.flightlog.definitions import DEFINING, Definitions
from protocol.flightlog.file_bytes import FileBytes
from protocol.flightlog.mcap_format import INDEX_HEADER, RECORD_HEADER

_MESSAGE = struct.Struct("<BQHIQ")  # without the publish time
_DATA = 31  # where a message record's data starts
_new = tuple.__new__  # makes a Record in half the time of the class's own constructor


class Record(NamedTuple):
    """One message of a file."""

    topic: str
    time_ns: int
    """The companion's clock, as it was given to `FlightLog`."""
    sequence: int
    """Counts the records that were given, in that order; a gap is a record that was dropped."""
    data: bytes


class Selection:
    """Reads messages of the topics for which `is_wanted` is true. `report` is told of channels that are not defined."""

    def __init__(
        self,
        definitions: Definitions,
        epoch_ns: int,
        is_wanted: Callable[[str], bool],
        report: Callable[[str], None],
    ) -> None:
        self._definitions = definitions
        self._epoch_ns = epoch_ns
        self._is_wanted = is_wanted
        self._report = report
        self._topics: dict[int, str | None] = {}
        """By channel; None for those to leave out."""

    def walk(self, content: bytes, found: list[Record]) -> None:
        """Add a chunk's messages to `found` and take in what it defines.

        Raises one of `chunks.DAMAGE` behind the last whole record.
        """
        epoch_ns, topics = self._epoch_ns, self._topics
        unpack, new = _MESSAGE.unpack_from, _new
        position = 0
        while position < len(content):
            opcode, length, channel, sequence, log_time = unpack(content, position)
            stop = position + 9 + length
            if opcode == 5:
                try:
                    topic = topics[channel]
                except KeyError:
                    topic = topics[channel] = self._topic(channel)
                if topic is not None:
                    found.append(new(Record, (topic, log_time - epoch_ns, sequence, content[position + _DATA : stop])))
            elif opcode in DEFINING:
                self._definitions.take(opcode, content[position + 9 : stop])
            position = stop
        if position > len(content):  # only the last record can be longer than the content
            if opcode == 5 and topic is not None:
                found.pop()
            raise EndOfFile

    def _topic(self, channel: int) -> str | None:
        kind = self._definitions.types.get(channel)
        if kind is not None:
            return kind.topic if self._is_wanted(kind.topic) else None
        if channel not in self._definitions.unsupported:
            self._report(f"what was on channel {channel} is lost with a damaged chunk")
        return None

    def places(self, data: FileBytes, chunk: Chunk) -> list[int] | None:
        """Offsets of the wanted messages in the chunk's content, by the indexes behind it; None without an index.

        Raises KeyError, OverflowError or struct.error for an index that can't be trusted: one with a
        channel that is only defined in the chunk, or with one place for two messages.
        """
        places, position = list[int](), chunk.stop
        while True:
            start = position + INDEX_HEADER.size
            opcode, length, channel, pairs = INDEX_HEADER.unpack(data[position:start])
            if opcode != Opcode.MESSAGE_INDEX:
                break
            if channel not in self._topics:
                if channel not in self._definitions.types and channel not in self._definitions.unsupported:
                    raise KeyError(channel)
                self._topics[channel] = self._topic(channel)
            if self._topics[channel] is not None:
                places += struct.unpack(f"<{pairs // 8}Q", data[start : start + pairs // 8 * 8])[1::2]
            position += RECORD_HEADER.size + length
        if position == chunk.stop:
            return None
        if len(set(places)) < len(places):
            raise KeyError(chunk.offset)
        places.sort()
        return places

    def pick(self, content: bytes, places: list[int]) -> list[Record]:
        """The messages at these places. Raises KeyError or struct.error if there is something else."""
        found: list[Record] = []
        epoch_ns, topics, unpack, new = self._epoch_ns, self._topics, _MESSAGE.unpack_from, _new
        for position in places:
            opcode, length, channel, sequence, log_time = unpack(content, position)
            topic = topics[channel]
            if opcode != 5 or topic is None:
                raise KeyError(channel)
            data = content[position + _DATA : position + 9 + length]
            found.append(new(Record, (topic, log_time - epoch_ns, sequence, data)))
        if position + 9 + length > len(content):
            raise KeyError(channel)
        return found
