"""Tracks: every derivative belongs to the one before, the joints are smooth, and the shapes are what they say."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.config import Trajectory
from companion.curves import Shape
from companion.trajectory import ReferenceGenerator, Track, track_of
from companion.trajectory.shapes import shape_of
from companion.trajectory.timing import TimeLaw
from protocol.arrays import Array
from protocol.frames import wrap
from protocol.vehicle_parameters import GRAVITY

SETTINGS = Trajectory()
CIRCLE = Shape("circle", speed=4.0, radius=3.0, laps=3.0)
SHAPES = [
    CIRCLE,
    Shape("helix", speed=2.0, radius=1.5, pitch=3.0, laps=2.0, heading="along"),
    Shape("ellipse", speed=10.0, acceleration=20.0, minor_radius=2.0, laps=2.5, heading="along"),
    Shape("lemniscate", speed=4.0, radius=3.0, laps=2.0, heading="along"),
]
LOOP = Shape("loop", speed=7.0, radius=2.0, laps=3.0, ramp_s=0.8)
SQUARE = Shape("square", speed=2.0, radius=1.5, laps=2.0, heading="along")
START = np.array([10.0, -20.0, -3.0])


def slope(function: Callable[[float], Array], at: float, step: float = 1e-3) -> Array:
    """By six points; its error is of the sixth order in the step."""
    weights = {-3: -1.0, -2: 9.0, -1: -45.0, 1: 45.0, 2: -9.0, 3: 1.0}
    total: Array = np.sum([weight * function(at + k * step) for k, weight in weights.items()], axis=0)
    return total / (60.0 * step)


def path_of(shape: Shape) -> Callable[[float], Array]:
    return shape_of(shape).at


def track(shape: Shape) -> Track:
    return track_of(shape, SETTINGS, 0.6).shifted(START)


@pytest.mark.parametrize("shape", [*SHAPES, LOOP, SQUARE], ids=lambda shape: shape.shape)
def test_derivatives_of_a_shape_by_its_parameter(shape: Shape) -> None:
    path = path_of(shape)
    assert not path(0.0)[0].any()
    for parameter in (0.3, 1.4, 2.9, 3.3, 5.7, 9.4):
        derivative, value = slope(path, parameter), path(parameter)
        assert np.allclose(derivative[:4], value[1:], atol=1e-8)
        assert np.abs(value[1]).max() > 0.5


def test_shapes_are_what_they_are_called() -> None:
    for angle in np.linspace(0.0, 7.0, 30).tolist():
        north, east, down = path_of(CIRCLE)(angle)[0]
        assert math.hypot(north, east - 3.0) == pytest.approx(3.0) and down == 0.0
        north, east, down = path_of(SHAPES[1])(angle)[0]
        assert math.hypot(north, east - 1.5) == pytest.approx(1.5)
        assert down == pytest.approx(-3.0 * angle / (2.0 * math.pi))
        north, east, _ = path_of(SHAPES[2])(angle)[0]
        assert (north / 5.0) ** 2 + ((east - 2.0) / 2.0) ** 2 == pytest.approx(1.0)
        north, east, _ = path_of(SHAPES[3])(angle)[0]  # Gerono's: x^4 = a^2 (x^2 - y^2)
        assert north**4 == pytest.approx(9.0 * (north**2 - east**2), abs=1e-9)
        north, east, down = path_of(LOOP)(angle)[0]
        assert north == 0.0 and math.hypot(east, -down - 2.0) == pytest.approx(2.0)
    assert path_of(LOOP)(0.1)[0][1] > 0.0 > path_of(LOOP)(math.pi)[0][2]
    corners = [path_of(SQUARE)(float(k))[0].tolist() for k in range(5)]
    assert corners == [[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0], [0, 0, 0]]


@pytest.mark.parametrize("shape", [*SHAPES, LOOP, SQUARE], ids=lambda shape: shape.shape)
def test_a_track_goes_from_rest_to_its_speed_and_to_rest(shape: Shape) -> None:
    flown = track(shape)
    motion = np.array([flown.at(t) for t in np.linspace(0.0, flown.duration_s, 4001).tolist()])
    speed = np.linalg.norm(motion[:, 1], axis=1)
    assert speed.max() == pytest.approx(shape.speed, rel=1e-3) and speed.max() <= shape.speed * (1.0 + 1e-12)
    for time in (-1.0, 0.0, flown.duration_s, flown.duration_s + 5.0):
        assert np.abs(flown.at(time)[1:5]).max() < 1e-9
        assert not flown.at(time)[5, 1:].any()
    assert np.array_equal(flown.at(0.0)[0], START)
    way = flown.at(1e9)[0] - START
    assert np.allclose(way, shape_of(shape).at(shape.laps * shape_of(shape).lap)[0], atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.shape)
def test_derivatives_of_a_track_by_time(shape: Shape) -> None:
    """The chain rule, on the ramps and between them, for position and heading."""
    flown = track(shape)
    for time in (0.4, 1.5, 2.9, 0.5 * flown.duration_s, flown.duration_s - 2.0, flown.duration_s - 0.4):
        value, derivative = flown.at(time), slope(flown.at, time)
        assert np.allclose(derivative[:4], value[1:5], atol=1e-7, rtol=1e-7)
        assert derivative[5, 1] == pytest.approx(value[5, 2], abs=1e-7)
        north, east, rate = math.cos(value[5, 0]), math.sin(value[5, 0]), value[5, 1]
        assert np.allclose([north, east], value[1, :2] / np.linalg.norm(value[1, :2]))
        turning = slope(lambda t: np.array([np.cos(flown.at(t)[5, 0]), np.sin(flown.at(t)[5, 0])]), time)
        assert np.allclose(turning, [-east * rate, north * rate], atol=1e-7)


@pytest.mark.parametrize("shape", [*SHAPES, LOOP], ids=lambda shape: shape.shape)
def test_joints_are_continuous_up_to_snap(shape: Shape) -> None:
    flown = track(shape)
    joints = (0.0, shape.ramp_s, flown.duration_s - shape.ramp_s, flown.duration_s)
    scale = np.abs([flown.at(t) for t in np.linspace(0.0, flown.duration_s, 500).tolist()]).max(axis=(0, 2))
    for joint in joints:
        before, after = flown.at(joint - 1e-6), flown.at(joint + 1e-6)
        assert (np.abs(after - before).max(axis=1)[:5] < 1e-4 * scale[:5]).all()


def test_a_circle_at_speed_is_the_analytic_one() -> None:
    flown = track(Shape("circle", speed=4.0, radius=3.0, laps=3.0, heading="along"))
    centre = START + np.array([0.0, 3.0, 0.0])
    for time in (4.0, 6.5, 9.0):
        position, velocity, acceleration, jerk, snap, heading = flown.at(time)
        out, rate = (position - centre) / 3.0, 4.0 / 3.0
        forward = np.array([-out[1], out[0], 0.0])  # clockwise from above: north, then east
        assert np.allclose(velocity, 4.0 * forward)
        assert np.allclose(acceleration, -3.0 * rate**2 * out)
        assert np.allclose(jerk, -3.0 * rate**3 * forward)
        assert np.allclose(snap, 3.0 * rate**4 * out)
        assert wrap(heading[0] - math.atan2(forward[1], forward[0])) == pytest.approx(0.0, abs=1e-12)
        assert heading[1] == pytest.approx(rate) and heading[2] == pytest.approx(0.0)


def test_a_square_jumps_at_its_corners_alone() -> None:
    flown = track(SQUARE)
    motion = np.array([flown.at(t) for t in np.linspace(3.01, flown.duration_s - 3.01, 3000).tolist()])
    assert np.allclose(np.linalg.norm(motion[:, 1], axis=1), 2.0)
    assert not motion[:, 2:5].any()
    assert (np.abs(np.diff(motion[:, 1], axis=0)).max(axis=1) > 1.0).sum() == 5


@pytest.mark.parametrize(("laps", "heading_deg"), [(0.25, 0.0), (0.5, 90.0), (0.75, 180.0), (1.0, -90.0), (3.0, -90.0)])
def test_a_square_ends_with_the_heading_of_its_last_edge(laps: float, heading_deg: float) -> None:
    flown = track(msgspec.structs.replace(SQUARE, laps=laps))
    for before_s in (0.3, 1e-3, 1e-6, 0.0, -1.0):
        heading = flown.at(flown.duration_s - before_s)[5, 0]
        assert abs(wrap(heading - math.radians(heading_deg))) < 1e-9


def test_without_ramps_it_is_at_speed_at_once() -> None:
    flown = track(Shape("circle", speed=4.0, radius=3.0, ramp_s=0.0))
    assert np.linalg.norm(flown.at(0.0)[1]) == pytest.approx(4.0)
    assert flown.duration_s == pytest.approx(2.0 * math.pi * 3.0 / 4.0)
    assert not flown.at(flown.duration_s)[1].any() and not flown.at(-1e-9)[1].any()


def test_a_way_too_short_for_its_ramps_is_flown_more_slowly() -> None:
    law = TimeLaw(1.0, 2.0, 4.0, 3.0, 1.0)
    path = np.array([law.at(t) for t in np.linspace(0.0, law.duration_s, 1001).tolist()])
    assert law.duration_s == 4.0
    assert path[0].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0]
    assert path[-1, 0] == pytest.approx(2.0) and path[:, 1].max() == pytest.approx(0.5, rel=1e-4)


def test_what_is_left_of_a_track_begins_at_rest_where_it_was_left() -> None:
    whole = track(CIRCLE)
    left = whole.resumed_at(5.0)
    assert np.allclose(left.start_ned, whole.at(5.0)[0])
    assert not left.at(0.0)[1:5].any()
    assert np.allclose(left.at(1e9)[0], whole.at(1e9)[0])
    assert np.linalg.norm(left.at(4.0)[1]) == pytest.approx(4.0)
    again = left.resumed_at(3.5)
    assert np.allclose(again.start_ned, left.at(3.5)[0])


@pytest.mark.parametrize("shape", [*SHAPES, LOOP, SQUARE], ids=lambda shape: shape.shape)
def test_what_is_left_of_a_track_at_its_end_is_to_stay_there(shape: Shape) -> None:
    whole = track(shape)
    left = whole.resumed_at(whole.duration_s + 1.0)
    for time_s in (0.0, 0.5, left.duration_s, 1e9):
        assert np.allclose(left.at(time_s)[0], whole.at(1e9)[0], atol=1e-9)
        assert not left.at(time_s)[1:5].any()


@pytest.mark.parametrize("shape", [CIRCLE, LOOP, SQUARE], ids=lambda shape: shape.shape)
def test_nothing_is_left_of_a_track_without_ramps_at_its_end(shape: Shape) -> None:
    whole = track(msgspec.structs.replace(shape, ramp_s=0.0))
    left = whole.resumed_at(whole.duration_s + 1.0)
    assert left.duration_s == 0.0
    assert np.allclose(left.start_ned, whole.at(1e9)[0], atol=1e-9)


def following(shape: Shape) -> ReferenceGenerator:
    generator = ReferenceGenerator(SETTINGS)
    flown = track(shape)
    generator.hold_at(START, flown.start_yaw or 0.0)
    generator.follow(0, flown)
    return generator


@pytest.mark.parametrize("heading", ["fixed", "along"])
def test_a_stop_on_a_circle_brakes_without_a_jump(heading: str) -> None:
    shape = Shape("circle", speed=4.0, radius=3.0, laps=3.0, heading="along" if heading == "along" else "fixed")
    generator = following(shape)
    now, tick = 6_000_000_000, 4_000_000
    before = generator.at(now)
    assert np.linalg.norm(before.acceleration_ned) == pytest.approx(16.0 / 3.0)
    generator.brake(now)
    assert not generator.following
    path = [generator.at(now + i * tick) for i in range(1000)]
    assert np.array_equal(path[0].position_ned, before.position_ned)
    assert np.array_equal(path[0].velocity_ned, before.velocity_ned)
    assert np.allclose(path[0].acceleration_ned, before.acceleration_ned)
    assert (path[0].yaw, path[0].yaw_rate) == (before.yaw, before.yaw_rate)
    for a, b in pairwise(path):
        assert np.abs(b.acceleration_ned - a.acceleration_ned).max() <= 2.0 * SETTINGS.jerk * tick * 1e-9 + 1e-9
        assert np.abs(b.velocity_ned - a.velocity_ned).max() < 0.025
        assert abs(b.yaw - a.yaw) < 0.006
    assert generator.at_rest(now + 4 * 10**9)
    assert np.abs(path[-1].velocity_ned).max() < 1e-9 and abs(path[-1].yaw_rate) < 1e-9


@pytest.mark.parametrize("heading", ["fixed", "along"])
def test_at_the_end_of_a_track_the_reference_stays_as_it_was(heading: Any) -> None:
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(START, 0.7)
    flown = track(Shape("circle", speed=2.0, radius=3.0, laps=1.25, heading=heading))
    generator.follow(0, flown)
    end_ns = round(flown.duration_s * 1e9) + 1
    before = generator.at(end_ns)
    assert before.yaw == pytest.approx(0.5 * math.pi if heading == "along" else 0.7)
    generator.end_track(end_ns)
    assert np.array_equal(generator.at(end_ns).rows, before.rows)


@pytest.mark.parametrize("shape", [Shape("ellipse", speed=10.0, acceleration=40.0, laps=9.0, heading="along"), SQUARE])
def test_a_hard_track_is_left_by_braking_as_hard(shape: Shape) -> None:
    """With the limits of other motion, the turn that is under way would carry it off at ten times its speed."""
    generator = following(shape)
    now, tick = 5_000_000_000, 20_000_000
    places, speeds = [], []
    for i in range(1000):
        generator.move_to(now + i * tick, START, 4.0, 1.5)
        generator.turn_to(now + i * tick, 1.0)
        reference = generator.at(now + i * tick)
        places.append(reference.position_ned)
        speeds.append(float(np.linalg.norm(reference.velocity_ned)))
    assert max(speeds) < 1.6 * shape.speed
    assert np.linalg.norm(np.array(places) - START, axis=1).max() < 30.0
    assert np.allclose(places[-1], START, atol=1e-6)
    assert wrap(reference.yaw - 1.0) == pytest.approx(0.0, abs=1e-6)


def test_from_a_track_to_a_target_and_a_heading() -> None:
    generator = following(SHAPES[1])
    now = 5_000_000_000
    before = generator.at(now)
    generator.move_to(now, START, 3.0, 1.0)
    after = generator.at(now)
    assert np.array_equal(after.velocity_ned, before.velocity_ned)
    assert after.yaw_rate == pytest.approx(before.yaw_rate)
    for later in range(100):  # once the heading has come to rest
        generator.turn_to(now + later * 50_000_000, 1.0)
    end = generator.at(now + 20 * 10**9)
    assert np.allclose(end.position_ned, START) and wrap(end.yaw - 1.0) == pytest.approx(0.0, abs=1e-9)
    assert generator.at_rest(now + 20 * 10**9) and not generator.at_rest(now + 10**9)


def test_a_track_rests_at_its_end_and_goes_on_from_there() -> None:
    generator = following(CIRCLE)
    end = round(track(CIRCLE).duration_s * 1e9)
    assert not generator.at_rest(end - 10**9) and generator.at_rest(end + 1000)
    for later in (10**6, 10**10):
        assert np.allclose(generator.at(end + later).position_ned, START, atol=1e-9)
        assert not generator.at(end + later).velocity_ned.any()
    beside = START + np.array([1.0, 0.0, 0.0])
    generator.move_to(end + 10**7, beside, 1.0, 1.0)
    assert np.allclose(generator.at(end + 10**10).position_ned, beside)


def test_back_to_the_target_that_it_came_from() -> None:
    helix = track(SHAPES[1])
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(START)
    generator.move_to(0, START, 1.0, 1.0)
    generator.follow(0, helix)
    end = round(helix.duration_s * 1e9) + 1000
    generator.move_to(end, START, 1.0, 1.0)
    assert np.allclose(generator.at(end + 30 * 10**9).position_ned, START)


def test_a_loop_heads_north_and_is_resumed_where_a_lap_begins() -> None:
    flown = track(LOOP)
    assert flown.start_yaw == 0.0 and not flown.along
    lap_s = 2.0 * math.pi * 2.0 / 7.0
    for time, laps in ((0.9, 3.0), (0.4 + 1.5 * lap_s, 2.0), (0.4 + 2.5 * lap_s, 1.0)):
        rest = flown.resumed_at(time)
        assert np.allclose(rest.start_ned, START) and np.allclose(rest.at(1e9)[0], START)
        assert rest.law.end - rest.law.start == pytest.approx(laps * 2.0 * math.pi)
    law = flown.resumed_at(1e9).law
    assert law.start == law.end


def test_nowhere_on_a_loop_the_thrust_vanishes() -> None:
    """Else the attitude would not be defined: on the ramps, too, where the vehicle is still slow."""
    for radius in (0.5, 2.0, 10.0):
        speed = 1.001 * math.sqrt(1.5 * GRAVITY * radius)
        flown = track(Shape("loop", speed=speed, radius=radius, ramp_s=0.999 * math.pi * radius / speed))
        thrust = np.array([flown.at(t)[2] for t in np.linspace(0.0, flown.duration_s, 2000).tolist()])
        thrust[:, 2] -= GRAVITY
        assert np.linalg.norm(thrust, axis=1).min() > 0.45 * GRAVITY


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"speed": 5.0}, "speed: a loop of radius 2 needs 5.4 m/s"),
        ({"ramp_s": 1.0}, "ramp_s: at most 0.90"),
        ({"laps": 1.5}, "flown whole"),
        ({"heading": "along"}, "fixed"),
    ],
)
def test_a_loop_that_can_not_be_flown_is_refused(changes: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        msgspec.structs.replace(LOOP, **changes)
