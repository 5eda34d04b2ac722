"""Frames of reference: NED world, FRD body, quaternions w,x,y,z; local <-> geodetic.

Quaternions `attitude_ned_frd` rotate a vector given in body axes (FRD) into world axes (NED). All functions take and
return float64 arrays, shape (3,) for vectors and (4,) for quaternions, never write into their input, and may be called
from compiled code.
"""

import math

import numpy as np
from numpy.typing import NDArray

from protocol.compiled import compiled

Array = NDArray[np.float64]

GRAVITY = 9.81
"""m/s2, the paper's Table 1."""


@compiled
def multiply(a: Array, b: Array) -> Array:
    """Hamilton product."""
    return np.array(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


@compiled
def conjugate(q: Array) -> Array:
    return np.array([q[0], -q[1], -q[2], -q[3]])


@compiled
def _rotated(w: float, x: float, y: float, z: float, v: Array) -> Array:
    tx = 2.0 * (y * v[2] - z * v[1])
    ty = 2.0 * (z * v[0] - x * v[2])
    tz = 2.0 * (x * v[1] - y * v[0])
    return np.array(
        [
            v[0] + w * tx + y * tz - z * ty,
            v[1] + w * ty + z * tx - x * tz,
            v[2] + w * tz + x * ty - y * tx,
        ]
    )


@compiled
def rotate(q: Array, v: Array) -> Array:
    """Body vector -> world vector."""
    return _rotated(q[0], q[1], q[2], q[3], v)


@compiled
def rotate_inverse(q: Array, v: Array) -> Array:
    """World vector -> body vector."""
    return _rotated(q[0], -q[1], -q[2], -q[3], v)


@compiled
def _length(v: Array) -> float:
    square = 0.0
    for component in v:
        square += component * component
    return math.sqrt(square)


@compiled
def normalized(v: Array) -> Array:
    return v / _length(v)


@compiled
def from_rotation_vector(rotation: Array) -> Array:
    """Axis times angle (rad) -> quaternion."""
    angle = _length(rotation)
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return np.array([math.cos(0.5 * angle), scale * rotation[0], scale * rotation[1], scale * rotation[2]])


@compiled
def to_rotation_vector(q: Array) -> Array:
    """The shortest rotation, axis times angle in [0, pi]; the same for q and -q."""
    sign = 1.0
    for component in q:  # of a half turn, w = 0, q and -q are told apart by the axis
        if component != 0.0:
            sign = 1.0 if component > 0.0 else -1.0
            break
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if sine < 1e-9 else 2.0 * math.atan2(sine, sign * q[0]) / sine * sign
    return np.array([scale * q[1], scale * q[2], scale * q[3]])


@compiled
def from_euler(roll: float, pitch: float, yaw: float) -> Array:
    """Z-Y-X angles (rad)."""
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
    """Roll, pitch, yaw (rad), Z-Y-X."""
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
def from_matrix(r: Array) -> Array:
    """Rotation matrix (3, 3), columns = body axes in the world -> quaternion with w >= 0.

    The largest of the four components is computed first, so it is exact for every attitude (Shepperd 1978).
    """
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    if trace > max(r[0, 0], r[1, 1], r[2, 2]):
        q = np.array([1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    elif r[0, 0] >= r[1, 1] and r[0, 0] >= r[2, 2]:
        q = np.array([r[2, 1] - r[1, 2], 1.0 + 2.0 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]])
    elif r[1, 1] >= r[2, 2]:
        q = np.array([r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], 1.0 + 2.0 * r[1, 1] - trace, r[1, 2] + r[2, 1]])
    else:
        q = np.array([r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1.0 + 2.0 * r[2, 2] - trace])
    if q[0] < 0.0:
        q = -q
    return normalized(q)


@compiled
def wrap(angle: float) -> float:
    """Angle (rad) in [-pi, pi)."""
    wrapped = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return -math.pi if wrapped >= math.pi else wrapped  # the remainder of a tiny negative number rounds to 2 pi


def enu_to_ned(v: Array) -> Array:
    """(..., 3) east, north, up -> north, east, down; its own inverse."""
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], axis=-1)


def flu_to_frd(v: Array) -> Array:
    """(..., 3) forward, left, up -> forward, right, down; its own inverse."""
    flipped: Array = v * np.array([1.0, -1.0, -1.0])
    return flipped


_WGS84_A = 6378137.0
_WGS84_E2 = 6.69437999014e-3


def _radii(latitude: float) -> tuple[float, float]:
    """Meridian and prime-vertical radius of curvature (m) at a latitude (rad)."""
    w = 1.0 - _WGS84_E2 * math.sin(latitude) ** 2
    return _WGS84_A * (1.0 - _WGS84_E2) / w**1.5, _WGS84_A / math.sqrt(w)


def to_geodetic(position_ned: Array, origin: tuple[float, float, float]) -> tuple[float, float, float]:
    """Local (m) -> latitude, longitude (rad), altitude (m), on the plane that touches WGS84 at `origin` (same units).

    Longitudes are in [-pi, pi), also across the date line.
    """
    meridian, prime = _radii(origin[0])
    return (
        origin[0] + position_ned[0] / meridian,
        wrap(origin[1] + position_ned[1] / (prime * math.cos(origin[0]))),
        origin[2] - position_ned[2],
    )


def to_local(geodetic: tuple[float, float, float], origin: tuple[float, float, float]) -> Array:
    """The inverse of `to_geodetic`; longitudes may lie on both sides of the date line."""
    meridian, prime = _radii(origin[0])
    return np.array(
        [
            (geodetic[0] - origin[0]) * meridian,
            wrap(geodetic[1] - origin[1]) * prime * math.cos(origin[0]),
            origin[2] - geodetic[2],
        ]
    )
