"""Some vehicles in one step of the integration, side by side: the processor computes each equation for all at once.

One array (ROWS * LANES,) has the numbers of all, one kind of number to a row: rows of one array can't overlap, which a
compiler must know to do so. A lane gets the state that `integrator.step` gives that vehicle, to the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, Quaternion, Vector
from protocol.jit import compiled, inlined
from vehicle_sim.airframe import PARAMETERS
from vehicle_sim.physics.integrator import follow, length, weighted
from vehicle_sim.physics.rigid_body import STATES, accelerations, air_wrench, attitude_rate, rotor_rate, with_ground

LANES = 8
"""As many doubles as the widest vector units hold."""
_PARAMETERS = PARAMETERS.itemsize // 8
_COMMANDS, _BODY, _WRENCH = 0, 4, 4 + _PARAMETERS
_STATE = _WRENCH + 6
_AT, _K1, _K2, _K3, _K4 = (_STATE + k * STATES for k in range(1, 6))
ROWS = _K4 + STATES
Pair = tuple[float, float]


class Body(NamedTuple):
    """What the equations of motion need of PARAMETERS, by the same names. Exists in compiled code only."""

    wind_ned: Vector
    force_ned: Vector
    mass_kg: float
    arm_length_m: float
    inertia_kgm2: Vector
    torque_per_thrust_m: float
    thrust_constant_ns2: float
    rotor_max_speed: float
    rotor_running: Quaternion
    voltage_share: float
    centre_of_mass_m: Pair
    quadratic_drag_kg_m: Vector
    propeller_radius_m: float
    rotor_thrust_share: Quaternion
    rotor_lag_share: Quaternion
    rotor_inertia_kgm2: float
    time_constant_up_s: float
    time_constant_down_s: float
    drag_kg_s: Vector
    foot_radius_m: float
    foot_height_m: float
    stiffness_n_m: float
    damping_ns_m: float
    friction: float


def _row(name: str) -> int:
    """The row of the first number of a field of PARAMETERS."""
    assert PARAMETERS.fields is not None
    return _BODY + PARAMETERS.fields[name][1] // 8


(
    _WIND,
    _FORCE,
    _MASS,
    _ARM,
    _INERTIA,
    _TORQUE,
    _THRUST,
    _MAX_SPEED,
    _RUNNING,
    _VOLTAGE,
    _CENTRE,
    _QUADRATIC,
    _RADIUS,
    _THRUST_SHARE,
    _LAG_SHARE,
    _ROTOR_INERTIA,
    _UP,
    _DOWN,
    _DRAG,
    _FOOT_RADIUS,
    _FOOT_HEIGHT,
    _STIFFNESS,
    _DAMPING,
    _FRICTION,
) = (_row(name) for name in Body._fields)


def loaded(states: Array, parameters: NDArray[np.void]) -> Array:
    """Work arrays (groups, ROWS * LANES) of `step`, with states (n, 17) and the records (n,) of PARAMETERS, LANES to
    each; lanes that are left fly the last."""
    groups = -(-len(states) // LANES)
    lanes = np.minimum(np.arange(groups * LANES), len(states) - 1)
    works = np.zeros((groups, ROWS, LANES))
    flat = np.ascontiguousarray(parameters).view(np.float64).reshape(len(parameters), _PARAMETERS)
    for row, values in ((_BODY, flat), (_STATE, states)):
        columns = values.shape[1]
        works[:, row : row + columns] = values[lanes].reshape(groups, LANES, columns).swapaxes(1, 2)
    return works.reshape(groups, ROWS * LANES)


@compiled
def take(work: Array, lane: int, state: Array) -> None:
    """Read the state (17,) of a lane."""
    for i in range(STATES):
        state[i] = work[(_STATE + i) * LANES + lane]


@compiled
def command(work: Array, lane: int, speeds: Array) -> None:
    """Write the commanded rotor speeds (4,) (rad/s) of a lane."""
    for i in range(4):
        work[(_COMMANDS + i) * LANES + lane] = speeds[i]


@inlined
def _one(work: Array, row: int, lane: int) -> float:
    value: float = work[row * LANES + lane]
    return value


@inlined
def _two(work: Array, row: int, lane: int) -> Pair:
    return _one(work, row, lane), _one(work, row + 1, lane)


@inlined
def _three(work: Array, row: int, lane: int) -> Vector:
    return _one(work, row, lane), _one(work, row + 1, lane), _one(work, row + 2, lane)


@inlined
def _four(work: Array, row: int, lane: int) -> Quaternion:
    return _one(work, row, lane), _one(work, row + 1, lane), _one(work, row + 2, lane), _one(work, row + 3, lane)


@inlined
def _put_three(work: Array, row: int, lane: int, values: Vector) -> None:
    for i in range(3):
        work[(row + i) * LANES + lane] = values[i]


@inlined
def _body(work: Array, lane: int) -> Body:
    return Body(
        _three(work, _WIND, lane),
        _three(work, _FORCE, lane),
        _one(work, _MASS, lane),
        _one(work, _ARM, lane),
        _three(work, _INERTIA, lane),
        _one(work, _TORQUE, lane),
        _one(work, _THRUST, lane),
        _one(work, _MAX_SPEED, lane),
        _four(work, _RUNNING, lane),
        _one(work, _VOLTAGE, lane),
        _two(work, _CENTRE, lane),
        _three(work, _QUADRATIC, lane),
        _one(work, _RADIUS, lane),
        _four(work, _THRUST_SHARE, lane),
        _four(work, _LAG_SHARE, lane),
        _one(work, _ROTOR_INERTIA, lane),
        _one(work, _UP, lane),
        _one(work, _DOWN, lane),
        _three(work, _DRAG, lane),
        _one(work, _FOOT_RADIUS, lane),
        _one(work, _FOOT_HEIGHT, lane),
        _one(work, _STIFFNESS, lane),
        _one(work, _DAMPING, lane),
        _one(work, _FRICTION, lane),
    )


@inlined
def _derivatives(work: Array, at: int, out: int) -> None:
    """`rigid_body.derivative` of the states in the rows from `at` on, into those from `out` on.

    The ground, under few, is looked at lane by lane, in a loop of its own: it would keep the others from going at once.
    """
    for lane in range(LANES):
        velocity, attitude = _three(work, at + 3, lane), _four(work, at + 6, lane)
        rates, rotors = _three(work, at + 10, lane), _four(work, at + 13, lane)
        force, torque = air_wrench(_one(work, at + 2, lane), velocity, attitude, rates, rotors, _body(work, lane))
        _put_three(work, _WRENCH, lane, force)
        _put_three(work, _WRENCH + 3, lane, torque)
    for lane in range(LANES):
        down, radius, height = _one(work, at + 2, lane), _one(work, _FOOT_RADIUS, lane), _one(work, _FOOT_HEIGHT, lane)
        if down + radius + height > 0.0:
            _add_ground(work, at, lane)
    for lane in range(LANES):
        body, rates = _body(work, lane), _three(work, at + 10, lane)
        wrench = _three(work, _WRENCH, lane), _three(work, _WRENCH + 3, lane)
        linear, turning = accelerations(wrench, rates, body)
        _put_three(work, out, lane, _three(work, at + 3, lane))
        _put_three(work, out + 3, lane, linear)
        _put_three(work, out + 10, lane, turning)
        turn = attitude_rate(_four(work, at + 6, lane), rates)
        for i in range(4):
            work[(out + 6 + i) * LANES + lane] = turn[i]
    for i in range(4):
        for lane in range(LANES):
            running, share = _one(work, _RUNNING + i, lane), _one(work, _LAG_SHARE + i, lane)
            commanded, speed = _one(work, _COMMANDS + i, lane), _one(work, at + 13 + i, lane)
            work[(out + 13 + i) * LANES + lane] = rotor_rate(commanded, speed, running, share, _body(work, lane))


@compiled
def _add_ground(work: Array, at: int, lane: int) -> None:
    """Add the ground's part to the force and the torque of a lane."""
    wrench = _three(work, _WRENCH, lane), _three(work, _WRENCH + 3, lane)
    velocity, attitude = _three(work, at + 3, lane), _four(work, at + 6, lane)
    down, rates = _one(work, at + 2, lane), _three(work, at + 10, lane)
    force, torque = with_ground(wrench, down, velocity, attitude, rates, _body(work, lane))
    _put_three(work, _WRENCH, lane, force)
    _put_three(work, _WRENCH + 3, lane, torque)


