"""The file that is written, chunk by chunk, as the mcap package reads it."""

import functools
import io
import os
import random
import resource
import signal
import struct
import time
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import (
    Chunk,
    MessageIndex,
)
from mcap.stream_reader import get_chunk_data_stream
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    Direction,
    LogReader,
    record_type,
)
from protocol.flightlog.mcap_file import CHUNK_BYTES, McapFile
from protocol.flightlog.mcap_format import message_record
from protocol.flightlog.recorder import CHUNK_AGE_NS
from tests.protocol.flightlog.made_logs import (
    Opener,
    chunk_ends,
    count,
    frame_of,
    grown,
    is_written,
    noise,
    numbers_of,
    until,
)


def indexed(path: Path) -> list[int]:
    """How many messages each chunk's indexes lead to, as the mcap package reads them, and that they are these."""
    content = path.read_bytes()
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    counts = []
    for index in summary.chunk_indexes:
        offset = index.chunk_start_offset
        chunk = Chunk.read(ReadDataStream(io.BytesIO(content[offset + 9 : offset + index.chunk_length])))
        inner, _ = get_chunk_data_stream(chunk, validate_crc=True)
        records = inner.read(chunk.uncompressed_size)
        counts.append(0)
        for channel, place in index.message_index_offsets.items():
            entries = MessageIndex.read(ReadDataStream(io.BytesIO(content[place + 9 :]))).records
            for log_time, start_of_message in entries:
                opcode, _, number, _, time_there = struct.unpack_from("<BQHIQ", records, start_of_message)
                assert (opcode, number, time_there) == (5, channel, log_time)
            counts[-1] += len(entries)
    return counts


def test_message_indexes_lead_to_their_messages(start: Opener) -> None:
    log = start()
    count(log, range(2000), noise(4))
    log.close()
    counts = indexed(log.path)
    assert len(counts) > 2 and sum(counts) == 2000


def test_indexes_lead_to_their_messages_in_joined_chunks(tmp_path: Path) -> None:
    """In a chunk that was three."""
    path = tmp_path / "joined.mcap"
    file = McapFile(path, with_large_chunks=True)
    channels = [file.add_channel(record_type(f"/{name}", "x/X", [("a", "uint8[]")])) for name in "ab"]
    for number in range(30):
        channel = channels[number % 2]
        file.add_message(channel, number, message_record(channel, number, number, bytes(number)))
        if number % 10 == 9:
            file.end_chunk()
    file.finish()
    assert indexed(path) == [30]


def test_a_chunk_costs_little_memory_for_the_rest_of_the_flight(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "long.mcap")
    channels = [file.add_channel(record_type(f"/{number}", "x/X", [("a", "uint8")])) for number in range(30)]

    def chunks(numbers: range) -> None:
        for number in numbers:
            for channel in channels:
                file.add_message(channel, number, message_record(channel, number, number, b"a"))
            file.end_chunk()

    chunks(range(10))
    assert grown(lambda: chunks(range(10, 310))) < 300 * 700  # 100 of each are in the index itself
    file.finish()
    with (tmp_path / "long.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count == 310


def test_chunks_grow_to_their_age(start: Opener) -> None:
    began = time.monotonic_ns()
    log = start()
    for number in range(100):  # each in a poll of its own; on a slower machine there is time for more chunks
        count(log, range(number, number + 1))
        until(functools.partial(is_written, log, number + 1))
    with log.path.open("rb") as file:  # as it is in flight
        log.close()
        most = (time.monotonic_ns() - began) // CHUNK_AGE_NS + 2
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) <= most


def test_chunks_are_bounded_however_many_records_wait(start: Opener) -> None:
    """What fails to be written, or is damaged, is one chunk: no more than half a megabyte."""
    log = start()
    filling = random.Random(3).randbytes(3000)
    os.kill(log.recorder_pid, signal.SIGSTOP)
    count(log, range(250), lambda number: filling)
    os.kill(log.recorder_pid, signal.SIGCONT)
    with log.path.open("rb") as file:  # as it is in flight
        log.close()
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert CHUNK_BYTES < max(index.uncompressed_size for index in summary.chunk_indexes) < CHUNK_BYTES + 4000


def test_the_finished_file_is_the_same_in_larger_chunks(start: Opener) -> None:
    log = start(metadata={"m": {"k": "v"}}, attachments={"a": b"bc"})
    for number in range(40):
        count(log, range(50 * number, 50 * number + 50))
        log.datagram(
            50_000 * number, Direction.IN, "a:1", frame_of(dialect.MAVLink_heartbeat_message(2, 3, 1, 1, 4, 3))
        )
        until(functools.partial(is_written, log, 51 * (number + 1)))
    copy = log.folder.parent / "in_flight.mcap"
    with log.path.open("rb") as file:
        log.close({"outcome": {"ended": "well"}})
        copy.write_bytes(file.read())
    assert [path.name for path in log.folder.iterdir()] == ["flight.mcap"]
    before, after = LogReader(copy), LogReader(log.path)
    assert before.problem is None and after.problem is None
    assert list(before.records()) == list(after.records())
    assert (before.metadata, before.attachments) == (after.metadata, after.attachments)
    assert len(chunk_ends(log.path)) < 0.1 * len(chunk_ends(copy))
    assert log.path.stat().st_size < 0.9 * copy.stat().st_size
    with log.path.open("rb") as file:
        found = list(make_reader(file, validate_crcs=True).iter_messages(["/mavlink/1/1/HEARTBEAT"]))
    assert [message.sequence for _, _, message in found] == list(range(50, 2040, 51))


def test_without_the_larger_chunks_the_file_in_flight_remains(start: Opener) -> None:
    log = start()
    count(log, range(100))
    until(lambda: log.written == 100)
    inode = log.path.stat().st_ino
    _, most = resource.prlimit(log.recorder_pid, resource.RLIMIT_NOFILE)
    resource.prlimit(log.recorder_pid, resource.RLIMIT_NOFILE, (3, most))  # nothing more can be opened
    log.close()
    assert log.fault is None
    assert log.path.stat().st_ino == inode
    assert LogReader(log.path).complete and numbers_of(log.path) == list(range(100))
    assert [path.name for path in log.folder.iterdir()] == ["flight.mcap"]
