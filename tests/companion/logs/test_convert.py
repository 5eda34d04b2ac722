"""Logs in other tools' formats, as these tools read them."""

import csv
import io
import resource
import struct
from collections import Counter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap_ros1.decoder import DecoderFactory
from pymavlink import mavutil
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.shell import FAILED
from companion.logs.convert import convert
from protocol.flightlog import DATAGRAM, Direction, FlightLogError, LogReader, datagrams
from protocol.flightlog.tlog import TlogReader, is_tlog
from protocol.framing import Framer
from protocol.messages import dialect
from tests.companion.logs.changed_logs import Flyer, foreign, heartbeat, stream_log, telemetry_log
from tests.flights.processes import run
from tests.protocol.flightlog.test_tlog import by_pymavlink

DATA = Path(__file__).resolve().parents[2] / "data"
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


def ulog(path: Path) -> Any:
    from pyulog import ULog

    found = ULog(str(path))
    assert not found.file_corruption
    return found


def test_messages_with_a_time_of_their_own_are_whole_in_ulog(tmp_path: Path) -> None:
    """Every topic of a PX4 recording is as long as it says and its stamps are those of the log."""
    convert(DATA / "px4_offboard.tlog", tmp_path / "a.ulg")
    convert(DATA / "px4_offboard.tlog", tmp_path / "a.mcap")
    log, found = LogReader(tmp_path / "a.mcap"), ulog(tmp_path / "a.ulg")
    counts = Counter(record.topic.split("/")[-1].lower() for record in log.records())
    for data in found.data_list:
        names = [field.field_name for field in data.field_data]
        assert len(names) == len(set(names)), data.name
        assert (np.diff(data.data["timestamp"].astype(np.int64)) >= 0).all(), data.name
        if not data.name.startswith("vehicle_"):
            assert len(data.data["timestamp"]) <= counts[data.name]
    zeros = [[0] * length for length in (3, 3, 4, 3, 3)]
    own = telemetry_log(tmp_path / "b.tlog", dialect.MAVLink_follow_target_message(77, 1, 2, 3, 4.0, *zeros, 5))
    convert(own, tmp_path / "b.ulg")
    (target,) = ulog(tmp_path / "b.ulg").data_list
    assert target.data["timestamp"].tolist() == [0] and target.data["timestamp_"].tolist() == [77]
    assert target.data["lat"].tolist() == [2] and target.data["custom_state"].tolist() == [5]


def test_texts_of_fixed_size_are_in_ulog(tmp_path: Path) -> None:
    source = telemetry_log(
        tmp_path / "a.tlog",
        dialect.MAVLink_param_value_message(b"MPC_XY_VEL_MAX", 12.0, 9, 100, 7),
        dialect.MAVLink_statustext_message(4, "low battery \u00e4".encode()),
        dialect.MAVLink_statustext_message(0, b"x" * 50),
    )
    convert(source, tmp_path / "a.ulg")
    found = ulog(tmp_path / "a.ulg")
    parameter = found.get_dataset("param_value").data
    letters = bytes(int(parameter[f"param_id[{index}]"][0]) for index in range(16))
    assert letters == b"MPC_XY_VEL_MAX\0\0" and parameter["param_value"].tolist() == [12.0]
    said = [(text.message, text.timestamp, text.log_level_str()) for text in found.logged_messages]
    assert said == [("low battery \u00e4", 100_000, "WARNING"), ("x" * 50, 200_000, "EMERGENCY")]


def test_ulog_of_what_other_programs_log(tmp_path: Path) -> None:
    """Topics that look like ours and are none, records beyond 64 KiB, times before the start, odd names."""
    number = struct.pack("<f", 2.5)
    source = foreign(
        tmp_path / "a.mcap",
        {
            "/attitude_quaternion": ("x/A", "float32 w\n", [(-0 + 1_000_000, number)]),
            "/large": ("x/L", "uint8[70000] data\n", [(2_000_000, bytes(70_000))]),
            "/a;b:c": ("x/B", "float32 timestamp\nfloat32 timestamp_\n", [(3_000_000, number * 2)]),
        },
        {"flightlog": {"epoch_ns": "10000000"}},
    )
    convert(source, tmp_path / "a.ulg")
    found = ulog(tmp_path / "a.ulg")
    times = {data.name: data.data["timestamp"].tolist() for data in found.data_list}
    assert times == {"attitude_quaternion": [0], "a_b_c": [2000]}
    assert found.get_dataset("a_b_c").data["timestamp__"].tolist() == [2.5]


