"""The recorder, a process of its own that writes the log: `python -m protocol.flightlog.recorder FD`.

FD is the shared memory. The pipe on its standard input tells it what to write first and then only stays open: when it
closes, however the flying process ended, the rest of the buffer is written and the file finished. Standard output
carries one answer, "ok" or why not; standard error is the console.

A chunk ends each tenth of a second, so that a killed recorder loses no more. Such small chunks cost a tenth of the file
and more. So a second file without a name is written beside it in large chunks, and takes the first one's place at the
end (`McapFile`).
"""

import errno
import gc
import mmap
import os
import select
import signal
import sys
import time
from typing import Final

from protocol.flightlog.console import Console
from protocol.flightlog.mavlink_records import MessageWriter
from protocol.flightlog.mcap_file import CHUNK_BYTES, McapFile
from protocol.flightlog.mcap_format import FILE_NAME, MESSAGE_HEADER, FlightLogError
from protocol.flightlog.record_types import DATAGRAM, TEXT, RecordType
from protocol.flightlog.shared_buffer import (
    CLOSED,
    CLOSING,
    DATAGRAM_CHANNEL,
    DROPPED,
    HEAD,
    LOST,
    METADATA_CHANNEL,
    STATE,
    STATUS_CHANNEL,
    TEXT_CHANNEL,
    WRITTEN,
    BufferReader,
    Setup,
    decode_metadata,
)
from protocol.flightlog.status import Status
from protocol.flightlog.syncing import Syncing

