"""The flying process's side of a log: it starts the recorder and hands it records."""

import contextlib
import logging
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Literal, Self

from protocol.flightlog import shared_buffer
from protocol.flightlog.mcap_format import FILE_NAME, UINT32, Direction, FlightLogError
from protocol.flightlog.record_types import TEXT, RecordType
from protocol.flightlog.shared_buffer import (
    BUFFER_BYTES,
    CLOSED,
    CLOSING,
    DATAGRAM_CHANNEL,
    DROPPED,
    FAILED,
    FIRST_CHANNEL,
    HEARTBEAT,
    LOST,
    METADATA_CHANNEL,
    STATE,
    STATUS_CHANNEL,
    TEXT_CHANNEL,
    WRITING,
    WRITTEN,
    BufferWriter,
    Setup,
)
from protocol.flightlog.status import Status

_SILENT_NS: Final = 100_000_000
"""A recorder that worked within this time needs no closer look."""
_STALLED_NS: Final = 1_000_000_000
"""A recorder that did not work for this time is a fault in real time."""
_GIVE_UP_NS: Final = 10 * _STALLED_NS
"""A recorder that did not work for this time is no longer waited for. In lockstep it is no fault until then: nothing is
lost meanwhile, and how busy the machine is must not change the flight."""
_CLOSE_TIMEOUT_S: Final = 60.0
_MOST_ADDRESSES: Final = 256
"""Addresses whose encoding is kept: strangers may speak from any number of ports."""
_pack_length = UINT32.pack


