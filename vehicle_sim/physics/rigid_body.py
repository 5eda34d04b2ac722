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

from protocol.arrays import Array, Quaternion, Vector
from protocol.jit import compiled, inlined
from protocol.vehicle_parameters import GRAVITY

Parameters = NDArray[np.void]
"""(1,) of airframe.PARAMETERS."""

POSITION, VELOCITY, ATTITUDE, RATES, ROTORS = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13), slice(13, 17)
STATES = 17

_SLIDING_M_S = 0.05
"""Below this speed friction passes from what opposes the motion to what holds against the push, so that the integrator
meets no step. Together they are never more than dry friction, and at any speed enough to stop what it can hold."""


@inlined
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
def _push(force: Vector, p: Any) -> tuple[float, float]:
    """How much (N, north and east) each newton that stands on the ground must hold under a force (N, NED) without that
    of the ground, but at most what dry friction can hold."""
    load, weight = math.hypot(force[0], force[1]), p.mass_kg * GRAVITY + force[2]
    share = p.friction / max(load, 1e-9) if load >= p.friction * weight else 1.0 / weight
    return share * force[0], share * force[1]


@compiled
def _contact_force(p: Any, sunk: float, velocity: Vector, push: tuple[float, float]) -> Vector:
    """Force (N, NED) on a foot that is `sunk` (m) in the ground and moves so (m/s): spring, damper and dry friction,
    which at rest holds against the push."""
    vx, vy, vz = velocity
    normal = max(0.0, p.stiffness_n_m * sunk + p.damping_ns_m * vz)
    speed = math.hypot(vx, vy)
    grip = p.friction * normal / max(speed, _SLIDING_M_S)
    sticking = normal * max(0.0, 1.0 - speed / _SLIDING_M_S)
    return -grip * vx - sticking * push[0], -grip * vy - sticking * push[1], -normal


@inlined
def attitude_rate(attitude: Quaternion, rates: Vector) -> Quaternion:
    """Rate of change (1/s) of the quaternion."""
    q0, q1, q2, q3 = attitude
    wx, wy, wz = rates
    return (
        0.5 * (-q1 * wx - q2 * wy - q3 * wz),
        0.5 * (q0 * wx + q2 * wz - q3 * wy),
        0.5 * (q0 * wy - q1 * wz + q3 * wx),
        0.5 * (q0 * wz + q1 * wy - q2 * wx),
    )


@inlined
def rotor_rate(command: float, speed: float, running: float, lag_share: float, p: Any) -> float:
    """Rate of change (rad/s2) of a rotor's speed (rad/s) under a command: a first-order lag, faster up than down."""
    reached = p.voltage_share * min(max(command, 0.0), p.rotor_max_speed)
    lack: float = running * reached - speed
    lag: float = lag_share * (p.time_constant_up_s if lack > 0.0 else p.time_constant_down_s)
    return lack / lag


@inlined
def _ground_effect(height: float, radius: float) -> float:
    """Thrust of a rotor at a height (m), as a share of that far above the ground: I. Cheeseman and W. Bennett, "The
    effect of the ground on a helicopter rotor in forward flight", ARC R&M 3021 (1955), down to half a radius."""
    if radius == 0.0:
        return 1.0
    return 1.0 / (1.0 - (radius / (4.0 * max(height, 0.5 * radius))) ** 2)


