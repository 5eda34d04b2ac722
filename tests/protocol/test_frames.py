"""Frames of reference, against scipy's rotations and geodesy by hand."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from protocol import frames
from protocol.arrays import Array

X, Y, Z = np.eye(3)
RIGHT = 0.5 * math.pi
ZURICH = (math.radians(47.4), math.radians(8.55), 488.0)


def random_quaternions(count: int = 200) -> list[Array]:
    """Uniform over all attitudes and both signs, w,x,y,z."""
    drawn = np.random.default_rng(7).normal(size=(count, 4))
    return list(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def random_vectors(count: int = 200) -> list[Array]:
    return list(np.random.default_rng(8).normal(scale=10.0, size=(count, 3)))


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v)


def from_matrix(r: Array) -> Array:
    """The columns of a rotation matrix (3, 3) are the body's axes in the world."""
    return frames.from_axes(*(tuple(column) for column in r.T.tolist()))


def oracle(q: Array) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def assert_same_attitude(actual: Array, expected: Array) -> None:
    """As rotations: q and -q are one."""
    assert np.linalg.norm(actual) == pytest.approx(1.0, abs=1e-12)
    assert abs(float(actual @ expected)) == pytest.approx(1.0, abs=1e-12)


# --- products and rotations -------------------------------------------------------------------------------------------


def test_a_product_turns_by_the_right_factor_first() -> None:
    for a, b in zip(random_quaternions(), random_quaternions()[::-1], strict=True):
        assert_same_attitude(frames.multiply(a, b), (oracle(a) * oracle(b)).as_quat(scalar_first=True))


def test_hamiltons_rule() -> None:
    i, j, k = np.eye(4)[1:]
    np.testing.assert_array_equal(frames.multiply(i, j), k)
    np.testing.assert_array_equal(frames.multiply(j, i), -k)


def test_a_quaternion_times_its_conjugate_is_one() -> None:
    for q in random_quaternions():
        np.testing.assert_allclose(frames.multiply(q, frames.conjugate(q)), [1.0, 0.0, 0.0, 0.0], atol=1e-15)


def test_rotations_as_scipy_does_them_for_both_signs() -> None:
    for q, v in zip(random_quaternions(), random_vectors(), strict=True):
        world = oracle(q).apply(v)
        np.testing.assert_allclose(frames.rotate(q, v), world, atol=1e-12)
        np.testing.assert_allclose(frames.rotate(-q, v), world, atol=1e-12)
        np.testing.assert_allclose(frames.to_body(q, world), v, atol=1e-12)
        np.testing.assert_allclose(frames.axes_frd(q) @ v, world, atol=1e-12)


@pytest.mark.parametrize(
    ("euler", "body", "world"),
    [
        ((0.0, 0.0, RIGHT), X, Y),  # heading east: the nose points east
        ((0.0, RIGHT, 0.0), X, -Z),  # pitched up: the nose points to the sky, and down is negative there
        ((RIGHT, 0.0, 0.0), Y, Z),  # rolled right: the right wing points down
        ((0.0, math.pi / 6, 0.0), -Z, np.array([-0.5, 0.0, -math.sqrt(0.75)])),  # pitched up: thrust pulls back
    ],
)
def test_signs_as_pilots_know_them(euler: tuple[float, float, float], body: Array, world: Array) -> None:
    np.testing.assert_allclose(frames.rotate(frames.from_euler(*euler), body), world, atol=1e-15)


def test_nothing_is_written_into_inputs() -> None:
    q, v = random_quaternions()[0], random_vectors()[0]
    q_before, v_before = q.copy(), v.copy()
    frames.multiply(q, q)
    frames.conjugate(q)
    frames.rotate(q, v)
    frames.to_body(q, v)
    frames.to_rotation_vector(-q)
    np.testing.assert_array_equal(q, q_before)
    np.testing.assert_array_equal(v, v_before)


