"""The flight log, against the mcap package's own readers and ROS 1 decoder, and against kills, cuts and full disks."""

import contextlib
import functools
import io
import itertools
import os
import random
import resource
import signal
import struct
import subprocess
import sys
import time
import tracemalloc
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from mcap.writer import IndexType, Writer
from mcap_ros1.decoder import DecoderFactory
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    DATAGRAM,
    HEADER,
    LENGTH_OF_EMPTY,
    MAGIC,
    METADATA_CHANNEL,
    Direction,
    FlightLog,
    FlightLogError,
    LogReader,
    Record,
    RecordType,
    datagrams,
    decompressed,
    digest,
    read,
    record_type,
)
from protocol.flightlog.recorder import CHUNK_AGE_NS, CHUNK_BYTES, McapFile, Messages, message_type

COUNT = record_type("/courier/count", "courier/Count", [("number", "int64"), ("filling", "uint8[]")])
TRACE = record_type(
    "/courier/trace",
    "courier/Trace",
    [("position_ned", "float64[3]"), ("phase", "uint8"), ("armed", "bool"), ("thrust", "float32")],
    {"position_ned": "m", "phase": "0=wait"},
)
EPOCH_NS = 1_700_000_000_123_456_789
DEADLINE_S = 20.0

Opener = Callable[..., FlightLog]


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.002)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Opener]:
    """Opens logs in the test's folder, small and without a console unless told, and closes them at the end."""
    logs: list[FlightLog] = []

    def opener(name: str = "log", **options: Any) -> FlightLog:
        defaults: dict[str, Any] = {
            "metadata": {},
            "attachments": {},
            "types": [COUNT, TRACE],
            "on_full": "wait",
            "console": False,
            "minimum_free_bytes": 0,
            "epoch_ns": EPOCH_NS,
            "ring_bytes": 1 << 20,
        }
        logs.append(FlightLog.open(tmp_path / name, **(defaults | options)))
        return logs[-1]

    yield opener
    for log in logs:
        log.close()


def count(log: FlightLog, numbers: range, filling: Callable[[int], bytes] = lambda number: b"") -> None:
    for number in numbers:
        log.record(COUNT, number * 1000, COUNT.pack(number, filling(number)))


def is_written(log: FlightLog, records: int) -> bool:
    return log.written == records


def numbers_of(path: Path) -> list[int]:
    return [COUNT.unpack(record.data)["number"] for record in read(path, (COUNT.topic,))]


def frame_of(message: Any, system: int = 1, component: int = 1) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, system, component)))


def noise(seed: int) -> Callable[[int], bytes]:
    """Fillings that can't be compressed, so that chunks are full soon."""
    generator = random.Random(seed)
    return lambda number: generator.randbytes(generator.randrange(3000))


# What goes in comes out.


def test_round_trip(start: Opener) -> None:
    log = start(metadata={"versions": {"courier": "1"}, "empty": {}}, attachments={"m.toml": b"a = 1", "void": b""})
    heartbeat = frame_of(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3))
    log.datagram(1, Direction.IN, "127.0.0.1:14540", heartbeat)
    log.record(TRACE, 2, TRACE.pack(1.0, -2.0, 3.5, 7, True, 0.25))
    log.text(3, 30, "supervisor", "wind über 10 m/s")
    log.datagram(4, Direction.OUT, "", b"")
    log.record(COUNT, 5, COUNT.pack(-1, b"\x00\xff"))
    log.close({"outcome": {"delivered": "true"}})
    assert log.fault is None
    assert log.dropped == 0

    reader = LogReader(log.path)
    assert reader.complete
    assert reader.epoch_ns == EPOCH_NS
    assert [(r.topic, r.time_ns, r.sequence) for r in reader.records()] == [
        (DATAGRAM.topic, 1, 0),
        ("/mavlink/1/1/HEARTBEAT", 1, 0),
        (TRACE.topic, 2, 1),
        ("/log", 3, 2),
        (DATAGRAM.topic, 4, 3),
        (COUNT.topic, 5, 4),
    ]
    assert reader.problem is None
    kinds = reader.topics
    values = {r.topic: kinds[r.topic].unpack(r.data) for r in reader.records()}
    assert values["/mavlink/1/1/HEARTBEAT"]["custom_mode"] == 5
    assert values[COUNT.topic] == {"number": -1, "filling": b"\x00\xff"}
    assert values["/log"]["message"] == "wind über 10 m/s"
    assert values["/log"]["level"] == 3
    assert values["/log"]["timestamp"] == divmod(EPOCH_NS + 3, 10**9)
    assert list(datagrams(log.path)) == [
        (1, Direction.IN, "127.0.0.1:14540", heartbeat),
        (4, Direction.OUT, "", b""),
    ]
    assert reader.metadata["versions"] == {"courier": "1"}
    assert reader.metadata["empty"] == {}
    assert reader.metadata["outcome"] == {"delivered": "true"}
    assert reader.metadata["flightlog end"]["reason"] == "closed"
    assert reader.attachments == {"m.toml": b"a = 1", "void": b""}


def test_arrays(start: Opener) -> None:
    log = start()
    positions = np.random.default_rng(1).normal(size=(500, 3))
    for index, position in enumerate(positions):
        log.record(TRACE, index * 4_000_000, TRACE.pack(*position, index % 9, index % 2 == 0, 0.5))
    log.close()
    table = LogReader(log.path).array(TRACE.topic)
    assert table["time_ns"].tolist() == [index * 4_000_000 for index in range(500)]
    np.testing.assert_array_equal(table["position_ned"], positions)
    assert table["phase"].tolist() == [index % 9 for index in range(500)]
    assert table["armed"].tolist() == [index % 2 == 0 for index in range(500)]
    with pytest.raises(FlightLogError, match="there is no topic /nothing"):
        LogReader(log.path).array("/nothing")


