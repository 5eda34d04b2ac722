"""Frames of reference: NED world, FRD body, quaternions w,x,y,z; local and geodetic coordinates.

The quaternion `attitude_ned_frd` rotates a vector from body axes (FRD) into world axes (NED). Vectors are float64
arrays (3,), quaternions (4,). No function writes into its input, and compiled functions may be called from compiled
code. Functions with tuples as results allocate nothing; they are for compiled code.
"""

import math

import numpy as np

from protocol.arrays import Array, Quaternion, Vector
from protocol.jit import compiled


@compiled
def product(a: Array | Quaternion, b: Array | Quaternion) -> Quaternion:
    """Hamilton product of two quaternions, as a tuple."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled
def multiply(a: Array, b: Array) -> Array:
    """Hamilton product of two quaternions."""
    return np.array(product(a, b))


@compiled
def conjugate(q: Array) -> Array:
    """The inverse of a unit quaternion."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@compiled
def _rotated(w: float, x: float, y: float, z: float, v: Array | Vector) -> Vector:
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


@compiled
def to_world(q: Array | Quaternion, v: Array | Vector) -> Vector:
    """Body vector to world vector, as a tuple."""
    return _rotated(q[0], q[1], q[2], q[3], v)


@compiled
def to_body(q: Array | Quaternion, v: Array | Vector) -> Vector:
    """World vector to body vector, as a tuple."""
    return _rotated(q[0], -q[1], -q[2], -q[3], v)


@compiled
def rotate(q: Array, v: Array) -> Array:
    """Body vector to world vector."""
    return np.array(to_world(q, v))


@compiled
def axes_frd(q: Array) -> Array:
    """North, east and down as body vectors (3, 3), a row each."""
    out = np.empty((3, 3))
    for i in range(3):
        x, y, z = to_body(q, (1.0 * (i == 0), 1.0 * (i == 1), 1.0 * (i == 2)))
        out[i, 0], out[i, 1], out[i, 2] = x, y, z
    return out


def down_axis(q: Array) -> Vector:
    """The body's down axis in the world, of an attitude (4,), as a tuple; not compiled: for single attitudes."""
    w, x, y, z = q.tolist()
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@compiled
def rotation_quaternion(x: float, y: float, z: float) -> Quaternion:
    """Quaternion of a rotation vector (rad), as a tuple."""
    angle = math.sqrt(x * x + y * y + z * z)
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x, scale * y, scale * z


@compiled
def from_rotation_vector(rotation: Array) -> Array:
    """Quaternion of a rotation vector (3,): axis times angle (rad)."""
    return np.array(rotation_quaternion(rotation[0], rotation[1], rotation[2]))


@compiled
def to_rotation_vector(q: Array) -> Array:
    """Rotation vector (3,) of the shortest rotation: axis times angle in [0, pi] (rad). The same for q and -q."""
    sign = 1.0
    for component in q:  # q and -q of a half turn (w = 0) differ in the axis alone
        if component != 0.0:
            sign = 1.0 if component > 0.0 else -1.0
            break
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if sine < 1e-9 else 2.0 * math.atan2(sine, sign * q[0]) / sine * sign
    return np.array([scale * q[1], scale * q[2], scale * q[3]])


@compiled
def from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """Quaternion of Z-Y-X Euler angles (rad)."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


@compiled
def to_euler(q: Array) -> Array:
    """Z-Y-X Euler angles (3,): roll, pitch, yaw (rad)."""
    return np.array(
        [
            math.atan2(2.0 * (q[0] * q[1] + q[2] * q[3]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])),
            math.asin(min(1.0, max(-1.0, 2.0 * (q[0] * q[2] - q[3] * q[1])))),
            math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3])),
        ]
    )


@compiled
def yaw_of(q: Array) -> float:
    """Heading (rad) of the body's x axis, clockwise from north."""
    return math.atan2(2.0 * (q[0] * q[3] + q[1] * q[2]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))


@compiled
def from_axes(x: Vector, y: Vector, z: Vector) -> Array:
    """Quaternion with w >= 0 from the body's axes, each a unit vector in world coordinates.

    The largest of the four components is computed first, so the result is exact for every attitude (Shepperd 1978).
    """
    trace = x[0] + y[1] + z[2]
    if trace > max(x[0], y[1], z[2]):
        a, b, c, d = 1.0 + trace, y[2] - z[1], z[0] - x[2], x[1] - y[0]
    elif x[0] >= y[1] and x[0] >= z[2]:
        a, b, c, d = y[2] - z[1], 1.0 + 2.0 * x[0] - trace, y[0] + x[1], z[0] + x[2]
    elif y[1] >= z[2]:
        a, b, c, d = z[0] - x[2], y[0] + x[1], 1.0 + 2.0 * y[1] - trace, z[1] + y[2]
    else:
        a, b, c, d = x[1] - y[0], z[0] + x[2], z[1] + y[2], 1.0 + 2.0 * z[2] - trace
    length = math.sqrt(a * a + b * b + c * c + d * d)
    if a < 0.0:
        length = -length
    return np.array([a / length, b / length, c / length, d / length])


@compiled
def wrap(angle: float) -> float:
    """The same angle (rad) in [-pi, pi)."""
    wrapped = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return -math.pi if wrapped >= math.pi else wrapped  # the remainder of a tiny negative angle rounds to 2 pi


def enu_to_ned(v: Array) -> Array:
    """Vectors (..., 3) from east, north, up to north, east, down, and back."""
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], axis=-1)


def flu_to_frd(v: Array) -> Array:
    """Vectors (..., 3) from forward, left, up to forward, right, down, and back."""
    flipped: Array = v * np.array([1.0, -1.0, -1.0])
    return flipped


_WGS84_A = 6378137.0
_WGS84_E2 = 6.69437999014e-3


def _radii(latitude: float) -> tuple[float, float]:
    """Meridian and prime-vertical radius of curvature (m) at a latitude (rad)."""
    w = 1.0 - _WGS84_E2 * math.sin(latitude) ** 2
    return _WGS84_A * (1.0 - _WGS84_E2) / w**1.5, _WGS84_A / math.sqrt(w)


def to_geodetic(position_ned: Array, origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Latitude, longitude (rad) and altitude (m) of a local position (3,) (m).

    The local plane touches WGS84 at `origin`, which is given in the same units. Longitudes are in [-pi, pi), also
    across the date line.
    """
    meridian, prime = _radii(origin[0])
    return (
        origin[0] + position_ned[0] / meridian,
        wrap(origin[1] + position_ned[1] / (prime * math.cos(origin[0]))),
        origin[2] - position_ned[2],
    )


def to_local(geodetic: tuple[float, float, float], origin: tuple[float, float, float]) -> Array:
    """Local position (3,) (m) of a latitude, longitude (rad) and altitude (m): the inverse of `to_geodetic`.

    The two longitudes may be on different sides of the date line.
    """
    meridian, prime = _radii(origin[0])
    return np.array(
        [
            (geodetic[0] - origin[0]) * meridian,
            wrap(geodetic[1] - origin[1]) * prime * math.cos(origin[0]),
            origin[2] - geodetic[2],
        ]
    )