@inlined
def air_wrench(
    down: float, velocity: Vector, attitude: Quaternion, rates: Vector, rotors: Quaternion, p: Any
) -> tuple[Vector, Vector]:
    """Force (N, NED) and torque (N m, FRD) of rotors (rad/s), air and what else pushes, at a height of -`down` (m)."""
    q0, q1, q2, q3 = attitude
    wx, wy, _ = rates
    w_front, w_right, w_back, w_left = rotors
    cushion = _ground_effect(-down, p.propeller_radius_m)
    front = p.rotor_thrust_share[0] * p.thrust_constant_ns2 * w_front * w_front
    right = p.rotor_thrust_share[1] * p.thrust_constant_ns2 * w_right * w_right
    back = p.rotor_thrust_share[2] * p.thrust_constant_ns2 * w_back * w_back
    left = p.rotor_thrust_share[3] * p.thrust_constant_ns2 * w_left * w_left
    tx = p.arm_length_m * cushion * (left - right)
    ty = p.arm_length_m * cushion * (front - back)
    tz = p.torque_per_thrust_m * (front + back - right - left)
    thrust = cushion * (front + right + back + left)
    tx += p.centre_of_mass_m[1] * thrust
    ty -= p.centre_of_mass_m[0] * thrust

    spin = p.rotor_inertia_kgm2 * (w_right + w_left - w_front - w_back)  # angular momentum along z
    tx -= wy * spin
    ty += wx * spin

    # drag and thrust in the body, then all forces in the world
    ax, ay, az = velocity[0] - p.wind_ned[0], velocity[1] - p.wind_ned[1], velocity[2] - p.wind_ned[2]
    bx, by, bz = to_world(q0, -q1, -q2, -q3, ax, ay, az)
    dx = -(p.drag_kg_s[0] + p.quadratic_drag_kg_m[0] * abs(bx)) * bx
    dy = -(p.drag_kg_s[1] + p.quadratic_drag_kg_m[1] * abs(by)) * by
    dz = -(p.drag_kg_s[2] + p.quadratic_drag_kg_m[2] * abs(bz)) * bz - thrust
    fx, fy, fz = to_world(q0, q1, q2, q3, dx, dy, dz)
    return (fx + p.force_ned[0], fy + p.force_ned[1], fz + p.force_ned[2]), (tx, ty, tz)


@inlined
def with_ground(
    wrench: tuple[Vector, Vector], down: float, velocity: Vector, attitude: Quaternion, rates: Vector, p: Any
) -> tuple[Vector, Vector]:
    """Force (N, NED) and torque (N m, FRD) with those of the ground on each foot that is in it."""
    if down + p.foot_radius_m + p.foot_height_m <= 0.0:
        return wrench
    (fx, fy, fz), (tx, ty, tz) = wrench
    push = _push(wrench[0], p)
    q0, q1, q2, q3 = attitude
    wx, wy, wz = rates
    for number in range(4):
        x, y, z = foot(number, p)
        rx, ry, rz = to_world(q0, q1, q2, q3, x, y, z)
        sunk = down + rz
        if sunk > 0.0:
            vx, vy, vz = to_world(q0, q1, q2, q3, wy * z - wz * y, wz * x - wx * z, wx * y - wy * x)
            vx += velocity[0]
            vy += velocity[1]
            vz += velocity[2]
            gx, gy, gz = _contact_force(p, sunk, (vx, vy, vz), push)
            fx += gx
            fy += gy
            fz += gz
            mx, my, mz = to_world(q0, -q1, -q2, -q3, ry * gz - rz * gy, rz * gx - rx * gz, rx * gy - ry * gx)
            tx += mx
            ty += my
            tz += mz
    return (fx, fy, fz), (tx, ty, tz)


@inlined
def accelerations(wrench: tuple[Vector, Vector], rates: Vector, p: Any) -> tuple[Vector, Vector]:
    """Acceleration (m/s2, NED, with gravity) and angular acceleration (rad/s2, FRD) under a force and a torque."""
    (fx, fy, fz), (tx, ty, tz) = wrench
    wx, wy, wz = rates
    ix, iy, iz = p.inertia_kgm2[0], p.inertia_kgm2[1], p.inertia_kgm2[2]
    linear = fx / p.mass_kg, fy / p.mass_kg, fz / p.mass_kg + GRAVITY
    turning = (
        (tx - (iz - iy) * wy * wz) / ix,
        (ty - (ix - iz) * wz * wx) / iy,
        (tz - (iy - ix) * wx * wy) / iz,
    )
    return linear, turning


@compiled
def derivative(state: Array, rotor_commands: Array, parameters: Parameters, out: Array) -> None:
    """Rate of change of the state (17,) into `out` (17,), under commanded rotor speeds (4,) in rad/s."""
    p = parameters[0]
    down, velocity = state[2], (state[3], state[4], state[5])
    attitude, rates = (state[6], state[7], state[8], state[9]), (state[10], state[11], state[12])
    rotors = state[13], state[14], state[15], state[16]
    wrench = air_wrench(down, velocity, attitude, rates, rotors, p)
    wrench = with_ground(wrench, down, velocity, attitude, rates, p)
    linear, turning = accelerations(wrench, rates, p)
    out[0], out[1], out[2] = velocity
    out[3], out[4], out[5] = linear
    out[6], out[7], out[8], out[9] = attitude_rate(attitude, rates)
    out[10], out[11], out[12] = turning
    for i in range(4):
        out[13 + i] = rotor_rate(rotor_commands[i], state[13 + i], p.rotor_running[i], p.rotor_lag_share[i], p)
