"""Differential flatness of the quadrotor with linear drag: from a motion and its derivatives to the attitude, rates,
angular acceleration and thrust that fly it. Exact, no small angles.

The force of the rotors is F = m (a - g) + R D R' v (D the drag along the body's axes). It points along -z of the body.
Its derivatives F', F'' follow from jerk and snap, and with the heading they give rates and angular acceleration.

Source: M. Faessler, A. Franchi, D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor drag for
accurate tracking of high-speed trajectories", IEEE RA-L 3(2), 2018. This module adds drag along z. As D differs from
axis to axis, R and F depend on each other, and a few iterations of substitution solve for both.
"""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Array, Vector
from protocol.frames import from_axes
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_ITERATIONS = 6
_LEAST_FORCE = 0.05
"""The least force of the rotors as a fraction of the weight: in free fall the attitude is undefined."""
_LEAST_PROJECTION = 0.1
"""The least projection of the heading on the body's x axis that the yaw rate is divided by."""

Axes = tuple[Vector, Vector, Vector]
"""The body's axes x, y, z as unit vectors, NED."""


class FlatMotion(NamedTuple):
    """The derivatives of the flat outputs: what a motion asks of the vehicle. World vectors NED."""

    velocity: Vector
    """m/s."""
    acceleration: Vector
    """m/s2."""
    jerk: Vector
    """m/s3."""
    snap: Vector
    """m/s4."""
    heading: Vector
    """Yaw (rad), yaw rate (rad/s) and yaw acceleration (rad/s2)."""


@compiled
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _scaled(a: Vector, b: Vector) -> Vector:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def vector(a: Array | Vector) -> Vector:
    """The three values as a tuple, which needs no memory from the heap."""
    return a[0], a[1], a[2]


@compiled
def _to_body(axes: Axes, v: Vector) -> Vector:
    """A world vector in the body's axes."""
    return _dot(axes[0], v), _dot(axes[1], v), _dot(axes[2], v)


@compiled
def _drag_change(w: Vector, drag: Vector, v: Vector) -> Vector:
    """([w] D - D [w]) v: the change of the drag of a velocity v as the body turns with w; body frame."""
    a, b = cross(w, _scaled(drag, v)), _scaled(drag, cross(w, v))
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _axes(thrust: Vector, yaw: float) -> Axes:
    """The body's axes with -z along `thrust` (not zero) and x heading to `yaw` (rad)."""
    size = -math.sqrt(_dot(thrust, thrust))
    down = thrust[0] / size, thrust[1] / size, thrust[2] / size
    # y = down x heading, heading = (cos, sin, 0)
    cos, sin = math.cos(yaw), math.sin(yaw)
    y = -down[2] * sin, down[2] * cos, down[0] * sin - down[1] * cos
    size = math.sqrt(_dot(y, y))
    y = y[0] / size, y[1] / size, y[2] / size
    return cross(y, down), y, down


@compiled
def attitude_command(thrust_ned: Array, yaw: float) -> Array:
    """Quaternion (4,) whose -z body axis is along `thrust_ned` (3,) in N, not zero, and whose x axis heads to `yaw`
    (rad).

    At 90 degrees of tilt across the heading the yaw is undefined; the limits on tilt keep away from it.
    """
    x, y, z = _axes(vector(thrust_ned), yaw)
    return from_axes(x, y, z)


@compiled
def inverse(
    velocity: Array,
    acceleration: Array,
    jerk: Array,
    snap: Array,
    heading_motion: Array,
    mass: float,
    drag: Array,
) -> tuple[Array, Array, Array, float]:
    """Attitude (4,), rates (3,) in rad/s and angular acceleration (3,) in rad/s2 (FRD), and thrust (N), for a motion.

    World vectors (3,) NED; `heading_motion` (3,) is yaw, its rate and acceleration (rad, s); `mass` in kg, `drag` (3,)
    in kg/s along the body's axes.
    """
    motion = FlatMotion(vector(velocity), vector(acceleration), vector(jerk), vector(snap), vector(heading_motion))
    guess = first_guess(motion, mass, drag)
    axes, rates, turning, thrust = inverse_from(guess, motion, mass, drag, _ITERATIONS)
    return from_axes(*axes), np.array(rates), np.array(turning), thrust


@compiled
def first_guess(motion: FlatMotion, mass: float, drag: Array) -> Array:
    """(3, 3) force (N, NED), rates (rad/s) and angular acceleration (rad/s2, FRD) that `inverse_from` can start from
    without an earlier result."""
    guess = np.zeros((3, 3))
    for i in range(3):
        guess[0, i] = mass * motion.acceleration[i] + drag[0] * motion.velocity[i]
    guess[0, 2] -= mass * GRAVITY
    return guess


