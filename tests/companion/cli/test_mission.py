"""`companion mission`, and what stands for a log that is not named."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from companion.cli.app import app
from companion.cli.shell import UNUSABLE, log_or_newest
from companion.logs.writer import Writer
from companion.mission.files import parse
from companion.runtime.files import load_mission
from tests.companion.mission.test_files import HOME, UP, A, B, at, do, plan


def ran(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(each) for each in arguments])
    return done.exit_code, done.output


def test_a_plan_is_shown_and_converted(tmp_path: Path) -> None:
    file = tmp_path / "trip.plan"
    file.write_text(plan([UP, at(*A, 2.0), at(*B), HOME]))
    code, shown = ran("mission", "show", file)
    assert code == 0 and [line.split()[1] for line in shown.split("\n\n")[0].splitlines()[1:]] == [
        "takeoff",
        *["route"] * 3,
        "land",
    ]
    assert "10.0" in shown and "20.0" in shown
    assert ran("mission", "convert", file, tmp_path / "trip.toml")[0] == 0
    assert load_mission(str(tmp_path / "trip.toml"))[0].waypoints[0].hold_s == 2.0
    assert ran("mission", "convert", file, tmp_path / "trip.waypoints")[0] == 0
    assert len(parse((tmp_path / "trip.waypoints").read_text()).items) == 4
    for target in ("trip.toml", "trip.kml"):
        code, said = ran("mission", "convert", file, tmp_path / target)
        assert code == UNUSABLE and target in said
    assert ran("mission", "show", "hover")[0] == 0


def test_what_can_not_be_flown_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "turns.plan"
    file.write_text(plan([UP, at(*A, 3.0, command=18), HOME]))
    for command in (("mission", "show", file), ("demo", file)):
        code, said = ran(*command)
        assert code == UNUSABLE and said == f"companion: {file}: item 2: NAV_LOITER_TURNS is not flown\n"
    assert ran("mission", "show", tmp_path / "none.plan")[0] == UNUSABLE
    file.write_text(plan([UP, do(17), HOME]))
    assert "item 2: NAV_LOITER_UNLIM" in ran("mission", "convert", file, tmp_path / "x.toml")[1]


def test_what_a_converted_file_does_not_hold_is_said(tmp_path: Path) -> None:
    file = tmp_path / "fenced.plan"
    circle = {"circle": {"center": at(0.0, 0.0, 1.0)[1][4:6], "radius": 80.5}, "inclusion": True, "version": 1}
    file.write_text(plan([UP, at(*A), HOME], geoFence={"circles": [circle], "version": 2}))
    toml, waypoints = tmp_path / "fenced.toml", tmp_path / "fenced.waypoints"
    said = ran("mission", "convert", file, toml)[1]
    assert f"{toml} does not hold the fence: --set geofence.radius=80\n" in said and "speed" not in said
    said = ran("mission", "convert", file, waypoints)[1]
    assert f"{waypoints} does not hold the speed: --set mission.speed=5\n" in said
    assert f"{waypoints} does not hold the fence\n" in said
    assert "does not hold" not in ran("mission", "convert", waypoints, tmp_path / "again.toml")[1]


def test_a_fence_without_room_is_one_line(tmp_path: Path) -> None:
    file = tmp_path / "tight.plan"
    circle = {"circle": {"center": at(*A)[1][4:6], "radius": A[0] + 0.5}, "inclusion": True, "version": 1}
    file.write_text(plan([UP, at(*A), HOME], geoFence={"circles": [circle], "version": 2}))
    for command in (("demo", file), ("mission", "show", file)):
        code, said = ran(*command)
        assert code == UNUSABLE and said.endswith(
            f"companion: {file}: its fence leaves 0.50 m around the take-off, and geofence.margin is 1 m\n"
        )


def test_waypoints_without_a_usable_curve_through_them_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "near.toml"
    places = "".join(f"[[waypoints]]\nnorth = 300.0\neast = {east}\nheight = 3.0\n" for east in ("0.0", "1e-9"))
    file.write_text(f'name = "near"\nprofile = "minimum_snap"\n{places}')
    for command in (("demo", file), ("mission", "show", file)):
        code, said = ran(*command)
        assert code == UNUSABLE and said.count("\n") == 1 and "its shortest leg has 1e-09 m, its longest 300 m" in said


def test_a_mission_that_leaves_its_own_fence_is_shown_as_one_that_can_not_be_flown(tmp_path: Path) -> None:
    file = tmp_path / "beyond.plan"
    for radius, ends in ((A[0] + 0.5, UNUSABLE), (A[0] + 1.1, 0)):
        circle = {"circle": {"center": at(0.0, 0.0, 1.0)[1][4:6], "radius": radius}, "inclusion": True, "version": 1}
        file.write_text(plan([UP, at(*A), HOME], geoFence={"circles": [circle], "version": 2}))
        code, said = ran("mission", "show", file)
        assert code == ends
        assert (f"{file}: the mission leaves its fence: route at north 10.0" in said) is bool(ends)


def test_the_newest_log_is_taken_where_none_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for command in ("info", "replay", "report"):
        assert ran(command) == (UNUSABLE, "companion: logs: there is no flight in it\n")
    (tmp_path / "logs" / "one").mkdir(parents=True)
    with Writer(tmp_path / "logs" / "one" / "flight.mcap", 0, {}):
        pass
    assert log_or_newest(None) == Path("logs/one/flight.mcap")
    assert log_or_newest(tmp_path) == tmp_path
    assert "logs/one/flight.mcap" in capsys.readouterr().err