# --- rotation vectors -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 1e-200, 1e-12, 1e-9, 9.99e-5, 1.01e-4, 0.09, 3.0, math.pi - 1e-7])
def test_rotation_vectors_round_trip_at_every_size(angle: float) -> None:
    rotation = angle * unit(np.array([1.0, -2.0, 3.0]))
    q = frames.from_rotation_vector(rotation)
    assert_same_attitude(q, Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    np.testing.assert_allclose(frames.to_rotation_vector(q), rotation, rtol=1e-9, atol=0.0)


def test_rotation_vectors_are_the_shortest_and_the_same_for_both_signs() -> None:
    for q in random_quaternions():
        rotation = frames.to_rotation_vector(q)
        np.testing.assert_allclose(rotation, oracle(q).as_rotvec(), atol=1e-12)
        np.testing.assert_array_equal(frames.to_rotation_vector(-q), rotation)
        assert np.linalg.norm(rotation) <= math.pi + 1e-12


@pytest.mark.parametrize("axis", [X, Y, Z, unit(np.array([0.0, -1.0, 2.0]))])
def test_a_half_turn_is_the_same_for_both_signs(axis: Array) -> None:
    q = np.array([0.0, *axis])
    rotation = frames.to_rotation_vector(q)
    np.testing.assert_array_equal(frames.to_rotation_vector(-q), rotation)
    np.testing.assert_allclose(frames.to_rotation_vector(np.array([-0.0, *axis])), rotation)
    assert np.linalg.norm(rotation) == pytest.approx(math.pi)


def test_no_rotation_from_minus_one() -> None:
    np.testing.assert_array_equal(frames.to_rotation_vector(np.array([-1.0, 0.0, 0.0, 0.0])), np.zeros(3))


# --- Euler angles and yaw ---------------------------------------------------------------------------------------------


def test_euler_angles_as_scipy_has_them() -> None:
    rng = np.random.default_rng(9)
    for _ in range(200):
        roll, pitch, yaw = rng.uniform(-math.pi, math.pi), rng.uniform(-1.57, 1.57), rng.uniform(-math.pi, math.pi)
        q = frames.from_euler(roll, pitch, yaw)
        assert_same_attitude(q, Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True))
        np.testing.assert_allclose(frames.to_euler(q), [roll, pitch, yaw], atol=1e-9)
        np.testing.assert_allclose(frames.to_euler(-q), [roll, pitch, yaw], atol=1e-9)
        assert frames.yaw_of(q) == pytest.approx(yaw, abs=1e-9)
        assert frames.yaw_of(-q) == frames.yaw_of(q)


@pytest.mark.parametrize("pitch", [RIGHT, -RIGHT])
def test_straight_up_and_down_have_a_pitch_and_no_nan(pitch: float) -> None:
    for yaw in np.linspace(-3.0, 3.0, 25):
        q = unit(frames.from_euler(0.0, pitch, yaw))
        angles = frames.to_euler(q)
        assert np.isfinite(angles).all()
        assert angles[1] == pytest.approx(pitch, abs=1e-7)


def test_yaw_is_where_the_nose_points_on_the_map() -> None:
    for q in random_quaternions():
        north, east, _ = oracle(q).apply(X)
        assert frames.yaw_of(q) == pytest.approx(math.atan2(east, north), abs=1e-12)


# --- axes ---------------------------------------------------------------------------------------------------------

DOMINATED = {
    "w": np.array([0.9, 0.2, -0.3, 0.1]),
    "x": np.array([0.1, -0.9, 0.3, 0.2]),
    "y": np.array([0.2, 0.1, 0.9, -0.3]),
    "z": np.array([-0.3, 0.2, 0.1, 0.9]),
}


@pytest.mark.parametrize("largest", DOMINATED)
def test_every_branch_of_from_axes(largest: str) -> None:
    expected = unit(DOMINATED[largest])
    assert int(np.argmax(np.abs(expected))) == "wxyz".index(largest)
    q = from_matrix(oracle(expected).as_matrix())
    assert q[0] >= 0.0
    assert_same_attitude(q, expected)


def test_from_axes_for_all_attitudes() -> None:
    for q in random_quaternions():
        actual = from_matrix(oracle(q).as_matrix())
        np.testing.assert_allclose(actual, q if q[0] >= 0.0 else -q, atol=1e-12)


@pytest.mark.parametrize("axis", [X, Y, Z, (X + Y + Z) / math.sqrt(3.0), (X - Y) / math.sqrt(2.0)])
@pytest.mark.parametrize("excess", [0.0, 1e-9, -1e-9])
def test_from_axes_at_half_turns(axis: Array, excess: float) -> None:
    rotation = Rotation.from_rotvec((math.pi + excess) * axis)
    assert_same_attitude(from_matrix(rotation.as_matrix()), rotation.as_quat(scalar_first=True))


# --- angles and axes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (3.0, 3.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (math.radians(190.0), math.radians(-170.0)),
        (math.radians(-190.0), math.radians(170.0)),
        (math.radians(725.0), math.radians(5.0)),
    ],
)
def test_wrap(angle: float, wrapped: float) -> None:
    assert frames.wrap(angle) == pytest.approx(wrapped, abs=1e-12)


@pytest.mark.parametrize("turns", range(-3, 4))
@pytest.mark.parametrize("steps", range(-3, 4))
def test_wrapped_angles_are_below_pi_whatever_the_rounding(turns: int, steps: int) -> None:
    angle = (2 * turns + 1) * math.pi
    for _ in range(abs(steps)):
        angle = math.nextafter(angle, math.copysign(math.inf, steps))
    wrapped = frames.wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.sin(wrapped - angle) == pytest.approx(0.0, abs=1e-12)


