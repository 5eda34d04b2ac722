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

from protocol.compiled import compiled
from protocol.frames import GRAVITY, Array, from_matrix

_ROUNDS = 6
_LEAST_FORCE = 0.05
"""Of the weight: in free fall the attitude is undefined."""
_LEAST_ACROSS = 0.1


@compiled
def axes_of(thrust_ned: Array, yaw: float) -> Array:
    """Rotation (3, 3) whose -z column is along `thrust_ned` (not zero) and whose x column heads to `yaw` (rad)."""
    down = -thrust_ned / math.sqrt(np.sum(thrust_ned * thrust_ned))
    # y = down x heading, heading = (cos, sin, 0)
    y = np.array([-down[2] * math.sin(yaw), down[2] * math.cos(yaw), down[0] * math.sin(yaw) - down[1] * math.cos(yaw)])
    y = y / math.sqrt(np.sum(y * y))
    r = np.empty((3, 3))
    r[0, 0] = y[1] * down[2] - y[2] * down[1]
    r[1, 0] = y[2] * down[0] - y[0] * down[2]
    r[2, 0] = y[0] * down[1] - y[1] * down[0]
    r[:, 1] = y
    r[:, 2] = down
    return r


@compiled
def attitude_command(thrust_ned: Array, yaw: float) -> Array:
    """Quaternion whose -z body axis is along `thrust_ned` (not zero) and whose x axis heads to `yaw` (rad).

    At 90 degrees of tilt across the heading the yaw is undefined; the limits on tilt keep away from it.
    """
    return from_matrix(axes_of(thrust_ned, yaw))


@compiled
def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def _times(r: Array, v: Array) -> Array:
    return np.array([_dot(r[0], v), _dot(r[1], v), _dot(r[2], v)])


@compiled
def _against(r: Array, v: Array) -> Array:
    return np.array([_dot(r[:, 0], v), _dot(r[:, 1], v), _dot(r[:, 2], v)])


@compiled
def cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
def _bracket(w: Array, drag: Array, v: Array) -> Array:
    """([w] D - D [w]) v, how turning with w changes the drag of a velocity v; all in the body."""
    return cross(w, drag * v) - drag * cross(w, v)


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
    return refined(velocity, acceleration, jerk, snap, heading_motion, mass, drag, guess, _ROUNDS)


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
    acceleration: Array,
    jerk: Array,
    snap: Array,
    heading_motion: Array,
    mass: float,
    drag: Array,
    guess: Array,
    rounds: int,
) -> tuple[Array, Array, Array, float]:
    """As `inverse`, by so many rounds of substitution from a guess (3, 3), which becomes the result's."""
    yaw, yaw_rate, yaw_acceleration = heading_motion
    heading = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    heading1 = yaw_rate * np.array([-heading[1], heading[0], 0.0])
    heading2 = yaw_acceleration * np.array([-heading[1], heading[0], 0.0]) - yaw_rate * yaw_rate * heading
    wanted = mass * acceleration
    wanted[2] -= mass * GRAVITY
    force, rates, turning = guess[0].copy(), guess[1].copy(), guess[2].copy()
    thrust = 0.0
    r = np.eye(3)
    for _ in range(rounds):
        size = math.sqrt(_dot(force, force))
        if size < _LEAST_FORCE * mass * GRAVITY:
            force = np.array([0.0, 0.0, -_LEAST_FORCE * mass * GRAVITY])
            size = _LEAST_FORCE * mass * GRAVITY
        r = axes_of(force, yaw)
        v, a, j = _against(r, velocity), _against(r, acceleration), _against(r, jerk)
        force = wanted + _times(r, drag * v)
        thrust = -_dot(force, r[:, 2])
        turn = _bracket(rates, drag, v)
        turn_on = cross(rates, turn) - _bracket(rates, drag, cross(rates, v)) + _bracket(turning, drag, v)
        # in the body: F', F''
        force1 = mass * j + drag * a + turn
        force2 = mass * _against(r, snap) + drag * j + 2.0 * _bracket(rates, drag, a) + turn_on
        # u = F / |F| = -z: u', u'' across z
        size1 = -force1[2]
        ux, uy = force1[0] / size, force1[1] / size
        size2x = (force2[0] - 2.0 * size1 * ux) / size
        size2y = (force2[1] - 2.0 * size1 * uy) / size
        h, h1, h2 = _against(r, heading), _against(r, heading1), _against(r, heading2)
        across = h[0] if abs(h[0]) > _LEAST_ACROSS else math.copysign(_LEAST_ACROSS, h[0])
        wx, wy = uy, -ux
        wz = (wx * h[2] + h1[1]) / across
        rates = np.array([wx, wy, wz])
        ax = wy * wz + size2y
        ay = -size2x - wx * wz
        y1 = -wz * h1[0] + wx * h1[2]  # y' . h'
        az = wx * wy + ((ax + wz * wy) * h[2] + 2.0 * y1 + h2[1]) / across
        turning = np.array([ax, ay, az])
    guess[0], guess[1], guess[2] = force, rates, turning
    return from_matrix(r), rates, turning, thrust