def test_a_cut_log_is_converted_as_far_as_it_goes_and_it_is_said(many_chunks: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(many_chunks.read_bytes()[:20_000])
    telemetry = tmp_path / "cut.tlog"
    telemetry.write_bytes((DATA / "px4_offboard.tlog").read_bytes()[:-5])
    for source, options in (
        (cut, ("a.tlog",)),
        (cut, ("a.ulg",)),
        (cut, ("a", "--as", "csv")),
        (telemetry, ("b.mcap",)),
        (telemetry, ("b.ulg",)),
        (telemetry, ("b", "--as", "parquet")),
    ):
        done = CliRunner().invoke(app, ["convert", str(source), str(tmp_path / options[0]), *options[1:]])
        assert done.exit_code == FAILED and "cut off" in done.stderr and str(source) in done.stderr
        assert (tmp_path / options[0]).exists()


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.ZSTD, None])
def test_a_flight_log_with_bare_chunks_is_no_telemetry_log(tmp_path: Path, compression: CompressionType | None) -> None:
    """Nor one without chunks, whose frames and stamps lie there as in one."""
    heartbeat = bytes(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3).pack(dialect.MAVLink(None, 1, 1)))
    records = [(number * 10**6, DATAGRAM.pack(0, "", heartbeat)) for number in range(20)]
    topics = {DATAGRAM.topic: (DATAGRAM.schema_name, DATAGRAM.definition, records)}
    options = {"use_chunking": False} if compression is None else {"compression": compression}
    source = foreign(tmp_path / "a.mcap", topics, **options)
    assert not is_tlog(source)
    if compression is not None:
        assert convert(source, tmp_path / "a.tlog").problem is None
        assert [entry.data for entry in TlogReader(tmp_path / "a.tlog").entries()] == [heartbeat] * 20


def test_any_text_is_one_field_of_csv(tmp_path: Path) -> None:
    import pyarrow.csv

    words = ["plain", "a\rb", "a\nb", 'say "so"', "a,b", "", "=1+1", " \r\n "]
    messages = [dialect.MAVLink_statustext_message(4, word.encode()) for word in words]
    convert(telemetry_log(tmp_path / "a.tlog", *messages), tmp_path / "a", "csv")
    (path,) = (tmp_path / "a").iterdir()
    content = path.read_bytes().decode()
    assert [row["text"] for row in csv.DictReader(io.StringIO(content, newline=""))] == words
    options = pyarrow.csv.ParseOptions(newlines_in_values=True)
    strings = pyarrow.csv.ConvertOptions(column_types={"text": pyarrow.string()})
    table = pyarrow.csv.read_csv(path, parse_options=options, convert_options=strings)
    assert table["text"].to_pylist() == words


@pytest.mark.parametrize(("kind", "code", "largest"), [("float64", "d", 0.1), ("uint64", "Q", 2**64 - 1)])
def test_arrays_of_any_length_may_begin_empty(tmp_path: Path, kind: str, code: str, largest: float) -> None:
    """For more rows than are written together; and their numbers may be the largest of their type."""
    parquet = pytest.importorskip("pyarrow.parquet")
    records = [(number, struct.pack("<I", 0)) for number in range(5000)]
    records.append((5000, struct.pack(f"<I{code}{code}", 2, 1, largest)))
    source = foreign(tmp_path / "a.mcap", {"/arrays": ("x/A", f"{kind}[] values\n", records)})
    convert(source, tmp_path / "a", "parquet")
    column = parquet.read_table(tmp_path / "a" / "arrays.parquet")["values"].to_pylist()
    assert column == [[]] * 5000 + [[1, largest]]
    convert(source, tmp_path / "b", "csv")
    *_, last = csv.reader((tmp_path / "b" / "arrays.csv").open())
    assert last == ["5000", str((type(largest)(1), largest))]


def test_numbers_beside_a_text_are_those_of_their_type(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    definition = "string name\nfloat32 value\nuint64 time\nfloat32[2] pair\nfloat32[] more\n"
    packed = [struct.pack("<I1sfQffIf", 1, b"a", 0.15, time, 0.1, 2.5, 1, 0.3) for time in (1, 2**64 - 1)]
    source = foreign(tmp_path / "a.mcap", {"/mixed": ("x/A", definition, list(enumerate(packed)))})
    convert(source, tmp_path / "b", "csv")
    rows = list(csv.reader((tmp_path / "b" / "mixed.csv").open()))
    assert rows[0] == ["time_ns", "name", "value", "time", "pair[0]", "pair[1]", "more"]
    assert rows[1:] == [
        [f"{at}", "a", "0.15", f"{time}", "0.1", "2.5", "(0.3,)"] for at, time in ((0, 1), (1, 2**64 - 1))
    ]
    convert(source, tmp_path / "a", "parquet")
    table = parquet.read_table(tmp_path / "a" / "mixed.parquet")
    assert [str(table.schema.field(name).type) for name in ("value", "time")] == ["float", "uint64"]
    assert table["time"].to_pylist() == [1, 2**64 - 1]


def test_a_log_may_have_more_topics_than_a_process_may_have_files(tmp_path: Path) -> None:
    topics = {f"/{number}/X": ("x/A", "float32 x\n", [(at, bytes(4)) for at in range(2)]) for number in range(300)}
    source = foreign(tmp_path / "a.mcap", topics)
    most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (200, most[1]))
    try:
        written = convert(source, tmp_path / "csv", "csv").written
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, most)
    assert len(written) == 300 and all(line.startswith("2 rows") for line in written)


