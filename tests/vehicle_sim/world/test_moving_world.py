"""What moves and what appears late: where it is when, and that the scan and the verdict on a flight know it."""

import math
from typing import Any

import numpy as np
import pytest

from protocol.toml_files import TomlFileError
from studies.joined import Joined, mission_of
from vehicle_sim.sensors.lidar import Lidar, LidarSettings
from vehicle_sim.world import Scene, World

ORIGIN = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
EYE = np.array([0.0, 0.0, -2.0])
SECOND = 1_000_000_000


def world_of(*cylinders: dict[str, Any], **more: list[dict[str, Any]]) -> World:
    rows = [{"name": f"walker {i}", "height": 4.0, **each} for i, each in enumerate(cylinders)]
    return World.from_tables({"name": "test", "origin": ORIGIN, "cylinder": rows, **more}, "test.toml")


WALKER = {"center": [10.0, 0.0], "radius": 0.5, "route": [[10.0, 6.0], [10.0, -3.0]], "speed": 1.5}


def place(scene: Scene, time_s: float) -> list[float]:
    row: list[float] = scene.at(round(time_s * SECOND)).cylinders[0, :2].tolist()
    return row


def test_a_walker_goes_to_its_route_and_repeats_it() -> None:
    scene = Scene(world_of(WALKER))
    assert place(scene, 0.0) == [10.0, 0.0]
    assert place(scene, 2.0) == pytest.approx([10.0, 3.0])
    assert place(scene, 4.0) == pytest.approx([10.0, 6.0])
    assert place(scene, 8.0) == pytest.approx([10.0, 0.0])  # on the way back
    assert place(scene, 10.0) == pytest.approx([10.0, -3.0])
    assert place(scene, 12.0) == pytest.approx([10.0, 0.0])  # a round is 18 m, 12 s
    for time_s in (5.0, 7.3, 11.9):
        assert place(scene, time_s + 12.0 * 40) == pytest.approx(place(scene, time_s))


def test_a_walker_keeps_the_speed_of_its_file() -> None:
    route = [[0.0, 4.0], [3.0, 8.0], [-5.0, 1.0]]
    scene = Scene(world_of({**WALKER, "center": [1.0, 1.0], "route": route}))
    places = np.array([place(scene, 0.01 * step) for step in range(4000)])
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps.max() == pytest.approx(0.015)
    assert (steps < 0.0149).sum() < 10  # at the corners alone


def test_the_scene_leaves_the_world_as_it_was() -> None:
    world = world_of(WALKER)
    before = world.cylinders.copy()
    Scene(world).at(3 * SECOND)
    np.testing.assert_array_equal(world.cylinders, before)
    still = world_of({"center": [5.0, 0.0], "radius": 0.5})
    assert Scene(still).at(3 * SECOND) is still


def test_a_scan_sees_a_walker_where_it_is_at_that_time() -> None:
    scene = Scene(world_of({**WALKER, "center": [10.0, -6.0], "route": [[10.0, 6.0], [10.0, -6.0]]}))
    lidar = Lidar(LidarSettings(noise_m=0.0, beams_per_sector=1), np.random.default_rng(0))
    scan = lidar.scan(scene.at(4 * SECOND), EYE, LEVEL)
    assert scan[0] == 950 and np.flatnonzero(scan < 1501).tolist() == [0]
    # after 8 s it is at east 6, 11.66 m off at 31 degrees
    scan = lidar.scan(scene.at(8 * SECOND), EYE, LEVEL)
    assert np.flatnonzero(scan < 1501).tolist() == [6]
    assert 0.01 * scan[6] == pytest.approx(math.hypot(10.0, 6.0) - 0.5, abs=0.05)  # the beam is a degree off its axis


def test_a_pillar_appears_when_the_vehicle_is_near_and_stays() -> None:
    pillar = {"center": [10.0, 0.0], "radius": 0.1, "appears_within": 2.0}
    scene = Scene(world_of(pillar, {"center": [30.0, 0.0], "radius": 1.0}))
    scene.update(SECOND, (7.8, 0.0, -2.0))
    absent = scene.at(SECOND)
    assert absent.nearest(EYE) == ("walker 1", 29.0) and len(absent.cylinders) == 1
    scene.update(2 * SECOND, (7.91, 0.0, -2.0))
    name, distance = scene.at(2 * SECOND).nearest(EYE)
    assert name == "walker 0" and distance == pytest.approx(9.9)
    scene.update(3 * SECOND, (0.0, 0.0, -2.0))
    assert scene.at(3 * SECOND).names == ("walker 0", "walker 1")
    assert scene.at(SECOND).names == ("walker 1",)  # what an older scan saw


def test_what_appears_late_walks_from_then_on() -> None:
    scene = Scene(world_of({**WALKER, "appears_within": 20.0}))
    scene.update(7 * SECOND, (0.0, 0.0, 0.0))
    assert place(scene, 7.0) == [10.0, 0.0]
    assert place(scene, 9.0) == pytest.approx([10.0, 3.0])


def test_a_walker_hits_a_vehicle_that_hovers(tmp_path: Any) -> None:
    text = """
name = "walk"
[origin]
latitude_deg = 47.0
longitude_deg = 8.0
altitude_m = 400.0
[[cylinder]]
name = "walker"
center = [0.0, 15.0]
radius = 0.3
height = 4.0
route = [[0.0, -15.0], [0.0, 15.0]]
speed = 1.5
"""
    path = tmp_path / "walk.toml"
    path.write_text(text)
    import msgspec

    mission = msgspec.structs.replace(mission_of("hover"), world=str(path))
    joined = Joined(mission, overrides=('avoidance.method="none"',))
    joined.fly(limit_s=20.0, until=lambda flown: flown.vehicle.finished)
    assert joined.vehicle.flight.crash == "walker"
    # 15 m at 1.5 m/s less both radii of 0.3 + 0.36 m
    assert joined.vehicle.time_ns * 1e-9 == pytest.approx((15.0 - 0.66) / 1.5, abs=0.1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"speed": 0.0}, "speed"),
        ({"route": []}, "route"),
        ({"route": [[10.0, 0.0]]}, "nowhere"),
        ({"appears_within": 0.0}, "appears_within"),
    ],
)
def test_an_impossible_route_is_refused(change: dict[str, Any], says: str) -> None:
    with pytest.raises(TomlFileError, match=says):
        world_of({**WALKER, **change})
