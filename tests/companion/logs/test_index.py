"""The listing of a folder and its index."""

import json
import math
import os
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.cli.view import _is_there
from companion.logs.index import index_of, listing
from companion.logs.recordings import flights
from companion.view.foxglove import convert as draw
from protocol.flightlog import DATAGRAM, FlightLogError, LogReader, Record
from protocol.messages import Encoder, dialect
from tests.companion.logs.changed_logs import Flyer, foreign, rewritten, telemetry_log
from tests.flights.processes import run


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


DATA = Path(__file__).resolve().parents[2] / "data"


@pytest.fixture
def folder(fly: Flyer, tmp_path: Path) -> Path:
    """A flight, the same cut off, another system's, and what is none."""
    (tmp_path / "one").mkdir()
    shutil.copy(fly(), tmp_path / "one" / "flight.mcap")
    (tmp_path / "two").mkdir()
    (tmp_path / "two" / "flight.mcap").write_bytes(fly().read_bytes()[:400_000])
    shutil.copy(DATA / "px4_offboard.tlog", tmp_path)
    (tmp_path / "broken.mcap").write_bytes(b"no log at all" * 20)
    (tmp_path / "notes.txt").write_text("nothing")
    return tmp_path


def test_what_it_says(folder: Path, fly: Flyer) -> None:
    rows = {row.log: row for row in listing(folder)}
    assert rows.keys() == {"one/flight.mcap", "two/flight.mcap", "px4_offboard.tlog", "broken.mcap"}
    one, two = rows["one/flight.mcap"], rows["two/flight.mcap"]
    assert (one.mission, one.result, one.faults) == ("hover", "flown", ())
    trace = LogReader(fly()).array("/companion/trace")
    span = np.ptp(trace["position_ned"][:, 2])
    assert one.distance_m is not None and one.distance_m >= span * 0.9
    assert (two.mission, two.result) == ("hover", "unfinished") and "cut off" in two.faults[0]
    assert two.duration_s < one.duration_s
    assert rows["px4_offboard.tlog"].result == "recorded" and (rows["px4_offboard.tlog"].distance_m or 0.0) > 4.0
    assert rows["broken.mcap"].result == "unreadable"
    times = [row.started_unix_s or 0.0 for row in listing(folder)]
    assert times == sorted(times, reverse=True)


def test_only_what_has_changed_is_looked_at_again(folder: Path) -> None:
    before = listing(folder)
    path = index_of(folder)
    index = msgspec.json.decode(path.read_bytes())
    for entry in index["entries"].values():
        entry["row"]["mission"] = "from the index"
    path.write_bytes(msgspec.json.encode(index))
    assert {row.mission for row in listing(folder)} == {"from the index"}
    changed = folder / "one" / "flight.mcap"
    os.utime(changed, ns=(1, 1))
    (folder / "broken.mcap").unlink()
    after = {row.log: row.mission for row in listing(folder)}
    assert after["one/flight.mcap"] == "hover" and after["two/flight.mcap"] == "from the index"
    assert "broken.mcap" not in after
    for broken in (b"", b"{", b'{"version": 0, "entries": {}}', b'{"version": 2, "entries": {"a": 1}}'):
        path.write_bytes(broken)
        again = listing(folder)
        assert [row for row in before if row.log != "broken.mcap"] == again


def test_the_command(folder: Path, tmp_path: Path) -> None:
    done = run("companion", "logs", str(folder))
    assert done.returncode == 0 and "one/flight.mcap" in done.stdout and "hover" in done.stdout
    rows = json.loads(run("companion", "logs", str(folder), "--json").stdout)
    assert {row["log"] for row in rows} == {row.log for row in listing(folder)}
    none = run("companion", "logs", str(tmp_path / "none"))
    assert none.returncode == 2 and len(none.stderr.splitlines()) == 1
    with pytest.raises(FlightLogError, match="No such file or directory"):
        listing(tmp_path / "none")
    for look in (listing, flights):
        with pytest.raises(FlightLogError, match="File name too long"):
            look(tmp_path / ("x" * 300))
    assert not _is_there(f"a:{'x' * 300}")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert run("companion", "logs", str(empty)).returncode == 0


