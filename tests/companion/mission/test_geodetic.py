"""Waypoints by latitude and longitude in a mission's own file."""

import math
from pathlib import Path

import numpy as np
import pytest

from companion.cli import flights
from companion.cli.flights import DemoOptions, FlyOptions
from companion.mission.plan import Mission
from companion.runtime.files import at_pad, is_geodetic, load_mission
from companion.runtime.flight import _attachments
from companion.runtime.station_files import origin_of
from protocol.frames import to_geodetic
from protocol.toml_files import TomlFileError
from tests.companion.runtime.test_check import Listened

PAD = origin_of("empty")
METRES = "north = 1.0\neast = 2.0\n"
FAR = "latitude = 0.5\nlongitude = -179.0\n"


def near(north: float, east: float) -> str:
    """The keys of a place around the pad (m)."""
    pad = math.radians(PAD[0]), math.radians(PAD[1]), 0.0
    latitude, longitude, _ = to_geodetic(np.array([north, east, 0.0]), pad)
    return f"latitude = {math.degrees(latitude)!r}\nlongitude = {math.degrees(longitude)!r}\n"


def written(folder: Path, *places: str) -> str:
    path = folder / "trip.toml"
    waypoints = "".join(f"[[waypoints]]\n{place}height = 3.0\nhold_s = 1.5\n" for place in places)
    path.write_text(f'name = "trip"\n{waypoints}')
    return str(path)


def places(mission: Mission) -> list[tuple[float, float]]:
    return [(waypoint.north, waypoint.east) for waypoint in mission.waypoints]


def test_they_are_around_the_pad_of_the_world(tmp_path: Path) -> None:
    trip = written(tmp_path, near(30.0, -40.0), METRES)
    mission = load_mission(trip)[0]
    assert places(mission) == [(30.0, -40.0), (1.0, 2.0)] and mission.waypoints[0].hold_s == 1.5
    assert is_geodetic(trip) and is_geodetic("trip.plan") and not is_geodetic("hover")


def test_in_a_flight_they_are_around_where_the_vehicle_stands_and_the_log_has_what_is_flown(tmp_path: Path) -> None:
    trip = written(tmp_path, near(30.0, -40.0))
    asked = FlyOptions(mission=trip, overrides=["mission.speed=2.5", "supervision.find_timeout=60"])
    first = flights._plan(asked, None)
    assert places(first.mission) == [(0.0, 0.0)], "around its first place as long as the vehicle was not asked"
    link = Listened()
    found = flights._located(asked, first, link, tmp_path)
    assert places(found.mission) == [pytest.approx((30.0, -40.0), abs=0.2)] and found.mission.speed == 2.5
    elsewhere = flights._plan(asked, None, (PAD[0] + 1e-3, PAD[1]))
    assert places(elsewhere.mission) == [pytest.approx((30.0 - 111.2, -40.0), abs=0.2)]
    kept = _attachments(elsewhere)
    assert kept["mission.geodetic.toml"] == Path(trip).read_bytes()
    (tmp_path / "mission.toml").write_bytes(kept["mission.toml"])
    assert load_mission(str(tmp_path / "mission.toml"))[0] == elsewhere.mission
    assert not is_geodetic(str(tmp_path / "mission.toml"))


def test_the_log_of_other_missions_has_the_file_alone() -> None:
    assert "mission.geodetic.toml" not in _attachments(flights._plan(DemoOptions(mission="hover"), 1))


def test_those_that_are_far_from_the_take_off_are_refused(tmp_path: Path) -> None:
    trip = written(tmp_path, METRES, near(0.0, 9_990.0), near(0.0, 10_010.0))
    with pytest.raises(TomlFileError, match=r"trip\.toml: waypoint 3: 10 km from the take-off"):
        load_mission(trip)
    with pytest.raises(TomlFileError, match="waypoint 1: "):
        flights._plan(DemoOptions(mission=written(tmp_path, FAR)), 1)
    assert places(flights._plan(FlyOptions(mission=written(tmp_path, FAR)), None).mission) == [(0.0, 0.0)]


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("latitude = 47.0\n", "give latitude and longitude, or north and east"),
        ("latitude = 47.0\nlongitude = 8.0\nnorth = 1.0\n", "give latitude and longitude, or north and east"),
        ("latitude = 47.0\nlongitude = 8.0\n" + METRES, "give latitude and longitude, or north and east"),
        ("latitude = 90.5\nlongitude = 8.0\n", r"latitude 90\.5: a number from -90 to 90"),
        ("latitude = 47.0\nlongitude = -181\n", "longitude -181: a number from -180 to 180"),
        ("latitude = nan\nlongitude = 8.0\n", "latitude nan: "),
        ('latitude = "47 N"\nlongitude = 8.0\n', "latitude '47 N': "),
    ],
)
def test_one_that_is_no_place_is_refused_by_its_number(place: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(TomlFileError, match=f"trip.toml: waypoint 2: {why}"):
        load_mission(written(tmp_path, METRES, place))


def test_the_world_that_counts_is_the_one_that_is_flown_in(tmp_path: Path) -> None:
    world = tmp_path / "there.toml"
    world.write_text("[origin]\nlatitude_deg = 0.5\nlongitude_deg = -179.0\naltitude_m = 1.0\n")
    mission = load_mission(written(tmp_path, FAR), [f"world={world}"], at_pad)[0]
    assert places(mission) == [(0.0, 0.0)]