class RecorderProcess:
    """The recorder's process, which gets ready for the log that is opened with it. It ends with this process, or when
    this is forgotten."""

    def __init__(self, buffer_bytes: int = BUFFER_BYTES) -> None:
        memory, self.mapping = shared_buffer.allocate(buffer_bytes)
        try:
            # From the folder that this package is in, so that this one starts there; in a session of its own, so that
            # Ctrl-C ends the flight and not its log.
            self.process = subprocess.Popen(
                [sys.executable, "-m", "protocol.flightlog.recorder", str(memory)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=(memory,),
                start_new_session=True,
                cwd=Path(__file__).resolve().parents[2],
            )
        finally:
            os.close(memory)


class FlightLog:
    """A log that is being written. For one thread; a record costs it 1-2 us and never waits for a disk."""

    def __init__(self, setup: Setup, types: Sequence[RecordType], recorder: RecorderProcess, *, waits: bool) -> None:
        self.folder = setup.path
        self._name = f"{setup.name}/{FILE_NAME}"
        self._process = recorder.process
        self._buffer = BufferWriter(recorder.mapping, setup.epoch_ns, waits=waits, is_lost=self._is_lost)
        self._words = self._buffer.words
        self._epoch_ns = setup.epoch_ns
        self._channels = {kind: FIRST_CHANNEL + index for index, kind in enumerate(types)}
        self._prefixes: dict[tuple[int, str], bytes] = {}
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
        buffer_bytes: int = BUFFER_BYTES,
        recorder: RecorderProcess | None = None,
    ) -> Self:
        """Start the recorder, if there is none yet. It makes `folder`/flight.mcap with the metadata and attachments.

        on_full: what to do with a record while the buffer is full: "drop" it (real time) or "wait" (lockstep). What is
        flown in real time is on the disk after a second or two, safe from a cut of the power.
        console: write texts to stderr, too. epoch_ns: the wall clock at time 0, or a constant for repeatable logs.
        preserves_datagrams: as the transport's; if False, frames may span several calls of `datagram`.
        Raises FlightLogError if the folder can't be written to, the file exists already, or too little space is left.
        """
        setup = Setup(
            folder=os.fsencode(Path(folder).absolute()),
            epoch_ns=epoch_ns,
            metadata={name: dict(table) for name, table in metadata.items()},
            attachments=dict(attachments),
            types=[(kind.topic, kind.schema_name, kind.definition) for kind in types],
            console=console,
            minimum_free_bytes=minimum_free_bytes,
            preserves_datagrams=preserves_datagrams,
            syncs=on_full == "drop",
        )
        return cls(setup, types, recorder or RecorderProcess(buffer_bytes), waits=on_full == "wait")

    def _start(self, setup: Setup) -> None:
        pipe, answers = self._process.stdin, self._process.stdout
        assert pipe is not None and answers is not None
        text = setup.encode()
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
        raise FlightLogError(answer or f"{setup.name}: the flight log's recorder ended at its start (exit code {code})")

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
        """The recorder's process."""
        return self._process.pid

    def datagram(self, time_ns: int, direction: Direction, address: str, data: bytes) -> None:
        """Record a datagram as it is; the recorder adds its MAVLink messages, decoded."""
        prefix = self._prefixes.get((direction, address))
        if prefix is None:
            if len(self._prefixes) >= _MOST_ADDRESSES:
                self._prefixes.clear()
            name = address.encode()
            prefix = self._prefixes[direction, address] = bytes([direction]) + _pack_length(len(name)) + name
        self._buffer.put(DATAGRAM_CHANNEL, time_ns, prefix + _pack_length(len(data)) + data)

    def record(self, record_type: RecordType, time_ns: int, payload: bytes) -> None:
        """Record `payload`, made by `record_type.pack`, on that type's topic. KeyError if `open` wasn't given it."""
        self._buffer.put(self._channels[record_type], time_ns, payload)

    def text(self, time_ns: int, level: int, name: str, message: str) -> None:
        """Record a line of text of the logger `name`; `level` as in `logging`."""
        seconds, nanoseconds = divmod(self._epoch_ns + time_ns, 1_000_000_000)
        severity = min(max(level // 10, 0), logging.CRITICAL // 10)
        self._buffer.put(TEXT_CHANNEL, time_ns, TEXT.pack(seconds, nanoseconds, severity, message, name, "", 0))

    def status(self, status: Status) -> None:
        """Show the progress on stderr: in place if that is a terminal, otherwise a line in 5 s. The recorder draws."""
        self._buffer.put(STATUS_CHANNEL, 0, status.encode())

    def _is_lost(self) -> bool:
        silent_ns = self._buffer.silent_ns
        return silent_ns > _SILENT_NS and (self._process.poll() is not None or silent_ns > _GIVE_UP_NS)

    @property
    def fault(self) -> str | None:
        """Why the log can't be written, or None; costs under 1 us while all is well. A failed write is a fault until a
        second of others has not failed."""
        if self._words[STATE] == WRITING and time.monotonic_ns() - self._words[HEARTBEAT] < _SILENT_NS:
            return None
        return self._diagnose()

    def _diagnose(self) -> str | None:
        if self._words[STATE] == FAILED:
            return self._buffer.fault_text
        if self._end is not None:
            return self._end
        if self._words[STATE] == CLOSED:
            return None
        code = self._process.poll()
        if code is not None:
            self._end = f"{self._name}: the log's recorder ended (exit code {code}), nothing more is written"
            return self._end
        silent_ns = self._buffer.silent_ns
        if silent_ns > (_GIVE_UP_NS if self._buffer.waits else _STALLED_NS):
            return f"{self._name}: the log's recorder has not moved for {silent_ns * 1e-9:.1f} s"
        return None

    @property
    def dropped(self) -> int:
        """Records that were lost because the buffer was full."""
        return self._words[DROPPED]

    @property
    def lost(self) -> int:
        """Records that could not be written: the disk was full."""
        return self._words[LOST]

    @property
    def written(self) -> int:
        """Records whose chunk is in the file, safe from a kill of any process; status lines and metadata count too."""
        return self._words[WRITTEN]

    def close(self, metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add metadata (the outcome) and wait until the recorder has finished the file; `fault` says if it couldn't."""
        if self._closed:
            return
        self._closed = self._buffer.waits = True
        for name, table in (metadata or {}).items():
            self._buffer.put(METADATA_CHANNEL, 0, shared_buffer.encode_metadata(name, table))
        self._words[CLOSING] = 1
        pipe = self._process.stdin
        assert pipe is not None
        with contextlib.suppress(BrokenPipeError):
            pipe.close()
        try:
            self._process.wait(_CLOSE_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._end = f"{self._name}: the log's recorder did not finish within {_CLOSE_TIMEOUT_S:.0f} s"
