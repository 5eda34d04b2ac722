"""The vehicle's own control laws, compiled: position -> attitude -> rates -> torque -> rotors.

A command enters the cascade at its level. All of it computes with scalars, so nothing is allocated.
"""

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.frames import product
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.physics.rigid_body import Parameters
from vehicle_sim.timing import TICK_S


class Level(IntEnum):
    """Where a command enters the cascade."""

    STOPPED = 0
    TORQUE = 1
    RATES = 2
    ATTITUDE = 3
    POSITION = 4


COMMAND = np.dtype(
    [
        ("level", "i8"),
        ("position_ned", "f8", 3),
        ("speed_limits", "f8", 3),  # m/s: horizontal, up, down
        ("yaw", "f8"),
        ("integrates", "b1"),  # the position law learns what holds the vehicle off, such as wind
        ("integral", "f8", 3),  # m/s2, NED: what it has learned
        ("attitude_ned_frd", "f8", 4),  # from here on: computed for a command of a higher level
        ("rates_frd", "f8", 3),
        ("torque_frd", "f8", 3),
        ("thrust_n", "f8"),
    ]
)
Command = NDArray[np.void]
"""(1,) of COMMAND."""
VELOCITY_INTEGRAL_1_S2 = 1.0
"""Gain on the integral of a velocity's error."""