def test_arrays_of_many_topics_are_those_of_each(start: Opener) -> None:
    log = start()
    for index in range(50):
        log.record(TRACE, 3 * index, TRACE.pack(index, 0.0, 0.0, 1, True, 0.5))
        attitude = frame_of(dialect.MAVLink_attitude_message(index, 0.1 * index, 0, 0, 0, 0, 0), 1, 1)
        log.datagram(3 * index + 1, Direction.IN, "", attitude)
    log.close()
    reader = LogReader(log.path)
    topics = (TRACE.topic, "/mavlink/1/1/ATTITUDE")
    tables = reader.arrays(topics)
    assert list(tables) == [*topics] and [len(tables[topic]) for topic in topics] == [50, 50]
    for topic in topics:
        np.testing.assert_array_equal(tables[topic], reader.array(topic))
    assert tables["/mavlink/1/1/ATTITUDE"]["time_boot_ms"].tolist() == list(range(50))
    with pytest.raises(FlightLogError, match="there is no topic /nothing"):
        reader.arrays((TRACE.topic, "/nothing"))


def test_varying_records_are_no_array(start: Opener) -> None:
    log = start()
    count(log, range(3))
    log.close()
    with pytest.raises(FlightLogError, match=COUNT.topic):
        LogReader(log.path).array(COUNT.topic)


def test_close_twice_and_without_a_record(start: Opener) -> None:
    log = start()
    log.close()
    log.close({"late": {}})
    reader = LogReader(log.path)
    assert list(reader.records()) == []
    assert reader.complete
    assert reader.problem is None
    assert "late" not in reader.metadata
    with log.path.open("rb") as file:
        assert list(make_reader(file, validate_crcs=True).iter_messages()) == []


@pytest.mark.parametrize(
    "field",
    [("a", "float64[]x"), ("a", "float16"), ("a", "string[]"), ("a", "uint8[0]"), ("a b", "uint8"), ("uint8", "a")],
)
def test_impossible_types(field: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match=field[0]):
        record_type("/t", "courier/T", [field])


def test_digest(start: Opener) -> None:
    def flight(name: str, address: str, out: bytes) -> dict[Direction, str]:
        log = start(name)
        log.datagram(1, Direction.IN, address, b"in")
        log.datagram(2, Direction.OUT, address, out)
        log.close()
        return digest(log.path)

    first, other_port, other_bytes = (
        flight("a", "127.0.0.1:1", b"xy"),
        flight("b", "127.0.0.1:2", b"xy"),
        flight("c", "127.0.0.1:1", b"xz"),
    )
    assert first == other_port
    assert first[Direction.IN] == other_bytes[Direction.IN] != first[Direction.OUT]
    assert first[Direction.OUT] != other_bytes[Direction.OUT]


# MAVLink messages, as foreign readers see them.


def example(message: Any, generator: random.Random) -> Any:
    """An instance of a message class with random values in every field."""
    codes = {"float": "f", "double": "d", "char": "c"}
    values: list[Any] = []
    counts = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    for name, kind in zip(message.fieldnames, message.fieldtypes, strict=True):
        number = counts[name]
        if kind == "char" and number:
            text = "".join(generator.choices("abcXYZ 09", k=generator.randrange(1, number + 1))).strip()
            values.append(text.encode())
            continue
        if kind in codes:
            many: list[Any] = [generator.uniform(-1e3, 1e3) for _ in range(max(number, 1))]
            if kind == "float":
                many = [struct.unpack("f", struct.pack("f", value))[0] for value in many]
        else:
            bits = int("".join(filter(str.isdigit, kind.removesuffix("_mavlink_version"))))
            low = 0 if kind.startswith("u") else -(1 << bits - 1)
            many = [generator.randrange(low, low + (1 << bits)) for _ in range(max(number, 1))]
        values.append(many if number else many[0])
    return message(*values)


def shown(value: Any) -> Any:
    """A decoder's value, in a form in which all decoders agree."""
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, list | tuple):
        return list(value)
    return value


def test_every_message_of_the_dialect_decodes_as_with_pymavlink(start: Opener) -> None:
    generator = random.Random(2)
    log = start()
    sent = {}
    for message in dialect.mavlink_map.values():
        instance = example(message, generator)
        sent[message.msgname] = instance
        log.datagram(1, Direction.IN, "a:1", frame_of(instance, 7, 42))
    log.close()
    reader = LogReader(log.path)
    kinds = reader.topics
    seen = set()
    for record in reader.records():
        if record.topic == DATAGRAM.topic:
            continue
        name = record.topic.removeprefix("/mavlink/7/42/")
        values = kinds[record.topic].unpack(record.data)
        assert list(values) == sent[name].ordered_fieldnames
        for field, value in values.items():
            assert shown(value) == shown(getattr(sent[name], field)), f"{name}.{field}"
        seen.add(name)
    assert seen == set(sent)


