"""Logs of other tools under names of ours: what is whole is shown, or one line says why not."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.known_topics import _MESSAGES, is_foreign
from companion.logs.convert.tables import to_tables
from companion.logs.convert.ulog import to_ulog
from companion.logs.index import describe
from companion.logs.info import info
from companion.logs.replay import replay
from companion.logs.writer import Writer
from companion.records import LEGACY_REQUEST, LOGGED, LOOP, OPERATION, PLANNED, TICK, TRACE
from companion.runtime.summary import summarize
from companion.view.finding import Finding
from companion.view.findings import findings
from companion.view.foxglove import convert
from companion.view.gather import GatheredFlight
from companion.view.report import compose
from companion.view.sources import FinishedLog, GrowingLog
from protocol.flightlog import DATAGRAM, TEXT, Direction, FlightLogError, LogReader, RecordType
from protocol.messages import Encoder, dialect
from tests.companion.logs.changed_logs import foreign
from tests.companion.test_known_topics import changed, lines, message, name_of, needed
from tests.companion.view.test_live import filled
from tests.golden.golden import path_of

TOPICS = (LOGGED, LOOP, TEXT, DATAGRAM, TICK, PLANNED, OPERATION, LEGACY_REQUEST, *map(message, _MESSAGES))
VALUES = {"frame": dialect.MAV_FRAME_BODY_FRD, "max_distance": 500, "q2": 0, "q3": 0, "q4": 0, "base_mode": 255}
"""Those of a record that are not 1."""


def _report(path: Path, folder: Path) -> None:
    compose(GatheredFlight(path))


def _view(path: Path, folder: Path) -> None:
    for source in (FinishedLog(LogReader(path)), GrowingLog(path)):
        history = filled(source)
        moment = history.at(history.end)
        assert moment.time == history.end and list(history.scans(-1.0, 10.0)) is not None
        history.phases(), history.modes(), history.clearance(0.0, 10.0)


def _drawn(path: Path, folder: Path) -> None:
    convert(path, folder / "drawn.mcap")


def _told(path: Path, folder: Path) -> None:
    info(path, check=True)


def _listed(path: Path, folder: Path) -> None:
    row = describe(path, "a")
    if row.result == "unreadable":
        raise FlightLogError(*row.faults)


def _summary(path: Path, folder: Path) -> None:
    summarize(path)


def _table(path: Path, folder: Path) -> None:
    to_tables(LogReader(path), folder / "tables", "csv")


def _ulog(path: Path, folder: Path) -> None:
    to_ulog(LogReader(path), folder / "a.ulg")


READERS: list[Callable[[Path, Path], None]] = [_report, _view, _drawn, _told, _listed, _summary, _table, _ulog]
every_reader = pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)


def _values(kind: RecordType) -> Iterator[Any]:
    for field in kind.fields:
        value = VALUES.get(field.name, 1)
        if field.kind == "string":
            yield "said"
        elif field.is_variable:
            yield b"x" if field.kind == "uint8" else [value]
        else:
            yield from [value] * field.values


def made(path: Path, kinds: dict[RecordType, bytes], *, flight: bool = True) -> Path:
    """A log with three records of each type, of a flight that was cut off, or of another tool."""
    with Writer(path, 10**18, {"flight": {"mission": "made"}} if flight else {}) as writer:
        for number in range(3):
            for kind, data in kinds.items():
                writer.record(kind, 10**8 * number, number, data)
    return path


def _other(text: str, size: int) -> dict[RecordType, bytes]:
    return {RecordType(kind.topic, "other/Kind", text): bytes(size) for kind in TOPICS}


@every_reader
@pytest.mark.parametrize(("text", "size"), [("float32 x", 4), ("string x", 4), ("uint8[] x\nuint8 y", 5)])
def test_other_fields_under_a_known_name_are_left_out(
    tmp_path: Path, reader: Callable[[Path, Path], None], text: str, size: int
) -> None:
    kinds = {kind: data for kind, data in _other(text, size).items() if kind.topic != DATAGRAM.topic}
    reader(made(tmp_path / "a.mcap", kinds), tmp_path)


@every_reader
@pytest.mark.parametrize("kind", TOPICS, ids=lambda kind: kind.topic)
def test_a_record_that_is_too_short_is_left_out_or_said_in_a_line(
    tmp_path: Path, reader: Callable[[Path, Path], None], kind: RecordType
) -> None:
    """The report and the page leave it out; a verdict is not made of it."""
    for flight in (False, True):
        folder = tmp_path / str(flight)
        folder.mkdir()
        try:
            reader(made(folder / "a.mcap", {kind: b"\xff"}, flight=flight), folder)
        except FlightLogError as error:
            assert "not as its schema says" in str(error) or "is damaged" in str(error)
            assert flight or reader not in (_report, _view)


@every_reader
def test_the_fields_that_a_topic_is_known_by_are_all_that_is_read_of_it(
    tmp_path: Path, reader: Callable[[Path, Path], None]
) -> None:
    """In each form that it had."""
    before = [line for line in lines(TRACE) if not name_of(line).startswith("guard_")]
    for number, trace in enumerate((LOGGED, TRACE, changed(TRACE, before))):
        bare = {changed(kind, needed(kind)) for kind in (trace, *TOPICS[1:])}
        if number:
            bare = {kind for kind in bare if kind.topic != LOOP.topic} | {
                RecordType(LOOP.topic, "x/L", "int64 latency_ns")
            }
        assert not any(map(is_foreign, bare))
        folder = tmp_path / str(number)
        folder.mkdir()
        reader(made(folder / "a.mcap", {kind: kind.pack(*_values(kind)) for kind in bare}), folder)


def _log_findings(path: Path) -> list[Finding]:
    return [each for each in findings(GatheredFlight(path)) if each.text.startswith("Left out")]


def test_the_report_says_what_is_left_out(tmp_path: Path) -> None:
    kinds = {**_other("float32 x", 4), RecordType("/own", "x/X", "float32 x"): bytes(4)}
    log = made(tmp_path / "a.mcap", kinds, flight=False)
    flight = GatheredFlight(log)
    assert [row.topic for row in compose(flight).topics] == ["/own"]
    (found,) = _log_findings(log)
    assert set(found.evidence) == {kind.topic for kind in TOPICS}
    sound = {kind: kind.pack(*_values(kind)) for kind in TOPICS}
    assert _log_findings(made(tmp_path / "b.mcap", sound)) == []


def test_beside_a_trace_of_another_tool_the_vehicle_s_positions_are_the_way(tmp_path: Path) -> None:
    vehicle, foreign_trace = Encoder(1, 1), RecordType(TRACE.topic, "other/Kind", "float32 x")
    with Writer(tmp_path / "a.mcap", 10**18, {}) as writer:
        for number, north in enumerate((0.0, 3.0, 7.0)):
            told = vehicle.encode_fields(dialect.MAVLink_local_position_ned_message, number, north, 0, 0, 0, 0, 0)
            writer.datagram(10**8 * number, number, Direction.IN, "", told)
            writer.record(foreign_trace, 10**8 * number, number, bytes(4))
    row = describe(tmp_path / "a.mcap", "a")
    assert (row.distance_m, row.clearance_m) == (7.0, None)


@every_reader
def test_a_topic_without_fields_is_no_trouble(tmp_path: Path, reader: Callable[[Path, Path], None]) -> None:
    empty, number = RecordType("/ping", "std_msgs/Empty", ""), RecordType("/number", "std_msgs/Int32", "int32 data")
    for name, kinds in (("alone", {empty: b""}), ("beside", {empty: b"", number: bytes(4)})):
        folder = tmp_path / name
        folder.mkdir()
        reader(made(folder / "a.mcap", kinds, flight=False), folder)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_the_times_of_a_topic_without_fields_are_its_table(tmp_path: Path, kind: Any) -> None:
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    log = made(tmp_path / "a.mcap", {RecordType("/ping", "std_msgs/Empty", ""): b""}, flight=False)
    assert to_tables(LogReader(log), tmp_path / "tables", kind) == {f"ping.{kind}": 3}
    if kind == "csv":
        assert (tmp_path / "tables" / "ping.csv").read_text().split() == ["time_ns", "0", "100000000", "200000000"]


@pytest.mark.parametrize("reader", [_report, _view, _table])
def test_a_time_beyond_all_clocks_is_said_in_a_line(tmp_path: Path, reader: Callable[[Path, Path], None]) -> None:
    log = foreign(tmp_path / "a.mcap", {"/number": ("std_msgs/Int32", "int32 data\n", [((1 << 63) + 5, bytes(4))])})
    with pytest.raises(FlightLogError, match="beyond 292 years"):
        reader(log, tmp_path)


def flown(target: Path, topic: str, kind: RecordType | None = None, data: bytes | None = None) -> Path:
    """The first second of a golden flight, with another type of record on a topic, and other data in its records."""
    log = LogReader(path_of("rates_lockstep"))
    kinds = {**log.topics, topic: kind or log.topics[topic]}
    metadata = {name: table for name, table in log.metadata.items() if name != "flightlog"}
    records = (record for record in log.records() if record.time_ns < 10**9)
    with Writer(target, log.epoch_ns, metadata) as writer:
        for name, content in log.attachments.items():
            writer.attach(name, content)
        for each in records:
            told = each.data if each.topic != topic or data is None else data
            writer.record(kinds[each.topic], each.time_ns, each.sequence, told)
    return target


@pytest.mark.parametrize("topic", [TICK.topic, PLANNED.topic])
def test_a_replay_leaves_out_what_is_not_what_its_name_says(tmp_path: Path, topic: str) -> None:
    log = flown(tmp_path / "a.mcap", topic, RecordType(topic, "other/Kind", "float32 x"), bytes(4))
    assert f"{topic} is left out: it has not the fields that the name says" in replay(log).notes


@pytest.mark.parametrize("topic", [TICK.topic, PLANNED.topic, DATAGRAM.topic])
def test_a_replay_says_in_a_line_which_record_is_too_short(tmp_path: Path, topic: str) -> None:
    with pytest.raises(FlightLogError, match=r"at 0\.\d+ s is (not as its schema says|damaged)"):
        replay(flown(tmp_path / "a.mcap", topic, data=b"\0"))


@pytest.mark.parametrize("data", [b"\1", b"\xff\0\0\0\0"])
def test_a_replay_says_in_a_line_which_operation_it_can_not_do(tmp_path: Path, data: bytes) -> None:
    """Too short, or of a kind that is not known."""
    with pytest.raises(FlightLogError, match=r"the operation at 0\.004 s is damaged"):
        replay(flown(tmp_path / "a.mcap", TICK.topic, OPERATION, data))


def test_traffic_of_other_fields_is_no_traffic(tmp_path: Path) -> None:
    with pytest.raises(FlightLogError, match="there is nothing in it that was sent"):
        replay(flown(tmp_path / "a.mcap", DATAGRAM.topic, RecordType(DATAGRAM.topic, "x/D", "float32 x"), bytes(4)))