@inlined
def _follow(work: Array, rate: int, dt: float) -> None:
    """`integrator.follow` in all lanes, by the rates in the rows from `rate` on."""
    size = STATES * LANES
    state, rates = work[_STATE * LANES : _STATE * LANES + size], work[rate * LANES : rate * LANES + size]
    follow(state, rates, dt, work[_AT * LANES : _AT * LANES + size])


@compiled
def step(work: Array, dt: float) -> None:
    """Integrate the states of all lanes over dt (s), as `integrator.step` does one."""
    _derivatives(work, _STATE, _K1)
    _follow(work, _K1, 0.5 * dt)
    _derivatives(work, _AT, _K2)
    _follow(work, _K2, 0.5 * dt)
    _derivatives(work, _AT, _K3)
    _follow(work, _K3, dt)
    _derivatives(work, _AT, _K4)
    for i in range(STATES * LANES):
        k1, k2 = work[_K1 * LANES + i], work[_K2 * LANES + i]
        work[_STATE * LANES + i] += weighted(k1, k2, work[_K3 * LANES + i], work[_K4 * LANES + i], dt)
    for lane in range(LANES):
        q0, q1, q2, q3 = _four(work, _STATE + 6, lane)
        norm = length(q0, q1, q2, q3)
        for i in range(4):
            work[(_STATE + 6 + i) * LANES + lane] /= norm