def test_topics_of_one_name_are_two_tables(tmp_path: Path) -> None:
    names = ("/a/b", "/a_b", "/A_b", "..", "", "/x" * 200, "ж" * 200)
    topics = {name: ("x/A", f"float32 x{number}\n", [(number, bytes(4))]) for number, name in enumerate(names)}
    source = foreign(tmp_path / "a.mcap", topics)
    for kind in ("csv", "parquet"):
        written = convert(source, tmp_path / kind, kind).written
        assert len(written) == len(names) == len(list((tmp_path / kind).iterdir()))
        assert len({path.name.casefold() for path in (tmp_path / kind).iterdir()}) == len(names)


@pytest.mark.parametrize("definition", ["float32 x\n", "string x\n"])
def test_a_record_that_is_cut_is_one_line(tmp_path: Path, definition: str) -> None:
    source = foreign(tmp_path / "a.mcap", {"/short": ("x/A", definition, [(10**9, b"\x09\0\0")])})
    for target in ("a.csv", "a.parquet", *(("a.ulg",) if "float" in definition else ())):
        form = {"a.csv": "csv", "a.parquet": "parquet"}.get(target)
        with pytest.raises(
            FlightLogError, match=r"a\.mcap: the record on /short at 1\.000 s is not as its schema says"
        ):
            convert(source, tmp_path / target, form)
        assert not (tmp_path / target).exists()


def test_messages_that_nobody_knows_come_back_as_they_were(tmp_path: Path) -> None:
    """At the start, alone, and where the start says no time."""
    known = bytes(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3).pack(dialect.MAVLink(None, 1, 1)))
    unknown = known[:7] + b"\x9a\x01" + known[9:]
    for number, frames in enumerate(([unknown, unknown, known], [unknown] * 3, [unknown, known, unknown])):
        source = telemetry_log(tmp_path / f"{number}.tlog", *frames)
        convert(source, tmp_path / f"{number}.mcap")
        convert(tmp_path / f"{number}.mcap", tmp_path / f"{number}_again.tlog")
        assert (tmp_path / f"{number}_again.tlog").read_bytes() == source.read_bytes()


def test_frames_that_span_two_reads_of_a_serial_line_are_in_a_tlog(tmp_path: Path) -> None:
    messages = [heartbeat(number) for number in range(1, 40)]
    convert(stream_log(tmp_path / "a.mcap", messages, 16), tmp_path / "a.tlog")
    found = [entry.data for entry in TlogReader(tmp_path / "a.tlog").entries()]
    assert [data for data in found if data in messages] == messages
    assert len({data for data in found if data not in messages}) == 1


@pytest.mark.parametrize("content", [b"", b"hello " * 100])
def test_what_is_no_log_is_not_called_one(tmp_path: Path, content: bytes) -> None:
    source = tmp_path / "a.txt"
    source.write_bytes(content)
    with pytest.raises(FlightLogError, match=r"a\.txt: (neither|an empty file)"):
        convert(source, tmp_path / "a.mcap")
    with pytest.raises(FlightLogError, match=r"none: No such file"):
        convert(tmp_path / "none", tmp_path / "a.mcap")


@pytest.mark.parametrize("started", ["nan", "inf", "1e300", "-1e11"])
def test_a_start_that_is_none_counts_from_1970(tmp_path: Path, started: str) -> None:
    heartbeat = bytes(dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3).pack(dialect.MAVLink(None, 1, 1)))
    records = [(10**9, DATAGRAM.pack(0, "", heartbeat))]
    metadata = {"flightlog": {"epoch_ns": "0"}, "flight": {"started_unix_s": started}}
    topics = {DATAGRAM.topic: (DATAGRAM.schema_name, DATAGRAM.definition, records)}
    convert(foreign(tmp_path / "a.mcap", topics, metadata), tmp_path / "a.tlog")
    assert [entry.time_us for entry in TlogReader(tmp_path / "a.tlog").entries()] == [10**6]


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_time_that_no_table_holds_is_named(form: Literal["csv", "parquet"], tmp_path: Path) -> None:
    records = [(0, struct.pack("<d", 1.0)), (2**63, struct.pack("<d", 2.0))]
    source = foreign(tmp_path / "a.mcap", {"/numbers": ("x/N", "float64 value\n", records)})
    with pytest.raises(FlightLogError, match=r"a\.mcap: a record's time is beyond 292 years"):
        convert(source, tmp_path / "a", form)
    assert not (tmp_path / "a").exists()
