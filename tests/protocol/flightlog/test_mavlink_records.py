"""MAVLink messages in the log, as pymavlink, the mcap package and its ROS 1 decoder read them."""

import random
import struct
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    DATAGRAM,
    Direction,
    LogReader,
    read,
)
from protocol.flightlog.mavlink_records import MessageWriter, message_type
from protocol.flightlog.mcap_file import McapFile
from tests.protocol.flightlog.made_logs import (
    COUNT,
    EPOCH_NS,
    TRACE,
    Opener,
    frame_of,
    grown,
)


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


def test_strange_senders_cost_no_memory_beyond_the_first(tmp_path: Path) -> None:
    file = McapFile(tmp_path / "noise.mcap")
    messages = MessageWriter(file, preserves_datagrams=True)

    def strange(numbers: range) -> None:
        for number in numbers:
            frame = bytes([0xFD, 0, 0, 0, number & 255, 7, 1]) + (1_000_000 + number).to_bytes(3, "little") + bytes(2)
            messages.add(DATAGRAM.pack(0, "", frame), number, number)

    strange(range(5000))
    file.end_chunk()
    assert grown(lambda: strange(range(5000, 10_000))) < 50_000
    file.finish()
    assert 4000 < len(LogReader(tmp_path / "noise.mcap").topics) < 5000


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
