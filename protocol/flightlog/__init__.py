"""The flight log: MCAP (mcap.dev), written by a process of its own (recorder.py), and reading it back.

The flying process packs each record as an MCAP message into a ring in shared memory; the recorder moves them into the
file, decodes the MAVLink frames of each datagram beside it, and ends a chunk at least every 0.1 s. It lives until the
pipe from the flying process closes, so nothing is lost when that is killed, and at most 0.2 s when the recorder is.

Every message is ROS 1 serialisation with a `ros1msg` schema: little-endian fields without padding, which is also what
a MAVLink payload of full length is. Topics:

    /courier/datagrams               every datagram byte for byte: direction, address, data
    /mavlink/{system}/{component}/*  the messages in them, under their own names, with their datagram's sequence
    /log                             text, as Foxglove shows it
    others                           what the companion declares at `FlightLog.open`

log_time is `epoch_ns` (in the metadata "flightlog") plus the time that was given. `sequence` counts what was handed
over, in that order: where records were dropped, it has a gap.
"""

import contextlib
import hashlib
import itertools
import logging
import mmap
import os
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from enum import IntEnum
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self

import mcap.records
import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode

if TYPE_CHECKING:  # numpy is imported where it is needed: the recorder starts 0.1 s sooner without it
    import numpy as np
    from numpy.typing import NDArray

FILE_NAME = "flight.mcap"
MAGIC = b"\x89MCAP0\r\n"


class FlightLogError(Exception):
    """A log that can't be written or read; one sentence naming the folder or file."""


class Direction(IntEnum):
    """As the companion sees it."""

    IN = 0
    OUT = 1


# ---------------------------------------------------------------------------------------------------- record types

