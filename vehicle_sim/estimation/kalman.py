"""An error-state Kalman filter of attitude, velocity, position and the sensors' wandering errors, compiled.

Nominal state (24,): attitude_ned_frd 0:4, velocity_ned 4:7 (m/s), position_ned 7:10 (m), the errors of gyroscope 10:13
(rad/s), accelerometer 13:16 (m/s2), satellite position 16:19 (m), magnetometer 19:22 (gauss), barometer 22 (m), and how
far down the ground under the vehicle is 23 (m). Its error (23,) has the same order, with the attitude's as a rotation
vector (3,) in the body: the true attitude is the nominal one turned by it. J. Sola, "Quaternion kinematics for the
error-state Kalman filter" (2017), chapters 5 and 6.

A fix of the receiver is compared with where the filter was then; what the error of then has become since is taken to
first order from the speed gained meanwhile.
"""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import product, rotation_quaternion
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.physics.rigid_body import to_world

NOMINAL, ERROR = 24, 23
ATTITUDE, VELOCITY, POSITION = slice(0, 4), slice(4, 7), slice(7, 10)
TURNED, SPEED, PLACE, WANDER = 0, 3, 6, 9
"""Where attitude, velocity, position and the wandering errors begin in the error state."""
GROUND = ERROR - 1
"""Where the ground is in the error state; it comes after the attitude's fourth number in the nominal one."""
SINCE = 8
"""What has happened since the covariance was brought forward: attitude then 0:4, speed gained 4:7 (m/s), time 7 (s)."""


@compiled
def turn(q: Array, x: float, y: float, z: float) -> None:
    """Turn an attitude (4,) in place by a rotation vector (rad) in the body."""
    q[0], q[1], q[2], q[3] = product(q, rotation_quaternion(x, y, z))
    norm = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    for i in range(4):
        q[i] /= norm


@compiled
def predict(nominal: Array, gained: Array, dt: float, since: Array) -> None:
    """Move the nominal state over a tick (s) by the inertial unit's angle and speed (6,)."""
    x, y, z = gained[0] - nominal[10] * dt, gained[1] - nominal[11] * dt, gained[2] - nominal[12] * dt
    u, v, w = gained[3] - nominal[13] * dt, gained[4] - nominal[14] * dt, gained[5] - nominal[15] * dt
    u, v, w = u + 0.5 * (y * w - z * v), v + 0.5 * (z * u - x * w), w + 0.5 * (x * v - y * u)
    dn, de, dd = to_world(nominal[0], nominal[1], nominal[2], nominal[3], u, v, w)
    since[4] += dn
    since[5] += de
    since[6] += dd
    since[7] += dt
    dd += GRAVITY * dt
    nominal[7] += (nominal[4] + 0.5 * dn) * dt
    nominal[8] += (nominal[5] + 0.5 * de) * dt
    nominal[9] += (nominal[6] + 0.5 * dd) * dt
    nominal[4] += dn
    nominal[5] += de
    nominal[6] += dd
    turn(nominal, x, y, z)


@compiled
def _matrix(q: Array, out: Array) -> None:
    """The rotation matrix (3, 3) of an attitude (4,)."""
    for j in range(3):
        x, y, z = to_world(q[0], q[1], q[2], q[3], 1.0 * (j == 0), 1.0 * (j == 1), 1.0 * (j == 2))
        out[0, j], out[1, j], out[2, j] = x, y, z


@compiled
def _crossed(s: Array, R: Array, sign: float, out: Array) -> None:
    """sign [s]x R (3, 3)."""
    for j in range(3):
        out[0, j] = sign * (s[1] * R[2, j] - s[2] * R[1, j])
        out[1, j] = sign * (s[2] * R[0, j] - s[0] * R[2, j])
        out[2, j] = sign * (s[0] * R[1, j] - s[1] * R[0, j])


@compiled
def _multiply(F: Array, P: Array, out: Array) -> None:
    """F P (23, 23), where F moves only attitude, velocity and position by others, up to the inertial unit's errors."""
    for i in range(ERROR):
        for j in range(ERROR):
            total = F[i, i] * P[i, j]
            if i < WANDER:
                for k in range(WANDER + 6):
                    if k != i:
                        total += F[i, k] * P[k, j]
            out[i, j] = total


