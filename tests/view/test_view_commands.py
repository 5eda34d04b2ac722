"""The commands as they are typed: where they write, what they say of what can't be used."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from companion.cli import app
from companion.shell import UNUSABLE
from tests.view.made_logs import make

DATA = Path(__file__).resolve().parent.parent / "data"


def test_a_folder_stands_for_the_flight_in_it(tmp_path: Path) -> None:
    make(tmp_path / "flight", 1.0)
    done = CliRunner().invoke(app, ["report", str(tmp_path / "flight")])
    assert done.exit_code == 0, done.output
    assert done.output == f"report: {tmp_path / 'flight' / 'report.html'}\n"


def test_a_telemetry_log_is_shown_without_being_converted_first(tmp_path: Path) -> None:
    log = tmp_path / "px4_offboard.tlog"
    shutil.copy(DATA / log.name, log)
    runner = CliRunner()
    assert runner.invoke(app, ["report", str(log)]).exit_code == 0
    assert runner.invoke(app, ["foxglove", str(log)]).exit_code == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["px4_offboard.tlog", "px4_offboard_foxglove.mcap", "px4_offboard_report.html"]
    assert log.read_bytes() == (DATA / log.name).read_bytes()


@pytest.mark.parametrize("command", ["report", "foxglove", "view"])
def test_a_log_that_is_not_there_is_one_line(tmp_path: Path, command: str) -> None:
    done = CliRunner().invoke(app, [command, str(tmp_path / "none.mcap")])
    assert done.exit_code == UNUSABLE
    assert len(done.output.splitlines()) == 1 and "none.mcap" in done.output


def test_control_needs_a_vehicle(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["view", str(tmp_path), "--control"])
    assert done.exit_code == UNUSABLE
    assert "--control needs the URL of a vehicle" in done.output


def test_an_unknown_world_is_one_line() -> None:
    done = CliRunner().invoke(app, ["view", "udpin:127.0.0.1:0", "--world", "nowhere"])
    assert done.exit_code == UNUSABLE
    assert len(done.output.splitlines()) == 1 and "nowhere" in done.output
