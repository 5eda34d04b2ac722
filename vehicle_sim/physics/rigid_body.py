"""The equations of motion of the quadrotor: rigid body, rotors with lag, drag, gyroscopic torque, feet on the ground.

State (17,): position_ned 0:3 (m), velocity_ned 3:6 (m/s), attitude_ned_frd 6:10, rates_frd 10:13 (rad/s), rotor speeds
13:17 (rad/s; front, right, back, left). The front and back rotors turn anticlockwise seen from above, so their drag
yaws the body clockwise (positive). The torque that accelerates a rotor is left out, as in the paper's model (4). All of
it computes with scalars, so nothing is allocated.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, Vector
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY

Parameters = NDArray[np.void]
"""(1,) of airframe.PARAMETERS."""

POSITION, VELOCITY, ATTITUDE, RATES, ROTORS = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 17)
STATES = 17

_SLIDING_M_S = 0.05
"""Below this speed friction is viscous, so that the integrator meets no step."""


@compiled
def to_world(q0: float, q1: float, q2: float, q3: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate a vector from the body into the world; with (q0, -q1, -q2, -q3) from the world into the body."""
    tx = 2.0 * (q2 * z - q3 * y)
    ty = 2.0 * (q3 * x - q1 * z)
    tz = 2.0 * (q1 * y - q2 * x)
    return x + q0 * tx + q2 * tz - q3 * ty, y + q0 * ty + q3 * tx - q1 * tz, z + q0 * tz + q1 * ty - q2 * tx


@compiled
def foot(number: int, p: Any) -> tuple[float, float, float]:
    """Position (m) of a foot (0 front, 1 right, 2 back, 3 left) in body axes."""
    r, h = p.foot_radius_m, p.foot_height_m
    if number == 0:
        return r, 0.0, h
    if number == 1:
        return 0.0, r, h
    if number == 2:
        return -r, 0.0, h
    return 0.0, -r, h


@compiled
def depth(state: Array, parameters: Parameters) -> float:
    """Depth (m) of the lowest foot in the ground, for a state (17,); negative above the ground."""
    deepest = -math.inf
    for number in range(4):
        x, y, z = foot(number, parameters[0])
        _, _, down = to_world(state[6], state[7], state[8], state[9], x, y, z)
        deepest = max(deepest, state[2] + down)
    return deepest


@compiled
def _contact_force(p: Any, sunk: float, vx: float, vy: float, vz: float) -> Vector:
    """Force (N, NED) on a foot that is `sunk` (m) in the ground and moves so (m/s): spring, damper and dry friction."""
    normal = max(0.0, p.stiffness_n_m * sunk + p.damping_ns_m * vz)
    grip = p.friction * normal / math.sqrt(vx * vx + vy * vy + _SLIDING_M_S * _SLIDING_M_S)
    return -grip * vx, -grip * vy, -normal


@compiled
def _attitude_derivative(state: Array, out: Array) -> None:
    """Rate of change of the quaternion into `out` 6:10."""
    q0, q1, q2, q3 = state[6], state[7], state[8], state[9]
    wx, wy, wz = state[10], state[11], state[12]
    out[6] = 0.5 * (-q1 * wx - q2 * wy - q3 * wz)
    out[7] = 0.5 * (q0 * wx + q2 * wz - q3 * wy)
    out[8] = 0.5 * (q0 * wy - q1 * wz + q3 * wx)
    out[9] = 0.5 * (q0 * wz + q1 * wy - q2 * wx)


@compiled
def _rotor_derivative(state: Array, rotor_commands: Array, p: Any, out: Array) -> None:
    """Rate of change of the rotor speeds into `out` 13:17: a first-order lag, faster up than down."""
    for i in range(4):
        reached = p.voltage_share * min(max(rotor_commands[i], 0.0), p.rotor_max_speed)
        lack = p.rotor_running[i] * reached - state[13 + i]
        out[13 + i] = lack / (p.rotor_lag_share[i] * (p.time_constant_up_s if lack > 0.0 else p.time_constant_down_s))


