"""The commands as they are typed: where they write, what they say of what can't be used."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.shell import ABANDONED, FAILED, UNUSABLE
from companion.cli.view import flight_log
from companion.view.foxglove import Converter
from protocol.flightlog import LogReader
from tests.companion.view.made_logs import make

DATA = Path(__file__).resolve().parents[2] / "data"


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


def test_a_telemetry_log_keeps_its_name_and_its_date(tmp_path: Path) -> None:
    source = DATA / "px4_offboard.tlog"
    with flight_log(source) as shown:
        flight = LogReader(shown.path).metadata["flight"]
    assert flight["source"] == str(source) and shown.problem is None
    assert float(flight["started_unix_s"]) == pytest.approx(int.from_bytes(source.read_bytes()[:8], "big") * 1e-6)


def test_what_is_whole_of_a_damaged_log_is_drawn_and_it_is_said(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(make(tmp_path, 1.0).read_bytes()[:-100])
    telemetry = tmp_path / "cut.tlog"
    telemetry.write_bytes((DATA / "px4_offboard.tlog").read_bytes()[:-5])
    for log in (cut, telemetry):
        done = CliRunner().invoke(app, ["foxglove", str(log)])
        assert done.exit_code == FAILED and "cut" in done.stderr and str(log) in done.stderr
        assert log.with_name("cut_foxglove.mcap").exists()
        done = CliRunner().invoke(app, ["report", str(log)])
        assert done.exit_code == FAILED and "cut" in done.stderr and str(log) in done.stderr
        assert log.with_name("cut_report.html").exists()


@pytest.mark.parametrize("command", ["report", "foxglove", "view"])
def test_nothing_is_made_of_nothing(tmp_path: Path, command: str) -> None:
    log = tmp_path / "empty.tlog"
    log.touch()
    done = CliRunner().invoke(app, [command, str(log)])
    assert done.exit_code == UNUSABLE and done.output == f"companion: {log}: an empty file\n"
    assert list(tmp_path.iterdir()) == [log]


def test_ctrl_c_while_drawing_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where it comes while protobuf works, which makes something else of it."""
    log = make(tmp_path, 1.0)

    def interrupted(self: Converter) -> int:
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(Converter, "run", interrupted)
    assert CliRunner().invoke(app, ["foxglove", str(log)]).exit_code == ABANDONED
    assert list(tmp_path.iterdir()) == [log]
