"""References: continuous, within their limits, and where they were sent."""

import math

import numpy as np
import pytest

from companion.config import Trajectory
from companion.state import Reference
from companion.trajectory import ReferenceGenerator
from protocol.frames import wrap

SETTINGS = Trajectory()
TICK = 4_000_000


def standing() -> ReferenceGenerator:
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(np.array([1.0, 2.0, -3.0]), 0.5)
    return generator


def run(generator: ReferenceGenerator, seconds: float, start_ns: int = 0) -> list[Reference]:
    """References at 250 Hz."""
    return [generator.at(start_ns + i * TICK) for i in range(round(seconds * 250))]


def test_stands_where_it_is_placed() -> None:
    reference = standing().at(12345)
    assert np.array_equal(reference.position_ned, [1.0, 2.0, -3.0])
    assert not reference.velocity_ned.any() and not reference.acceleration_ned.any()
    assert (reference.yaw, reference.yaw_rate) == (0.5, 0.0)


def test_whoever_asked_may_write_into_a_reference() -> None:
    """At rest, too, where the same one is given again."""
    generator = standing()
    for _ in range(3):
        reference = generator.at(12345)
        assert np.array_equal(reference.rows[:2], [[1.0, 2.0, -3.0], [0.0, 0.0, 0.0]])
        reference.rows[:] = 7.0


def test_a_leg_is_straight_and_keeps_to_speed_and_acceleration() -> None:
    generator = standing()
    target = np.array([31.0, 42.0, -3.0])
    generator.move_to(0, target, 4.0, 1.5)
    path = run(generator, 20.0)
    speeds = [np.linalg.norm(r.velocity_ned) for r in path]
    assert max(speeds) == pytest.approx(4.0, rel=0.01)
    assert max(np.abs(r.acceleration_ned).max() for r in path) <= SETTINGS.acceleration + 1e-9
    way = (target - path[0].position_ned) / 50.0
    for r in path:
        offset = r.position_ned - path[0].position_ned
        assert np.linalg.norm(offset - (offset @ way) * way) < 1e-6
    assert np.allclose(path[-1].position_ned, target)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-9)


def test_no_way_is_faster_than_what_is_asked_for_not_even_up_or_down() -> None:
    for height in (-20.0, 20.0):
        generator = standing()
        generator.move_to(0, np.array([1.0, 2.0, height]), 0.5, 1.5)
        fastest = max(float(np.linalg.norm(r.velocity_ned)) for r in run(generator, 60.0))
        assert fastest == pytest.approx(0.5, rel=1e-6)


@pytest.mark.parametrize("north", [1.0, 11.0])
def test_up_and_down_no_way_is_faster_than_the_vertical_speed(north: float) -> None:
    for height in (-20.0, 20.0):
        generator = standing()
        generator.move_to(0, np.array([north, 2.0, height]), 4.0, 1.5)
        path = run(generator, 30.0)
        assert max(abs(float(r.velocity_ned[2])) for r in path) == pytest.approx(1.5, rel=1e-6)
        assert path[-1].position_ned == pytest.approx([north, 2.0, height])


def test_derivatives_belong_to_the_position() -> None:
    generator = standing()
    generator.move_to(0, np.array([11.0, -5.0, -6.0]), 3.0, 1.0)
    path = run(generator, 6.0)
    dt = TICK * 1e-9
    for a, b, c in zip(path, path[1:], path[2:], strict=False):
        assert np.allclose((c.position_ned - a.position_ned) / (2 * dt), b.velocity_ned, atol=1e-3)
        assert np.allclose((c.velocity_ned - a.velocity_ned) / (2 * dt), b.acceleration_ned, atol=0.07)


def test_a_new_target_in_motion_makes_no_jump() -> None:
    rng = np.random.default_rng(1)
    generator = standing()
    generator.move_to(0, np.array([20.0, 0.0, -3.0]), 4.0, 1.5)
    now = 0
    before = generator.at(0)
    for _ in range(60):
        for _ in range(25):
            now += TICK
            reference = generator.at(now)
            assert np.linalg.norm(reference.position_ned - before.position_ned) < 0.03
            assert np.linalg.norm(reference.velocity_ned - before.velocity_ned) < 0.03
            assert np.linalg.norm(reference.acceleration_ned - before.acceleration_ned) < 0.25
            before = reference
        generator.move_to(now, before.position_ned + rng.uniform(-15.0, 15.0, 3), rng.uniform(0.3, 4.0), 1.5)


def test_a_target_that_creeps_does_not_shake_the_vehicle() -> None:
    """Each scan puts the target some millimetres further: the cruise stays one; where it moves on, it is gone to."""
    generator = standing()
    target = np.array([30.0, 8.0, -3.0])
    now, cruise = 0, []
    for scan in range(60):
        generator.move_to(now, target + 0.007 * scan * np.array([1.0, -0.3, 0.0]), 4.0, 1.5)
        for _ in range(17):
            now += TICK
            if 2.0e9 < now < 4.0e9:
                cruise.append(generator.at(now).acceleration_ned)
    assert (np.abs(cruise) > 1e-6).any(axis=1).mean() < 0.15
    final = target + np.array([1.0, -2.0, 0.0])
    generator.move_to(now, final, 4.0, 1.5)
    assert np.allclose(generator.at(now + 60 * 10**9).position_ned, final)


def test_a_stop_brakes_within_the_limits() -> None:
    generator = standing()
    generator.move_to(0, np.array([60.0, 2.0, -3.0]), 4.0, 1.5)
    moving = generator.at(4 * 10**9)
    assert np.linalg.norm(moving.velocity_ned) == pytest.approx(4.0, rel=0.01)
    generator.brake(4 * 10**9)
    path = run(generator, 3.0, 4 * 10**9)
    assert np.allclose(path[0].velocity_ned, moving.velocity_ned)
    assert not path[-1].velocity_ned.any() or np.linalg.norm(path[-1].velocity_ned) < 1e-9
    assert max(np.abs(r.acceleration_ned).max() for r in path) <= SETTINGS.acceleration + 1e-9
    covered = np.linalg.norm(path[-1].position_ned - path[0].position_ned)
    assert 4.0**2 / (2 * SETTINGS.acceleration) < covered < 4.0**2 / (2 * SETTINGS.acceleration) + 1.0


@pytest.mark.parametrize("start", [3.0, -3.0, 0.0])
@pytest.mark.parametrize("goal", [-3.0, 3.0, 1.0])
def test_turns_the_shorter_way(start: float, goal: float) -> None:
    generator = ReferenceGenerator(SETTINGS)
    generator.hold_at(np.zeros(3), start)
    generator.turn_to(0, goal)
    path = run(generator, 8.0)
    assert wrap(path[-1].yaw - goal) == pytest.approx(0.0, abs=1e-6)
    assert abs(path[-1].yaw - start) <= math.pi + 1e-9
    assert max(abs(r.yaw_rate) for r in path) <= math.radians(SETTINGS.yaw_rate_deg) + 1e-9
    assert not path[-1].velocity_ned.any()


def test_another_vertical_speed_on_the_way_raises_nothing() -> None:
    """ruckig has an error for some of these; the reference then goes on to where it was sent before."""
    rng = np.random.default_rng(1)
    for _ in range(2000):
        generator = ReferenceGenerator(SETTINGS)
        start, end = rng.uniform(-30.0, 30.0, (2, 3))
        generator.hold_at(start, 0.0)
        generator.move_to(0, end, 4.0, 1.0)
        generator.move_to(30_000_000_000, end, 4.0, 1.5)
        assert generator.at(200_000_000_000).position_ned == pytest.approx(end, abs=1e-6)
