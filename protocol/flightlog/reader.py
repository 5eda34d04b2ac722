"""Reading a log as it is now: finished, cut off or damaged. `follower` reads one that grows."""

import hashlib
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from protocol.flightlog.chunks import CHUNK_MARK, DAMAGE, Chunk, ChunkError, chunk_content
from protocol.flightlog.definitions import Definitions
from protocol.flightlog.file_bytes import FileBytes
from protocol.flightlog.mcap_format import MAGIC, Direction, FlightLogError
from protocol.flightlog.outline import Outline
from protocol.flightlog.problems import Problems
from protocol.flightlog.record_types import DATAGRAM, RecordType
from protocol.flightlog.selection import Record, Selection

if TYPE_CHECKING:  # numpy is imported where it is needed
    import numpy as np
    from numpy.typing import NDArray

_SEARCHED_BYTES: Final = 1 << 20
"""A damaged file whose first bytes, up to here, hold no chunk is no log."""


class LogReader:
    """A log, of which everything whole is read and everything else is reported.

    `problem` knows of a truncated end and of damage to a finished file at once, and of damaged chunks of an unfinished
    one after `records` has read them. Topics with a schema that isn't one of ROS 1's plain ones are left out. Raises
    FlightLogError only if the file can't be opened or read, or is no MCAP file at all.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._problems = Problems()
        self._definitions = Definitions(self._problems.report)
        self.metadata: dict[str, dict[str, str]] = self._definitions.metadata
        self.attachments: dict[str, bytes] = self._definitions.attachments
        self._data = FileBytes(self.path)
        if not MAGIC.startswith(self._data[: len(MAGIC)]) and CHUNK_MARK not in self._data[:_SEARCHED_BYTES]:
            raise FlightLogError(f"{self.path}: not an MCAP file")
        self._outline = Outline(self._data, self._definitions, self._problems)
        self.complete = self._outline.complete
        """Whether the file was finished: it has its summary and its end."""
        self._knows_topics = self._outline.has_summary
        epoch_ns = self._definitions.start_time_ns()
        self.epoch_ns = epoch_ns or 0
        """log_time of time 0 (ns since 1970), from 0 to the greatest number of 63 bits."""
        if epoch_ns is None:
            damaged = bool(self.metadata.get("flightlog", {}).get("epoch_ns"))
            self._problems.report(f"its start time is {'damaged' if damaged else 'missing'}, times count from 1970")

    @property
    def problem(self) -> str | None:
        """What is wrong with the file, or None."""
        return f"{self.path}: {self._problems}" if self._problems else None

    @property
    def abandoned(self) -> str | None:
        """Why nobody closed it, in the recorder's words: the flying process has ended; None for any other log."""
        reason = self.metadata.get("flightlog end", {}).get("reason", "closed")
        return None if reason == "closed" else reason

    @property
    def missing(self) -> dict[str, str]:
        """How many records did not reach the log, in the recorder's words, by what became of them: dropped (it was too
        slow), lost (it could not write), undecoded (there as bytes alone). Empty for a log that has all, or that was
        not closed."""
        end = self.metadata.get("flightlog end", {})
        return {name: end[name] for name in ("dropped", "lost", "undecoded") if end.get(name, "0") != "0"}

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """The messages of `topics` (None: of all) in the order in which they were written."""
        is_wanted = (lambda topic: True) if topics is None else topics.__contains__
        selection = Selection(self._definitions, self.epoch_ns, is_wanted, self._problems.report)
        for chunk in self._outline.chunks:
            indexed = None if topics is None else self._indexed(chunk, selection)
            if indexed is not None:
                yield from indexed
                continue
            content = self._content(chunk)
            if content is not None:
                found: list[Record] = []
                try:
                    selection.walk(content, found)
                except DAMAGE:
                    self._problems.report(f"chunk at byte {chunk.offset} holds something else than messages")
                yield from found

    def _content(self, chunk: Chunk) -> bytes | None:
        try:
            return chunk_content(self._data, chunk)
        except ChunkError as error:
            self._problems.report(str(error))
            return None

    def _indexed(self, chunk: Chunk, selection: Selection) -> list[Record] | None:
        """The messages by the chunk's indexes, without a look at other topics' messages.

        None if there are no indexes or they can't be trusted.
        """
        if chunk.unchunked or not (self._outline.verified and self._outline.has_summary):
            return None
        try:
            places = selection.places(self._data, chunk)
            if not places:
                return None if places is None else []
            content = self._content(chunk)
            return None if content is None else selection.pick(content, places)
        except (KeyError, OverflowError, struct.error):
            return None

    @property
    def topics(self) -> dict[str, RecordType]:
        """The type of the records on each topic."""
        if not self._knows_topics:
            for _ in self.records(()):
                pass
            self._knows_topics = True
        return {kind.topic: kind for kind in self._definitions.types.values()}

    def array(self, topic: str) -> "NDArray[np.void]":
        """`arrays` of one topic."""
        return self.arrays((topic,))[topic]

    def arrays(self, topics: Collection[str]) -> "dict[str, NDArray[np.void]]":
        """Structured arrays (n,) by topic, with the fields `time_ns` and then those of the schema.

        Raises FlightLogError if a topic isn't there, its records vary in size or don't fit its schema, a field of its
        own is called `time_ns`, or a time is beyond 63 bits.
        """
        known = self.topics
        for topic in topics:
            if topic not in known:
                raise FlightLogError(f"{self.path}: there is no topic {topic}")
            if any(field.name == "time_ns" for field in known[topic].fields):
                raise FlightLogError(f"{self.path}: {topic} has a field time_ns of its own; read it one by one")
        layouts = {topic: known[topic].dtype for topic in topics}
        found: dict[str, tuple[list[int], list[bytes]]] = {topic: ([], []) for topic in topics}
        for topic, time_ns, _, data in self.records(topics):  # whole records would be work for the garbage collector
            times_ns, parts = found[topic]
            times_ns.append(time_ns)
            parts.append(data)
        return {topic: self._table(topic, layouts[topic], *held) for topic, held in found.items()}

    def _table(
        self, topic: str, layout: "np.dtype[np.void]", times_ns: list[int], parts: list[bytes]
    ) -> "NDArray[np.void]":
        import numpy as np

        if {*map(len, parts)} - {layout.itemsize}:
            raise FlightLogError(f"{self.path}: a record on {topic} is not as its schema says")
        values = np.ndarray(len(parts), layout, b"".join(parts))
        names = layout.names or ()
        columns = [
            ("time_ns", np.dtype("<i8"), ()),
            *((name, values[name].dtype, values[name].shape[1:]) for name in names),
        ]
        table = np.empty(len(parts), columns)
        try:
            table["time_ns"] = times_ns
        except OverflowError:
            raise FlightLogError(f"{self.path}: a record on {topic} has a time beyond all clocks") from None
        for name in names:
            table[name] = values[name]
        return table


def read(path: Path | str, topics: Collection[str] | None = None) -> Iterator[Record]:
    """The messages of a log in the order in which they were written; `LogReader` also says whether it is whole."""
    return LogReader(path).records(topics)


def datagrams(path: Path | str) -> Iterator[tuple[int, Direction, str, bytes]]:
    """Every datagram: time (ns), direction, address, bytes."""
    for record in read(path, (DATAGRAM.topic,)):
        values = DATAGRAM.unpack(record.data)
        yield record.time_ns, Direction(values["direction"]), values["address"], values["data"]


def digest(path: Path | str) -> dict[Direction, str]:
    """SHA-256 over the datagrams received and sent, and of each other direction that there is, with time and length;
    addresses are left out, since ports vary."""
    sums = {direction: hashlib.sha256() for direction in (Direction.IN, Direction.OUT)}
    for time_ns, direction, _, data in datagrams(path):
        sums.setdefault(direction, hashlib.sha256()).update(struct.pack("<qI", time_ns, len(data)) + data)
    return {direction: total.hexdigest() for direction, total in sums.items()}