SCALARS = {  # as ROS 1 and as struct name them
    "bool": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
_VARIABLE = -1
_LARGEST_RECORD = 1 << 24
"""Bytes of a record's fields of fixed size; whatever asks for more is no schema of a log."""
_LENGTH = struct.Struct("<I")


class _Field(NamedTuple):
    name: str
    kind: str
    """A key of SCALARS, "string" or "time"."""
    length: int | None
    """None: one; otherwise an array of so many, or _VARIABLE."""

    @property
    def is_variable(self) -> bool:
        return self.kind == "string" or self.length == _VARIABLE

    @property
    def values(self) -> int:
        """So many of them, where that is fixed."""
        return 2 if self.kind == "time" else self.length or 1

    @property
    def size(self) -> int:
        """Bytes, where that is fixed."""
        return self.values * struct.calcsize("<" + SCALARS.get(self.kind, "I"))

    @property
    def format(self) -> str:
        if self.kind == "time":
            return "II"
        code = SCALARS[self.kind]
        return code if self.length is None else f"{self.length}{code}"


class _Fixed(NamedTuple):
    """Neighbouring fields of fixed size, as one."""

    layout: struct.Struct
    values: int
    places: tuple[tuple[str, int | slice], ...]
    """Each field's name, and where its value or values are among those of the layout."""


def _fixed(fields: list[_Field]) -> _Fixed:
    places: list[tuple[str, int | slice]] = []
    count = 0
    for field in fields:
        single = field.length is None and field.kind != "time"
        places.append((field.name, count if single else slice(count, count + field.values)))
        count += field.values
    return _Fixed(struct.Struct("<" + "".join(field.format for field in fields)), count, tuple(places))


def _parse_field(name: str, text: str) -> _Field:
    kind, bracket, rest = text.partition("[")
    if not bracket:
        length = None
    elif rest == "]":
        length = _VARIABLE
    else:
        length = int(rest[:-1]) if rest[:-1].isdigit() and rest[-1] == "]" else 0
    if length == 0 or (kind not in SCALARS and (kind not in ("time", "string") or length is not None)):
        raise ValueError(f"{name}: {text} is no type that a log record can have")
    if not name.isidentifier():
        raise ValueError(f"{name}: not a name for a field")
    return _Field(name, kind, length)


class RecordType:
    """One topic and the layout of what is on it; made by `record_type` or read from a file. ValueError if it is none.

    `pack(*values)` gives the bytes. Values come in the order of the fields, arrays of fixed size spread into single
    values, "time" as seconds and nanoseconds; "string" takes a str, "uint8[]" bytes, other open arrays a sequence.
    """

    __slots__ = ("_parts", "definition", "fields", "pack", "schema_name", "size", "topic")

    pack: Callable[..., bytes]
    size: int | None
    """Bytes of each record, or None if they vary."""

    def __init__(self, topic: str, schema_name: str, definition: str) -> None:
        self.topic = topic
        self.schema_name = schema_name
        self.definition = definition
        """The layout as ROS 1 writes it, a line a field; may hold comments."""
        lines = (line.partition("#")[0] for line in definition.splitlines())
        words = (line.split() for line in lines if line.strip() and "=" not in line)  # with "=" it is a constant
        self.fields = tuple(_parse_field(name, kind) for kind, name in words)
        if len({field.name for field in self.fields}) < len(self.fields):
            raise ValueError(f"{topic}: two fields have one name")
        if sum(field.size for field in self.fields if not field.is_variable) > _LARGEST_RECORD:
            raise ValueError(f"{topic}: a record would have more than {_LARGEST_RECORD} bytes")
        self._parts = self._compile()
        if any(field.is_variable for field in self.fields):
            self.size = None
            self.pack = self._pack_variable
        else:
            layout = struct.Struct("<" + "".join(field.format for field in self.fields))
            self.size = layout.size
            self.pack = layout.pack

    def _compile(self) -> list[_Fixed | _Field]:
        parts: list[_Fixed | _Field] = []
        for is_variable, group in itertools.groupby(self.fields, lambda field: field.is_variable):
            if is_variable:
                parts.extend(group)
            else:
                parts.append(_fixed(list(group)))
        return parts

    def _pack_variable(self, *values: Any) -> bytes:
        packed = []
        position = 0
        for part in self._parts:
            if isinstance(part, _Fixed):
                packed.append(part.layout.pack(*values[position : position + part.values]))
                position += part.values
                continue
            value = values[position]
            position += 1
            if part.kind == "string":
                value = value.encode()
            packed.append(_LENGTH.pack(len(value)))
            if not isinstance(value, bytes):
                value = struct.pack(f"<{len(value)}{SCALARS[part.kind]}", *value)
            packed.append(value)
        if position != len(values):
            raise ValueError(f"{self.topic}: {position} values make a record, not {len(values)}")
        return b"".join(packed)

    def unpack(self, data: bytes) -> dict[str, Any]:
        """The record's fields by name: numbers, tuples, str, bytes (for uint8[]). Raises struct.error if it is cut."""
        values: dict[str, Any] = {}
        position = 0
        for part in self._parts:
            if isinstance(part, _Fixed):
                found = part.layout.unpack_from(data, position)
                for name, place in part.places:
                    values[name] = found[place]
                position += part.layout.size
                continue
            (count,) = _LENGTH.unpack_from(data, position)
            position += 4
            code = "s" if part.kind in ("string", "uint8") else SCALARS[part.kind]
            value: Any = struct.unpack_from(f"<{count}{code}", data, position)
            position += struct.calcsize(f"<{count}{code}")
            if code == "s":
                value = value[0].decode(errors="replace") if part.kind == "string" else value[0]
            values[part.name] = value
        return values

    @property
    def dtype(self) -> "np.dtype[np.void]":
        """The layout as numpy's, without padding. Raises FlightLogError if records vary in size."""
        import numpy as np

        if self.size is None:
            raise FlightLogError(f"{self.topic}: its records vary in size; read them one by one")
        columns: list[Any] = []
        for field in self.fields:
            kind: Any = [("sec", "<u4"), ("nsec", "<u4")] if field.kind == "time" else "<" + SCALARS[field.kind]
            columns.append((field.name, kind) if field.length is None else (field.name, kind, (field.length,)))
        return np.dtype(columns)


def record_type(
    topic: str, schema_name: str, fields: Sequence[tuple[str, str]], comments: Mapping[str, str] | None = None
) -> RecordType:
    """A type of record from its fields, (name, type): "float64", "float64[3]", "bool", "string", "uint8[]", "time".

    `comments` (units, enums) by field name are kept in the file's schema. Raises ValueError for a type that isn't one.
    """
    lines = []
    for name, kind in fields:
        _parse_field(name, kind)
        comment = (comments or {}).get(name)
        lines.append(f"{kind} {name}  # {comment}" if comment else f"{kind} {name}")
    return RecordType(topic, schema_name, "\n".join(lines) + "\n")


DATAGRAM = record_type(
    "/courier/datagrams",
    "courier/Datagram",
    [("direction", "uint8"), ("address", "string"), ("data", "uint8[]")],
    {"direction": "0 received, 1 sent"},
)
TEXT = record_type(
    "/log",
    "foxglove_msgs/Log",
    [
        ("timestamp", "time"),
        ("level", "uint8"),
        ("message", "string"),
        ("name", "string"),
        ("file", "string"),
        ("line", "uint32"),
    ],
    {"level": "0 unknown, 1 debug, 2 info, 3 warning, 4 error, 5 fatal"},
)
_datagram_head = struct.Struct("<BI").unpack_from


def datagram_of(record: bytes) -> tuple[int, bool, bytes]:
    """A record of DATAGRAM, quicker than by `unpack`: its direction, whether it has an address, and its data."""
    direction, address = _datagram_head(record)
    return direction, address > 0, record[9 + address :]


# --------------------------------------------------------------------------------------------- what both sides share

WRITING, FAILED, CLOSED = range(3)
"""The recorder's state."""

# 64-bit words at the start of the shared memory. The flying process writes the first row, the recorder the second;
# each counts bytes or records since the start and never wraps.
HEAD, DROPPED, CLOSING = 0, 1, 2
TAIL, BEAT, STATE, WRITTEN = 8, 9, 10, 11
WORDS_BYTES = 128
FAULT_TEXT = slice(128, 1024)
RING = 4096
"""Where the ring starts. A record is never split: one that doesn't fit before the end starts again at the beginning,
and a zero byte marks the gap. Beyond the end lie bytes enough to look for a header anywhere."""
RING_SLACK = 64

HEADER = struct.Struct("<BQHIQQ")
"""An MCAP message without its data: opcode, length, channel, sequence, log time, publish time (ns)."""
LENGTH_OF_EMPTY = HEADER.size - 9

DATAGRAM_CHANNEL, TEXT_CHANNEL, FIRST_CHANNEL = 1, 2, 3
METADATA_CHANNEL, STATUS_CHANNEL = 0xFFFE, 0xFFFF
"""Through the ring, but not messages in the file."""

RING_BYTES = 32 << 20
_SILENT_NS = 100_000_000
_STALLED_NS = 1_000_000_000
_GIVE_UP_NS = 10 * _STALLED_NS
_CLOSE_TIMEOUT_S = 60.0


class Setup(msgspec.Struct, frozen=True):
    """What the recorder is told at its start, through the pipe that then stays open for life."""

    folder: str
    epoch_ns: int
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    types: list[tuple[str, str, str]]
    """Topic, schema name, definition: channels from FIRST_CHANNEL on."""
    console: bool
    minimum_free_bytes: int
    preserves_datagrams: bool


# ----------------------------------------------------------------------------------------------------------- writing


class FlightLog:
    """The flying process's end of a log. One thread; a record costs it 1-2 us and never waits for a disk."""

    def __init__(self, setup: Setup, types: Sequence[RecordType], *, wait: bool, ring_bytes: int) -> None:
        if ring_bytes & (ring_bytes - 1):
            raise ValueError(f"ring_bytes: {ring_bytes} is no power of two")
        self.folder = Path(setup.folder)
        memory = os.memfd_create("flightlog")
        try:
            os.ftruncate(memory, RING + ring_bytes + RING_SLACK)
            self._memory = mmap.mmap(memory, 0, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
            # From the folder that this package is in, so that it is this one that starts there; in a session of its
            # own, so that Ctrl-C ends the flight and not its log.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "protocol.flightlog.recorder", str(memory)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=(memory,),
                start_new_session=True,
                cwd=Path(__file__).resolve().parent.parent,
            )
        finally:
            os.close(memory)
        self._words = memoryview(self._memory)[:WORDS_BYTES].cast("Q")
        self._ring_bytes = ring_bytes
        self._mask = ring_bytes - 1
        self._wait = wait
        self._epoch_ns = setup.epoch_ns
        self._channels = {kind: FIRST_CHANNEL + index for index, kind in enumerate(types)}
        self._prefixes: dict[tuple[int, str], bytes] = {}
        self._sequence = -1
        self._head = 0
        self._free_until = ring_bytes
        self._end: str | None = None
        self._closed = False
        self._start(setup)

    @classmethod
    def open(
        cls,
        folder: Path,
        *,
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, bytes],
        types: Sequence[RecordType],
        on_full: Literal["drop", "wait"],
        console: bool,
        minimum_free_bytes: int = 200_000_000,
        epoch_ns: int = 0,
        preserves_datagrams: bool = True,
        ring_bytes: int = RING_BYTES,
    ) -> Self:
        """Start the recorder and let it make `folder`/flight.mcap with the metadata and attachments in it.

        on_full: what to do with a record while the ring is full, "drop" it (real time) or "wait" (lockstep).
        console: texts go to stderr too. epoch_ns: the wall clock at time 0, or a constant where logs shall repeat.
        preserves_datagrams: as the transport's; if False, frames may span what `datagram` is given.
        Raises FlightLogError if the folder can't be written to or the file is there already, or little space is left.
        """
        setup = Setup(
            folder=str(Path(folder).absolute()),
            epoch_ns=epoch_ns,
            metadata={name: dict(table) for name, table in metadata.items()},
            attachments=dict(attachments),
            types=[(kind.topic, kind.schema_name, kind.definition) for kind in types],
            console=console,
            minimum_free_bytes=minimum_free_bytes,
            preserves_datagrams=preserves_datagrams,
        )
        return cls(setup, types, wait=on_full == "wait", ring_bytes=ring_bytes)

    def _start(self, setup: Setup) -> None:
        pipe, answers = self._process.stdin, self._process.stdout
        assert pipe is not None and answers is not None
        text = msgspec.msgpack.encode(setup)
        with contextlib.suppress(BrokenPipeError):
            pipe.write(len(text).to_bytes(8, "little") + text)
            pipe.flush()
        answer = answers.read().decode()
        answers.close()
        if answer == "ok":
            return
        with contextlib.suppress(BrokenPipeError):
            pipe.close()
        code = self._process.wait()
        raise FlightLogError(
            answer or f"{self.folder}: the flight log's recorder ended at its start (exit code {code})"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def path(self) -> Path:
        """The file."""
        return self.folder / FILE_NAME

    @property
    def recorder_pid(self) -> int:
        return self._process.pid

    def datagram(self, time_ns: int, direction: Direction, address: str, data: bytes) -> None:
        """Keep a datagram as it is; the recorder adds the messages in it, decoded."""
        prefix = self._prefixes.get((direction, address))
        if prefix is None:
            if len(self._prefixes) >= 256:  # strangers may speak from any number of ports
                self._prefixes.clear()
            name = address.encode()
            prefix = self._prefixes[direction, address] = bytes([direction]) + _LENGTH.pack(len(name)) + name
        self._put(DATAGRAM_CHANNEL, time_ns, prefix + _LENGTH.pack(len(data)) + data)

    def record(self, record_type: RecordType, time_ns: int, payload: bytes) -> None:
        """Keep `payload`, as `record_type.pack` made it, on that type's topic. KeyError if `open` wasn't given it."""
        self._put(self._channels[record_type], time_ns, payload)

    def text(self, time_ns: int, level: int, name: str, message: str) -> None:
        """Keep a line of text from the logger `name`; `level` as in `logging`."""
        seconds, nanoseconds = divmod(self._epoch_ns + time_ns, 1_000_000_000)
        severity = min(max(level // 10, 0), logging.CRITICAL // 10)
        self._put(TEXT_CHANNEL, time_ns, TEXT.pack(seconds, nanoseconds, severity, message, name, "", 0))

    def status(self, line: str) -> None:
        """Show a line of progress on stderr: in place if that is a terminal, otherwise at most one in 5 s."""
        self._put(STATUS_CHANNEL, 0, line.encode())

    def _put(self, channel: int, time_ns: int, data: bytes) -> None:
        self._sequence = sequence = (self._sequence + 1) & 0xFFFF_FFFF
        log_time = self._epoch_ns + time_ns
        record = HEADER.pack(5, LENGTH_OF_EMPTY + len(data), channel, sequence, log_time, log_time) + data
        head = self._head
        start = head & self._mask
        gap = self._ring_bytes - start
        if gap >= len(record):
            gap = 0
        end = head + gap + len(record)
        if end > self._free_until and not self._make_room(end):
            self._words[DROPPED] += 1
            return
        if gap:
            self._memory[RING + start] = 0
            start = 0
        self._memory[RING + start : RING + start + len(record)] = record
        # Last: what lies before the head is whole, also when this process is killed between any two instructions.
        self._words[HEAD] = self._head = end

    def _make_room(self, end: int) -> bool:
        """Whether the ring is free up to `end`; waits for it where that is wanted and somebody empties it."""
        while True:
            self._free_until = self._words[TAIL] + self._ring_bytes
            if end <= self._free_until:
                return True
            if not self._wait or end - self._head > self._ring_bytes or self._is_lost():
                return False
            time.sleep(0.0002)

    def _is_lost(self) -> bool:
        silent_ns = time.monotonic_ns() - self._words[BEAT]
        return silent_ns > _SILENT_NS and (self._process.poll() is not None or silent_ns > _GIVE_UP_NS)

    @property
    def fault(self) -> str | None:
        """What keeps the log from being written, or None; under 1 us while all is well. A failed write stays said."""
        if self._words[STATE] == WRITING and time.monotonic_ns() - self._words[BEAT] < _SILENT_NS:
            return None
        return self._diagnose()

    def _diagnose(self) -> str | None:
        if self._words[STATE] == FAILED:
            text = bytes(self._memory[FAULT_TEXT])
            return text[: text.index(0)].decode(errors="replace")
        if self._end is not None:
            return self._end
        if self._words[STATE] == CLOSED:
            return None
        code = self._process.poll()
        if code is not None:
            self._end = f"{self.path}: the log's recorder ended (exit code {code}), nothing more is written"
            return self._end
        silent_ns = time.monotonic_ns() - self._words[BEAT]
        if silent_ns > _STALLED_NS:
            return f"{self.path}: the log's recorder has not moved for {silent_ns * 1e-9:.1f} s"
        return None

    @property
    def dropped(self) -> int:
        """Records that were not kept because the ring was full."""
        return self._words[DROPPED]

    @property
    def written(self) -> int:
        """Records whose chunk is in the file, safe from a kill of any process; status lines and the like count too."""
        return self._words[WRITTEN]

    def close(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add metadata (the outcome) and wait until the recorder has finished the file; `fault` says if it couldn't."""
        if self._closed:
            return
        self._closed = self._wait = True
        for name, table in (metadata or {}).items():
            self._put(METADATA_CHANNEL, 0, msgspec.msgpack.encode((name, dict(table))))
        self._words[CLOSING] = 1
        pipe = self._process.stdin
        assert pipe is not None
        with contextlib.suppress(BrokenPipeError):
            pipe.close()
        try:
            self._process.wait(_CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._end = f"{self.path}: the log's recorder did not finish within {_CLOSE_TIMEOUT_S:.0f} s"


# ----------------------------------------------------------------------------------------------------------- reading


class Record(NamedTuple):
    """One message of the file."""

    topic: str
    time_ns: int
    """The companion's clock, as handed over."""
    sequence: int
    data: bytes


class _Chunk(NamedTuple):
    offset: int
    """Of the chunk's record in the file."""
    start: int
    stop: int
    """Where its compressed content is."""
    compression: str
    size: int
    crc: int
    torn: bool = False
    """The file ends within it."""
    loose: bool = False
    """No chunk, but messages outside of chunks, one behind the other; nothing vouches for them but the file's CRC."""


_RECORD = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")  # start time, end time, size, CRC, length of the compression's name
_MESSAGE = struct.Struct("<BQHIQ")
_INDEX = struct.Struct("<BQHI")  # opcode, length, channel, bytes of pairs of a time and an offset
_new = tuple.__new__  # of a Record: half the time of the class's own constructor
_CHUNK_MARK = b"\x04\x00\x00\x00zstd"
_MARK_OFFSET = _RECORD.size + _CHUNK.size - 4
_DAMAGE = (McapError, ValueError, struct.error, KeyError, OverflowError)
"""What reading bytes raises that are not what they seem to be."""
_PIECE = 1 << 22
_LARGEST_CHUNK = 1 << 30
_PIECE_OF_TORN = 1 << 8
"""Unpacked at once: no more than 8 MB come of it, since four bytes of zstd hold 128 KiB at the most."""
_UNSTATED = -1


class LogReader:
    """A log, finished or cut off or damaged: what is whole is read, and what is not is said.

    `problem` knows at once of a torn end and of damage to a finished file, and of damaged chunks of an unfinished
    one when `records` has come by. Topics whose schema isn't one of ROS 1's plain ones are left out. Raises
    FlightLogError only if the file can't be opened or is no MCAP at all, whatever it holds.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.complete = False
        """Whether the file was finished: it has its summary and its end."""
        self._problems: dict[str, None] = {}
        self._chunks: list[_Chunk] = []
        self._schemas: dict[int, mcap.records.Schema] = {}
        self._channels: dict[int, RecordType] = {}
        self._foreign: set[int] = set()  # channels without a schema that is one of ours
        self._summarised = False
        self._data_ended = False
        self._checked = self._verified = False  # by the checksum over all of the data
        self._passed = 0
        self._data = self._open()
        self._scan()
        self._doubt_loose()
        epoch = self.metadata.get("flightlog", {}).get("epoch_ns", "")
        known = epoch.isascii() and epoch.isdigit() and len(epoch) <= 19 and int(epoch) < 1 << 63
        self.epoch_ns = int(epoch) if known else 0
        """log_time of time 0; from 0 to the greatest number of 63 bits."""
        if not known:
            self._report(f"its start time is {'damaged' if epoch else 'missing'}, times count from 1970")

    def _open(self) -> "mmap.mmap | bytes":
        try:
            with self.path.open("rb") as file:
                data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) if os.fstat(file.fileno()).st_size else b""
        except OSError as error:
            raise FlightLogError(f"{self.path}: {error.strerror or error}") from error
        if data[: len(MAGIC)] != MAGIC and _CHUNK_MARK not in data[: 1 << 20]:
            if MAGIC.startswith(data[: len(MAGIC)]):
                return data  # cut within its first bytes
            raise FlightLogError(f"{self.path}: not an MCAP file")
        return data

    @property
    def problem(self) -> str | None:
        """What is wrong with the file, or None."""
        return f"{self.path}: " + "; ".join(self._problems) if self._problems else None

    def _report(self, text: str) -> None:
        self._problems[text] = None

    # The outer records, without opening chunks.

    def _scan(self) -> None:
        data = self._data
        position = len(MAGIC)
        suspect = 0  # from here on nothing was checked by a CRC yet
        if data[: len(MAGIC)] != MAGIC:
            self._report("its first bytes are damaged or missing")
            position = self._next_chunk(0)
        while position < len(data):
            stop = self._scan_record(position)
            if self.complete:
                return
            if stop is None:
                found = self._next_chunk(suspect)
                if found == len(data):
                    self._take_torn(position)
                    break
                self._report(f"damaged after byte {suspect}, resumed at byte {found}")
                position = found
                continue
            if self._chunks and self._chunks[-1].offset == position and not self._chunks[-1].loose:
                suspect = stop
            position = stop
            self._pass(position)
        self._report(f"cut off at byte {min(position, len(data))}")

    def _scan_record(self, position: int) -> int | None:
        """Take in the record there; where the next one starts, or None if this one isn't whole or isn't one."""
        data = self._data
        if position + _RECORD.size > len(data):
            return None
        opcode, length = _RECORD.unpack_from(data, position)
        start = position + _RECORD.size
        stop: int = start + length
        if stop > len(data):
            return None
        try:
            if opcode == Opcode.CHUNK:
                chunk = self._chunk_at(position)
                if chunk is None:
                    return None
                self._chunks.append(chunk)
            elif opcode == Opcode.MESSAGE:
                if length < LENGTH_OF_EMPTY:
                    return None
                self._add_loose(position, stop)
            elif opcode in _READERS:
                self._take(opcode, data[start:stop])
            elif opcode == Opcode.DATA_END:
                (crc,) = _LENGTH.unpack_from(data, start)
                if crc and not self._checked:
                    self._checked = True
                    self._verified = crc == self._crc(0, position)
                    if not self._verified:
                        self._report("bytes in it are damaged")
                self._data_ended = True
            elif opcode == Opcode.FOOTER:
                self._finish(position, stop)
            elif not Opcode.HEADER <= opcode <= Opcode.DATA_END:
                return None
        except _DAMAGE:
            return None
        return stop

    def _take(self, opcode: int, content: bytes) -> None:
        if opcode == Opcode.ATTACHMENT and _LENGTH.unpack(content[-4:])[0] not in (0, zlib.crc32(content[:-4])):
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
            self._foreign.add(channel.id)
        elif schema is not None:  # otherwise it is lost with a damaged chunk, and so is what this channel holds
            known = self._channels.get(channel.id)
            try:
                definition = schema.data.decode()
                if known is None or known.topic != channel.topic or known.definition != definition:
                    self._channels[channel.id] = RecordType(channel.topic, schema.name, definition)
            except ValueError:
                self._foreign.add(channel.id)

    def _add_loose(self, start: int, stop: int) -> None:
        """A message outside of chunks, to those before it: as many as are read at once."""
        last = self._chunks[-1] if self._chunks else None
        if last is not None and last.loose and last.stop == start and last.size < _PIECE:
            self._chunks[-1] = last._replace(stop=stop, size=stop - last.start)
        else:
            self._chunks.append(_Chunk(start, start, stop, "", stop - start, 0, loose=True))

    def _doubt_loose(self) -> None:
        """In a damaged file of chunks, what looks like messages between them may be the damage."""
        chunks = [chunk for chunk in self._chunks if not chunk.loose]
        if self._problems and 0 < len(chunks) < len(self._chunks):
            self._chunks = chunks
            self._report("messages between its chunks are left out, nothing vouches for them")

    def _finish(self, position: int, stop: int) -> None:
        data = self._data
        summary_start, _, crc = struct.unpack_from("<QQI", data, position + _RECORD.size)
        self.complete = self._data_ended and stop + len(MAGIC) == len(data) and data[stop:] == MAGIC
        if not self.complete:
            self._report("its last bytes are damaged or missing")
        elif crc and crc != self._crc(summary_start, stop - 4):
            self._report("its summary is damaged")
        elif summary_start:
            self._summarised = True

    def _crc(self, start: int, stop: int) -> int:
        """Of the file's bytes, some at a time."""
        crc = 0
        for piece in range(start, stop, _PIECE):
            end = min(piece + _PIECE, stop)
            crc = zlib.crc32(self._data[piece:end], crc)
            self._let_go(piece, end)
        return crc

    def _pass(self, position: int) -> None:
        """The file has been read up to there. Told in large steps: the system maps what is around, too."""
        if abs(position - self._passed) >= _PIECE:
            self._let_go(min(position, self._passed), max(position, self._passed))
            self._passed = position

    def _let_go(self, start: int, stop: int) -> None:
        """These bytes of the file need not stay in memory."""
        if isinstance(self._data, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            page = start & ~(mmap.PAGESIZE - 1)
            self._data.madvise(mmap.MADV_DONTNEED, page, stop - page)

    def _take_torn(self, position: int) -> None:
        """What there is of a chunk, if the file ends with one."""
        chunk = self._chunk_at(position, cut=True)
        if chunk is not None and chunk.compression == "zstd":
            self._chunks.append(chunk)
            self._report(f"the checksum of its last chunk, at byte {position}, is cut off with the chunk's end")

    def _chunk_at(self, position: int, *, cut: bool = False) -> _Chunk | None:
        data = self._data
        start = position + _RECORD.size
        if start + _CHUNK.size > len(data):
            return None
        opcode, length = _RECORD.unpack_from(data, position)
        _, _, size, crc, name_length = _CHUNK.unpack_from(data, start)
        name_start = start + _CHUNK.size
        content = name_start + name_length + 8
        if opcode != Opcode.CHUNK or name_length > 16 or content > len(data) or size > _LARGEST_CHUNK:
            return None
        (compressed,) = struct.unpack_from("<Q", data, content - 8)
        stop = content + compressed
        if stop != start + length or (stop > len(data)) != cut:
            return None
        name = data[name_start : name_start + name_length].decode(errors="replace")
        return _Chunk(position, content, min(stop, len(data)), name, size, crc, cut)

    def _next_chunk(self, position: int) -> int:
        """Where the next whole chunk after a damage starts, or the file's end."""
        while True:
            mark = self._data.find(_CHUNK_MARK, position + 1)
            if mark < 0:
                return len(self._data)
            offset = mark - _MARK_OFFSET
            if offset >= position and self._chunk_at(offset) is not None:
                return offset
            position = mark

    # The messages.

    def _content(self, chunk: _Chunk) -> bytes | None:
        packed = self._data[chunk.start : chunk.stop]
        try:
            if chunk.torn:
                content = _beginning(packed, chunk.size)
            elif chunk.compression == "zstd":
                content = decompressed(packed, chunk.size)
            elif chunk.compression == "":
                content = packed
            else:
                self._report(f"chunk at byte {chunk.offset} is packed with {chunk.compression}, which isn't read")
                return None
        except (zstandard.ZstdError, MemoryError):
            content = b""
        self._pass(chunk.stop)
        if chunk.torn:
            return content
        if len(content) != chunk.size or (chunk.crc and zlib.crc32(content) != chunk.crc):
            self._report(f"chunk at byte {chunk.offset} is damaged")
            return None
        return content

    def records(self, topics: Collection[str] | None = None) -> Iterator[Record]:
        """The messages of `topics` (None: of all) in the order in which they were written."""
        wanted: dict[int, str | None] = {}
        for chunk in self._chunks:
            indexed = None if topics is None else self._indexed(chunk, topics, wanted)
            if indexed is not None:
                yield from indexed
                continue
            content = self._content(chunk)
            if content is not None:
                found: list[Record] = []
                try:
                    self._walk(content, topics, wanted, found)
                except _DAMAGE:
                    self._report(f"chunk at byte {chunk.offset} holds something else than messages")
                yield from found

    def _walk(
        self, content: bytes, topics: Collection[str] | None, wanted: dict[int, str | None], found: list[Record]
    ) -> None:
        """Add a chunk's records to `found`; `wanted` remembers each channel's topic, None for those to leave out.

        Raises one of _DAMAGE behind the last whole record.
        """
        epoch_ns = self.epoch_ns
        unpack, new = _MESSAGE.unpack_from, _new
        position = 0
        while position < len(content):
            opcode, length, channel, sequence, log_time = unpack(content, position)
            stop = position + 9 + length
            if opcode == 5:
                try:
                    topic = wanted[channel]
                except KeyError:
                    topic = wanted[channel] = self._topic(channel, topics)
                if topic is not None:
                    found.append(new(Record, (topic, log_time - epoch_ns, sequence, content[position + 31 : stop])))
            elif opcode in _READERS:
                self._take(opcode, content[position + 9 : stop])
            position = stop
        if position > len(content):  # only the last record can be longer than what there is
            if opcode == 5 and topic is not None:
                found.pop()
            raise EndOfFile

    def _indexed(self, chunk: _Chunk, topics: Collection[str], wanted: dict[int, str | None]) -> list[Record] | None:
        """As `_walk`, by the indexes behind the chunk, so that nobody looks at other topics' records; None if there are
        none, or they are not to be trusted."""
        if chunk.loose or not (self._verified and self._summarised):
            return None
        try:
            places = self._places(chunk, topics, wanted)
            if not places:
                return None if places is None else []
            content = self._content(chunk)
            return None if content is None else self._pick(content, wanted, places)
        except (IndexError, KeyError, OverflowError, struct.error):
            return None

    def _places(self, chunk: _Chunk, topics: Collection[str], wanted: dict[int, str | None]) -> list[int] | None:
        """Where in the chunk's content the wanted messages begin; None without an index. Raises KeyError for a channel
        that is only described in there, and where one place is said to be two messages'."""
        data, places, position = self._data, list[int](), chunk.stop
        while data[position] == Opcode.MESSAGE_INDEX:
            _, length, channel, pairs = _INDEX.unpack_from(data, position)
            if channel not in wanted:
                if channel not in self._channels and channel not in self._foreign:
                    raise KeyError(channel)
                wanted[channel] = self._topic(channel, topics)
            if wanted[channel] is not None:
                places += struct.unpack_from(f"<{pairs // 8}Q", data, position + _INDEX.size)[1::2]
            position += 9 + length
        if position == chunk.stop:
            return None
        if len(set(places)) < len(places):
            raise KeyError(chunk.offset)
        places.sort()
        return places

    def _pick(self, content: bytes, wanted: dict[int, str | None], places: list[int]) -> list[Record]:
        """The messages at these places. Raises KeyError or struct.error where there is something else."""
        found: list[Record] = []
        epoch_ns, unpack, new = self.epoch_ns, _MESSAGE.unpack_from, _new
        for position in places:
            opcode, length, channel, sequence, log_time = unpack(content, position)
            topic = wanted[channel]
            if opcode != 5 or topic is None:
                raise KeyError(channel)
            data = content[position + 31 : position + 9 + length]
            found.append(new(Record, (topic, log_time - epoch_ns, sequence, data)))
        if position + 9 + length > len(content):
            raise KeyError(channel)
        return found

    def _topic(self, channel: int, topics: Collection[str] | None) -> str | None:
        kind = self._channels.get(channel)
        if kind is None and channel in self._foreign:
            return None
        if kind is None:
            self._report(f"what was on channel {channel} is lost with a damaged chunk")
            return None
        return kind.topic if topics is None or kind.topic in topics else None

    @property
    def topics(self) -> dict[str, RecordType]:
        """What there is on each topic."""
        if not self._summarised:
            for _ in self.records(()):
                pass
            self._summarised = True
        return {kind.topic: kind for kind in self._channels.values()}

    def array(self, topic: str) -> "NDArray[np.void]":
        """`arrays` of one topic."""
        return self.arrays((topic,))[topic]

    def arrays(self, topics: Collection[str]) -> "dict[str, NDArray[np.void]]":
        """Topics whose records have one size as structured arrays: `time_ns`, then the schema's fields.

        Raises FlightLogError if one isn't there, its records vary in size or aren't as its schema says, a field of its
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
        columns: list[Any] = [
            ("time_ns", "<i8"),
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


def decompressed(packed: bytes, size: int) -> bytes:
    """What a zstd frame holds, at most `size` bytes: a frame that says itself that it holds something else is refused
    before any of it is unpacked. Raises zstandard.ZstdError if it is refused or damaged."""
    stated = zstandard.frame_content_size(packed)
    if stated not in (_UNSTATED, size):
        raise zstandard.ZstdError(f"a frame of {stated} bytes, not of {size}")
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)


def _beginning(packed: bytes, size: int) -> bytes:
    """The whole records in what there is of a compressed chunk of `size` bytes."""
    unpack = zstandard.ZstdDecompressor().decompressobj()
    content = bytearray()
    with contextlib.suppress(zstandard.ZstdError):
        for start in range(0, len(packed), _PIECE_OF_TORN):
            if len(content) >= size:
                break
            content += unpack.decompress(packed[start : start + _PIECE_OF_TORN])
    del content[size:]
    position = 0
    while position + _RECORD.size <= len(content):
        opcode, length = _RECORD.unpack_from(content, position)
        stop = position + _RECORD.size + length
        if stop > len(content) or (opcode != Opcode.MESSAGE and opcode not in _READERS):
            break
        position = stop
    return bytes(content[:position])


_READERS: dict[int, Callable[[ReadDataStream], mcap.records.McapRecord]] = {
    Opcode.SCHEMA: mcap.records.Schema.read,
    Opcode.CHANNEL: mcap.records.Channel.read,
    Opcode.METADATA: mcap.records.Metadata.read,
    Opcode.ATTACHMENT: mcap.records.Attachment.read,
}


def read(path: Path | str, topics: Collection[str] | None = None) -> Iterator[Record]:
    """The messages of a log in the order in which they were written; `LogReader` also says whether it is whole."""
    return LogReader(path).records(topics)


def datagrams(path: Path | str) -> Iterator[tuple[int, Direction, str, bytes]]:
    """Every datagram: time (ns), direction, address, bytes."""
    for record in read(path, (DATAGRAM.topic,)):
        values = DATAGRAM.unpack(record.data)
        yield record.time_ns, Direction(values["direction"]), values["address"], values["data"]


def digest(path: Path | str) -> dict[Direction, str]:
    """SHA-256 over each direction's datagrams, with time and length; addresses are left out, since ports vary."""
    sums = {direction: hashlib.sha256() for direction in Direction}
    for time_ns, direction, _, data in datagrams(path):
        sums[direction].update(struct.pack("<qI", time_ns, len(data)) + data)
    return {direction: total.hexdigest() for direction, total in sums.items()}
