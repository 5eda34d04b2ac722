"""From acceleration to thrust and attitude and back: what the command does is what was asked for."""

import math

import numpy as np
import pytest

from companion.control.flatness import attitude_command, inverse
from companion.control.thrust import collective, thrust_vector
from protocol.arrays import Array
from protocol.frames import conjugate, multiply, rotate, to_body, to_rotation_vector, yaw_of
from protocol.vehicle_parameters import GRAVITY

MASS = 1.3
FULL = 32.0
UP = np.array([0.0, 0.0, -1.0])


def accelerated(attitude: Array, force: float) -> Array:
    """What a thrust along the body's -z does to the mass, with gravity."""
    acceleration: Array = rotate(attitude, force * UP) / MASS + np.array([0.0, 0.0, GRAVITY])
    return acceleration


def test_hover_is_level_at_the_weight() -> None:
    thrust, limited = thrust_vector(np.zeros(3), MASS, 1.0, FULL, 0.6)
    assert np.allclose(thrust, [0.0, 0.0, -MASS * GRAVITY])
    assert not limited
    assert np.allclose(attitude_command(thrust, 0.0), [1.0, 0.0, 0.0, 0.0])


def test_inversion_is_exact_for_any_yaw() -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        wanted = rng.uniform(-5.0, 5.0, 3)
        yaw = rng.uniform(-math.pi, math.pi)
        thrust, limited = thrust_vector(wanted, MASS, 0.1, 100.0, 1.5)
        assert not limited
        attitude = attitude_command(thrust, yaw)
        assert np.linalg.norm(attitude) == pytest.approx(1.0)
        assert np.allclose(accelerated(attitude, float(np.linalg.norm(thrust))), wanted, atol=1e-9)
        nose = rotate(attitude, np.array([1.0, 0.0, 0.0]))
        # the heading is that of the body's x axis in the plane through y; exact where y is level
        side = rotate(attitude, np.array([0.0, 1.0, 0.0]))
        assert nose @ np.array([math.cos(yaw), math.sin(yaw), 0.0]) > 0.0
        assert side @ np.array([math.cos(yaw), math.sin(yaw), 0.0]) == pytest.approx(0.0, abs=1e-9)


def test_directions() -> None:
    """North is nose down (negative pitch) at heading 0, east is right side down (positive roll)."""
    north = attitude_command(np.array([3.0, 0.0, -12.0]), 0.0)
    assert north[2] < 0.0 and north[1] == pytest.approx(0.0)
    east = attitude_command(np.array([0.0, 3.0, -12.0]), 0.0)
    assert east[1] > 0.0 and east[2] == pytest.approx(0.0)
    assert yaw_of(attitude_command(np.array([0.0, 0.0, -12.0]), 2.5)) == pytest.approx(2.5)


def test_altitude_comes_first() -> None:
    rng = np.random.default_rng(2)
    for _ in range(500):
        wanted = rng.uniform(-30.0, 30.0, 3)
        tilt = rng.uniform(0.1, 1.0)
        thrust, limited = thrust_vector(wanted, MASS, 2.0, 25.0, tilt)
        up = -thrust[2]
        assert 2.0 <= up <= 25.0
        assert up == pytest.approx(min(max(MASS * (GRAVITY - wanted[2]), 2.0), 25.0))
        assert np.linalg.norm(thrust) <= 25.0 + 1e-9
        assert math.atan2(math.hypot(thrust[0], thrust[1]), up) <= tilt + 1e-9
        assert thrust[0] * wanted[1] == pytest.approx(thrust[1] * wanted[0], abs=1e-6)  # the direction is kept
        assert thrust[0] * wanted[0] >= 0.0
        free, _ = thrust_vector(wanted, MASS, 1e-9, 1e9, math.pi / 2 - 1e-9)
        assert limited == (not np.allclose(free, thrust, atol=1e-6))


def test_without_a_limit_on_the_tilt_the_thrust_keeps_its_direction() -> None:
    rng = np.random.default_rng(4)
    for _ in range(500):
        wanted = rng.uniform(-30.0, 30.0, 3)
        thrust, limited = thrust_vector(wanted, MASS, 2.0, 25.0, math.pi)
        force = MASS * (wanted - np.array([0.0, 0.0, GRAVITY]))
        size = float(np.linalg.norm(force))
        assert np.allclose(thrust, force * min(max(size, 2.0), 25.0) / size)
        assert limited == (not 2.0 <= size <= 25.0)
    falling, limited = thrust_vector(np.array([0.0, 0.0, GRAVITY]), MASS, 2.0, 25.0, math.pi)
    assert np.allclose(falling, [0.0, 0.0, -2.0]) and limited