@compiled
def spread(nominal: Array, P: Array, since: Array, densities: Array, deviations: Array, times: Array) -> None:
    """Bring the covariance (23, 23) forward over what has happened `since`, and begin anew.

    `densities` (3,) are the noise of gyroscope and accelerometer, and how the ground's height walks with the root of
    the way over it; `deviations` and `times` (13,) the wanders.
    """
    dt = since[7]
    F = np.eye(ERROR)
    then, now, turned = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    _matrix(since[:4], then)
    _matrix(nominal[:4], now)
    _crossed(since[4:7], then, -1.0, turned)
    for i in range(3):
        for j in range(3):
            F[i, j] = now[0, i] * then[0, j] + now[1, i] * then[1, j] + now[2, i] * then[2, j]
            F[3 + i, j] = turned[i, j]
            F[6 + i, j] = 0.5 * dt * turned[i, j]
            F[3 + i, 12 + j] = -dt * then[i, j]
            F[6 + i, 12 + j] = -0.5 * dt * dt * then[i, j]
        F[i, 9 + i] = -dt
        F[6 + i, 3 + i] = dt
    for i in range(13):
        F[9 + i, 9 + i] = math.exp(-dt / times[i])
    M = np.zeros((ERROR, ERROR))
    _multiply(F, P, M)
    _multiply(F, M.T, P)  # F P F' is symmetric
    for i in range(3):
        P[i, i] += densities[0] ** 2 * dt
        P[3 + i, 3 + i] += densities[1] ** 2 * dt
    for i in range(13):
        P[9 + i, 9 + i] += deviations[i] ** 2 * (1.0 - math.exp(-2.0 * dt / times[i]))
    P[GROUND, GROUND] += densities[2] ** 2 * math.sqrt(nominal[4] ** 2 + nominal[5] ** 2) * dt
    since[:4] = nominal[:4]
    since[4:] = 0.0


@compiled
def _correct(nominal: Array, P: Array, H: Array, innovation: Array, variance: Array, gate: float) -> Array:
    """Take measurements one after another: rows H (n, 23), innovations and variances (n,). Those beyond `gate` standard
    deviations are left. Of each the squared ratio (n,) of the innovation and its deviation: the test ratios."""
    change, Ph, ratios = np.zeros(ERROR), np.empty(ERROR), np.empty(len(innovation))
    for row in range(len(innovation)):
        S, left = variance[row], innovation[row]
        for i in range(ERROR):
            Ph[i] = 0.0
            for j in range(ERROR):
                Ph[i] += P[i, j] * H[row, j]
            S += H[row, i] * Ph[i]
            left -= H[row, i] * change[i]
        ratios[row] = left * left / S
        if left * left > gate * gate * S:
            continue
        for i in range(ERROR):
            gain = Ph[i] / S
            change[i] += gain * left
            for j in range(ERROR):
                P[i, j] -= gain * Ph[j]
    for i in range(ERROR):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    turn(nominal, change[0], change[1], change[2])
    for i in range(3, ERROR):
        nominal[1 + i] += change[i]
    return ratios


@compiled
def take_field(nominal: Array, P: Array, field_ned: Array, read_frd: Array, noise: float, gate: float) -> Array:
    """The magnetometer's reading (3,) of a known field (3,). The test ratios (3,)."""
    q = nominal
    x, y, z = to_world(q[0], -q[1], -q[2], -q[3], field_ned[0], field_ned[1], field_ned[2])
    H, innovation, variance = np.zeros((3, ERROR)), np.empty(3), np.full(3, noise * noise)
    H[0, 1], H[0, 2], H[1, 0], H[1, 2], H[2, 0], H[2, 1] = -z, y, z, -x, -y, x
    innovation[0] = read_frd[0] - x - q[19]
    innovation[1] = read_frd[1] - y - q[20]
    innovation[2] = read_frd[2] - z - q[21]
    for i in range(3):
        H[i, 18 + i] = 1.0
    return _correct(nominal, P, H, innovation, variance, gate)


@compiled
def take_height(nominal: Array, P: Array, height: float, noise: float, gate: float) -> Array:
    """The barometer's. The test ratio (1,)."""
    H, innovation = np.zeros((1, ERROR)), np.empty(1)
    H[0, 8], H[0, 21] = -1.0, 1.0
    innovation[0] = height + nominal[9] - nominal[22]
    return _correct(nominal, P, H, innovation, np.full(1, noise * noise), gate)


@compiled
def take_fix(nominal: Array, P: Array, then: Array, late: float, read: Array, noise: Array, gate: float) -> Array:
    """Position and velocity (6,) of the receiver, with their standard deviations (6,), from a time `late` (s) ago, when
    the nominal state was `then` (24,). The test ratios (6,)."""
    R, gained, turned = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    _matrix(nominal[:4], R)
    for i in range(3):
        gained[i] = nominal[4 + i] - then[4 + i]
    gained[2] -= GRAVITY * late
    _crossed(gained, R, 1.0, turned)
    H, innovation = np.zeros((6, ERROR)), np.empty(6)
    for i in range(3):
        for j in range(3):
            H[i, j] = -0.5 * late * turned[i, j]
            H[i, 12 + j] = -0.5 * late * late * R[i, j]
            H[3 + i, j] = turned[i, j]
            H[3 + i, 12 + j] = late * R[i, j]
        H[i, 3 + i] = -late
        H[i, 6 + i] = 1.0
        H[i, 15 + i] = 1.0
        H[3 + i, 3 + i] = 1.0
        innovation[i] = read[i] - then[7 + i] - then[16 + i]
        innovation[3 + i] = read[3 + i] - then[4 + i]
    return _correct(nominal, P, H, innovation, noise * noise, gate)


