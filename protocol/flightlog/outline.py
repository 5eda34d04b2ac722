"""The outer records of an MCAP file: where its chunks are and whether it is whole, without opening the chunks."""

from mcap.opcode import Opcode

from protocol.flightlog.chunks import DAMAGE, Chunk, chunk_at, next_chunk, record_at
from protocol.flightlog.definitions import DEFINING, Definitions
from protocol.flightlog.file_bytes import PIECE_BYTES, FileBytes
from protocol.flightlog.mcap_format import EMPTY_MESSAGE_LENGTH, FOOTER, MAGIC, UINT32
from protocol.flightlog.problems import Problems


class Outline:
    """Scanned when it is made. Damage is reported to `problems` and passed over, up to the next whole chunk.

    `definitions` takes in what the outer records define.
    """

    def __init__(self, data: FileBytes, definitions: Definitions, problems: Problems) -> None:
        self.chunks: list[Chunk] = []
        """Whole ones, a truncated one at the end, and runs of messages outside of chunks."""
        self.complete = False
        """Whether the file was finished: it has its summary and its end."""
        self.has_summary = False
        self.verified = False
        """Whether a checksum over all of the data is there, and right."""
        self._data = data
        self._definitions = definitions
        self._problems = problems
        self._data_ended = False
        self._checked = False
        self._scan()
        self._leave_out_unchunked()

    def _scan(self) -> None:
        data = self._data
        position = len(MAGIC)
        suspect = 0  # nothing from here on was checked by a CRC yet
        if data[: len(MAGIC)] != MAGIC:
            self._problems.report("its first bytes are damaged or missing")
            position = next_chunk(data, 0)
        while position < len(data):
            stop = self._scan_record(position)
            if self.complete:
                return
            if stop is None:
                found = next_chunk(data, suspect)
                if found == len(data):
                    self._take_truncated(position)
                    break
                self._problems.report(f"damaged after byte {suspect}, resumed at byte {found}")
                position = found
                continue
            if self.chunks and self.chunks[-1].offset == position and not self.chunks[-1].unchunked:
                suspect = stop
            position = stop
        self._problems.report(f"cut off at byte {min(position, len(data))}")

    def _scan_record(self, position: int) -> int | None:
        """Take in the record there. Returns where the next one starts, or None if there is no whole record."""
        data = self._data
        record = record_at(data, position)
        if record is None:
            return None
        opcode, start, stop = record
        try:
            if opcode == Opcode.CHUNK:
                chunk = chunk_at(data, position)
                if chunk is None:
                    return None
                self.chunks.append(chunk)
            elif opcode == Opcode.MESSAGE:
                if stop - start < EMPTY_MESSAGE_LENGTH:
                    return None
                self._add_unchunked(position, stop)
            elif opcode in DEFINING:
                self._definitions.take(opcode, data[start:stop])
            elif opcode == Opcode.DATA_END:
                self._end_data(position, UINT32.unpack(data[start : start + UINT32.size])[0])
            elif opcode == Opcode.FOOTER:
                self._finish(position, stop)
            elif not Opcode.HEADER <= opcode <= Opcode.DATA_END:
                return None
        except DAMAGE:
            return None
        return stop

    def _add_unchunked(self, start: int, stop: int) -> None:
        """Add a message outside of chunks to those before it, up to a piece that is read at once."""
        last = self.chunks[-1] if self.chunks else None
        if last is not None and last.unchunked and last.stop == start and last.size < PIECE_BYTES:
            self.chunks[-1] = last._replace(stop=stop, size=stop - last.start)
        else:
            self.chunks.append(Chunk(start, start, stop, "", stop - start, 0, unchunked=True))

    def _leave_out_unchunked(self) -> None:
        """In a damaged file of chunks, what looks like messages between them may be the damage."""
        chunks = [chunk for chunk in self.chunks if not chunk.unchunked]
        if self._problems and 0 < len(chunks) < len(self.chunks):
            self.chunks = chunks
            self._problems.report("messages between its chunks are left out, nothing vouches for them")

    def _end_data(self, position: int, crc: int) -> None:
        if crc and not self._checked:
            self._checked = True
            self.verified = crc == self._data.crc(0, position)
            if not self.verified:
                self._problems.report("bytes in it are damaged")
        self._data_ended = True

    def _finish(self, position: int, stop: int) -> None:
        data = self._data
        _, _, summary_start, _, crc = FOOTER.unpack(data[position : position + FOOTER.size])
        self.complete = self._data_ended and stop + len(MAGIC) == len(data) and data[stop:] == MAGIC
        if not self.complete:
            self._problems.report("its last bytes are damaged or missing")
        elif crc and crc != self._data.crc(summary_start, stop - 4):
            self._problems.report("its summary is damaged")
        elif summary_start:
            self.has_summary = True

    def _take_truncated(self, position: int) -> None:
        """Take in the last chunk, if the file ends within it."""
        chunk = chunk_at(self._data, position, truncated=True)
        if chunk is not None and chunk.compression == "zstd":
            self.chunks.append(chunk)
            self._problems.report(
                f"the checksum of its last chunk, at byte {position}, is cut off with the chunk's end"
            )