@compiled
def _heading_derivatives(motion: Vector) -> tuple[Vector, Vector, Vector]:
    """The unit vector of the heading (NED) and its first two derivatives by time, from yaw, its rate and
    acceleration."""
    yaw, rate, acceleration = motion
    cos, sin = math.cos(yaw), math.sin(yaw)
    squared = rate * rate
    return (
        (cos, sin, 0.0),
        (-rate * sin, rate * cos, 0.0),
        (-acceleration * sin - squared * cos, acceleration * cos - squared * sin, 0.0),
    )


@compiled
def _force_derivatives(
    axes: Axes, motion: FlatMotion, mass: float, drag: Vector, rates: Vector, turning: Vector
) -> tuple[Vector, float, float]:
    """F' (N/s) and the x and y of F'' (N/s2), in the body's axes, for its rates and angular acceleration."""
    v, a = _to_body(axes, motion.velocity), _to_body(axes, motion.acceleration)
    j, s = _to_body(axes, motion.jerk), _to_body(axes, motion.snap)
    turn, turn_a = _drag_change(rates, drag, v), _drag_change(rates, drag, a)
    on, on_v, on_w = cross(rates, turn), _drag_change(rates, drag, cross(rates, v)), _drag_change(turning, drag, v)
    first = (
        mass * j[0] + drag[0] * a[0] + turn[0],
        mass * j[1] + drag[1] * a[1] + turn[1],
        mass * j[2] + drag[2] * a[2] + turn[2],
    )
    second_x = mass * s[0] + drag[0] * j[0] + 2.0 * turn_a[0] + (on[0] - on_v[0] + on_w[0])
    second_y = mass * s[1] + drag[1] * j[1] + 2.0 * turn_a[1] + (on[1] - on_v[1] + on_w[1])
    return first, second_x, second_y


@compiled
def inverse_from(
    guess: Array, motion: FlatMotion, mass: float, drag: Array, iterations: int
) -> tuple[Axes, Vector, Vector, float]:
    """As `inverse`, by a fixed number of iterations from a guess (3, 3), see `first_guess`, which is overwritten with
    the result. The attitude is given as the body's axes."""
    yaw = motion.heading[0]
    heading, heading1, heading2 = _heading_derivatives(motion.heading)
    d, wanted = vector(drag), motion.acceleration
    wanted = mass * wanted[0], mass * wanted[1], mass * wanted[2] - mass * GRAVITY
    force, rates, turning = vector(guess[0]), vector(guess[1]), vector(guess[2])
    thrust = 0.0
    axes = _axes((0.0, 0.0, -1.0), 0.0)
    for _ in range(iterations):
        size = math.sqrt(_dot(force, force))
        if size < _LEAST_FORCE * mass * GRAVITY:
            size = _LEAST_FORCE * mass * GRAVITY
            force = 0.0, 0.0, -size
        axes = _axes(force, yaw)
        x, y, z = axes
        pull = _scaled(d, _to_body(axes, motion.velocity))
        force = (
            wanted[0] + (x[0] * pull[0] + y[0] * pull[1] + z[0] * pull[2]),
            wanted[1] + (x[1] * pull[0] + y[1] * pull[1] + z[1] * pull[2]),
            wanted[2] + (x[2] * pull[0] + y[2] * pull[1] + z[2] * pull[2]),
        )
        thrust = -_dot(force, z)
        force1, force2_x, force2_y = _force_derivatives(axes, motion, mass, d, rates, turning)
        # u = F / |F| = -z: u', u'' across z
        size1 = -force1[2]
        ux, uy = force1[0] / size, force1[1] / size
        size2x = (force2_x - 2.0 * size1 * ux) / size
        size2y = (force2_y - 2.0 * size1 * uy) / size
        h, h1, h2 = _to_body(axes, heading), _to_body(axes, heading1), _to_body(axes, heading2)
        across = h[0] if abs(h[0]) > _LEAST_PROJECTION else math.copysign(_LEAST_PROJECTION, h[0])
        wx, wy = uy, -ux
        wz = (wx * h[2] + h1[1]) / across
        rates = wx, wy, wz
        ax = wy * wz + size2y
        ay = -size2x - wx * wz
        y1 = -wz * h1[0] + wx * h1[2]  # y' . h'
        az = wx * wy + ((ax + wz * wy) * h[2] + 2.0 * y1 + h2[1]) / across
        turning = ax, ay, az
    guess[0], guess[1], guess[2] = force, rates, turning
    return axes, rates, turning, thrust
