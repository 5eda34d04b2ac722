"""Logs in other tools' formats, as these tools read them."""

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory
from pymavlink import mavutil

from companion.logs.convert import convert
from protocol.flightlog import DATAGRAM, Direction, FlightLogError, LogReader, datagrams
from protocol.framing import Framer
from tests.flights.processes import run
from tests.logs.changed_logs import Flyer
from tests.protocol.test_tlog import by_pymavlink

DATA = Path(__file__).resolve().parents[1] / "data"
RECORDINGS = ("px4_offboard", "ardupilot_guided")


@pytest.mark.parametrize("name", RECORDINGS)
def test_tlog_to_mcap_and_back_is_the_same_file(name: str, tmp_path: Path) -> None:
    source = DATA / f"{name}.tlog"
    convert(source, tmp_path / "a.mcap")
    convert(tmp_path / "a.mcap", tmp_path / "a.tlog")
    assert (tmp_path / "a.tlog").read_bytes() == source.read_bytes()


def test_also_for_what_pymavlink_writes_and_for_damaged_ones(tmp_path: Path) -> None:
    by_pymavlink(tmp_path / "a.tlog")
    content = bytearray((tmp_path / "a.tlog").read_bytes())
    for number, place in enumerate((None, 500, 900, -1)):
        if place is not None:
            content[place] ^= 0x55
        source, between, target = (tmp_path / f"{number}{suffix}" for suffix in (".tlog", ".mcap", "_again.tlog"))
        source.write_bytes(content)
        convert(source, between)
        convert(between, target)
        assert target.read_bytes() == content


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_converted_tlog_reads_like_a_flight_log(name: str, tmp_path: Path) -> None:
    """By the mcap package and its decoder: each message as pymavlink reads it from the telemetry log, in order."""
    convert(DATA / f"{name}.tlog", tmp_path / "a.mcap")
    theirs = mavutil.mavlogfile(str(DATA / f"{name}.tlog"))
    counts = Counter[str]()
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, values in reader.iter_decoded_messages(log_time_order=False):
            if not channel.topic.startswith("/mavlink/"):
                continue
            kind = channel.topic.split("/")[-1]
            expected = theirs.recv_msg()
            assert message.log_time // 1000 == round(expected._timestamp * 1e6)
            if kind.startswith("UNKNOWN_"):
                continue
            assert expected.get_type() == kind
            for field in ("time_boot_ms", "custom_mode", "q1", "vx"):
                if hasattr(expected, field):
                    assert repr(getattr(values, field)) == repr(getattr(expected, field))  # NaN, too
            counts[kind] += 1
    assert theirs.recv_msg() is None
    assert counts["HEARTBEAT"] > 20 and counts["ATTITUDE_QUATERNION"] > 500
    directions = Counter(direction for _, direction, _, _ in datagrams(tmp_path / "a.mcap"))
    assert directions[Direction.IN] > directions[Direction.OUT] > 500


def test_a_flight_log_to_tlog_is_read_by_pymavlink(fly: Flyer, tmp_path: Path) -> None:
    convert(fly(), tmp_path / "a.tlog")
    theirs = mavutil.mavlogfile(str(tmp_path / "a.tlog"))
    read = []
    while (message := theirs.recv_msg()) is not None:
        read.append(bytes(message.get_msgbuf()))
    ours = [frame.raw for _, _, _, data in datagrams(fly()) for frame in Framer().datagram(data)]
    assert read == ours