def test_the_mcap_package_and_its_ros1_decoder_read_every_topic(start: Opener) -> None:
    names = [
        "HEARTBEAT",
        "STATUSTEXT",
        "PARAM_VALUE",
        "ODOMETRY",
        "OBSTACLE_DISTANCE",
        "CAMERA_INFORMATION",
        "PLAY_TUNE",
    ]
    generator = random.Random(3)
    sent = {name: example(getattr(dialect, f"MAVLink_{name.lower()}_message"), generator) for name in names}
    log = start(attachments={"a": b"b"}, metadata={"m": {"k": "v"}})
    for time_ns, message in enumerate(sent.values()):
        log.datagram(time_ns, Direction.OUT, "[::1]:5", frame_of(message))
    log.record(TRACE, 100, TRACE.pack(1.0, 2.0, 3.0, 4, False, 0.5))
    log.record(COUNT, 101, COUNT.pack(6, b"seven"))
    log.text(102, 20, "name", "message")
    log.close()
    decoded: dict[str, Any] = {}
    times = []
    with log.path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, values in reader.iter_decoded_messages():
            decoded[channel.topic] = values
            times.append(message.log_time)
        summary = reader.get_summary()
        assert [attachment.data for attachment in reader.iter_attachments()] == [b"b"]
        assert {"m": {"k": "v"}}.items() <= {m.name: m.metadata for m in reader.iter_metadata()}.items()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 2 * len(names) + 3
    assert summary.statistics.message_start_time == EPOCH_NS
    assert summary.statistics.message_end_time == EPOCH_NS + 102
    assert times[-1] == EPOCH_NS + 102
    for name, message in sent.items():
        for field in message.fieldnames:
            assert shown(getattr(decoded[f"/mavlink/1/1/{name}"], field)) == shown(getattr(message, field)), field
    assert decoded[TRACE.topic].position_ned == (1.0, 2.0, 3.0)
    assert decoded[COUNT.topic].filling == b"seven"
    assert decoded[DATAGRAM.topic].address == "[::1]:5"
    assert decoded["/log"].message == "message"
    assert decoded["/log"].timestamp.secs * 10**9 + decoded["/log"].timestamp.nsecs == EPOCH_NS + 102


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
    file = McapFile(path, tidies=True)
    channels = [file.add_channel(record_type(f"/{name}", "x/X", [("a", "uint8[]")])) for name in "ab"]
    for number in range(30):
        head = HEADER.pack(5, LENGTH_OF_EMPTY + number, channels[number % 2], number, number, number)
        file.add_message(channels[number % 2], number, head + bytes(number))
        if number % 10 == 9:
            file.end_chunk()
    file.finish()
    assert indexed(path) == [30]


def grown(what: Callable[[], object]) -> int:
    """Bytes that are still held after it."""
    tracemalloc.start()
    what()
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return held


def test_strange_senders_cost_no_memory_beyond_the_first(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "noise.mcap")
    messages = Messages(file, preserves_datagrams=True)

    def strange(numbers: range) -> None:
        for number in numbers:
            frame = bytes([0xFD, 0, 0, 0, number & 255, 7, 1]) + (1_000_000 + number).to_bytes(3, "little") + bytes(2)
            messages.add(DATAGRAM.pack(0, "", frame), number, number)

    strange(range(5000))
    file.end_chunk()
    assert grown(lambda: strange(range(5000, 10_000))) < 50_000
    file.finish()
    assert 4000 < len(LogReader(tmp_path / "noise.mcap").topics) < 5000


