"""Reading logs: tables, topics by the index, files of other tools."""

import random
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    Channel,
    DataEnd,
    Footer,
    Metadata,
    Schema,
)
from mcap.writer import IndexType, Writer
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    MAGIC,
    Direction,
    FlightLogError,
    LogReader,
    read,
)
from protocol.flightlog.mcap_format import message_record
from protocol.flightlog.selection import Selection
from tests.protocol.flightlog.made_logs import (
    COUNT,
    DEFINITION,
    START,
    TRACE,
    Opener,
    chunk_ends,
    chunked,
    encoded,
    frame_of,
    rewrite,
    written,
)


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
        patch.delattr(Selection, "walk")
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
    first, second, third = (message_record(1, n, n, bytes(8)) for n in range(3))
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


@pytest.mark.parametrize("epoch", ["9" * 400, "9" * 5000, str(1 << 63), "-1", "1.5", "²", ""])
def test_a_start_time_that_is_none_is_said(epoch: str, tmp_path: Path) -> None:
    table = encoded(Metadata("flightlog", {"epoch_ns": "0"})), encoded(Metadata("flightlog", {"epoch_ns": epoch}))
    content = chunked(DEFINITION + message_record(1, 0, 7, bytes(8))).replace(*table)
    records, reader = written(content, tmp_path / "epoch.mcap")
    assert reader.epoch_ns == 0 and [record.time_ns for record in records] == [7]
    assert f"its start time is {'damaged' if epoch else 'missing'}" in str(reader.problem)


def test_the_latest_start_time(tmp_path: Path) -> None:
    latest = str((1 << 63) - 1)
    table = encoded(Metadata("flightlog", {"epoch_ns": "0"})), encoded(Metadata("flightlog", {"epoch_ns": latest}))
    _, reader = written(chunked(DEFINITION).replace(*table), tmp_path / "epoch.mcap")
    assert str(reader.epoch_ns) == latest and "start time" not in str(reader.problem)


def test_what_is_no_table_is_said(tmp_path: Path) -> None:
    """A field that is called as the time is, no fields at all, and a time that numpy has no number for."""
    for text, data in ((b"int64 time_ns", bytes(8)), (b"", b"")):
        kind = encoded(Schema(1, text, "ros1msg", "x/X"), Channel(1, "/x", "ros1", {}, 1))
        message = message_record(1, 0, 7, data)
        _, reader = written(chunked(kind + message), tmp_path / "table.mcap")
        if text:
            with pytest.raises(FlightLogError, match="a field time_ns of its own"):
                reader.array("/x")
        else:
            table = reader.array("/x")
            assert table["time_ns"].tolist() == [7] and table.dtype.names == ("time_ns",)
    late = message_record(1, 0, 1 << 63, bytes(8))
    _, reader = written(chunked(DEFINITION + late), tmp_path / "late.mcap")
    with pytest.raises(FlightLogError, match="time beyond all clocks"):
        reader.array("/x")