@compiled
def depth(nominal: Array, rates: Array, late: float, distance: float) -> tuple[float, float, float, float]:
    """How far below the vehicle a beam along the body's z axis met something at a `distance` (m), `late` (s) ago, while
    the vehicle turned at `rates` (3,) (rad/s); how much too far that is for each rad by which the attitude errs about
    the body's x and y axes; and the cosine of the tilt of then."""
    q = nominal
    x, y, z = to_world(q[0], -q[1], -q[2], -q[3], 0.0, 0.0, 1.0)
    upright = z - late * (x * rates[1] - y * rates[0])
    return distance * upright, distance * y, -distance * x, upright


@compiled
def take_range(
    nominal: Array, P: Array, rates: Array, late: float, distance: float, noise: float, gate: float
) -> float:
    """Correct the ground by the range finder's distance (m) of a time `late` (s) ago, see `depth`. The test ratio.

    Nothing else is corrected, whatever it shares with the ground (a Schmidt-Kalman update): a beam that is stuck or
    meets a hanging parcel would hold the height.
    """
    below, by_roll, by_pitch, _ = depth(nominal, rates, late, distance)
    H, Ph = np.zeros(ERROR), np.zeros(ERROR)
    H[0], H[1], H[5], H[8], H[GROUND] = by_roll, by_pitch, late, -1.0, 1.0
    innovation = below - nominal[1 + GROUND] + nominal[9] - late * nominal[6]
    S = noise * noise
    for i in range(ERROR):
        for j in range(ERROR):
            Ph[i] += P[i, j] * H[j]
        S += H[i] * Ph[i]
    ratio: float = innovation * innovation / S
    if ratio <= gate * gate:
        gain = Ph[GROUND] / S
        nominal[1 + GROUND] += gain * innovation
        for i in range(GROUND):
            P[GROUND, i] -= gain * Ph[i]
            P[i, GROUND] = P[GROUND, i]
        P[GROUND, GROUND] -= gain * Ph[GROUND]
    return ratio


def find_ground(nominal: Array, P: Array, below: float, noise: float) -> None:
    """Believe that the ground is so far (m) `below` the vehicle: it is as uncertain as the vehicle's height."""
    nominal[1 + GROUND] = nominal[9] + below
    P[GROUND, :GROUND] = P[:GROUND, GROUND] = P[8, :GROUND]
    P[GROUND, GROUND] = P[8, 8] + noise**2


@compiled
def of_motion(nominal: Array, P: Array, noise: float) -> Array:
    """Covariances (2, 6, 6): of the position (m, NED) and the attitude as a turn (rad, FRD); and of velocity (m/s, FRD)
    and rates (rad/s, FRD), of which `noise` is the variance of a reading."""
    J, out = np.zeros((2, 6, WANDER + 3)), np.zeros((2, 6, 6))
    q = nominal
    u, v, w = to_world(q[0], -q[1], -q[2], -q[3], q[4], q[5], q[6])
    J[1, 0, 1], J[1, 0, 2], J[1, 1, 0], J[1, 1, 2], J[1, 2, 0], J[1, 2, 1] = -w, v, w, -u, -v, u
    R = np.empty((3, 3))
    _matrix(nominal[:4], R)
    for i in range(3):
        J[0, i, PLACE + i], J[0, 3 + i, TURNED + i], J[1, 3 + i, WANDER + i] = 1.0, 1.0, -1.0
        for j in range(3):
            J[1, i, SPEED + j] = R[j, i]
    for kind in range(2):
        for i in range(6):
            for k in range(WANDER + 3):
                if J[kind, i, k] != 0.0:
                    for m in range(WANDER + 3):
                        for j in range(6):
                            out[kind, i, j] += J[kind, i, k] * P[k, m] * J[kind, j, m]
    for i in range(3, 6):
        out[1, i, i] += noise
    return out


def reset_to_fix(nominal: Array, P: Array, then: Array, late: float, read: Array, noise: Array, wander: Array) -> None:
    """Believe the receiver alone: position and velocity (6,), with their standard deviations (6,), from a time `late`
    (s) ago, when the nominal state was `then` (24,). Nothing is known of its wandering error but its deviation (3,)."""
    nominal[4:7] += read[3:] - then[4:7]
    nominal[7:10] += read[:3] - then[7:10] + late * (read[3:] - then[4:7])
    nominal[16:19] = 0.0
    known = np.r_[SPEED : PLACE + 3, 15:18]
    P[known, :] = P[:, known] = 0.0
    for i in range(3):
        P[SPEED + i, SPEED + i] = noise[3 + i] ** 2
        P[PLACE + i, PLACE + i] = noise[i] ** 2 + wander[i] ** 2 + (late * noise[3 + i]) ** 2
        P[PLACE + i, SPEED + i] = P[SPEED + i, PLACE + i] = late * noise[3 + i] ** 2
        P[15 + i, 15 + i] = wander[i] ** 2
        P[PLACE + i, 15 + i] = P[15 + i, PLACE + i] = -(wander[i] ** 2)
