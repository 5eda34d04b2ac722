"""The world: analytic distances and hits, and an oracle that knows points and footprints only."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from protocol import toml_files
from vehicle_sim.world import World, WorldTable

Array = NDArray[np.float64]

ORIGIN = {"latitude_deg": 47.0, "longitude_deg": 8.0, "altitude_m": 400.0}
NEIGHBOURHOOD = toml_files.find("worlds", "neighbourhood")


def tables(**obstacles: list[dict[str, Any]]) -> dict[str, Any]:
    named = {kind: [{"name": f"{kind} {i}", **one} for i, one in enumerate(rows)] for kind, rows in obstacles.items()}
    return {"name": "test", "origin": dict(ORIGIN), **named}


def world_of(**obstacles: list[dict[str, Any]]) -> World:
    return World.from_tables(tables(**obstacles), "test.toml")


def at(north: float, east: float, height: float) -> Array:
    return np.array([north, east, -height])


def assert_nearest(world: World, place: Array, name: str, distance_m: float) -> None:
    found, distance = world.nearest(place)
    assert found == name
    assert distance == pytest.approx(distance_m)


def random_world(rng: np.random.Generator) -> tuple[World, dict[str, Any]]:
    """A crowded 40 m square of everything that a file can hold, and its tables."""

    def place() -> list[float]:
        return [float(x) for x in rng.uniform(-20.0, 20.0, 2)]

    def height() -> list[float]:
        bottom = float(rng.choice([0.0, rng.uniform(0.0, 4.0)]))
        return [bottom, bottom + float(rng.uniform(0.5, 6.0))]

    boxes = [
        {
            "center": place(),
            "size": [float(x) for x in rng.uniform(0.3, 6.0, 2)],
            "height": height(),
            "yaw_deg": float(rng.uniform(-180.0, 180.0)),
        }
        for _ in range(8)
    ]
    cylinders = [{"center": place(), "radius": float(rng.uniform(0.1, 2.0)), "height": height()} for _ in range(8)]
    walls = [{"start": place(), "end": place(), "thickness": 0.3, "height": height()} for _ in range(3)]
    trees = [
        {"center": place(), "trunk_radius": 0.2, "crown_radius": float(rng.uniform(0.5, 2.0)), "height": height()}
        for _ in range(4)
    ]
    hills = [
        {"center": place(), "radius": float(rng.uniform(3.0, 8.0)), "height": float(rng.uniform(0.3, 3.0))}
        for _ in range(3)
    ]
    text = tables(box=boxes, cylinder=cylinders, wall=walls, tree=trees, hill=hills)
    return World.from_tables(text, "random.toml"), text


def inside(text: dict[str, Any], points: Array) -> NDArray[np.bool_]:
    """Oracle: which points (n, 3) NED lie in an obstacle, straight from the tables; boxes as convex polygons."""
    north, east, height = points[:, 0], points[:, 1], -points[:, 2]
    result = np.zeros(len(points), dtype=np.bool_)

    def polygon(corners: list[complex], low: float, high: float) -> None:
        within = (height >= low) & (height <= high)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):  # clockwise seen from above: right is inside
            within &= (b - a).real * (east - a.imag) - (b - a).imag * (north - a.real) >= 0.0
        result[within] = True

    def disc(center: list[float], radius: float, low: float, high: float) -> None:
        result[
            ((north - center[0]) ** 2 + (east - center[1]) ** 2 <= radius**2) & (height >= low) & (height <= high)
        ] = True

    for box in text["box"]:
        turn = complex(math.cos(math.radians(box["yaw_deg"])), math.sin(math.radians(box["yaw_deg"])))
        along, across = 0.5 * box["size"][0], 0.5 * box["size"][1]
        corners = [complex(*box["center"]) + turn * complex(i * along, j * across) for i, j in CLOCKWISE]
        polygon(corners, *box["height"])
    for wall in text["wall"]:
        start, end = complex(*wall["start"]), complex(*wall["end"])
        side = 1j * (end - start) / abs(end - start) * 0.5 * wall["thickness"]
        polygon([start - side, end - side, end + side, start + side], *wall["height"])
    for cylinder in text["cylinder"]:
        disc(cylinder["center"], cylinder["radius"], *cylinder["height"])
    for tree in text["tree"]:
        disc(tree["center"], tree["trunk_radius"], 0.0, tree["height"][0])
        disc(tree["center"], tree["crown_radius"], *tree["height"])
    for hill in text["hill"]:
        radius, top = hill["radius"], hill["height"]
        sunk = (radius**2 - top**2) / (2.0 * top)  # of the sphere's centre
        aside = (north - hill["center"][0]) ** 2 + (east - hill["center"][1]) ** 2
        result[(aside + (height + sunk) ** 2 <= (top + sunk) ** 2) & (height >= 0.0)] = True
    return result


CLOCKWISE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]  # north is real, east imaginary


# --- distances --------------------------------------------------------------------------------------------------------


def test_box_distances_by_hand() -> None:
    # 6 long, 2 wide, turned 90 degrees clockwise: long axis along east
    world = world_of(box=[{"center": [10.0, 3.0], "size": [6.0, 2.0], "height": [1.0, 4.0], "yaw_deg": 90.0}])
    assert world.clearance(at(5.0, 3.0, 2.0)) == pytest.approx(4.0)  # face at north 9
    assert world.clearance(at(10.0, 8.5, 2.0)) == pytest.approx(2.5)  # face at east 6
    assert world.clearance(at(6.0, 10.0, 2.0)) == pytest.approx(5.0)  # edge at 9, 6: 3-4-5
    assert world.clearance(at(7.0, 9.0, 10.0)) == pytest.approx(7.0)  # corner at 9, 6, 4: 2-3-6
    assert world.clearance(at(10.0, 3.0, 0.25)) == pytest.approx(0.75)  # from below
    assert world.clearance(at(10.2, 3.0, 3.0)) == pytest.approx(-0.8)  # depth from the face at 11


def test_box_turns_clockwise_from_north() -> None:
    world = world_of(box=[{"center": [0.0, 0.0], "size": [10.0, 0.2], "height": 3.0, "yaw_deg": 30.0}])
    axis = np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0)), 0.0])
    assert world.clearance(7.0 * axis + at(0.0, 0.0, 1.0)) == pytest.approx(2.0)
    mirrored = axis * np.array([1.0, -1.0, 1.0])
    assert world.clearance(5.0 * mirrored + at(0.0, 0.0, 1.0)) == pytest.approx(
        5.0 * math.sin(math.radians(60.0)) - 0.1
    )


def test_cylinder_distances_by_hand() -> None:
    world = world_of(cylinder=[{"center": [2.0, -1.0], "radius": 1.0, "height": [2.0, 5.0]}])
    assert world.clearance(at(5.0, 3.0, 3.0)) == pytest.approx(4.0)  # 3-4-5 less the radius
    assert world.clearance(at(2.0, -1.0, 9.0)) == pytest.approx(4.0)  # over the cap
    assert world.clearance(at(2.0, -6.0, 8.0)) == pytest.approx(5.0)  # rim at east -2, height 5: 4-3-5
    assert world.clearance(at(2.0, -1.3, 3.5)) == pytest.approx(-0.7)


def test_wall_is_a_box_along_its_line() -> None:
    world = world_of(wall=[{"start": [0.0, 2.0], "end": [6.0, 10.0], "thickness": 0.4, "height": 2.0}])
    assert world.clearance(at(9.0, 14.0, 1.0)) == pytest.approx(5.0)  # on its line, 5 m past the end
    assert world.clearance(at(3.0 - 4.0, 6.0 + 3.0, 1.0)) == pytest.approx(4.8)  # 5 m square off its middle


def test_tree_is_a_trunk_and_a_crown() -> None:
    world = world_of(tree=[{"center": [0.0, 0.0], "trunk_radius": 0.2, "crown_radius": 1.5, "height": [2.0, 6.0]}])
    assert world.clearance(at(3.0, 0.0, 4.0)) == pytest.approx(1.5)
    assert world.clearance(at(3.0, 0.0, 0.0)) == pytest.approx(2.5)  # rim of the crown, nearer than the trunk
    assert world.clearance(at(0.7, 0.0, 0.5)) == pytest.approx(0.5)  # under the crown
    assert world.names == ("tree 0", "tree 0")


def test_a_hill_is_the_cap_of_a_sphere() -> None:
    world = world_of(hill=[{"center": [0.0, 0.0], "radius": 20.0, "height": 10.0}])  # of 25 m, 15 m below the ground
    assert world.clearance(at(0.0, 0.0, 12.0)) == pytest.approx(2.0)
    assert world.clearance(at(21.0, 0.0, 13.0)) == pytest.approx(10.0)  # 21, 28: 35 m from the centre
    assert world.clearance(at(23.0, 0.0, 0.0)) == pytest.approx(3.0)  # of its foot
    assert world.clearance(at(0.0, 12.0, 0.4)) == pytest.approx(-0.4)  # above the ground that it stands on
    down, north = np.eye(3)[2], np.eye(3)[0]
    assert world.range_along(at(15.0, 0.0, 9.0), down, 50.0) == pytest.approx(4.0)  # 20 above the centre
    assert world.range_along(at(-30.0, 0.0, 5.0), north, 50.0) == pytest.approx(15.0)
    assert world.range_along(at(-30.0, 0.0, 10.1), north, 50.0) == math.inf
    assert world.range_along(at(-30.0, 0.0, 1.0), -north, 50.0) == math.inf


def test_nearest_says_whose_surface() -> None:
    world = world_of(
        box=[{"center": [0.0, 10.0], "size": [2.0, 2.0], "height": 5.0}],
        cylinder=[{"center": [0.0, -10.0], "radius": 2.0, "height": 5.0}],
    )
    assert_nearest(world, at(0.0, 2.0, 1.0), "box 0", 7.0)
    assert_nearest(world, at(0.0, 0.0, 1.0), "cylinder 0", 8.0)


def test_an_empty_world_has_ground_only() -> None:
    world = World.load(toml_files.find("worlds", "empty"))
    assert world.clearance(at(3.0, 4.0, 1.0)) == math.inf
    assert world.nearest(at(3.0, 4.0, 1.0)) == (None, math.inf)
    down = np.array([0.6, 0.0, 0.8])
    assert world.range_along(at(0.0, 0.0, 4.0), down, 15.0) == pytest.approx(5.0)
    assert world.range_along(at(0.0, 0.0, 4.0), down, 4.9) == math.inf
    assert world.range_along(at(0.0, 0.0, 4.0), np.array([0.6, 0.0, -0.8]), 1e6) == math.inf
    assert world.range_along(at(0.0, 0.0, 0.0), np.array([1.0, 0.0, 0.0]), 1e6) == math.inf


@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_the_distance_to_the_set_of_inside_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world, text = random_world(rng)
    points = rng.uniform([-25.0, -25.0, -12.0], [25.0, 25.0, -0.0], (400, 3))
    signs = np.array([world.clearance(p) for p in points])
    np.testing.assert_array_equal(signs < 0.0, inside(text, points))
    directions = rng.standard_normal((300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for point, distance in zip(points[signs > 0.0][:150], signs[signs > 0.0][:150], strict=True):
        # nothing is nearer than the clearance, in any direction ...
        assert not inside(text, point + (distance - 1e-9) * directions).any()
        # ... and against its gradient something is, just beyond it
        step = 1e-6 * np.eye(3)
        gradient = np.array([world.clearance(point + s) - world.clearance(point - s) for s in step]) / 2e-6
        if abs(np.linalg.norm(gradient) - 1.0) < 1e-6:  # elsewhere two obstacles are equally near
            foot = point - (distance + 1e-4) * gradient / np.linalg.norm(gradient)
            # at the sharp foot of a hill the line may pass the edge
            assert inside(text, foot[None])[0] or -foot[2] < 1e-3


# --- rays -------------------------------------------------------------------------------------------------------------


def test_ray_hits_by_hand() -> None:
    world = world_of(
        box=[{"center": [10.0, 0.0], "size": [2.0, 4.0], "height": [2.0, 5.0]}],
        cylinder=[{"center": [0.0, 8.0], "radius": 1.0, "height": [1.0, 3.0]}],
    )
    north, east, down = np.eye(3)
    assert world.range_along(at(0.0, 1.9, 3.0), north, 50.0) == pytest.approx(9.0)
    assert world.range_along(at(0.0, 2.1, 3.0), north, 50.0) == math.inf  # just past its side
    assert world.range_along(at(0.0, 1.9, 1.9), north, 50.0) == math.inf  # just under it
    assert world.range_along(at(20.0, 0.0, 3.0), north, 50.0) == math.inf  # behind
    assert world.range_along(at(20.0, 0.0, 3.0), -north, 50.0) == pytest.approx(9.0)
    assert world.range_along(at(10.0, 0.0, 9.0), down, 50.0) == pytest.approx(4.0)  # roof before ground
    assert world.range_along(at(10.0, 0.0, 0.5), -down, 50.0) == pytest.approx(1.5)  # from below
    assert world.range_along(at(0.6, 0.0, 2.0), east, 50.0) == pytest.approx(8.0 - 0.8)  # chord at 0.6 of radius 1
    assert world.range_along(at(0.0, 8.5, 7.0), down, 50.0) == pytest.approx(4.0)  # cap
    # falling at 3-4-5 onto the cap: from height 6 the cap's height 3 is 5 m away, at east 7.5
    assert world.range_along(at(0.0, 3.5, 6.0), np.array([0.0, 0.8, 0.6]), 50.0) == pytest.approx(5.0)
    assert world.range_along(at(10.0, 0.0, 3.0), east, 50.0) == 0.0  # from inside


@pytest.mark.parametrize("seed", range(2))
def test_rays_end_on_the_first_surface(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    world, text = random_world(rng)
    max_range, hits = 30.0, 0
    samples = np.arange(0.0, max_range, 0.02)[:, None]
    for _ in range(600):
        origin = rng.uniform([-22.0, -22.0, -6.0], [22.0, 22.0, -0.2])
        if world.clearance(origin) <= 0.0:
            continue
        direction = rng.standard_normal(3) * [1.0, 1.0, rng.choice([0.0, 0.1, 1.0])]
        direction /= np.linalg.norm(direction)
        distance = world.range_along(origin, direction, max_range)
        path = origin + samples * direction
        before = samples[:, 0] < min(distance, max_range) - 1e-9
        assert not inside(text, path[before]).any()
        assert (path[before][:, 2] <= 1e-9).all()
        if math.isfinite(distance):
            end = origin + distance * direction
            if end[2] < -1e-9:  # above the ground: an obstacle
                hits += 1
                assert abs(world.clearance(end)) < 1e-9
                assert inside(text, (end + 1e-7 * direction)[None])[0]
    assert hits > 100


# --- files ------------------------------------------------------------------------------------------------------------

GOOD: dict[str, dict[str, Any]] = {
    "box": {"center": [1.0, 2.0], "size": [1.0, 1.0], "height": [0.0, 2.0]},
    "cylinder": {"center": [1.0, 2.0], "radius": 1.0, "height": 2.0},
    "wall": {"start": [0.0, 0.0], "end": [1.0, 0.0], "thickness": 0.2, "height": 2},
    "hill": {"center": [1.0, 2.0], "radius": 9.0, "height": 1.0},
    "tree": {"center": [1.0, 2.0], "trunk_radius": 0.1, "crown_radius": 1.0, "height": [1.0, 2.0]},
}


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("box", "size", [0.0, 1.0]),
        ("box", "size", [1.0, -2.0]),
        ("box", "size", [1.0]),
        ("box", "height", [2.0, 2.0]),
        ("box", "height", [3.0, 2.0]),
        ("box", "height", [-1.0, 2.0]),
        ("box", "height", 0.0),
        ("box", "center", [math.nan, 0.0]),
        ("box", "size", [math.inf, 1.0]),
        ("box", "yaw_deg", math.nan),
        ("box", "colour", "red"),
        ("cylinder", "radius", -1.0),
        ("cylinder", "height", math.inf),
        ("cylinder", "name", ""),
        ("hill", "radius", 1e300),
        ("hill", "height", 1e300),
        ("hill", "height", 1e-300),
        ("wall", "thickness", 0.0),
        ("wall", "end", [0.0, 0.0]),
        ("tree", "crown_radius", 0.0),
        ("tree", "trunk_radius", "thick"),
    ],
)
def test_impossible_obstacles_are_refused_with_file_and_key(kind: str, key: str, value: object) -> None:
    assert world_of(**{kind: [GOOD[kind]]}).names  # the same without the fault
    with pytest.raises(toml_files.TomlFileError) as refused:
        world_of(**{kind: [GOOD[kind], {**GOOD[kind], key: value}]})
    text = str(refused.value)
    assert "test.toml" in text
    assert f"{kind}[1]" in text
    assert key in text


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("latitude_deg", 91.0),
        ("longitude_deg", 200.0),
        ("altitude_m", math.nan),
        ("altitude_m", 5e4),
        ("altitude_m", -2e3),
    ],
)
def test_impossible_origins_are_refused(key: str, value: float) -> None:
    with pytest.raises(toml_files.TomlFileError, match=rf"test\.toml.*{key}"):
        World.from_tables({**tables(), "origin": {**ORIGIN, key: value}}, "test.toml")


def test_files_are_read_from_disk(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    path.write_text(
        'name = "small"\n[origin]\nlatitude_deg = 45\nlongitude_deg = -90.0\naltitude_m = 7\n'
        '[[box]]\nname = "shed"\ncenter = [4, 0]\nsize = [2, 2]\nheight = 3\n'
    )
    world = World.load(path)
    assert world.name == "small"
    assert world.origin == pytest.approx((math.pi / 4, -math.pi / 2, 7.0))
    assert_nearest(world, at(0.0, 0.0, 1.0), "shed", 3.0)
    path.write_text(path.read_text().replace("size = [2, 2]", "size = [2, 0]"))
    with pytest.raises(toml_files.TomlFileError, match=r"small\.toml.*box\[0\].*size"):
        World.load(path)


# --- the neighbourhood ------------------------------------------------------------------------------------------------

FLIGHT_HEIGHT = 3.0
HULL = 0.4


def footprints_at_flight_height() -> list[tuple[str, tuple[float, float, float, float]]]:
    """Name and bounds (south, north, west, east) of everything that reaches into the flown layer."""
    table = toml_files.load(NEIGHBOURHOOD, WorldTable)
    bounds = []
    for box in table.box:
        c, s = abs(math.cos(math.radians(box.yaw_deg))), abs(math.sin(math.radians(box.yaw_deg)))
        north = 0.5 * (box.size[0] * c + box.size[1] * s)
        east = 0.5 * (box.size[0] * s + box.size[1] * c)
        bounds.append((box.name, box.span, box.center, north, east))
    bounds += [(c.name, c.span, c.center, c.radius, c.radius) for c in table.cylinder]
    bounds += [(t.name, t.span, t.center, t.crown_radius, t.crown_radius) for t in table.tree]
    return [
        (name, (place[0] - north, place[0] + north, place[1] - east, place[1] + east))
        for name, (low, high), place, north, east in bounds
        if low <= FLIGHT_HEIGHT <= high
    ]


def across_the_line() -> list[tuple[str, tuple[float, float, float, float]]]:
    on_line = [(n, b) for n, b in footprints_at_flight_height() if b[2] < HULL and b[3] > -HULL and b[1] < 120.0]
    return sorted(on_line, key=lambda one: one[1][0] + one[1][1])


def test_at_least_twelve_obstacles_lie_across_the_way() -> None:
    world = World.load(NEIGHBOURHOOD)
    touched = {
        name
        for name, distance in (world.nearest(at(n, 0.0, FLIGHT_HEIGHT)) for n in np.arange(0.0, 120.0, 0.02))
        if distance < HULL
    }
    assert len(touched) >= 12
    assert touched == {name for name, _ in across_the_line()}


def test_the_obstacles_across_the_way_vary() -> None:
    bounds = [b for _, b in across_the_line()]
    middles = [0.5 * (b[0] + b[1]) for b in bounds]
    widths = [b[3] - b[2] for b in bounds]
    sides = [-b[2] < b[3] for b in bounds]  # the nearer edge is the left one
    assert bounds[0][0] >= 10.0
    assert min(np.diff(middles)) >= 7.9 and max(np.diff(middles)) <= 9.0
    assert min(widths) == pytest.approx(0.3) and max(widths) == pytest.approx(8.0)
    assert all(a != b for a, b in itertools.pairwise(sides))


def test_each_can_be_passed_three_metres_outside_its_nearer_edge() -> None:
    world = World.load(NEIGHBOURHOOD)
    for name, (south, north, west, east) in across_the_line():
        side, edge = (-1.0, west) if -west < east else (1.0, east)
        for n in np.linspace(south, north, 30):
            for width in np.linspace(0.01, 7.0, 60):
                assert world.clearance(at(n, edge + side * width, FLIGHT_HEIGHT)) > 0.0, name
            assert world.clearance(at(n, edge + side * 3.0, FLIGHT_HEIGHT)) > 2.5, name


def test_home_and_the_lawn_are_free() -> None:
    world = World.load(NEIGHBOURHOOD)
    others = [name for name in dict.fromkeys(world.names) if name != "customer's house"]
    for height in np.linspace(0.0, 12.0, 25):
        assert world.clearance(at(0.0, 0.0, height)) >= 6.0
        for angle in np.radians(np.arange(0.0, 360.0, 5.0)):
            for radius in (1.0, 3.0, 4.99):
                place = at(120.0 + radius * math.cos(angle), radius * math.sin(angle), height)
                name, distance = world.nearest(place)
                assert distance > 0.0 or name not in others
    assert_nearest(world, at(120.0, 0.0, 2.0), "customer's house", 4.0)


def test_it_is_a_street() -> None:
    world = World.load(NEIGHBOURHOOD)
    assert 45 <= len(set(world.names)) <= 60
    houses = [b for name, b in footprints_at_flight_height() if name.startswith("house")]
    assert len(houses) >= 10
    assert all(east <= -14.0 or west >= 14.0 for _, _, west, east in houses)
    assert {west >= 14.0 for _, _, west, _ in houses} == {True, False}
