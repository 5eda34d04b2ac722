"""Places by seed: the file is the world, the seed is the place, and each is what it says it is."""

import itertools
import math
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from typer.testing import CliRunner

from companion.runtime.files import load_mission
from studies import __main__ as command_line
from studies import askew, enclosed, moving, narrow, traps, worlds
from studies.sites import SITES
from studies.worlds import HULL, shortest
from vehicle_sim.world import Scene, World

KINDS = sorted(SITES)


def at(north: float, east: float, height: float = 3.0) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    return np.array([north, east, -height])


@pytest.mark.parametrize("kind", KINDS)
def test_the_seed_is_the_place_and_the_file_is_the_world(kind: str, tmp_path: Path) -> None:
    site = SITES[kind](3)
    assert site == SITES[kind](3)
    if kind != "fig6":
        assert site.tables != SITES[kind](4).tables
    world_file, mission_file = site.save(tmp_path, speed=3.5)
    read, made = World.load(world_file), site.world()
    np.testing.assert_array_equal(read.boxes, made.boxes)
    np.testing.assert_array_equal(read.cylinders, made.cylinders)
    assert read.names == made.names and len(read.names) == len(read.boxes) + len(read.cylinders) > 0
    assert [each.appears_within for each in read.dynamic] == [each.appears_within for each in made.dynamic]
    mission, _ = load_mission(str(mission_file))
    assert mission == site.mission(3.5, world_file.absolute())
    assert (mission.waypoints[-1].north, mission.waypoints[-1].east) == site.goal


@pytest.mark.parametrize("study", [askew, enclosed, moving, narrow, traps])
def test_what_is_flown_through_can_be_made_by_name(study: ModuleType) -> None:
    assert {setup.site for setup in study.SETUPS} <= set(SITES.values())


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("fig6", "shaft")])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_start_and_goal_are_free(kind: str, seed: int) -> None:
    site = SITES[kind](seed)
    world = site.world()
    for place in ((0.0, 0.0), site.goal):
        assert world.clearance(at(*place, site.height)) > HULL + 0.5