@compiled
def _ground_effect(height: float, radius: float) -> float:
    """Thrust of a rotor at a height (m), as a share of that far above the ground: I. Cheeseman and W. Bennett, "The
    effect of the ground on a helicopter rotor in forward flight", ARC R&M 3021 (1955), down to half a radius."""
    if radius == 0.0:
        return 1.0
    return 1.0 / (1.0 - (radius / (4.0 * max(height, 0.5 * radius))) ** 2)


@compiled
def derivative(state: Array, rotor_commands: Array, parameters: Parameters, out: Array) -> None:
    """Rate of change of the state (17,) into `out` (17,), under commanded rotor speeds (4,) in rad/s."""
    p = parameters[0]
    q0, q1, q2, q3 = state[6], state[7], state[8], state[9]
    wx, wy, wz = state[10], state[11], state[12]
    ix, iy, iz = p.inertia_kgm2[0], p.inertia_kgm2[1], p.inertia_kgm2[2]

    cushion = _ground_effect(-state[2], p.propeller_radius_m)
    front = p.rotor_thrust_share[0] * p.thrust_constant_ns2 * state[13] * state[13]
    right = p.rotor_thrust_share[1] * p.thrust_constant_ns2 * state[14] * state[14]
    back = p.rotor_thrust_share[2] * p.thrust_constant_ns2 * state[15] * state[15]
    left = p.rotor_thrust_share[3] * p.thrust_constant_ns2 * state[16] * state[16]
    tx = p.arm_length_m * (left - right)
    ty = p.arm_length_m * (front - back)
    tz = p.torque_per_thrust_m * (front + back - right - left)
    thrust = cushion * (front + right + back + left)
    tx += p.centre_of_mass_m[1] * thrust
    ty -= p.centre_of_mass_m[0] * thrust

    spin = p.rotor_inertia_kgm2 * (state[14] + state[16] - state[13] - state[15])  # angular momentum along z
    tx -= wy * spin
    ty += wx * spin

    # drag and thrust in the body, then all forces in the world
    ax, ay, az = state[3] - p.wind_ned[0], state[4] - p.wind_ned[1], state[5] - p.wind_ned[2]
    bx, by, bz = to_world(q0, -q1, -q2, -q3, ax, ay, az)
    dx = -(p.drag_kg_s[0] + p.quadratic_drag_kg_m[0] * abs(bx)) * bx
    dy = -(p.drag_kg_s[1] + p.quadratic_drag_kg_m[1] * abs(by)) * by
    dz = -(p.drag_kg_s[2] + p.quadratic_drag_kg_m[2] * abs(bz)) * bz - thrust
    fx, fy, fz = to_world(q0, q1, q2, q3, dx, dy, dz)
    fx, fy, fz = fx + p.force_ned[0], fy + p.force_ned[1], fz + p.force_ned[2]

    if state[2] + p.foot_radius_m + p.foot_height_m > 0.0:
        for number in range(4):
            x, y, z = foot(number, p)
            rx, ry, rz = to_world(q0, q1, q2, q3, x, y, z)
            sunk = state[2] + rz
            if sunk > 0.0:
                vx, vy, vz = to_world(q0, q1, q2, q3, wy * z - wz * y, wz * x - wx * z, wx * y - wy * x)
                vx += state[3]
                vy += state[4]
                vz += state[5]
                gx, gy, gz = _contact_force(p, sunk, vx, vy, vz)
                fx += gx
                fy += gy
                fz += gz
                mx, my, mz = to_world(q0, -q1, -q2, -q3, ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx)
                tx += mx
                ty += my
                tz += mz

    out[0], out[1], out[2] = state[3], state[4], state[5]
    out[3] = fx / p.mass_kg
    out[4] = fy / p.mass_kg
    out[5] = fz / p.mass_kg + GRAVITY
    out[10] = (tx - (iz - iy) * wy * wz) / ix
    out[11] = (ty - (ix - iz) * wz * wx) / iy
    out[12] = (tz - (iy - ix) * wx * wy) / iz
    _attitude_derivative(state, out)
    _rotor_derivative(state, rotor_commands, p, out)
