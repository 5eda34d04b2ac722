"""The listing of a folder and its index."""

import json
import os
import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest

from companion.logs.index import INDEX_NAME, listing
from protocol.flightlog import FlightLogError, LogReader
from tests.flights.processes import run
from tests.logs.changed_logs import Flyer

DATA = Path(__file__).resolve().parents[1] / "data"


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
    assert (one.mission, one.result, one.faults) == ("hover", "landed", ())
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
    path = folder / INDEX_NAME
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
    for broken in (b"", b"{", b'{"version": 0, "entries": {}}', b'{"version": 1, "entries": {"a": 1}}'):
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
    with pytest.raises(FlightLogError, match="no such folder"):
        listing(tmp_path / "none")
    empty = tmp_path / "empty"
    empty.mkdir()
    assert run("companion", "logs", str(empty)).returncode == 0
