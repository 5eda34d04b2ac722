"""Ground stations' files: read as their own tools read them, flown where they say, refused with the item's number."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil, mavwp

from companion.curves import Shape
from companion.mission.files import (
    MissionFileError,
    fence_radius,
    parse,
    to_mission,
    to_toml,
    to_waypoints,
)
from companion.mission.plan import Delivery, Mission, Phase, Waypoint, steps
from companion.runtime.files import load_mission, load_settings
from companion.runtime.station_files import fenced, load_of_station, origin_of
from protocol.frames import to_geodetic, to_local
from protocol.messages import dialect
from protocol.toml_files import TomlFileError
from studies.joined import Joined

ORIGIN = origin_of("empty")
RADIANS = math.radians(ORIGIN[0]), math.radians(ORIGIN[1]), 0.0
NAN = math.nan
TAKEOFF, WAYPOINT, LOITER, RTL, LAND, DELAY, YAW, SPEED, GRIPPER, JUMP = 22, 16, 19, 20, 21, 93, 115, 178, 211, 177


def at(north: float, east: float, height: float, *params: float, command: int = WAYPOINT) -> tuple[int, list[float]]:
    """An item at a place around the origin, m."""
    latitude, longitude, _ = to_geodetic(np.array([north, east, 0.0]), RADIANS)
    four = [*params, 0.0, 0.0, 0.0, 0.0][:4]
    return command, [*four, round(math.degrees(latitude), 8), round(math.degrees(longitude), 8), height]


def do(command: int, *params: float) -> tuple[int, list[float]]:
    return command, [*params, *[0.0] * 7][:7]


UP, HOME, DOWN = (TAKEOFF, [0.0, 0.0, 0.0, NAN, 0.0, 0.0, 5.0]), do(RTL), do(LAND)
Items = list[tuple[int, list[float]]]


def wpl(items: Items, frame: int = 3) -> str:
    """As Mission Planner writes it: item 0 is home."""
    lines = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{ORIGIN[0]:.8f}\t{ORIGIN[1]:.8f}\t488.0\t1"]
    for number, (command, params) in enumerate(items, 1):
        numbers = "\t".join(f"{0.0 if math.isnan(value) else value:.8f}" for value in params)
        lines.append(f"{number}\t0\t{frame}\t{command}\t{numbers}\t1")
    return "\r\n".join(lines) + "\r\n"


def plan(items: Items, **changes: Any) -> str:
    """As QGroundControl writes it."""
    simple = [
        {
            "type": "SimpleItem", "autoContinue": True, "command": command, "doJumpId": number, "frame": 3,
            "params": [None if math.isnan(value) else value for value in params],
        }
        for number, (command, params) in enumerate(items, 1)
    ]  # fmt: skip
    tables: dict[str, Any] = {
        "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "rallyPoints": {"points": [], "version": 2},
        "mission": {"version": 2, "firmwareType": 12, "vehicleType": 2, "cruiseSpeed": 15, "hoverSpeed": 5.0,
                    "plannedHomePosition": [*ORIGIN, 488.0], "items": simple},
    }  # fmt: skip
    return json.dumps(tables | changes)


def flown(text: str) -> Mission:
    return to_mission(parse(text), ORIGIN, "a plan (1)")


def places(mission: Mission) -> list[tuple[float, float, float]]:
    return [(round(each.north, 2), round(each.east, 2), each.height) for each in mission.waypoints]


A, B, C = (10.0, 0.0, 5.0), (10.0, 20.0, 6.0), (-5.0, 20.0, 4.0)
HOME_AT = (0.0, 0.0)


@pytest.mark.parametrize("write", [wpl, plan])
@pytest.mark.parametrize(
    ("items", "waypoints"),
    [
        ([UP, at(*A), at(*B), HOME], [A, B, (*HOME_AT, 6.0)]),
        ([UP, at(*A), at(*B), DOWN], [A, B]),
        ([UP, at(*A), at(*C, command=LAND)], [A, (-5.0, 20.0, 5.0)]),
        ([UP, DOWN], [(*HOME_AT, 5.0)]),
        ([UP, HOME], [(*HOME_AT, 5.0), (*HOME_AT, 5.0)]),
        ([UP, at(*A), at(*B), do(JUMP, 2, 2), HOME], [A, B, A, B, A, B, (*HOME_AT, 6.0)]),
        ([UP, at(*A), do(JUMP, 4, 1), at(*B), HOME], [A, B, (*HOME_AT, 6.0)]),
    ],
)
def test_the_way_is_that_of_the_items(write: Any, items: Items, waypoints: list[tuple[float, float, float]]) -> None:
    mission = flown(write(items))
    assert places(mission) == waypoints
    assert mission.name == "a-plan-1" and mission.takeoff_height == 5.0 and not mission.return_home
    assert [step.phase for step in steps(mission, np.zeros(3))][-2:] == [Phase.ROUTE, Phase.LAND]


@pytest.mark.parametrize("write", [wpl, plan])
def test_what_is_done_on_the_way(write: Any) -> None:
    items = [
        UP, do(SPEED, 1, 3.0, -1), at(*A, 2.0), do(DELAY, 1.5), do(YAW, 90.0), at(*B, 4.0, command=LOITER),
        do(SPEED, 1, 6.0, -1), at(*C), do(GRIPPER, 1, 0), HOME,
    ]  # fmt: skip
    mission = flown(write(items))
    assert [each.speed for each in mission.waypoints] == [3.0, 3.0, 6.0, 6.0]
    assert [each.hold_s for each in mission.waypoints] == [3.5, 4.0, 0.0, 0.0]
    assert [each.yaw_deg for each in mission.waypoints] == [90.0, None, None, None]
    assert [each.release for each in mission.waypoints] == [False, False, True, False] and mission.parcels == 1
    phases = [step.phase.name for step in steps(mission, np.zeros(3))]
    assert phases == ["TAKEOFF", "ROUTE", "ROUTE", "ROUTE", "RELEASE", "ROUTE", "LAND"]
    assert not steps(mission, np.zeros(3))[3].passes, "it stops to release"


@pytest.mark.parametrize(
    ("items", "number", "why"),
    [
        ([at(*A), HOME], 1, "take-off"),
        ([UP, at(*A)], 2, "ends in the air"),
        ([UP, HOME, at(*A)], 3, "after the landing"),
        ([UP, UP, HOME], 2, "second take-off"),
        ([UP, do(17), HOME], 2, "NAV_LOITER_UNLIM"),
        ([UP, at(*A, 3.0, command=18), HOME], 2, "NAV_LOITER_TURNS"),
        ([UP, at(*A), do(201), HOME], 3, "DO_SET_ROI"),
        ([UP, at(*A), do(60000), HOME], 3, "60000"),
        ([UP, at(10.0, 0.0, -1.0), HOME], 2, "-1 m"),
        ([UP, (WAYPOINT, [0.0] * 6 + [5.0]), HOME], 2, "no latitude"),
        ([UP, at(*A), do(JUMP, 2, -1), HOME], 3, "for ever"),
        ([UP, at(*A), do(JUMP, 2, math.inf), HOME], 3, "for ever"),
        ([UP, at(*A), do(JUMP, 9, 1), HOME], 3, "item 9"),
        ([UP, at(*A), do(JUMP, 2, 5001), HOME], 3, "more than 1000"),
        ([UP, at(*A), do(GRIPPER, 1, 1), HOME], 3, "opened alone"),
        ([UP, at(*A), do(GRIPPER, 1, 0), do(GRIPPER, 1, 0), HOME], 4, "before"),
        ([UP, at(*A), do(DELAY, -1, 12, 0, 0), HOME], 3, "time of the day"),
        ([UP, at(*A), do(YAW, 90, 0, 1, 1), HOME], 3, "by an angle"),
        ([UP, at(*A), do(SPEED, 2, 3), HOME], 3, "type 2"),
        ([UP, at(12_000.0, 0.0, 5.0), HOME], 2, "12 km from the take-off"),
        ([UP, at(*A), at(0.0, 30_000.0, 5.0, command=LAND)], 3, "30 km from the take-off"),
        ([UP, at(*A, math.inf), HOME], 2, "for ever"),
        ([UP, at(*A), do(DELAY, math.inf), HOME], 3, "for ever"),
        ([UP, at(*A, 0.0, 0.0, 0.0, math.inf), HOME], 2, "no heading"),
        ([UP, at(*A), do(YAW, math.inf), HOME], 3, "no heading"),
        ([UP, at(*A), do(YAW, -math.inf), HOME], 3, "no heading"),
    ],
)
def test_what_can_not_be_flown_is_refused_with_its_number(items: Items, number: int, why: str) -> None:
    for text in (wpl(items), plan(items)):
        with pytest.raises(MissionFileError, match=rf"^item {number}: ") as caught:
            flown(text)
        assert why in str(caught.value)


def test_altitudes_are_above_the_take_off() -> None:
    for frame in (0, 10):
        with pytest.raises(MissionFileError, match=r"item 1: .*frame"):
            flown(wpl([UP, at(*A), HOME], frame))


@pytest.mark.parametrize("frame", [0, 10])
def test_an_altitude_without_a_place_is_above_the_take_off_too(frame: int) -> None:
    text = wpl([UP, at(*A), do(LOITER, 5, 0, 0, 0, 0, 0, 550), HOME]).replace(f"3\t{LOITER}\t", f"{frame}\t{LOITER}\t")
    with pytest.raises(MissionFileError, match=rf"item 3: .*frame {frame}"):
        flown(text)


def test_a_turn_that_leaves_its_heading_open_is_refused() -> None:
    with pytest.raises(MissionFileError, match=r"^item 3: nan is no heading"):
        flown(plan([UP, at(*A), do(YAW, NAN), HOME]))


def test_a_jump_that_leaves_its_number_open_is_refused() -> None:
    with pytest.raises(MissionFileError, match="item 3: it does not say how many times"):
        flown(plan([UP, at(*A), do(JUMP, 2, NAN), HOME]))


def test_a_byte_order_mark_is_no_part_of_a_file() -> None:
    items = [UP, at(*A), HOME]
    for text in (wpl(items), plan(items)):
        assert flown(f"\ufeff{text}") == flown(text)


def test_numbers_and_nestings_beyond_all_bounds_are_no_plan() -> None:
    whole = plan([UP, at(*A), HOME])
    for number, other in (
        ('"frame": 3', '"frame": Infinity'),
        ('"doJumpId": 2', '"doJumpId": [2]'),
        ('"hoverSpeed": 5.0', f'"hoverSpeed": {10**400}'),
    ):
        assert number in whole
        with pytest.raises(MissionFileError, match="no plan"):
            parse(whole.replace(number, other))
    with pytest.raises(MissionFileError, match="JSON"):
        parse("[" * 200_000)


def test_files_that_are_none() -> None:
    for text in ("", "nothing", "{}", "[]", "QGC WPL 100\n", "QGC WPL 110\n1 0 3 16 x\n", '{"fileType": "Settings"}'):
        with pytest.raises(MissionFileError):
            to_mission(parse(text), ORIGIN, "x")
    survey = json.loads(plan([UP, at(*A), HOME]))
    survey["mission"]["items"][1] = {"type": "ComplexItem", "complexItemType": "survey"}
    with pytest.raises(MissionFileError, match=r"item 2: a pattern \(survey\)"):
        parse(json.dumps(survey))


def test_the_fence_is_kept_inside_of() -> None:
    def circle(north: float, radius: float, inclusion: bool = True) -> dict[str, Any]:
        _, params = at(north, 0.0, 1.0)
        return {"circle": {"center": params[4:6], "radius": radius}, "inclusion": inclusion, "version": 1}

    def fence(*circles: dict[str, Any], polygons: tuple[Any, ...] = ()) -> str:
        return plan([UP, at(*A), HOME], geoFence={"circles": circles, "polygons": polygons, "version": 2})

    assert fence_radius(parse(fence()), ORIGIN) is None
    assert fence_radius(parse(fence(circle(0.0, 50.0), circle(10.0, 40.0))), ORIGIN) == pytest.approx(30.0, abs=0.01)
    for text, why in (
        (fence(circle(60.0, 50.0)), "outside"),
        (fence(circle(0.0, 50.0, inclusion=False)), "kept out of"),
        (fence(circle(0.0, NAN)), "nan m"),
        (fence(polygons=({"polygon": [[0, 0]] * 5, "inclusion": True},)), "5 corners"),
    ):
        with pytest.raises(MissionFileError, match=why):
            fence_radius(parse(text), ORIGIN)
    rally = plan([UP, at(*A), HOME], rallyPoints={"points": [[47.0, 8.0, 50.0]], "version": 2})
    assert "1 rally" in parse(rally).notes[0]


def test_the_nearer_fence_counts_and_a_take_off_at_its_edge_is_refused() -> None:
    plain, file = load_settings(None, []), Path("trip.plan")
    near = load_settings(None, ["geofence.radius=20"])
    assert fenced(plain, file, None) is plain
    assert fenced(plain, file, 30.0).geofence.radius == 30.0
    assert fenced(near, file, 30.0) is near and fenced(near, file, 10.0).geofence.radius == 10.0
    with pytest.raises(TomlFileError, match=r"trip\.plan: its fence leaves 0\.50 m around the take-off"):
        fenced(plain, file, 0.5)


def test_waypoints_are_read_and_written_as_mavproxy_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both ways against pymavlink's own reader and writer, which have a version for the whole process."""
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil.set_dialect("ardupilotmega")
    items = [UP, at(*A, 2.0), do(SPEED, 1, 3.0, -1), at(*B), do(JUMP, 2, 1), HOME]
    loader = mavwp.MAVWPLoader()
    source = tmp_path / "source.waypoints"
    source.write_text(wpl(items))
    loader.load(str(source))
    theirs = tmp_path / "theirs.waypoints"
    loader.save(str(theirs))
    read = parse(theirs.read_text())
    assert [each.number for each in read.items] == [loader.wp(number).seq for number in range(1, loader.count())]
    for item in read.items:
        wanted = loader.wp(item.number)
        assert (item.frame, item.command) == (wanted.frame, wanted.command)
        ours = (wanted.param1, wanted.param2, wanted.param3, wanted.param4, wanted.x, wanted.y, wanted.z)
        assert item.params == pytest.approx(ours, abs=1e-6)
    back = tmp_path / "back.waypoints"
    back.write_text(to_waypoints(parse(plan(items))))
    again = mavwp.MAVWPLoader()
    again.load(str(back))
    assert again.count() == loader.count() == len(items) + 1
    assert flown(back.read_text()) == flown(wpl(items))