def test_a_chunk_costs_little_memory_for_the_rest_of_the_flight(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "long.mcap")
    channels = [file.add_channel(record_type(f"/{number}", "x/X", [("a", "uint8")])) for number in range(30)]

    def chunks(numbers: range) -> None:
        for number in numbers:
            for channel in channels:
                head = HEADER.pack(5, LENGTH_OF_EMPTY + 1, channel, number, number, number)
                file.add_message(channel, number, head + b"a")
            file.end_chunk()

    chunks(range(10))
    assert grown(lambda: chunks(range(10, 310))) < 300 * 700  # 100 of each are in the index itself
    file.finish()
    with (tmp_path / "long.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count == 310


def test_topics_are_found_by_the_index(start: Opener, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the order of the file, without a look at other records; by such looks where the index lies though all
    checksums are right, where there is none, and where the chunks alone describe the channels."""
    log = start()
    for number in range(3000):
        log.record(COUNT, number, COUNT.pack(number, bytes(number % 5)))
        if number % 7 == 0:
            log.record(TRACE, number, TRACE.pack(1.0, 2.0, 3.0, 4, True, 0.5))
        if number % 100 == 0:
            log.text(number, 20, "name", "message")
    log.close()
    everything = list(read(log.path))

    def agrees(path: Path) -> bool:
        reader = LogReader(path)
        selections = [(COUNT.topic,), ("/log", TRACE.topic), (TRACE.topic, "/nothing"), ("/nothing",), ()]
        selections += [(COUNT.topic, TRACE.topic)]
        found = [list(reader.records(topics)) for topics in selections]
        wanted = [[record for record in everything if record.topic in topics] for topics in selections]
        return reader.problem is None and found == wanted

    with monkeypatch.context() as patch:
        patch.delattr(LogReader, "_walk")
        assert agrees(log.path)

    with log.path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    content = log.path.read_bytes()
    first, second, *_ = (place + 9 + 6 + 8 for place in summary.chunk_indexes[0].message_index_offsets.values())
    for lie in (content[second : second + 8], bytes(8), b"\xff" * 8, b"\xff\xff\xff" + bytes(5)):
        lying = bytearray(content)
        lying[first : first + 8] = lie  # another topic's message, no message, and places that are none
        end = lying.rindex(struct.pack("<BQ", Opcode.DATA_END, 4))
        lying[end + 9 : end + 13] = struct.pack("<I", zlib.crc32(lying[:end]))
        liar = log.path.with_name("liar.mcap")
        liar.write_bytes(lying)
        assert agrees(liar)

    for name, index_types, repeats in (("none", IndexType.NONE, True), ("all", IndexType.ALL, False)):
        other = log.path.with_name(f"{name}.mcap")
        writer = Writer(
            str(other), index_types=index_types, repeat_channels=repeats, repeat_schemas=repeats, enable_data_crcs=True
        )
        writer.start()
        rewrite(LogReader(log.path), everything, writer)
        assert agrees(other)


def test_units_and_enums_are_in_the_schema() -> None:
    kind, size, convert = message_type(dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE, "/t")
    assert "uint16[72] distances  # cm" in kind.definition
    assert "uint8 frame  # MAV_FRAME" in kind.definition
    assert size == kind.size == 167
    assert convert is None


def test_unknown_messages_are_carried(start: Opener) -> None:
    log = start()
    payload = b"\x01\x02\x03"
    log.datagram(1, Direction.IN, "a:1", b"\xfd\x03\x00\x00\x09\x05\x06\x45\x23\x6f" + payload + b"\xaa\xbb")
    log.close()
    reader = LogReader(log.path)
    (topic,) = (topic for topic in reader.topics if topic.startswith("/mavlink/"))
    assert topic == f"/mavlink/5/6/UNKNOWN_{0x6F2345}"
    (record,) = reader.records((topic,))
    assert reader.topics[topic].unpack(record.data) == {"payload": payload}


@pytest.mark.parametrize(("preserves_datagrams", "decoded"), [(True, 1), (False, 2)])
def test_frames_span_reads_of_a_stream_but_not_datagrams(
    start: Opener, preserves_datagrams: bool, decoded: int
) -> None:
    log = start(preserves_datagrams=preserves_datagrams)
    frame = frame_of(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3))
    log.datagram(1, Direction.IN, "a:1", frame + frame[:9])
    log.datagram(2, Direction.OUT, "a:1", b"")
    log.datagram(3, Direction.IN, "a:1", frame[9:])
    log.close()
    times = [record.time_ns for record in read(log.path, ("/mavlink/1/1/HEARTBEAT",))]
    assert times == [1, 3][:decoded]


# The ring.


def test_ring_wraps_with_odd_sizes(start: Opener) -> None:
    log = start(ring_bytes=1 << 16)
    generator = random.Random(5)
    fillings = [generator.randbytes(generator.choice([0, 1, 7, generator.randrange(6000)])) for _ in range(3000)]
    count(log, range(3000), fillings.__getitem__)
    log.close()
    records = [COUNT.unpack(record.data) for record in read(log.path)]
    assert [values["number"] for values in records] == list(range(3000))
    assert [values["filling"] for values in records] == fillings
    assert log.dropped == 0


def test_records_that_just_fit_the_ring_and_that_never_do(start: Opener) -> None:
    log = start(ring_bytes=1 << 16)
    overhead = 31 + len(COUNT.pack(0, b""))
    sizes = [(1 << 16) - overhead, (1 << 16) - overhead + 1, (1 << 16) - overhead, 0]
    count(log, range(4), lambda number: bytes(sizes[number]))
    log.close()
    assert numbers_of(log.path) == [0, 2, 3]
    assert log.dropped == 1
    assert LogReader(log.path).metadata["flightlog end"]["dropped"] == "1"


def test_drop_never_waits_and_leaves_gaps_in_the_sequence(start: Opener, capfd: pytest.CaptureFixture[str]) -> None:
    log = start(on_full="drop", ring_bytes=1 << 16)
    os.kill(log.recorder_pid, signal.SIGSTOP)
    count(log, range(5000))  # would never return if it waited
    dropped = log.dropped
    os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.written == 5000 - dropped)
    count(log, range(5000, 5001))
    log.close()
    sequences = [record.sequence for record in read(log.path)]
    assert sequences == [*range(5000 - dropped), 5000]
    assert 0 < dropped == log.dropped < 5000
    assert f"{dropped} records not logged" in capfd.readouterr().err


# Kills.

PRODUCER = """
import os, sys
from pathlib import Path
from protocol.flightlog import FlightLog, record_type
COUNT = record_type("/courier/count", "courier/Count", [("number", "int64"), ("filling", "uint8[]")])
log = FlightLog.open(Path(sys.argv[1]), metadata={}, attachments={}, types=[COUNT], on_full="wait", console=True,
                     minimum_free_bytes=0, ring_bytes=1 << 20)
number = 0
while True:
    log.record(COUNT, number, COUNT.pack(number, bytes(number % 300)))
    number += 1
    if number % 50 == 0:
        os.write(1, number.to_bytes(8, "little"))
"""


@pytest.mark.parametrize("moment", [50, 3_000, 61_000])
def test_kill_of_the_flying_process_loses_nothing(tmp_path: Path, moment: int) -> None:
    folder = tmp_path / "log"
    with subprocess.Popen(
        [sys.executable, "-c", PRODUCER, str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        handed_over = 0
        while handed_over < moment:
            message = process.stdout.read(8)
            assert message, process.stderr.read().decode()
            handed_over = int.from_bytes(message, "little")
        process.kill()
        handed_over = max(handed_over, int.from_bytes(process.stdout.read()[-8:], "little"))
        assert process.stderr.read() == b""  # until the recorder, which has it too, has ended
    reader = LogReader(folder / "flight.mcap")
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert reader.complete
    assert reader.problem is None
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= handed_over
    assert "without closing" in reader.metadata["flightlog end"]["reason"]


def test_a_record_is_safe_soon_without_more_to_follow(start: Opener) -> None:
    log = start()
    count(log, range(1))
    until(lambda: log.written == 1)
    reader = LogReader(log.path)  # while it is being written
    assert [COUNT.unpack(record.data)["number"] for record in reader.records()] == [0]
    assert not reader.complete
    assert reader.problem is not None
    assert "cut off" in reader.problem
    assert reader.metadata["flightlog"]["epoch_ns"] == str(EPOCH_NS)


def test_chunks_grow_to_their_age(start: Opener) -> None:
    began = time.monotonic_ns()
    log = start()
    for number in range(100):  # spread over many polls; on a slower machine there is time for more chunks
        count(log, range(number, number + 1))
        time.sleep(0.003)
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


def test_kill_of_the_recorder_is_said_and_stops_nothing(start: Opener) -> None:
    log = start()
    count(log, range(3000), noise(6))
    until(lambda: log.written >= 2000)
    assert log.fault is None
    safe = log.written
    os.kill(log.recorder_pid, signal.SIGKILL)
    count(log, range(3000, 6000), noise(7))  # more than the ring holds: it must not wait for a dead recorder
    until(lambda: log.fault is not None)
    assert log.fault is not None
    assert str(log.path) in log.fault
    assert log.dropped > 0
    log.close()
    assert log.fault is not None
    reader = LogReader(log.path)
    assert [path.name for path in log.folder.iterdir()] == ["flight.mcap"]
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert len(numbers) >= safe
    assert numbers == list(range(len(numbers)))
    assert not reader.complete
    assert list(reader.topics) == [DATAGRAM.topic, "/log", COUNT.topic, TRACE.topic]


def test_recorder_that_stands_still_is_said(start: Opener) -> None:
    log = start()
    os.kill(log.recorder_pid, signal.SIGSTOP)
    try:
        until(lambda: log.fault is not None)
        assert log.fault is not None
        assert "not moved" in log.fault
    finally:
        os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.fault is None)


def test_signals_for_the_flight_do_not_end_the_log(start: Opener) -> None:
    log = start()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(log.recorder_pid, number)
    count(log, range(10))
    log.close()
    assert numbers_of(log.path) == list(range(10))


# Disks.


def test_folder_that_is_none(start: Opener, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name in ("file", "file/below"):
        with pytest.raises(FlightLogError) as caught:
            start(name)
        assert str(tmp_path / name) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_file_that_is_there_already_is_kept(start: Opener, tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    path = tmp_path / "log" / "flight.mcap"
    path.write_text("precious")
    with pytest.raises(FlightLogError, match=f"{tmp_path}/log.*File exists"):
        start()
    assert path.read_text() == "precious"


def test_little_space_left(start: Opener, tmp_path: Path) -> None:
    with pytest.raises(FlightLogError, match=f"{tmp_path}/log.*free"):
        start(minimum_free_bytes=1 << 60)
    assert not (tmp_path / "log" / "flight.mcap").exists()


def test_full_disk_in_flight_is_said_and_what_is_written_stays_readable(start: Opener) -> None:
    log = start()
    limit = 1_000_000
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    count(log, range(2000), noise(8))
    until(lambda: log.fault is not None)
    assert log.fault is not None
    assert str(log.folder) in log.fault
    assert "File too large" in log.fault
    reader = LogReader(log.path)
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert 0 < len(numbers) < 2000
    assert numbers == sorted(set(numbers))
    assert numbers[:100] == list(range(100))
    assert log.path.stat().st_size <= limit
    copy = log.folder / "copy.mcap"

    def ends_whole() -> bool:  # what was half written is cut off again
        content = log.path.read_bytes()
        return f"cut off at byte {len(content)}" in str(written(content, copy)[1].problem)

    until(ends_whole)
    # Room again: the log goes on behind the gap, and the fault stays said.
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    count(log, range(2000, 2100))
    log.close()
    assert log.fault is not None
    reader = LogReader(log.path)
    numbers = [COUNT.unpack(record.data)["number"] for record in reader.records()]
    assert numbers[-100:] == list(range(2000, 2100))
    assert reader.complete
    assert reader.problem is None
    assert int(reader.metadata["flightlog end"]["lost"]) == 2100 - len(numbers)
    with log.path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(numbers)


def test_what_a_full_disk_takes_is_counted_where_metadata_ends_the_chunk(start: Opener) -> None:
    log = start()
    limit = log.path.stat().st_size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    os.kill(log.recorder_pid, signal.SIGSTOP)
    count(log, range(10))
    log._put(METADATA_CHANNEL, 0, msgspec.msgpack.encode(("landed", {"at": "home"})))
    os.kill(log.recorder_pid, signal.SIGCONT)
    until(lambda: log.fault is not None)
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    count(log, range(10, 13))
    until(lambda: log.written == 3)
    log.close()
    assert numbers_of(log.path) == [10, 11, 12]
    end = LogReader(log.path).metadata["flightlog end"]
    assert (end["records"], end["lost"]) == ("3", "11")


def test_first_chunk_that_fails_does_not_take_the_channels_with_it(start: Opener) -> None:
    log = start()
    size = log.path.stat().st_size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    count(log, range(1))
    until(lambda: log.fault is not None)
    assert log.path.stat().st_size == size
    resource.prlimit(log.recorder_pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    count(log, range(1, 3))
    until(lambda: log.written == 2)
    assert numbers_of(log.path) == [1, 2]  # without the summary, which has them again
    log.close()
    assert numbers_of(log.path) == [1, 2]


# Damage.


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A file of many chunks with something of everything."""
    log = FlightLog.open(
        tmp_path_factory.mktemp("finished"),
        metadata={"m": {"k": "v"}},
        attachments={"a": bytes(range(256))},
        types=[COUNT, TRACE],
        on_full="wait",
        console=False,
        minimum_free_bytes=0,
        ring_bytes=1 << 20,
    )
    heartbeat = frame_of(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3))
    fill = noise(9)
    for number in range(1500):
        log.record(COUNT, number, COUNT.pack(number, fill(number)))
        log.datagram(number, Direction.IN, "a:1", heartbeat)
    log.close({"outcome": {"delivered": "yes"}})
    return log.path.read_bytes()


def written(content: bytes, path: Path) -> tuple[list[Record], LogReader]:
    path.unlink(missing_ok=True)  # quicker than to cut it, and nobody's reader loses the bytes that it has mapped
    path.write_bytes(content)
    reader = LogReader(path)
    return list(reader.records()), reader


def rewrite(source: LogReader, records: list[Record], writer: Writer, between: Sequence[int] = ()) -> None:
    """The records as the mcap package writes them, and now and then a message on each of the channels `between`."""
    writer.add_metadata("flightlog", {"epoch_ns": str(source.epoch_ns)})
    channels = {}
    for topic, kind in source.topics.items():
        schema = writer.register_schema(kind.schema_name, "ros1msg", kind.definition.encode())
        channels[topic] = writer.register_channel(topic, "ros1", schema)
    for number, record in enumerate(records):
        log_time = source.epoch_ns + record.time_ns
        for channel in between if number % 50 == 0 else ():
            writer.add_message(channel, log_time, bytes(10), log_time)
        writer.add_message(channels[record.topic], log_time, record.data, log_time, record.sequence)
    writer.finish()  # type: ignore[no-untyped-call]


def encoded(*records: McapRecord) -> bytes:
    """As the mcap package writes them."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


DEFINITION = encoded(Schema(1, b"float64 a", "ros1msg", "x/X"), Channel(1, "/x", "ros1", {}, 1))
"""Of channel 1, as long as a record is."""
START = MAGIC + encoded(Header("", ""), Metadata("flightlog", {"epoch_ns": "0"}))


def chunked(content: bytes, *, packed: bytes | None = None, size: int | None = None, cut: int = 0) -> bytes:
    """A log of one chunk that has no checksum, without its end; `cut` bytes of the chunk are missing."""
    packed = zstandard.compress(content) if packed is None else packed
    chunk = encoded(Chunk("zstd", packed + bytes(cut), 0, 0, 0, len(content) if size is None else size))
    return START + chunk[: len(chunk) - cut]


A_SLICE = 40_000
"""Bytes that are enough for a compressed slice (16 KiB) and what frames a chunk."""


def chunk_ends(path: Path) -> list[tuple[int, int]]:
    """The end of each chunk in the file, and the messages up to there, by the mcap package."""
    ends = []
    total = 0
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                total += sum(isinstance(inner, Message) for inner in breakup_chunk(record))
                ends.append((file.tell(), total))
    return ends


def test_cuts_lose_little_of_a_chunk_and_nothing_before_it(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    whole, reader = written(finished, path)
    assert reader.problem is None
    ends = chunk_ends(path)
    assert len(ends) >= 3
    assert ends[-1][1] == len(whole)
    generator = random.Random(10)
    cuts = [generator.randrange(len(finished)) for _ in range(50)]
    cuts += [0, 1, 8, 9, *(end + by for end, _ in ends for by in (-1, 0, 1)), len(finished) - 1]
    for cut in cuts:
        records, reader = written(finished[:cut], path)
        assert records == whole[: len(records)], cut
        assert len(records) >= max((messages for end, messages in ends if end <= cut), default=0), cut
        assert sum(31 + len(record.data) for record in records) >= min(cut, ends[-1][0]) - A_SLICE, cut
        assert not reader.complete
        assert reader.problem is not None


def test_flipped_bits_are_found(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    whole, _ = written(finished, path)
    contents = {(record.topic, record.sequence): record.data for record in whole}
    summary = struct.unpack_from("<Q", finished, len(finished) - 28)[0]
    generator = random.Random(11)
    bits = [generator.randrange(8 * len(finished)) for _ in range(40)]
    bits += [generator.randrange(8 * (summary - 13), 8 * len(finished)) for _ in range(60)]
    bits += [generator.randrange(64, 8 * 1000) for _ in range(40)]
    for bit in bits:
        damaged = bytearray(finished)
        damaged[bit // 8] ^= 1 << bit % 8
        try:
            records, reader = written(bytes(damaged), path)
        except FlightLogError:
            pytest.fail(f"not readable with bit {bit} flipped")
        assert reader.problem is not None, f"bit {bit} at byte {bit // 8} of {len(finished)}"
        assert all(contents[record.topic, record.sequence] == record.data for record in records)
        assert len(records) >= len(whole) * 0.4, f"bit {bit}"


def test_flip_in_an_unfinished_file_costs_its_chunk_alone(finished: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flipped.mcap"
    whole, _ = written(finished, path)
    ends = chunk_ends(path)
    (_, first), (second_end, second) = ends[:2]
    cut = ends[-1][0]
    for place in (second_end - 500, ends[0][0] + 3):  # within the second chunk, and in what frames it
        damaged = bytearray(finished[:cut])
        damaged[place] ^= 0x10
        records, reader = written(bytes(damaged), path)
        assert records in (whole[:first] + whole[second:], whole), place
        assert reader.problem is not None
        if place > ends[0][0] + 100:
            assert records != whole
            assert "damaged" in reader.problem


def test_messages_outside_of_chunks_are_read(finished: bytes, tmp_path: Path) -> None:
    """All of a whole file, up to the cut of one that is cut; and none where they may be a damage between chunks."""
    whole, source = written(finished, tmp_path / "whole.mcap")
    path = tmp_path / "loose.mcap"
    writer = Writer(str(path), use_chunking=False)
    writer.start()
    rewrite(source, whole, writer)
    with path.open("rb") as file:
        theirs = [(channel.topic, m.sequence, m.data) for _, channel, m in make_reader(file).iter_messages()]
    reader = LogReader(path)
    assert [(record.topic, record.sequence, record.data) for record in reader.records()] == theirs
    assert list(reader.records()) == whole
    assert reader.problem is None and reader.complete
    assert list(reader.records((COUNT.topic,))) == [record for record in whole if record.topic == COUNT.topic]
    content = path.read_bytes()
    generator = random.Random(13)
    for cut in [generator.randrange(len(content)) for _ in range(20)]:
        records, reader = written(content[:cut], path)
        assert records == whole[: len(records)]
        assert sum(31 + len(record.data) for record in records) >= cut - 10_000
        assert reader.problem is not None

    (end, _), *_ = chunk_ends(source.path)
    assert finished[end] == Opcode.MESSAGE_INDEX
    flipped = finished[:end] + bytes([Opcode.MESSAGE]) + finished[end + 1 :]
    records, reader = written(flipped, path)
    assert records == whole
    assert "messages between its chunks are left out" in str(reader.problem)


def test_messages_before_and_behind_a_chunk_and_attachments_without_a_checksum_are_read(tmp_path: Path) -> None:
    first, second, third = (HEADER.pack(5, LENGTH_OF_EMPTY + 8, 1, n, n, n) + bytes(8) for n in range(3))
    attachment = encoded(Attachment(0, 0, "a", "b", b"c"))[:-4] + bytes(4)
    chunk = chunked(second).removeprefix(START)
    content = START + DEFINITION + first + chunk + third + attachment
    end = encoded(DataEnd(zlib.crc32(content)), Footer(0, 0, 0)) + MAGIC
    records, reader = written(content + end, tmp_path / "mixed.mcap")
    assert [record.sequence for record in records] == [0, 1, 2]
    assert reader.problem is None and reader.attachments == {"a": b"c"}


def test_channels_of_other_tools_cost_their_own_messages_alone(finished: bytes, tmp_path: Path) -> None:
    """Without a schema, of another encoding, with a nested or an unknown type, with more values than there is memory,
    and a name twice: in a whole file, in one that is cut, and outside of chunks."""
    whole, source = written(finished, tmp_path / "whole.mcap")
    texts = ["Header header\nstring child", "string[] a", "float64[999999999999] a", f"uint8[{'9' * 5000}] a"]
    texts += ["uint8[9000000] a\nuint8[9000000] b", "float32 a\nfloat32 a", "float32", "\xff \xfe", "duration a"]
    path = tmp_path / "foreign.mcap"
    for chunks in (True, False):
        writer = Writer(str(path), chunk_size=1 << 18, use_chunking=chunks)
        writer.start()
        channels = [writer.register_channel("/without", "json", 0)]
        for number, text in enumerate(texts):
            schema = writer.register_schema(f"x/{number}", "ros1msg", text.encode("latin-1"))
            channels.append(writer.register_channel(f"/{number}", "ros1", schema))
        schema = writer.register_schema("x/Json", "jsonschema", b"{}")
        channels.append(writer.register_channel("/json", "json", schema))
        rewrite(source, whole, writer, channels)
        records, reader = written(path.read_bytes(), path)
        assert records == whole
        assert reader.problem is None
        assert reader.topics.keys() == source.topics.keys()
        records, reader = written(path.read_bytes()[:400_000], path)
        assert records == whole[: len(records)] and len(records) > 200
        assert str(reader.problem).count(";") == chunks  # the cut, and the checksum of a chunk that is cut


def test_a_message_longer_than_its_chunk_is_damage_and_those_before_it_are_kept(tmp_path: Path) -> None:
    first, last = (HEADER.pack(5, LENGTH_OF_EMPTY + length, 1, 0, 0, 0) for length in (8, 1000))
    content = DEFINITION + first + bytes(8) + last + bytes(999)
    records, reader = written(chunked(content), tmp_path / "long.mcap")
    assert records == [Record("/x", 0, 0, bytes(8))]
    assert "something else than messages" in str(reader.problem)
    records, reader = written(chunked(content + b"\0"), tmp_path / "long.mcap")
    assert len(records) == 2
    assert str(reader.problem).endswith(f"cut off at byte {reader.path.stat().st_size}")


def test_what_unpacks_to_more_than_its_chunk_is_refused_before_it_does(tmp_path: Path) -> None:
    """With the frame's own size in it and without, whole and cut."""
    many = DEFINITION + bytes(1 << 26)
    stated, unstated = (zstandard.ZstdCompressor(write_content_size=states).compress(many) for states in (True, False))
    for packed in (stated, unstated):
        with pytest.raises(zstandard.ZstdError):
            decompressed(packed, 10)
        for cut in (0, 1000):
            path = tmp_path / "bomb.mcap"
            path.write_bytes(chunked(b"", packed=packed, size=100, cut=cut))
            tracemalloc.start()
            reader = LogReader(path)
            assert list(reader.records()) == []
            most = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert most < 30_000_000
            assert ("cut off at byte" if cut else "is damaged") in str(reader.problem)


@pytest.mark.parametrize("epoch", ["9" * 400, "9" * 5000, str(1 << 63), "-1", "1.5", "²", ""])
def test_a_start_time_that_is_none_is_said(epoch: str, tmp_path: Path) -> None:
    table = encoded(Metadata("flightlog", {"epoch_ns": "0"})), encoded(Metadata("flightlog", {"epoch_ns": epoch}))
    content = chunked(DEFINITION + HEADER.pack(5, LENGTH_OF_EMPTY + 8, 1, 0, 7, 7) + bytes(8)).replace(*table)
    records, reader = written(content, tmp_path / "epoch.mcap")
    assert reader.epoch_ns == 0 and [record.time_ns for record in records] == [7]
    assert f"its start time is {'damaged' if epoch else 'missing'}" in str(reader.problem)


def test_the_latest_start_time(tmp_path: Path) -> None:
    latest = str((1 << 63) - 1)
    table = encoded(Metadata("flightlog", {"epoch_ns": "0"})), encoded(Metadata("flightlog", {"epoch_ns": latest}))
    _, reader = written(chunked(DEFINITION).replace(*table), tmp_path / "epoch.mcap")
    assert str(reader.epoch_ns) == latest and "start time" not in str(reader.problem)


@pytest.mark.parametrize("end", [DataEnd(1), Footer(1, 0, 1)])
def test_the_data_is_summed_once_however_many_ends_there_are(
    end: McapRecord, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    summed = []
    crc = LogReader._crc

    def counted(reader: LogReader, start: int, stop: int) -> int:
        summed.append(stop - start)
        return crc(reader, start, stop)

    monkeypatch.setattr(LogReader, "_crc", counted)
    _, reader = written(chunked(DEFINITION) + 1000 * encoded(end) + MAGIC, tmp_path / "ends.mcap")
    assert len(summed) <= 1
    assert reader.problem is not None


def test_what_is_no_table_is_said(tmp_path: Path) -> None:
    """A field that is called as the time is, no fields at all, and a time that numpy has no number for."""
    for text, data in ((b"int64 time_ns", bytes(8)), (b"", b"")):
        kind = encoded(Schema(1, text, "ros1msg", "x/X"), Channel(1, "/x", "ros1", {}, 1))
        message = HEADER.pack(5, LENGTH_OF_EMPTY + len(data), 1, 0, 7, 7) + data
        _, reader = written(chunked(kind + message), tmp_path / "table.mcap")
        if text:
            with pytest.raises(FlightLogError, match="a field time_ns of its own"):
                reader.array("/x")
        else:
            table = reader.array("/x")
            assert table["time_ns"].tolist() == [7] and table.dtype.names == ("time_ns",)
    late = HEADER.pack(5, LENGTH_OF_EMPTY + 8, 1, 0, 1 << 63, 0) + bytes(8)
    _, reader = written(chunked(DEFINITION + late), tmp_path / "late.mcap")
    with pytest.raises(FlightLogError, match="time beyond all clocks"):
        reader.array("/x")


def test_no_content_of_a_chunk_raises_anything(tmp_path: Path) -> None:
    """Bytes changed below the checksums: the reader knows nothing of the damage, and stumbles over none of it."""
    messages = b"".join(
        HEADER.pack(5, LENGTH_OF_EMPTY + 8, 1, number, number, number) + bytes(8) for number in range(3)
    )
    attachment = encoded(Attachment(0, 0, "a", "b", b"c"))
    content = DEFINITION + messages + encoded(Metadata("m", {"k": "v"})) + attachment + messages
    lies = [bytes(8), b"\xff" * 8, b"\xff" * 7 + b"\x7f", b"\x01" + bytes(7)]
    for place, lie, size in itertools.product(range(len(content)), lies, (1, 2, 4, 8)):
        damaged = content[:place] + lie[:size] + content[place + size :]
        _, reader = written(chunked(damaged), tmp_path / "lie.mcap")
        for topic in reader.topics:
            with contextlib.suppress(FlightLogError):
                reader.array(topic)


def test_an_attachment_longer_than_any_file(tmp_path: Path) -> None:
    attachment = bytearray(encoded(Attachment(0, 0, "a", "b", b"c"))[:-4])
    attachment[-9:-1] = b"\xff" * 8
    attachment += struct.pack("<I", zlib.crc32(attachment[9:]))
    _, reader = written(chunked(DEFINITION) + attachment, tmp_path / "long.mcap")
    assert reader.attachments == {} and "cut off at byte" in str(reader.problem)


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "no.mcap"
    with pytest.raises(FlightLogError, match="No such file"):
        LogReader(path)
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(FlightLogError, match="not an MCAP file"):
        LogReader(path)


# The console.

TALKER = """
import sys
from pathlib import Path
from protocol.flightlog import FlightLog
log = FlightLog.open(Path(sys.argv[1]), metadata={}, attachments={}, types=[], on_full="wait",
                     console=sys.argv[2] == "1", minimum_free_bytes=0, ring_bytes=1 << 16)
for number in range(20):
    log.status(f"at {number} m")
log.text(1_500_000_000, 30, "supervisor", "too late")
log.close()
"""


def test_console_without_a_terminal(tmp_path: Path) -> None:
    command = [sys.executable, "-c", TALKER]
    loud = subprocess.run([*command, str(tmp_path / "a"), "1"], stderr=subprocess.PIPE, check=True)
    assert loud.stderr.decode().splitlines() == ["at 0 m", "    1.500 WARNING supervisor: too late"]
    quiet = subprocess.run([*command, str(tmp_path / "b"), "0"], stderr=subprocess.PIPE, check=True)
    assert quiet.stderr.decode() == ""
    (record,) = read(tmp_path / "b" / "flight.mcap")
    assert record.topic == "/log"


def test_console_on_a_terminal(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    subprocess.run([sys.executable, "-c", TALKER, str(tmp_path / "a"), "1"], stderr=theirs, check=True)
    shown_bytes = os.read(ours, 1 << 16).decode()
    os.close(ours)
    os.close(theirs)
    assert "\rat 0 m" in shown_bytes.replace("\x1b[K", "")
    assert "\r\x1b[K    1.500 WARNING supervisor: too late\r\nat 19 m" in shown_bytes
    assert shown_bytes.endswith("at 19 m\r\n")


def test_console_that_nobody_reads_stops_nothing(tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    code = TALKER.replace("range(20)", "range(0)").replace("log.close()", "") + (
        "for number in range(3000): log.text(number, 30, 'chatter', 'x' * 100)\nlog.close()\nprint(log.fault)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "a"), "1"], stdout=subprocess.PIPE, stderr=write_end, check=True
    )
    os.close(read_end)
    os.close(write_end)
    assert done.stdout == b"None\n"
    assert sum(1 for _ in read(tmp_path / "a" / "flight.mcap")) == 3001


def test_definition_survives_the_file() -> None:
    again = RecordType(TRACE.topic, TRACE.schema_name, TRACE.definition)
    assert again.fields == TRACE.fields
    assert again.size == TRACE.size == 30
    assert again.dtype == np.dtype([("position_ned", "<f8", (3,)), ("phase", "u1"), ("armed", "?"), ("thrust", "<f4")])