@pytest.mark.parametrize(
    "kind",
    [
        "forest",
        "utrap",
        "gap",
        "pole",
        "maze",
        "barn",
        "fig6",
        "shaft",
        "corridor",
        "alley",
        "office",
        "warehouse",
        "doors",
        "bend",
        "zigzag",
        "rooms",
        "roundroom",
        "posts",
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_there_is_a_way_and_it_is_no_shorter_than_straight(kind: str, seed: int) -> None:
    site = SITES[kind](seed)
    way = shortest(site, HULL, margin=8.0)
    straight = sum(math.dist(a, b) for a, b in itertools.pairwise([(0.0, 0.0), *site.waypoints]))
    assert straight - 0.2 <= way < math.inf


def test_a_forest_has_the_density_it_says() -> None:
    sites = [worlds.forest(seed) for seed in range(150)]
    # what the free circles of 2.8 m around start and goal leave of 30 x 60 m
    expected = (1800.0 - 2.0 * math.pi * 2.8**2) / 25.0
    counts = np.array([len(site.world().cylinders) for site in sites])
    assert abs(counts.mean() - expected) < 4.0 * math.sqrt(expected / len(sites))
    assert counts.var() == pytest.approx(expected, rel=0.3)  # Poisson's
    trees = np.concatenate([site.world().cylinders for site in sites])
    assert (trees[:, 2] == 0.3).all()
    assert -10.0 <= trees[:, 0].min() < -9.9 and 49.9 < trees[:, 0].max() <= 50.0
    assert -15.0 <= trees[:, 1].min() < -14.9 and 14.9 < trees[:, 1].max() <= 15.0


def test_a_longer_forest_is_as_dense_up_to_beyond_its_goal() -> None:
    sites = [worlds.forest(seed, length=150.0) for seed in range(20)]
    assert all(site.goal == (150.0, 0.0) for site in sites)
    trees = np.concatenate([site.world().cylinders for site in sites])
    expected = 20.0 * (30.0 * 170.0 - 2.0 * math.pi * 2.8**2) / 25.0
    assert abs(len(trees) - expected) < 4.0 * math.sqrt(expected)
    assert -10.0 <= trees[:, 0].min() < -9.5 and 159.5 < trees[:, 0].max() <= 160.0


@pytest.mark.parametrize("seed", range(50))
def test_the_shaft_is_as_wide_as_it_says(seed: int) -> None:
    """And the start is within it, clear of the hull by a hand."""
    site = worlds.shaft(seed)
    (a, b), (c, d), _ = (np.array([wall["start"], wall["end"]]) for wall in site.tables["wall"])
    along, across = b - a, c - a
    width = abs(along[0] * across[1] - along[1] * across[0]) / np.linalg.norm(along) - 0.2
    assert 1.1 <= width <= 1.2 and np.allclose(b - a, d - c)
    assert HULL + 0.1 < site.world().clearance(at(0.0, 0.0)) <= 0.6


@pytest.mark.parametrize("seed", range(3))
def test_the_gap_is_as_wide_as_it_says(seed: int) -> None:
    site = worlds.gap(seed)
    walls = site.tables["wall"]
    left, right = np.array(walls[0]["end"]), np.array(walls[1]["start"])
    assert np.linalg.norm(right - left) == pytest.approx(0.9)
    assert site.world().clearance(at(*(0.5 * (left + right)))) == pytest.approx(0.45)
    assert shortest(site, 0.36) < 40.0
    assert shortest(site, 0.5) == math.inf  # there is no other way


@pytest.mark.parametrize("seed", range(5))
def test_the_trap_catches_who_flies_straight(seed: int) -> None:
    site = worlds.u_trap(seed)
    ahead = site.world().range_along(at(0.0, 0.0), np.array([1.0, 0.0, 0.0]), 100.0)
    assert 15.0 < ahead < 20.0
    assert shortest(site, HULL) > 32.3


@pytest.mark.parametrize("seed", range(5))
def test_a_court_is_entered_from_above_alone(seed: int) -> None:
    site = worlds.court(seed)
    assert shortest(site, 0.1) == math.inf
    ahead = np.array([1.0, 0.0, 0.0])
    (height,) = {wall["height"] for wall in site.tables["wall"]}
    assert 4.0 <= height <= 6.0
    assert 12.0 < site.world().range_along(at(0.0, 0.0, height - 0.01), ahead, 30.0) < 19.0
    assert site.world().range_along(at(0.0, 0.0, height + 0.01), ahead, 30.0) == math.inf


@pytest.mark.parametrize("seed", range(2))
def test_all_rooms_of_the_maze_can_be_reached_and_none_from_outside(seed: int) -> None:
    site = worlds.maze(seed)
    for room in ((0.0, 20.0), (20.0, 0.0), (8.0, 12.0)):
        assert math.isfinite(shortest(worlds.Site(site.name, site.tables, (room,)), HULL))
    outside = worlds.Site(site.name, site.tables, ((27.0, 10.0),))
    assert shortest(outside, 0.3) == math.inf


@pytest.mark.parametrize("seed", range(3))
def test_each_inner_wall_of_the_maze_parts_two_rooms(seed: int) -> None:
    site = worlds.maze(seed)
    world = site.world()
    parted = 0
    for room in itertools.product(range(6), repeat=2):
        for course in ((1.0, 0.0), (0.0, 1.0)):
            eye, direction = at(4.0 * room[0], 4.0 * room[1]), np.array([*course, 0.0])
            last = 5 in (room[0] * course[0], room[1] * course[1])
            parted += math.isfinite(world.range_along(eye, direction, 4.0)) and not last
    assert parted == len(site.tables["wall"]) - 4
    assert 15 <= parted <= 60 - 35  # of 60 places for a wall, a tree of 36 rooms takes 35 at least


def test_barn_is_scaled_to_the_vehicle() -> None:
    site = worlds.barn(5)
    assert site.goal[0] == pytest.approx(10.0 * 0.72 / 0.43, abs=0.01)
    assert set(site.world().cylinders[:, 2]) == {0.13}  # 0.075 m * 1.67, to the centimetre
    assert math.isfinite(shortest(site, HULL + 0.05))


def test_the_pillar_is_not_there_before_it_appears() -> None:
    site = worlds.pop_up(1)
    scene = Scene(site.world())
    assert scene.at(0).names == ()
    north, east, radius = site.world().cylinders[0, :3]
    scene.update(5, (north - radius - 2.01, east, -3.0))
    assert scene.at(5).names == ()
    scene.update(9, (north - radius - 1.99, east, -3.0))
    assert scene.at(9).names == ("cylinder 1",)


@pytest.mark.parametrize("seed", range(3))
def test_walkers_walk_and_leave_start_and_goal_alone(seed: int) -> None:
    site = worlds.street(seed)
    scene = Scene(site.world())
    places = np.array([scene.at(round(t * 1e9)).cylinders[:, :2] for t in np.arange(0.0, 120.0, 0.5)])
    for end in ((0.0, 0.0), site.goal):
        assert np.hypot(*(places - np.array(end)).transpose(2, 0, 1)).min() > 4.0
    speeds = np.hypot(*np.diff(places, axis=0).transpose(2, 0, 1)) / 0.5
    assert np.median(speeds) > 0.5 and speeds.max() < 1.51
    assert np.abs(places[..., 1]).max() < 5.6


def test_the_shortest_way_round_a_wall() -> None:
    wall = {"name": "wall", "start": [10.0, -4.0], "end": [10.0, 4.0], "thickness": 0.2, "height": 10.0}
    site = worlds.Site("wall", {"name": "wall", "origin": dict(worlds.forest(1).tables["origin"]), "wall": [wall]},
                       ((20.0, 0.0),))  # fmt: skip
    # two tangents to a circle of 0.5 m around each corner, and the bit along it; the wall's thickness is small
    corner = math.hypot(10.0, 4.0)
    along = 2.0 * math.sqrt(corner**2 - 0.25) + 2.0 * 0.5 * (math.atan2(4.0, 10.0) + math.asin(0.5 / corner))
    assert shortest(site, 0.5) == pytest.approx(along, rel=0.035)


def test_toml_gives_back_what_it_was_given() -> None:
    tables = {
        "name": 'a "b" \\ c',
        "on": True,
        "n": 3,
        "x": [1.5, -2e-7],
        "origin": {"h": 1.0},
        "box": [{"p": [[1.0, 2.0]]}],
    }
    assert tomllib.loads(worlds.toml(tables)) == tables


def test_command_line(tmp_path: Path) -> None:
    run = CliRunner().invoke(
        command_line.places, ["gap", "--seed", "7", "--picture", "--folder", str(tmp_path), "--speed", "2"]
    )
    assert run.exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"gap_7.toml", "gap_7_mission.toml", "gap_7.png", "gap_7.svg"}
    assert load_mission(str(tmp_path / "gap_7_mission.toml"))[0].speed == 2.0
    wrong = CliRunner().invoke(command_line.places, ["swamp"])
    assert wrong.exit_code == 2 and "swamp: no such place (there: forest" in wrong.output
    endless = CliRunner().invoke(command_line.places, ["gap", "--folder", str(tmp_path / "no"), "--speed", "inf"])
    assert endless.exit_code == 2 and "--speed" in endless.output and not (tmp_path / "no").exists()