@compiled
def _limited(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


@compiled
def position_law(state: Array, command: Command, parameters: Parameters) -> None:
    """Attitude and thrust from position and yaw, into the command.

    P on the position, speed limits, PI on the velocity, acceleration limits, then the tilt at which the thrust gives
    that acceleration. The integral waits at the limits, and its part along down at full thrust, too.
    """
    p, c = parameters[0], command[0]
    vn = p.position_gain * (c.position_ned[0] - state[0])
    ve = p.position_gain * (c.position_ned[1] - state[1])
    scale = min(1.0, c.speed_limits[0] / max(1e-9, math.hypot(vn, ve)))
    vd = min(max(p.position_gain * (c.position_ned[2] - state[2]), -c.speed_limits[1]), c.speed_limits[2])
    slow_n, slow_e = vn * scale - state[3], ve * scale - state[4]
    an = p.velocity_gain * slow_n + c.integral[0]
    ae = p.velocity_gain * slow_e + c.integral[1]
    scale = min(1.0, p.acceleration_limit / max(1e-9, math.hypot(an, ae)))
    if c.integrates and scale == 1.0:
        c.integral[0] += VELOCITY_INTEGRAL_1_S2 * slow_n * TICK_S
        c.integral[1] += VELOCITY_INTEGRAL_1_S2 * slow_e * TICK_S
    an *= scale
    ae *= scale
    slow_d = vd - state[5]
    ad = p.velocity_gain * slow_d + c.integral[2]
    lift = GRAVITY - _limited(ad, p.climb_acceleration_limit)
    size = math.sqrt(an * an + ae * ae + lift * lift)
    if c.integrates and abs(ad) < p.climb_acceleration_limit and p.mass_kg * size < 4.0 * p.rotor_max_thrust_n:
        c.integral[2] += VELOCITY_INTEGRAL_1_S2 * slow_d * TICK_S

    # the body's down axis is (-an, -ae, lift) / size: the shortest tilt to it from level, after the yaw
    t0, t1, t2 = 1.0 + lift / size, ae / size, -an / size
    norm = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
    t0, t1, t2 = t0 / norm, t1 / norm, t2 / norm
    y0, y3 = math.cos(0.5 * c.yaw), math.sin(0.5 * c.yaw)
    c.attitude_ned_frd[0] = t0 * y0
    c.attitude_ned_frd[1] = t1 * y0 + t2 * y3
    c.attitude_ned_frd[2] = t2 * y0 - t1 * y3
    c.attitude_ned_frd[3] = t0 * y3
    c.thrust_n = p.mass_kg * size


@compiled
def attitude_law(state: Array, command: Command, parameters: Parameters) -> None:
    """Rates from the attitude, into the command: a gain on the rotation vector of the error. q and -q give the same."""
    p, c = parameters[0], command[0]
    e0, e1, e2, e3 = product((state[6], -state[7], -state[8], -state[9]), c.attitude_ned_frd)
    sign = -1.0 if e0 < 0.0 else 1.0
    sine = math.sqrt(e1 * e1 + e2 * e2 + e3 * e3)
    scale = 2.0 * sign if sine < 1e-9 else 2.0 * sign * math.atan2(sine, sign * e0) / sine
    c.rates_frd[0] = p.attitude_gain[0] * scale * e1
    c.rates_frd[1] = p.attitude_gain[1] * scale * e2
    c.rates_frd[2] = p.attitude_gain[2] * scale * e3


@compiled
def rate_law(state: Array, command: Command, parameters: Parameters) -> None:
    """Torque from the rates, into the command: a gain on the error, and the gyroscopic torques compensated."""
    p, c = parameters[0], command[0]
    wx, wy, wz = state[10], state[11], state[12]
    ix, iy, iz = p.inertia_kgm2[0], p.inertia_kgm2[1], p.inertia_kgm2[2]
    spin = p.rotor_inertia_kgm2 * (state[14] + state[16] - state[13] - state[15])
    ex = _limited(c.rates_frd[0], p.rate_limit[0]) - wx
    ey = _limited(c.rates_frd[1], p.rate_limit[1]) - wy
    ez = _limited(c.rates_frd[2], p.rate_limit[2]) - wz
    c.torque_frd[0] = ix * p.rate_gain[0] * ex + (iz - iy) * wy * wz + wy * spin
    c.torque_frd[1] = iy * p.rate_gain[1] * ey + (ix - iz) * wz * wx - wx * spin
    c.torque_frd[2] = iz * p.rate_gain[2] * ez + (iy - ix) * wx * wy


@compiled
def mix(thrust_n: float, torque_frd: Array, parameters: Parameters, thrusts: Array) -> None:
    """Thrust (N) of each rotor into `thrusts` (4,), from collective thrust (N) and torque (3,) (N m), within the
    limits.

    Roll and pitch have priority: near full thrust the thrust is lowered for them, near zero thrust they are reduced
    with it, as PX4 does without airmode. Yaw gets the rest.
    """
    p = parameters[0]
    most = p.rotor_max_thrust_n
    roll = 0.5 * torque_frd[0] / p.arm_length_m
    pitch = 0.5 * torque_frd[1] / p.arm_length_m
    yaw = 0.25 * torque_frd[2] / p.torque_per_thrust_m

    tilt = max(abs(roll), abs(pitch))
    each = min(max(0.25 * thrust_n, 0.0), most)
    each = max(min(each, most - tilt), min(each, 0.5 * most))
    room = min(each, most - each)
    if tilt > room:
        roll *= room / tilt
        pitch *= room / tilt

    thrusts[0] = each + pitch
    thrusts[1] = each - roll
    thrusts[2] = each - pitch
    thrusts[3] = each + roll
    if yaw > 0.0:
        yaw = min(yaw, most - thrusts[0], most - thrusts[2], thrusts[1], thrusts[3])
    else:
        yaw = -min(-yaw, thrusts[0], thrusts[2], most - thrusts[1], most - thrusts[3])
    thrusts[0] += yaw
    thrusts[1] -= yaw
    thrusts[2] += yaw
    thrusts[3] -= yaw


@compiled
def rotor_commands(state: Array, command: Command, parameters: Parameters, speeds: Array) -> None:
    """The cascade below the position law, in each step of 1 ms: commanded rotor speeds (4,) (rad/s) into `speeds`."""
    c = command[0]
    if c.level == Level.STOPPED:
        for i in range(4):
            speeds[i] = 0.0
        return
    if c.level >= Level.ATTITUDE:
        attitude_law(state, command, parameters)
    if c.level >= Level.RATES:
        rate_law(state, command, parameters)
    mix(c.thrust_n, c.torque_frd, parameters, speeds)
    for i in range(4):
        speeds[i] = math.sqrt(max(0.0, speeds[i]) / parameters[0].thrust_constant_ns2)
