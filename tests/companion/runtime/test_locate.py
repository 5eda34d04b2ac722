"""Where a vehicle stands and the mission that it has stored, asked before its flight."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from companion.cli import flights
from companion.cli.app import app
from companion.cli.flights import STORED, FlyOptions
from companion.cli.shell import UNUSABLE
from companion.mission.files import MissionFileError, parse, stored, to_mission, to_waypoints
from companion.runtime import side_links
from companion.runtime.files import load_settings
from companion.runtime.flight import Plan, PlanError
from companion.runtime.locate import download, locate
from companion.runtime.station_files import origin_of
from protocol.messages import Encoder, dialect
from protocol.toml_files import TomlFileError
from tests.companion.mission.corpus import CORPUS, Entry, loaded, plan
from tests.companion.runtime.test_check import IMPATIENT, NEVER_SENT, SETTINGS, Listened, Nobody


def test_the_place_is_the_vehicle_s_own_and_nothing_is_flown() -> None:
    link = Listened()
    place = locate(SETTINGS, link)
    assert place == pytest.approx(origin_of("empty"), abs=1e-6)
    assert not link.sent & NEVER_SENT and not link.vehicle.flight.armed


def test_in_flight_the_place_is_that_of_the_take_off() -> None:
    """A mission around the vehicle's present place would be flown elsewhere."""
    link = Listened()
    link.vehicle.flight.home_ned = (30.0, 0.0, 0.0)
    there, here = locate(SETTINGS, link, home=True), locate(SETTINGS, link)
    assert there is not None and here is not None and here == pytest.approx(origin_of("empty"), abs=1e-6)
    assert math.radians(there[0] - here[0]) * 6.37e6 == pytest.approx(30.0, abs=0.2)
    assert there[1] == pytest.approx(here[1], abs=1e-6)
    assert not link.sent & NEVER_SENT


@pytest.mark.parametrize("home", [False, True])
def test_without_a_vehicle_that_is_what_is_said(home: bool) -> None:
    with pytest.raises(MissionFileError, match=r"no vehicle within 0\.05 s"):
        locate(load_settings(None, [IMPATIENT]), Nobody(), home=home)


def test_the_command_says_where_no_vehicle_was_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_links, "open_link", lambda url: Nobody())
    file = tmp_path / "round.plan"
    file.write_text(json.dumps(plan(CORPUS["round"], HOME)))
    done = CliRunner().invoke(app, ["fly", str(file), "--set", IMPATIENT], env={"COLUMNS": "200"})
    assert done.exit_code == UNUSABLE and "no vehicle within 0.05 s at udpin:127.0.0.1:14540" in done.output


HOME = origin_of("empty")


def holding(entry: Entry) -> Listened:
    """A vehicle to which the items were uploaded, the home not among them, as PX4 numbers them."""
    link, station = Listened(), Encoder(255, 190)
    loader = loaded(entry, HOME)
    items = [loader.wp(number) for number in range(1, loader.count())]
    link.vehicle.receive(station.encode_fields(dialect.MAVLink_mission_count_message, 1, 1, len(items), 0))
    for number, item in enumerate(items):
        four = item.param1, item.param2, item.param3, item.param4
        if item.command == dialect.MAV_CMD_DO_JUMP:
            four = item.param1 - 1, *four[1:]
        fields = item.frame, item.command, 0, 1, *four, round(item.x * 1e7), round(item.y * 1e7), item.z, 0
        link.vehicle.advance()
        link.vehicle.receive(station.encode_fields(dialect.MAVLink_mission_item_int_message, 1, 1, number, *fields))
    assert len(link.vehicle.flight.mission.items) == len(items)
    return link


@pytest.mark.parametrize("name", ["round", "twice", "speed, heading, parcel"])
def test_the_stored_mission_is_the_one_that_was_uploaded(name: str) -> None:
    link = holding(CORPUS[name])
    file = download(SETTINGS, link, HOME)
    assert [item.number for item in file.items] == list(range(len(CORPUS[name].items)))
    wanted = to_mission(parse(json.dumps(plan(CORPUS[name], HOME))), HOME, "x")
    for read in (file, parse(to_waypoints(file))):
        mission = to_mission(read, HOME, "x")
        for waypoint, planned in zip(mission.waypoints, wanted.waypoints, strict=True):
            place = planned.north, planned.east, planned.height
            assert (waypoint.north, waypoint.east, waypoint.height) == pytest.approx(place, abs=0.05)
            assert (waypoint.speed, waypoint.yaw_deg) == (planned.speed or None, planned.yaw_deg)
            assert (waypoint.hold_s, waypoint.release) == (planned.hold_s, planned.release)
    assert not link.sent & NEVER_SENT and not link.vehicle.flight.armed
    assert dialect.MAVLINK_MSG_ID_MISSION_ACK in link.sent, "the vehicle is told that all has come"


def test_a_vehicle_without_a_mission_or_without_a_word_of_it() -> None:
    with pytest.raises(MissionFileError, match="no mission stored"):
        download(SETTINGS, Listened(), HOME)
    with pytest.raises(MissionFileError, match="no vehicle within"):
        download(load_settings(None, [IMPATIENT]), Nobody(), HOME)


def test_the_home_of_ardupilot_and_a_place_that_is_left_open_are_no_places_to_fly_to() -> None:
    def item(number: int, command: int, x: int, y: int, z: float) -> Any:
        return dialect.MAVLink_mission_item_int_message(1, 191, number, 3, command, 0, 1, 0, 0, 0, 0, x, y, z)

    items = [item(0, 16, 470000000, 80000000, 400.0), item(1, 22, 2**31 - 1, 2**31 - 1, 5.0), item(2, 20, 0, 0, 0.0)]
    file = stored(items, HOME, first_is_home=True)
    assert [each.number for each in file.items] == [1, 2] and file.home == HOME
    assert file.items[0].place is None and to_mission(file, HOME, "x").takeoff_height == 5.0
    assert math.isnan(file.items[0].params[4])


def located(link: Listened, folder: Path) -> Plan:
    asked = FlyOptions(mission=STORED, overrides=["mission.speed=2.5"])
    first = replace(flights._plan(asked, None), connect="px4")
    return flights._located(asked, first, link, folder)


def test_the_vehicle_s_own_mission_is_planned_and_goes_into_the_log(tmp_path: Path) -> None:
    found = located(holding(CORPUS["round"]), tmp_path)
    assert found.mission.name == STORED and len(found.mission.waypoints) == 4 and found.connect == "px4"
    assert found.mission.speed == 2.5 and not found.mission.waits
    assert len(parse(found.files["mission"].read_text()).items) == 5


def test_what_it_holds_and_can_not_be_flown_is_refused_by_the_vehicle_s_number(tmp_path: Path) -> None:
    with pytest.raises(TomlFileError, match="item 2: "):
        located(holding(CORPUS["in the air"]), tmp_path)
    with pytest.raises(PlanError, match="no mission stored"):
        located(Listened(), tmp_path)


def test_the_command_takes_one_mission(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(side_links, "open_link", lambda url: Listened())
    for arguments in ([], ["hover", "--mission", "vehicle"]):
        done = CliRunner().invoke(app, ["fly", *arguments])
        assert done.exit_code == UNUSABLE and "one mission" in done.output
    done = CliRunner().invoke(app, ["fly", "--mission", "vehicle"])
    assert done.exit_code == UNUSABLE and "no mission stored" in done.output