def test_csv_and_parquet_hold_the_same_values(fly: Flyer, tmp_path: Path) -> None:
    from pyarrow import parquet

    convert(fly(), tmp_path / "csv", "csv")
    convert(fly(), tmp_path / "parquet", "parquet")
    log = LogReader(fly())
    counts = Counter(record.topic for record in log.records())
    assert len(list((tmp_path / "csv").iterdir())) == len(counts) - (DATAGRAM.topic in counts)
    for topic, name in (
        ("/mavlink/1/1/ATTITUDE_QUATERNION", "1_1_ATTITUDE_QUATERNION"),
        ("/mavlink/1/1/OBSTACLE_DISTANCE", "1_1_OBSTACLE_DISTANCE"),
        ("/companion/trace", "companion_trace"),
    ):
        expected = log.array(topic)
        table = parquet.read_table(tmp_path / "parquet" / f"{name}.parquet")
        rows = list(csv.DictReader((tmp_path / "csv" / f"{name}.csv").open(encoding="utf-8")))
        assert table.num_rows == len(rows) == len(expected)
        for field in expected.dtype.names or ():
            values = np.array(table[field].to_pylist(), expected[field].dtype)
            np.testing.assert_array_equal(values, expected[field])
            if expected[field].ndim == 1 and expected[field].dtype.kind in "fiu":
                again = np.array([row[field] for row in rows]).astype(expected[field].dtype)
            elif expected[field].ndim == 2:
                again = np.array([[row[f"{field}[{i}]"] for i in range(expected[field].shape[1])] for row in rows])
                again = again.astype(expected[field].dtype)
            else:
                again = np.array([row[field] == "True" for row in rows])
            np.testing.assert_array_equal(again, expected[field])
    texts = list(csv.DictReader((tmp_path / "csv" / "log.csv").open(encoding="utf-8")))
    assert any("taking off" in row["message"] for row in texts)


def test_ulog_is_read_by_pyulog(fly: Flyer, tmp_path: Path) -> None:
    from pyulog import ULog

    convert(fly(), tmp_path / "a.ulg")
    theirs, log = ULog(str(tmp_path / "a.ulg")), LogReader(fly())
    assert not theirs.file_corruption
    for topic, name in (
        ("/mavlink/1/1/ATTITUDE_QUATERNION", "attitude_quaternion"),
        ("/companion/trace", "companion_trace"),
    ):
        expected, found = log.array(topic), theirs.get_dataset(name).data
        np.testing.assert_array_equal(found["timestamp"], expected["time_ns"] // 1000)
        for field in expected.dtype.names or ():
            columns = expected[field].reshape(len(expected), -1)
            if field != "time_ns":
                for index in range(columns.shape[1]):
                    key = field if expected[field].ndim == 1 else f"{field}[{index}]"
                    np.testing.assert_array_equal(found[key], columns[:, index])
    attitude = theirs.get_dataset("vehicle_attitude").data
    np.testing.assert_array_equal(attitude["q[3]"], log.array("/mavlink/1/1/ATTITUDE_QUATERNION")["q4"])
    assert theirs.msg_info_dict["mission"] == "hover"
    assert any("taking off" in text.message for text in theirs.logged_messages)


def test_a_tlog_becomes_tables_and_ulog_too(tmp_path: Path) -> None:
    from pyulog import ULog

    source = DATA / "px4_offboard.tlog"
    convert(source, tmp_path / "csv", "csv")
    convert(source, tmp_path / "a.ulg")
    rows = len((tmp_path / "csv" / "1_1_ATTITUDE_QUATERNION.csv").read_text().splitlines()) - 1
    assert rows == len(ULog(str(tmp_path / "a.ulg")).get_dataset("attitude_quaternion").data["timestamp"]) == 2075


def test_what_can_not_be_converted_is_one_line(fly: Flyer, tmp_path: Path) -> None:
    taken = tmp_path / "taken.tlog"
    taken.write_bytes(b"mine")
    for source, target in (
        (fly(), tmp_path / "a.xyz"),
        (fly(), tmp_path / "b.mcap"),
        (fly(), taken),
        (fly(), tmp_path / "no" / "a.tlog"),
        (DATA / "px4_offboard.tlog", tmp_path / "b.tlog"),
        (tmp_path / "none.mcap", tmp_path / "c.tlog"),
    ):
        with pytest.raises(FlightLogError):
            convert(source, target)
    assert taken.read_bytes() == b"mine" and not (tmp_path / "b.tlog").exists()
    done = run("companion", "convert", str(fly()), str(taken))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "taken.tlog" in done.stderr
