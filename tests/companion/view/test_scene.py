"""The world as it is drawn: the simulator's own shapes, closed and the right way out."""

import itertools
import math
import tomllib

import numpy as np
import pytest

from companion.view.scene import ROOM, in_the_way, mesh, origin, solids
from protocol.toml_files import ROOT
from vehicle_sim.world import World

TEXT = (ROOT / "worlds" / "neighbourhood.toml").read_bytes()
WORLD = World.from_tables(tomllib.loads(TEXT.decode()), "neighbourhood.toml")


def test_every_box_and_cylinder_is_where_the_simulator_has_it() -> None:
    """The simulator's rows are the oracle: north, east, half sizes, cos and sin of the yaw, top and bottom (down)."""
    drawn = solids(TEXT)
    boxes = [prism for prism in drawn if not prism.round]
    cylinders = [prism for prism in drawn if prism.round]
    assert len(boxes) == len(WORLD.boxes) and len(cylinders) == len(WORLD.cylinders)
    for prism, (north, east, along, across, cos, sin, top, bottom) in zip(boxes, WORLD.boxes, strict=True):
        wanted = {
            (round(north + cos * a - sin * b, 6), round(east + sin * a + cos * b, 6))
            for a in (along, -along)
            for b in (across, -across)
        }
        assert {(round(n, 6), round(e, 6)) for n, e in prism.outline} == wanted, prism.name
        assert (prism.top, prism.bottom) == (-top, -bottom)
    for prism, (north, east, radius, top, bottom, _) in zip(cylinders, WORLD.cylinders, strict=True):
        assert all(math.dist(place, (north, east)) == pytest.approx(radius) for place in prism.outline), prism.name
        assert (prism.top, prism.bottom) == (-top, -bottom)


def test_a_hill_is_drawn_as_steps_with_its_volume() -> None:
    hill = b'[[hill]]\nname = "mound"\ncenter = [5.0, -3.0]\nradius = 20.0\nheight = 4.0\n'
    steps = solids(hill)
    assert steps[0].bottom == 0.0 and steps[-1].top == pytest.approx(4.0)
    assert all(low.top == pytest.approx(high.bottom) for low, high in itertools.pairwise(steps))
    radii = [math.dist(step.outline[0], (5.0, -3.0)) for step in steps]
    volume = sum(math.pi * radius**2 * (step.top - step.bottom) for radius, step in zip(radii, steps, strict=True))
    assert volume == pytest.approx(math.pi * 4.0 * (3.0 * 20.0**2 + 4.0**2) / 6.0, rel=0.01)


def test_meshes_are_closed_and_turned_outwards() -> None:
    """The signed volume of the triangles is the volume of the prism, and each edge is walked once each way."""
    for prism in solids(TEXT):
        corners, faces = mesh(prism)
        points = np.array(corners)
        volume = sum(np.dot(points[a], np.cross(points[b], points[c])) for a, b, c in faces) / 6.0
        north, east = np.array(prism.outline).T
        area = 0.5 * abs(np.dot(north, np.roll(east, 1)) - np.dot(east, np.roll(north, 1)))
        assert volume == pytest.approx(area * (prism.top - prism.bottom)), prism.name
        edges = [edge for a, b, c in faces for edge in ((a, b), (b, c), (c, a))]
        assert len(set(edges)) == len(edges)
        assert {(b, a) for a, b in edges} == set(edges)


def test_what_a_straight_flight_comes_near_is_named() -> None:
    """The simulator's distances are the oracle; at corners a little more than ROOM is near, too."""
    generator = np.random.default_rng(1)
    near = far = 0
    for _ in range(150):
        start, end = generator.uniform((0.0, -8.0, -6.0), (120.0, 8.0, -1.0), (2, 3))
        line = start + np.linspace(0.0, 1.0, 400)[:, None] * (end - start)
        clearance = min(WORLD.clearance(place) for place in line)
        named = in_the_way(TEXT, start, end)
        if clearance < 0.95 * ROOM:
            near += 1
            assert named
        elif clearance > 1.5 * ROOM:
            far += 1
            assert not named, (named, clearance)
    assert near > 20 and far > 20
    assert in_the_way(TEXT, np.array([0.0, 0.2, -3.0]), np.array([15.0, 0.2, -3.0])) == ["street lamp"]


def test_the_origin_is_the_simulators() -> None:
    assert origin(TEXT) == pytest.approx(WORLD.origin)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\xff",
        b"not toml",
        b"[[box]]\nname = 1\n",
        b"box = 3\n",
        b"a = " + b"[" * 3000 + b"]" * 3000,
        b"[[box]]\nname" + b".a" * 3000 + b" = 1\ncenter = [0, 0]\nsize = [1, 1]\nheight = 1\n",
        b"a = " + b"9" * 5000,
    ],
)
def test_a_world_that_can_t_be_read_is_drawn_as_empty(text: bytes) -> None:
    assert solids(text) == []
    assert origin(text) is None


@pytest.mark.parametrize(
    "hill", [b"radius = 1e300\nheight = 1e300", b"radius = 9.0\nheight = 0.0", b"radius = 9.0\nheight = []"]
)
def test_a_solid_that_can_t_exist_is_left_out(hill: bytes) -> None:
    names = {each.name for each in solids(TEXT)}
    assert {each.name for each in solids(TEXT + b'\n[[hill]]\nname = "bad"\ncenter = [9, 0]\n' + hill)} == names
