"""Missions: what the files say, what is flown, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from companion.curves import Route, Shape
from companion.mission.plan import Delivery, Phase, steps
from companion.runtime.files import load_mission
from protocol.toml_files import ROOT, TomlFileError

HEAD = 'name = "mine"\n'
WAYPOINT = "[[waypoints]]\nnorth = 1.0\neast = 2.0\nheight = 3.0\n"
SHAPE = '[trajectory]\nshape = "{0}"\nspeed = 2.0\n'
MISSIONS = sorted(path.stem for path in (ROOT / "missions").glob("*.toml"))
START = np.array([5.0, 6.0, 0.5])


def refused(tmp_path: Path, text: str) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + text)
    with pytest.raises(TomlFileError) as refusal:
        load_mission(str(path))
    assert "mine.toml" in str(refusal.value)
    return str(refusal.value)


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_takes_off_first_and_lands_last(name: str) -> None:
    mission, path = load_mission(name)
    assert mission.name == path.stem
    plan = steps(mission, START)
    assert plan[0].phase is Phase.TAKEOFF and plan[-1].phase is Phase.LAND
    assert np.array_equal(plan[0].target_ned, START - [0.0, 0.0, mission.takeoff_height])  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["far/near", "two words", r"line\n", r"\nline", ""])
def test_a_name_is_one_of_a_folder(name: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(HEAD.replace("mine", name) + WAYPOINT)
    with pytest.raises(TomlFileError, match=r"mine\.toml: .* - at `name`"):
        load_mission(str(path))


def test_a_shape_begins_over_the_place_of_take_off_or_where_it_is_put(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + "takeoff_height = 4.0\n" + SHAPE.format("circle") + "radius = 2.0\n")
    mission, _ = load_mission(str(path))
    phases = [step.phase for step in steps(mission, START)]
    assert phases == [Phase.TAKEOFF, Phase.TRACK, Phase.RETURN, Phase.LAND]
    track = steps(mission, START)[1]
    assert track.target_ned is not None and track.curve is mission.trajectory
    assert track.target_ned.tolist() == [5.0, 6.0, -3.5]
    elsewhere, _ = load_mission(str(path), ["trajectory.north=10.0", "trajectory.east=-1.0", "trajectory.height=7.0"])
    track = steps(elsewhere, START)[1]
    assert track.target_ned is not None and track.target_ned.tolist() == [15.0, 5.0, -6.5]


def test_one_curve_up_to_each_hold(tmp_path: Path) -> None:
    """And none where there is no way; the return is one curve, whatever was held before."""
    path = tmp_path / "mine.toml"
    places = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    holds = (1.0, 0.0, 2.0, 0.0)
    waypoints = "".join(
        f"[[waypoints]]\nnorth = {north}\neast = {east}\nheight = 3.0\nhold_s = {hold_s}\n"
        for (north, east), hold_s in zip(places, holds, strict=True)
    )
    path.write_text(HEAD + 'profile = "minimum_snap"\nspeed = 7.0\n' + waypoints)
    plan = steps(load_mission(str(path))[0], START)
    phases = ["TAKEOFF", "ROUTE", "TRACK", "ROUTE", "TRACK", "RETURN", "RETURN", "LAND"]
    assert [step.phase.name for step in plan] == phases
    assert [step.hold_s for step in plan] == [0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]
    assert not any(step.avoids for step in plan)
    out, further, back = (step for step in plan if step.curve is not None)
    for step, expected in (
        (out, [[0, 0], [10, 0], [10, 10]]),
        (further, [[10, 10], [0, 10]]),
        (back, [[0, 10], [10, 10], [10, 0], [0, 0]]),
    ):
        assert isinstance(step.curve, Route) and step.curve.speed == 7.0 and step.target_ned is not None
        places_ned = step.target_ned + step.curve.points_ned - START
        assert np.allclose(places_ned, [[*place, -3.0] for place in expected])


def test_the_numbers_of_the_phases_stay() -> None:
    """They are in logs."""
    assert {phase.name: phase.value for phase in Phase} == {
        "PREPARE": 0,
        "TAKEOFF": 1,
        "ROUTE": 2,
        "DESCEND": 3,
        "RELEASE": 4,
        "CLIMB": 5,
        "RETURN": 6,
        "LAND": 7,
        "DONE": 8,
        "TRACK": 9,
        "WAIT": 10,
    }


def test_waypoints_or_a_trajectory(tmp_path: Path) -> None:
    circle = SHAPE.format("circle") + "radius = 2.0\n"
    assert "waypoints" in refused(tmp_path, "")
    assert "waypoints" in refused(tmp_path, WAYPOINT + circle)
    assert "profile" in refused(tmp_path, 'profile = "step"\n' + circle)
    assert "profile" in refused(tmp_path, 'profile = "rough"\n' + WAYPOINT)
    assert "delivery" in refused(tmp_path, circle + "[delivery]\n")


@pytest.mark.parametrize(
    ("shape", "lines", "word"),
    [
        ("circle", "radius = 0.0", "trajectory.radius"),
        ("circle", "radius = -1.0", "trajectory.radius"),
        ("circle", "", "radius"),
        ("circle", "radius = 1.0\nacceleration = 2.0", "radius"),
        ("lemniscate", "acceleration = 2.0", "acceleration"),
        ("helix", "acceleration = 2.0", "acceleration"),
        ("circle", "radius = 1.0\npitch = 1.0", "pitch"),
        ("helix", "radius = 1.0\nminor_radius = 1.0", "minor_radius"),
        ("ellipse", "radius = 1.0\nminor_radius = 1.5", "minor_radius"),
        ("ellipse", "acceleration = 4.0\nminor_radius = 1.5", "minor_radius"),
        ("circle", "radius = 1.0\nlaps = 0", "trajectory.laps"),
        ("circle", "radius = 1.0\nramp_s = -1.0", "trajectory.ramp_s"),
        ("circle", 'radius = 1.0\nheading = "up"', "trajectory.heading"),
        ("triangle", "radius = 1.0", "trajectory.shape"),
        ("circle", "radius = 1.0\nradios = 1.0", "radios"),
    ],
)
def test_impossible_shapes_are_refused_with_file_and_key(tmp_path: Path, shape: str, lines: str, word: str) -> None:
    assert word in refused(tmp_path, SHAPE.format(shape) + lines + "\n")


def test_a_height_beyond_what_messages_hold_is_refused_with_its_key(tmp_path: Path) -> None:
    circle = SHAPE.format("circle") + "radius = 2.0\n"
    for text, key in (
        (WAYPOINT.replace("3.0", "1e39"), "waypoints[0].height"),
        ("takeoff_height = 1e39\n" + WAYPOINT, "takeoff_height"),
        (WAYPOINT + "[delivery]\nrelease_height = 1e39\n", "delivery.release_height"),
        (circle + "height = 1e39\n", "trajectory.height"),
    ):
        assert f"<= 10000.0 - at `{key}`" in refused(tmp_path, text)


def test_a_descent_that_would_climb_is_refused_with_its_key(tmp_path: Path) -> None:
    text = WAYPOINT + "[delivery]\nrelease_height = {}\n"
    assert "delivery.release_height 3.1: above the last waypoint, at 3" in refused(tmp_path, text.format(3.1))
    (tmp_path / "level.toml").write_text(HEAD + text.format(3.0))
    assert load_mission(str(tmp_path / "level.toml"))[0].delivery == Delivery(3.0)


def test_speeds_and_sizes_that_nothing_flies_are_refused_with_their_key(tmp_path: Path) -> None:
    circle, at_most = SHAPE.format("circle"), "<= 1000.0 - at `{}`"
    for text, words in (
        ("speed = 1e300\n" + WAYPOINT, at_most.format("speed")),
        (WAYPOINT + "speed = 1e300\n", at_most.format("waypoints[0].speed")),
        (circle.replace("2.0", "1e200") + "acceleration = 1.0\n", at_most.format("trajectory.speed")),
        (circle + "radius = 1e300\n", "<= 10000.0 - at `trajectory.radius`"),
        (circle + "acceleration = 1e-300\n", ">= 1e-09 - at `trajectory.acceleration`"),
        (circle + "acceleration = 1e-8\n", "acceleration: at 2 m/s the radius is 4e+08 m, up to 10000"),
        (circle.replace("2.0", "1e-8") + "acceleration = 1.0\n", "acceleration: at 1e-08 m/s the radius is 1e-16 m"),
    ):
        assert words in refused(tmp_path, text)


def test_radius_from_speed_and_acceleration() -> None:
    assert Shape("circle", speed=6.0, acceleration=12.0).size == 3.0
