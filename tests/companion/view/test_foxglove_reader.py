"""Logs read as Foxglove reads them: by the libraries that it is made of, from npm (tests/foxglove/)."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from companion.view.foxglove import convert
from protocol.flightlog import LogReader
from protocol.toml_files import ROOT
from tests.companion.view.made_logs import Values, from_tlog, make

READER = ROOT / "tests" / "foxglove"
NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(
    NODE is None or not (READER / "node_modules").is_dir(), reason="not installed: npm ci --prefix tests/foxglove"
)


def read(path: Path) -> dict[str, Any]:
    done = subprocess.run([str(NODE), str(READER / "read.mjs"), str(path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def check(path: Path) -> dict[str, Any]:
    """Every topic and every message is there, by its schema and in order of time, and nothing is complained about."""
    found = read(path)
    assert found["complaints"] == []
    ours = LogReader(path).topics
    for topic, kind in ours.items():
        count = sum(1 for _ in LogReader(path).records((topic,)))
        if not count:
            continue
        assert found["topics"][topic]["schema"] == kind.schema_name
        assert found["topics"][topic]["fields"] == [field.name for field in kind.fields]
        assert found["topics"][topic]["messages"] == count
    topics: dict[str, Any] = found["topics"]
    return topics


def test_a_flight_and_what_is_drawn_of_it_open_without_a_warning(tmp_path: Path) -> None:
    def change(time: float, values: Values) -> None:
        values["guard_reason"] = 1.0 <= time < 1.5

    log = make(tmp_path, 4.0, change=change)
    assert "/courier/datagrams" in check(log)
    drawn = {topic: each["schema"] for topic, each in check(convert(log)[0]).items() if topic.startswith("/foxglove/")}
    assert len(drawn) == 12 and all(schema.startswith("foxglove.") for schema in drawn.values())


@pytest.mark.parametrize("name", ["px4_offboard", "ardupilot_guided"])
def test_flights_of_other_systems_do_too(tmp_path: Path, name: str) -> None:
    log = from_tlog(ROOT / "tests" / "data" / f"{name}.tlog", tmp_path)
    check(log)
    check(convert(log)[0])


def test_a_cut_log_is_refused_as_in_foxglove(tmp_path: Path) -> None:
    """Until it is repaired; so the reader does look."""
    path = tmp_path / "none.mcap"
    path.write_bytes(make(tmp_path, 0.2).read_bytes()[:-100])
    with pytest.raises(AssertionError, match=r"[Mm]agic|footer|index"):
        read(path)