_POLL_MS: Final = 5
CHUNK_AGE_NS: Final = 80_000_000
"""A chunk is ended at this age: with a poll and a slow moment, less than 0.1 s after its first record."""
_DROPPED_INTERVAL_NS: Final = 1_000_000_000
"""Between two messages about dropped records."""
_RECOVERS_NS: Final = 1_000_000_000
"""Writes that have not failed for so long are no fault any more: a disk that is all but full fails now and then."""
_BATCH: Final = 256
"""Records between two heartbeats."""
_LEVELS: Final = ("", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")


class Recorder:
    """Moves records from the shared buffer into the file until the flying process has ended."""

    def __init__(self, memory: mmap.mmap, setup: Setup, file: McapFile) -> None:
        self._buffer = BufferReader(memory)
        self._words = self._buffer.words
        self._setup = setup
        self._file = file
        self._messages = MessageWriter(file, preserves_datagrams=setup.preserves_datagrams)
        self._console = Console()
        self._taken = 0
        self._chunk_start_ns = 0
        self._dropped_shown = 0
        self._dropped_shown_ns = 0
        self._undecoded = 0
        self._failed_ns: int | None = None
        """When a write has failed last; None while all is well."""
        self._syncing: Syncing | None = None
        for kind in (DATAGRAM, TEXT, *(RecordType(*kind) for kind in setup.types)):
            file.add_channel(kind)

    def run(self) -> None:
        """Returns when the pipe has closed, the buffer is empty and the file is finished."""
        if self._setup.syncs:
            self._syncing = Syncing(self._file.sync)
        poller = select.poll()
        poller.register(0, 0)
        while True:
            # The head is read before the wait: between seeing a new head and reading what it announces lies a system
            # call, so that on processors that reorder memory accesses the records are there, too.
            head = self._words[HEAD]
            ended = bool(poller.poll(_POLL_MS))
            self._drain(head)
            now_ns = self._buffer.beat()
            if not self._file.pending_bytes:
                self._chunk_start_ns = now_ns
                self._words[WRITTEN] = self._taken - self._words[LOST]
            elif now_ns - self._chunk_start_ns > CHUNK_AGE_NS:
                self._end_chunk()
            self._show_dropped(now_ns)
            if self._syncing is not None and self._syncing.error is not None:
                self._fail(self._syncing.error)
            if ended and head == self._words[HEAD]:
                break
        self._finish()

    def _drain(self, head: int) -> None:
        file, messages = self._file, self._messages
        count = 0
        for channel, sequence, log_time, record in self._buffer.records(head):
            if channel == DATAGRAM_CHANNEL:
                file.add_message(channel, log_time, record)
                try:
                    messages.add(record[MESSAGE_HEADER.size :], sequence, log_time)
                except Exception as error:  # the bytes are kept; a decoder's mistake must not end the log
                    self._count_undecoded(error)
            elif channel < METADATA_CHANNEL:
                file.add_message(channel, log_time, record)
                if channel == TEXT_CHANNEL and self._setup.console:
                    self._show_text(log_time, record[MESSAGE_HEADER.size :])
            else:
                self._release(count)
                count = 0
                self._handle_request(channel, record[MESSAGE_HEADER.size :])
            count += 1
            if count == _BATCH or file.pending_bytes >= CHUNK_BYTES:
                self._release(count)
                count = 0
                if file.pending_bytes >= CHUNK_BYTES:
                    self._end_chunk()
        self._release(count)

    def _release(self, count: int) -> None:
        """Take `count` more records from the buffer; always before a chunk is ended, which counts them."""
        self._taken += count
        self._buffer.release()

    def _show_dropped(self, now_ns: int) -> None:
        dropped = self._words[DROPPED]
        if dropped > self._dropped_shown and now_ns - self._dropped_shown_ns > _DROPPED_INTERVAL_NS:
            self._dropped_shown = dropped
            self._dropped_shown_ns = now_ns
            self._console.text(f"{self._setup.name}: {dropped} records not logged so far, the buffer was full")

    def _count_undecoded(self, error: Exception) -> None:
        if not self._undecoded:
            self._console.text(f"{self._setup.name}: the flight log left a message undecoded: {error!r}")
        self._undecoded += 1

    def _handle_request(self, channel: int, data: bytes) -> None:
        if channel == STATUS_CHANNEL:
            if self._setup.console:
                self._console.status(Status.decode(data))
            return
        name, table = decode_metadata(data)
        self._end_chunk()
        try:
            self._file.add_metadata(name, table)
        except OSError as error:
            self._fail(error)
            self._words[LOST] += 1

    def _show_text(self, log_time: int, data: bytes) -> None:
        text = TEXT.unpack(data)
        time_s = (log_time - self._setup.epoch_ns) * 1e-9
        level = _LEVELS[text["level"]]
        self._console.text(f"{time_s:9.3f} {level:7} {text['name']}: {text['message']}", level)

    def _end_chunk(self) -> None:
        self._chunk_start_ns = now_ns = time.monotonic_ns()
        words, writes = self._words, self._file.pending_bytes > 0
        try:
            self._file.end_chunk()
        except OSError as error:
            self._fail(error)
            words[LOST] = self._taken - words[WRITTEN]
        else:
            if self._file.deleted:
                self._fail(FileNotFoundError(errno.ENOENT, "its file was deleted"))
            elif writes and self._failed_ns is not None and now_ns - self._failed_ns > _RECOVERS_NS:
                self._failed_ns = None
                self._buffer.recover()
                self._console.text(f"{self._setup.name}: the flight log is written again, {words[LOST]} records lost")
        words[WRITTEN] = self._taken - words[LOST]

    def _fail(self, error: OSError) -> None:
        first, self._failed_ns = self._failed_ns is None, time.monotonic_ns()
        if not first:
            return
        text = f"{self._setup.name}: the flight log can't be written: {error.strerror}"
        self._buffer.fail(text)
        self._console.text(text)

    def _finish(self) -> None:
        closed = bool(self._words[CLOSING])
        dropped = self._words[DROPPED]
        self._end_chunk()
        if self._syncing is not None:
            self._syncing.stop()
        try:
            self._file.add_metadata(
                "flightlog end",
                {
                    "reason": "closed" if closed else "the flying process ended without closing the log",
                    "records": str(self._words[WRITTEN]),
                    "dropped": str(dropped),
                    "lost": str(self._words[LOST]),
                    "undecoded": str(self._undecoded),
                },
            )
            self._file.finish()
            (self._setup.path / FILE_NAME).stat()  # its second copy may have given a deleted one its name again
            self._words[STATE] = CLOSED
        except OSError as error:
            self._fail(error)
        self._console.close()


def create(setup: Setup) -> McapFile:
    """Make the folder and the file, with the metadata and attachments that are known at the start.

    Raises FlightLogError if they can't be made or there is too little space.
    """
    folder, name = setup.path, setup.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        space = os.statvfs(folder)
        free = space.f_bavail * space.f_frsize
        if free < setup.minimum_free_bytes:
            raise FlightLogError(
                f"{name}: {free / 1e6:.0f} MB free, a flight log needs {setup.minimum_free_bytes / 1e6:.0f} MB"
            )
        file = McapFile(folder / FILE_NAME, with_large_chunks=True)
        file.add_metadata("flightlog", {"version": "1", "epoch_ns": str(setup.epoch_ns)})
        for name, table in setup.metadata.items():
            file.add_metadata(name, table)
        for name, content in setup.attachments.items():
            file.add_attachment(name, setup.epoch_ns, content)
    except OSError as error:
        raise FlightLogError(f"{name}: the flight log can't be written: {error.strerror}") from error
    return file


def main() -> None:
    """Record one flight, if there is one."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)  # it ends when the flying process has ended, not before
    memory = mmap.mmap(int(sys.argv[1]), 0)
    os.close(int(sys.argv[1]))
    with os.fdopen(os.dup(0), "rb") as pipe:
        size = int.from_bytes(pipe.read(8), "little")
        if not size:
            return  # no log was opened with it
        setup = Setup.decode(pipe.read(size))
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