def test_collective_is_the_nearest_thrust_along_the_body() -> None:
    """What is left of the wanted force is across the body's axis; all of it is given where the attitude is right."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        thrust = np.array([*rng.uniform(-20.0, 20.0, 2), -rng.uniform(5.0, 20.0)])
        tilted = attitude_command(np.array([*rng.uniform(-6.0, 6.0, 2), -12.0]), rng.uniform(-3.0, 3.0))
        force = collective(thrust, tilted)
        assert (thrust - rotate(tilted, force * UP)) @ rotate(tilted, UP) == pytest.approx(0.0, abs=1e-9)
        assert collective(thrust, attitude_command(thrust, 0.3)) == pytest.approx(np.linalg.norm(thrust))


def lissajous(time: float) -> tuple[Array, Array, Array, Array, Array]:
    """Velocity, acceleration, jerk, snap, and the heading with two derivatives, of a smooth motion in all axes."""
    amplitude, rate, phase = np.array([[4.0, 3.0, 1.0], [1.3, 2.1, 1.7], [0.2, 1.0, 2.0]])
    one, two, three, four = (amplitude * rate**n * np.sin(rate * time + phase + n * math.pi / 2) for n in range(1, 5))
    heading = np.array([0.7 * 0.9**n * math.sin(0.9 * time + n * math.pi / 2) for n in range(3)])
    return one, two, three, four, heading


DRAG = np.array([0.45, 0.6, 0.9])


def test_flatness_satisfies_newtons_law() -> None:
    """Thrust, weight and drag at the attitude that it gives are the mass times the acceleration."""
    for time in np.linspace(0.0, 6.0, 40):
        velocity, acceleration, jerk, snap, heading = lissajous(time)
        attitude, _, _, thrust = inverse(velocity, acceleration, jerk, snap, heading, MASS, DRAG)
        drag = rotate(attitude, DRAG * np.array(to_body(attitude, velocity)))
        assert accelerated(attitude, thrust) - drag / MASS == pytest.approx(acceleration, abs=1e-3)
        side = rotate(attitude, np.array([0.0, 1.0, 0.0]))
        assert side @ np.array([math.cos(heading[0]), math.sin(heading[0]), 0.0]) == pytest.approx(0.0, abs=1e-6)


def test_rates_and_angular_acceleration_are_the_attitudes_derivatives() -> None:
    h = 1e-4
    for time in np.linspace(0.0, 6.0, 40):
        (before, rates_before, _, _), (_, rates, turning, _), (after, rates_after, _, _) = (
            inverse(*lissajous(at), MASS, DRAG) for at in (time - h, time, time + h)
        )
        turned = to_rotation_vector(multiply(conjugate(before), after)) / (2.0 * h)
        assert rates == pytest.approx(turned, abs=2e-3)
        assert turning == pytest.approx((rates_after - rates_before) / (2.0 * h), abs=2e-2)


def test_free_fall_has_an_attitude_all_the_same() -> None:
    fall = np.array([0.0, 0.0, GRAVITY])
    attitude, rates, turning, _ = inverse(np.zeros(3), fall, np.zeros(3), np.zeros(3), np.zeros(3), MASS, DRAG)
    assert np.linalg.norm(attitude) == pytest.approx(1.0)
    assert np.isfinite([*rates, *turning]).all()


def test_attitude_is_smooth_in_the_command() -> None:
    """A small change of the thrust or yaw is a small change of the attitude (no jump of frame or sign of rotation)."""
    rng = np.random.default_rng(4)
    for _ in range(300):
        thrust = np.array([*rng.uniform(-6.0, 6.0, 2), -rng.uniform(4.0, 20.0)])
        yaw = rng.uniform(-math.pi, math.pi)
        a = attitude_command(thrust, yaw)
        b = attitude_command(thrust + rng.normal(size=3) * 1e-4, yaw + 1e-4)
        assert np.linalg.norm(to_rotation_vector(multiply(conjugate(a), b))) < 1e-3