def test_a_nan_stays_one() -> None:
    assert math.isnan(frames.wrap(math.nan))


def test_enu_and_ned_are_each_others_mirror() -> None:
    np.testing.assert_array_equal(frames.enu_to_ned(np.array([1.0, 2.0, 3.0])), [2.0, 1.0, -3.0])
    many = np.array(random_vectors()).reshape(10, 20, 3)
    np.testing.assert_array_equal(frames.enu_to_ned(frames.enu_to_ned(many)), many)
    u, v = many[0, 0], many[0, 1]  # both are right-handed, so cross products survive
    np.testing.assert_allclose(frames.enu_to_ned(np.cross(u, v)), np.cross(frames.enu_to_ned(u), frames.enu_to_ned(v)))


def test_flu_and_frd_are_each_others_mirror() -> None:
    np.testing.assert_array_equal(frames.flu_to_frd(np.array([1.0, 2.0, 3.0])), [1.0, -2.0, -3.0])
    many = np.array(random_vectors()).reshape(10, 20, 3)
    np.testing.assert_array_equal(frames.flu_to_frd(frames.flu_to_frd(many)), many)


# --- geodesy ----------------------------------------------------------------------------------------------------------


def ecef(latitude: float, longitude: float, altitude: float) -> Array:
    """Earth-centred coordinates (m) from the ellipsoid's two axes, as in any textbook."""
    a, b = 6378137.0, 6356752.314245
    n = a * a / math.hypot(a * math.cos(latitude), b * math.sin(latitude))
    return np.array(
        [
            (n + altitude) * math.cos(latitude) * math.cos(longitude),
            (n + altitude) * math.cos(latitude) * math.sin(longitude),
            (n * b * b / (a * a) + altitude) * math.sin(latitude),
        ]
    )


def test_an_arc_minute_of_latitude_is_a_nautical_mile() -> None:
    minute = math.radians(1.0 / 60.0)
    north = frames.to_local((math.radians(45.0) + minute, 0.0, 0.0), (math.radians(45.0), 0.0, 0.0))
    np.testing.assert_allclose(north, [1852.2, 0.0, 0.0], atol=1.0)
    # 1843 m at the equator and 1862 m at the poles, because the earth is flat there
    assert frames.to_local((minute, 0.0, 0.0), (0.0, 0.0, 0.0))[0] == pytest.approx(1842.9, abs=0.1)
    pole = 0.5 * math.pi
    assert frames.to_local((pole, 0.0, 0.0), (pole - minute, 0.0, 0.0))[0] == pytest.approx(1861.6, abs=0.1)


def test_an_arc_minute_of_longitude_shrinks_with_the_latitude() -> None:
    minute = math.radians(1.0 / 60.0)
    assert frames.to_local((0.0, minute, 0.0), (0.0, 0.0, 0.0))[1] == pytest.approx(1855.3, abs=0.1)
    sixty = math.radians(60.0)
    assert frames.to_local((sixty, minute, 0.0), (sixty, 0.0, 0.0))[1] == pytest.approx(930.0, abs=0.1)


@pytest.mark.parametrize("origin", [ZURICH, (-0.59, 2.63, 20.0), (0.0, 0.0, 0.0), (1.2, -1.9, -3.0)])
def test_local_and_geodetic_are_each_others_inverse(origin: tuple[float, float, float]) -> None:
    for position_ned in random_vectors(50):
        far = 100.0 * position_ned
        np.testing.assert_allclose(frames.to_local(frames.to_geodetic(far, origin), origin), far, atol=1e-6)
    assert frames.to_geodetic(np.zeros(3), origin) == pytest.approx(origin, abs=1e-15)


def test_distances_on_the_ground_are_those_through_the_earth() -> None:
    origin = (ZURICH[0], ZURICH[1], 0.0)
    for north, east, up in [(300.0, 0.0, 0.0), (0.0, 300.0, 0.0), (-200.0, 150.0, 40.0)]:
        there = frames.to_geodetic(np.array([north, east, -up]), origin)
        assert there[2] == up
        straight = float(np.linalg.norm(ecef(*there) - ecef(*origin)))
        assert straight == pytest.approx(math.hypot(north, east, up), abs=0.02)


@pytest.mark.parametrize("east", [500.0, -500.0])
def test_across_the_date_line(east: float) -> None:
    origin = (math.radians(-16.8), math.copysign(math.radians(179.999), east), 10.0)  # Taveuni, Fiji
    position_ned = np.array([30.0, east, -5.0])
    there = frames.to_geodetic(position_ned, origin)
    assert -math.pi <= there[1] < math.pi
    assert there[1] * origin[1] < 0.0
    np.testing.assert_allclose(frames.to_local(there, origin), position_ned, atol=1e-6)
