"""The corpus of ground stations' files: each is read as its items say, or refused by the number of one."""

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from companion.mission.files import MissionFileError, parse, to_mission
from companion.mission.plan import Mission
from companion.runtime.station_files import load_of_station, origin_of
from protocol.toml_files import TomlFileError
from studies.joined import Joined
from tests.companion.mission.corpus import CORPUS, Entry, loaded, plan

HOME = origin_of("empty")


def read_as(text: str) -> Mission:
    return to_mission(parse(text), HOME, "corpus")


@pytest.mark.parametrize("entry", CORPUS.values(), ids=CORPUS)
def test_a_file_is_read_as_its_items_say_or_refused(entry: Entry, tmp_path: Path) -> None:
    saved = tmp_path / "saved.waypoints"
    loaded(entry, HOME).save(str(saved))
    texts = saved.read_text(), json.dumps(plan(entry, HOME))
    for text in texts:
        if entry.refused is not None:
            with pytest.raises(MissionFileError, match=rf"^item {entry.refused}: "):
                read_as(text)
            continue
        mission = read_as(text)
        assert mission.takeoff_height == 3.0 and len(mission.waypoints) == len(entry.places)
        for waypoint, place in zip(mission.waypoints, entry.places, strict=True):
            assert (waypoint.north, waypoint.east, waypoint.height) == pytest.approx(place, abs=0.05)


@pytest.mark.parametrize("name", [name for name, entry in CORPUS.items() if entry.refused is None])
def test_what_is_read_is_flown_within_a_metre_of_its_items(name: str) -> None:
    """The true way comes by each place in its turn, and ends on the ground within a metre of the last one or of the
    take-off."""
    entry = CORPUS[name]
    mission = replace(read_as(json.dumps(plan(entry, HOME))), world="empty")
    joined = Joined(mission, overrides=("avoidance.method=none",), remembers=False).fly()
    assert joined.autopilot.supervisor.verdict is None and joined.vehicle.summary().outcome == "landed"
    way = np.array(joined.truths)[:, :3]
    for north, east, height in (*entry.places, (*entry.places[-1][:2], 0.0)):
        near = np.flatnonzero(np.linalg.norm(way - (north, east, -height), axis=1) < 1.0)
        assert near.size, (north, east, height)
        way = way[near[0] :]


def test_plans_of_other_versions_and_without_a_mission_are_refused() -> None:
    right = plan(CORPUS["round"], HOME)
    assert len(read_as(json.dumps(right)).waypoints) == 4
    for wrong, words in (
        (right | {"version": 2}, "version 2, its mission of version 2"),
        (right | {"mission": right["mission"] | {"version": 3}}, "version 1, its mission of version 3"),
        ({name: table for name, table in right.items() if name != "mission"}, "no mission"),
    ):
        with pytest.raises(MissionFileError, match=words):
            read_as(json.dumps(wrong))


def test_without_a_home_it_is_around_its_first_place_or_where_the_vehicle_stands(tmp_path: Path) -> None:
    file = tmp_path / "homeless.waypoints"
    loaded(CORPUS["round"], HOME).save(str(file))
    lines = file.read_text().splitlines()
    home = lines[1].split("\t")
    lines[1] = "\t".join([*home[:8], "0", "0", *home[10:]])
    file.write_text("\n".join(lines) + "\n")
    first, second = load_of_station(str(file)).mission.waypoints[:2]
    assert (first.north, first.east) == (0.0, 0.0) and (second.north, second.east) == pytest.approx((0, 8), abs=0.05)
    there = load_of_station(str(file), origin=lambda mission: HOME).mission.waypoints[0]
    assert (there.north, there.east) == pytest.approx((6, 0), abs=0.05)
    file.write_text("\n".join(lines[:3]) + "\n")
    with pytest.raises(TomlFileError, match="nor any place"):
        load_of_station(str(file))
