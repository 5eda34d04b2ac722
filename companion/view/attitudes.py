"""Attitudes and rotations of whole arrays; `protocol.frames` has the same for one vector or quaternion."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.view.lines import Floats


def euler_deg(attitudes: NDArray[Any]) -> Floats:
    """(n, 4) quaternions w,x,y,z -> (n, 3) roll, pitch, yaw (deg), Z-Y-X, as `protocol.frames.to_euler`."""
    w, x, y, z = (attitudes[:, index].astype(np.float64) for index in range(4))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin((2.0 * (w * y - z * x)).clip(-1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    angles: Floats = np.degrees(np.column_stack((roll, pitch, yaw)))
    return angles


def tilt_deg(euler: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw (deg) -> (n,) the angle between the body's down axis and the world's (deg)."""
    roll, pitch = np.radians(euler[:, :2]).T
    angles: Floats = np.degrees(np.arccos((np.cos(roll) * np.cos(pitch)).clip(-1.0, 1.0)))
    return angles


def quaternions(euler: Floats) -> Floats:
    """(n, 3) roll, pitch, yaw (rad) -> (n, 4) quaternions w,x,y,z, as `protocol.frames.from_euler`."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * euler).T, np.sin(0.5 * euler).T
    return np.column_stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def rotated(attitude: Floats, vectors: Floats) -> Floats:
    """(4,) attitude and (n, 3) vectors in body axes -> (n, 3) in world axes, as `protocol.frames.rotate`."""
    axis, w = attitude[1:], attitude[0]
    t = 2.0 * np.cross(axis, vectors)
    result: Floats = vectors + w * t + np.cross(axis, t)
    return result