def test_nothing_is_written_into_the_folder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever name leads there, it is one folder; without a cache there is no index."""
    before = sorted(folder.rglob("*"))
    rows = listing(folder)
    assert index_of(folder).exists() and index_of(folder / "one" / "..") == index_of(folder)
    assert index_of(folder / "one") != index_of(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "notes.txt"))
    assert listing(folder) == rows and sorted(folder.rglob("*")) == before


def test_what_was_drawn_from_a_flight_is_none(folder: Path) -> None:
    before = listing(folder)
    drawn = draw(folder / "one" / "flight.mcap").path
    drawn.rename(folder / "drawn.mcap")
    assert listing(folder) == before


def test_one_bad_log_hides_no_other(fly: Flyer, tmp_path: Path) -> None:
    """Damage that no checksum tells, nonsense for a date, a name that is not UTF-8."""
    for number, started in enumerate(("nan", "inf", "1e300", "-1e11")):
        rewritten(fly(), tmp_path / f"{number}.mcap", flight={"started_unix_s": started})

    def damaged(data: bytes, name: str) -> None:
        topics = {DATAGRAM.topic: (DATAGRAM.schema_name, DATAGRAM.definition, [(0, data)])}
        foreign(tmp_path / name, topics)

    damaged(DATAGRAM.pack(7, "", b"x"), "direction.mcap")
    damaged(DATAGRAM.pack(0, "", b"x" * 50)[:20], "short.mcap")
    stray = b"h\xf6ver.tlog".decode(errors="surrogateescape")
    telemetry_log(tmp_path / stray, dialect.MAVLink_heartbeat_message(2, 3, 81, 5, 4, 3))
    for _ in range(2):  # the second time from the index
        rows = {row.log: row for row in listing(tmp_path)}
        assert len(rows) == 7 and index_of(tmp_path).exists()
        for name in ("direction.mcap", "short.mcap"):
            assert rows[name].result == "unreadable" and "the datagram at 0.000 s is damaged" in rows[name].faults[0]
        for number in range(4):
            row = rows[f"{number}.mcap"]
            assert row.result == "flown" and (row.started_unix_s is None or row.started_unix_s > 0.0)
        (other,) = (row for row in rows.values() if "ver.tlog" in row.log)
        assert other.result == "recorded"
    done = run("companion", "logs", str(tmp_path))
    assert done.returncode == 0 and all(name in done.stdout for name in rows)


def test_a_trace_that_is_cut_is_said(fly: Flyer, tmp_path: Path) -> None:
    def cut(record: Record) -> list[Record]:
        return [record._replace(data=record.data[:3]) if record.topic == "/companion/loop" else record]

    rewritten(fly(), tmp_path / "a.mcap", cut)
    (row,) = listing(tmp_path)
    assert row.result == "unreadable" and row.faults[0]


def test_places_that_are_no_numbers_count_for_no_distance(tmp_path: Path) -> None:
    places = [(0.0, 0.0), (3.0, 4.0), (math.nan, 4.0), (1e30, 4.0), (3.0, 5.0)]
    telemetry_log(
        tmp_path / "a.tlog", *(dialect.MAVLink_local_position_ned_message(1, *place, 0, 0, 0, 0) for place in places)
    )
    (row,) = listing(tmp_path)
    assert row.distance_m == 6.0


def test_the_distance_between_two_vehicles_is_none_that_was_flown(tmp_path: Path) -> None:
    with (tmp_path / "two.tlog").open("wb") as file:
        for number in range(20):
            for system in (1, 2) if number % 2 else (1,):
                place = 1, 50.0 * system, 0.1 * number, 0, 0, 0, 0
                data = Encoder(system, 1).encode_fields(dialect.MAVLink_local_position_ned_message, *place)
                file.write((1_700_000_000_000_000 + number).to_bytes(8, "big") + data)
    (row,) = listing(tmp_path)
    assert row.distance_m == 1.9
