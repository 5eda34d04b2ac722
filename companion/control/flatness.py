"""Differential flatness of the quadrotor with linear drag: from a motion and its derivatives to the attitude, rates,
angular acceleration and thrust that fly it. Exact, no small angles.

The force of the rotors is F = m (a - g) + R D R' v (D the drag along the body's axes) and points along -z of the body;
its derivatives F', F'' follow from jerk and snap, and with the heading they give rates and angular acceleration. After
M. Faessler, A. Franchi, D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to rotor drag for accurate
tracking of high-speed trajectories", IEEE RA-L 3(2), 2018, here for drag along z too: as D differs from axis to axis, R
and F depend on each other, and a few rounds of substitution solve for both.
"""

import math

import numpy as np

from protocol.arrays import Array, Vector
from protocol.frames import from_axes
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

_ROUNDS = 6
_LEAST_FORCE = 0.05
"""Of the weight: in free fall the attitude is undefined."""
_LEAST_ACROSS = 0.1


@compiled
def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def _scaled(a: Vector, b: Vector) -> Vector:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def _vector(a: Array | Vector) -> Vector:
    return a[0], a[1], a[2]


@compiled
def _against(columns: tuple[Vector, Vector, Vector], v: Vector) -> Vector:
    """World -> body."""
    return _dot(columns[0], v), _dot(columns[1], v), _dot(columns[2], v)


@compiled
def _bracket(w: Vector, drag: Vector, v: Vector) -> Vector:
    """([w] D - D [w]) v, how turning with w changes the drag of a velocity v; all in the body."""
    a, b = cross(w, _scaled(drag, v)), _scaled(drag, cross(w, v))
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def _axes(thrust: Vector, yaw: float) -> tuple[Vector, Vector, Vector]:
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
    """Quaternion whose -z body axis is along `thrust_ned` (not zero) and whose x axis heads to `yaw` (rad).

    At 90 degrees of tilt across the heading the yaw is undefined; the limits on tilt keep away from it.
    """
    x, y, z = _axes(_vector(thrust_ned), yaw)
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

    World vectors NED; `heading_motion` (3,) is yaw, its rate and acceleration (rad, s); `mass` in kg, `drag` (3,) in
    kg/s along the body's axes.
    """
    guess = first_guess(velocity, acceleration, mass, drag)
    axes, rates, turning, thrust = refined(
        velocity, acceleration, jerk, snap, heading_motion, mass, drag, guess, _ROUNDS
    )
    return from_axes(*axes), np.array(rates), np.array(turning), thrust


@compiled
def first_guess(velocity: Array, acceleration: Array, mass: float, drag: Array) -> Array:
    """(3, 3) force (N, NED), rates and angular acceleration to begin `refined` with, where nothing is known."""
    guess = np.zeros((3, 3))
    guess[0] = mass * acceleration + drag[0] * velocity
    guess[0, 2] -= mass * GRAVITY
    return guess


@compiled
def refined(
    velocity: Array,
    acceleration: Array | Vector,
    jerk: Array,
    snap: Array,
    heading_motion: Array,
    mass: float,
    drag: Array,
    guess: Array,
    rounds: int,
) -> tuple[tuple[Vector, Vector, Vector], Vector, Vector, float]:
    """As `inverse`, by so many rounds of substitution from a guess (3, 3), which becomes the result's; the attitude as
    the body's axes."""
    yaw, yaw_rate, yaw_acceleration = heading_motion
    cos, sin = math.cos(yaw), math.sin(yaw)
    heading = cos, sin, 0.0
    heading1 = -yaw_rate * sin, yaw_rate * cos, 0.0
    squared = yaw_rate * yaw_rate
    heading2 = -yaw_acceleration * sin - squared * cos, yaw_acceleration * cos - squared * sin, 0.0
    d, moves, pulls = _vector(drag), _vector(velocity), _vector(acceleration)
    jerks, snaps = _vector(jerk), _vector(snap)
    wanted = mass * pulls[0], mass * pulls[1], mass * pulls[2] - mass * GRAVITY
    force, rates, turning = _vector(guess[0]), _vector(guess[1]), _vector(guess[2])
    thrust = 0.0
    axes = _axes((0.0, 0.0, -1.0), 0.0)
    for _ in range(rounds):
        size = math.sqrt(_dot(force, force))
        if size < _LEAST_FORCE * mass * GRAVITY:
            size = _LEAST_FORCE * mass * GRAVITY
            force = 0.0, 0.0, -size
        axes = _axes(force, yaw)
        x, y, z = axes
        v, a, j, s = _against(axes, moves), _against(axes, pulls), _against(axes, jerks), _against(axes, snaps)
        pull = _scaled(d, v)
        force = (
            wanted[0] + (x[0] * pull[0] + y[0] * pull[1] + z[0] * pull[2]),
            wanted[1] + (x[1] * pull[0] + y[1] * pull[1] + z[1] * pull[2]),
            wanted[2] + (x[2] * pull[0] + y[2] * pull[1] + z[2] * pull[2]),
        )
        thrust = -_dot(force, z)
        turn, turn_a = _bracket(rates, d, v), _bracket(rates, d, a)
        on, on_v, on_w = cross(rates, turn), _bracket(rates, d, cross(rates, v)), _bracket(turning, d, v)
        # in the body: F', and F'' across z
        force1_x = mass * j[0] + d[0] * a[0] + turn[0]
        force1_y = mass * j[1] + d[1] * a[1] + turn[1]
        force1_z = mass * j[2] + d[2] * a[2] + turn[2]
        force2_x = mass * s[0] + d[0] * j[0] + 2.0 * turn_a[0] + (on[0] - on_v[0] + on_w[0])
        force2_y = mass * s[1] + d[1] * j[1] + 2.0 * turn_a[1] + (on[1] - on_v[1] + on_w[1])
        # u = F / |F| = -z: u', u'' across z
        size1 = -force1_z
        ux, uy = force1_x / size, force1_y / size
        size2x = (force2_x - 2.0 * size1 * ux) / size
        size2y = (force2_y - 2.0 * size1 * uy) / size
        h, h1, h2 = _against(axes, heading), _against(axes, heading1), _against(axes, heading2)
        across = h[0] if abs(h[0]) > _LEAST_ACROSS else math.copysign(_LEAST_ACROSS, h[0])
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