def test_a_mission_of_a_plan_is_a_mission_file(tmp_path: Path) -> None:
    items = [UP, at(*A, 2.0), do(YAW, 90.0), at(*B), do(GRIPPER, 1, 0), HOME]
    mission = flown(plan(items))
    (tmp_path / "own.toml").write_text(to_toml(mission))
    assert load_mission(str(tmp_path / "own.toml"))[0] == mission
    (tmp_path / "trip.plan").write_text(plan(items))
    found = load_of_station(str(tmp_path / "trip.plan"), ["speed=2"], lambda planned: (ORIGIN[0], ORIGIN[1] + 1e-4))
    assert found.mission.speed == 2.0 and found.mission.name == "trip"
    assert found.mission.waypoints[0].east == pytest.approx(-1e-4 * 75_500.0, rel=0.01), "around where it stands"


@pytest.mark.parametrize(
    "mission",
    [
        Mission("up", waits=True, takeoff_height=2.0),
        Mission("x", waits=True),
        Mission(
            "parcel", waypoints=[Waypoint(1.0, 2.0, 3.0, speed=1.0)], delivery=Delivery(0.7), description='"a" = b'
        ),
        Mission("round", trajectory=Shape("helix", 2.0, radius=3.0, laps=2.0), return_home=False),
        Mission("letters", waits=True, vehicle="/home/\U0001f681/quad.toml", description="Stra\xdfe\t\x7f\x00\u2028"),
    ],
    ids=lambda mission: str(mission.name),
)
def test_a_mission_made_in_code_is_a_mission_file(mission: Mission, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(to_toml(mission), encoding="utf-8")
    assert load_mission(str(tmp_path / "own.toml"))[0] == mission


def test_it_is_flown_within_a_metre_of_its_items() -> None:
    """Each place in latitude and longitude, as the vehicle tells its own."""
    items = [UP, at(6.0, 0.0, 5.0, 1.0), at(6.0, 5.0, 4.0), do(GRIPPER, 1, 0), at(2.0, 4.0, 4.0, 1.0), HOME]
    joined = Joined(flown(plan(items)), remembers=False).fly(90.0)
    assert joined.autopilot.supervisor.verdict is None and joined.vehicle.summary().outcome == "landed"
    assert joined.vehicle.summary().released and joined.autopilot.navigator.released
    way = np.array(joined.truths)[:, :3]
    for command, params in (each for each in items if each[0] == dialect.MAV_CMD_NAV_WAYPOINT):
        assert command == WAYPOINT
        there = math.radians(params[4]), math.radians(params[5]), params[6]
        place = to_local(there, RADIANS)
        assert np.linalg.norm(way - place, axis=1).min() < 1.0
