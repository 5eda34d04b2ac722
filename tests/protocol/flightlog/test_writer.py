"""What the flying process hands over comes out of the file, and a log that can't be started says why."""

import os
from pathlib import Path

import pytest
from mcap.reader import make_reader
from pymavlink.dialects.v20 import ardupilotmega as dialect

from protocol.flightlog import (
    DATAGRAM,
    TEXT,
    Direction,
    FlightLogError,
    LogReader,
    datagrams,
    digest,
)
from tests.protocol.flightlog.made_logs import (
    COUNT,
    EPOCH_NS,
    TRACE,
    Opener,
    frame_of,
)


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


def test_folder_that_is_none(start: Opener, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name in ("file", "file/below"):
        with pytest.raises(FlightLogError) as caught:
            start(name)
        assert str(tmp_path / name) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_names_of_files_may_be_any_bytes(start: Opener) -> None:
    """In the folder's name, in what is said of it, and in a text."""
    name = os.fsdecode(b"l\xe9")
    log = start(name)
    log.text(1, 20, "companion", f"world: {name}.toml")
    log.close()
    assert [TEXT.unpack(each.data)["message"] for each in LogReader(log.path).records()] == ["world: l\\udce9.toml"]
    with pytest.raises(FlightLogError, match=r"l\\xe9: the flight log can't be written: File exists"):
        start(name)


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
