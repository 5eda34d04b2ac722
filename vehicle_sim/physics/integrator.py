"""Integration of the equations of motion: classical Runge-Kutta of fourth order."""

import math

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled, inlined
from vehicle_sim.physics.rigid_body import STATES, Parameters, derivative


def work_array() -> Array:
    """The work array (7, 17) of `step` and of tick.advance, which allocate nothing."""
    return np.zeros((7, STATES))


@compiled
def step(state: Array, commands: Array, parameters: Parameters, dt: float, work: Array) -> None:
    """Integrate the state (17,) over dt (s) in place, under commanded rotor speeds (4,) in rad/s.

    The quaternion is normalised afterwards. `work` (>= 5, 17) is a work array, see `work_array`.
    """
    k1, k2, k3, k4, at = work[0], work[1], work[2], work[3], work[4]
    derivative(state, commands, parameters, k1)
    follow(state, k1, 0.5 * dt, at)
    derivative(at, commands, parameters, k2)
    follow(state, k2, 0.5 * dt, at)
    derivative(at, commands, parameters, k3)
    follow(state, k3, dt, at)
    derivative(at, commands, parameters, k4)
    for i in range(STATES):
        state[i] += weighted(k1[i], k2[i], k3[i], k4[i], dt)
    norm = length(state[6], state[7], state[8], state[9])
    for i in range(6, 10):
        state[i] /= norm


@inlined
def follow(state: Array, rate: Array, dt: float, out: Array) -> None:
    """Where a state would be after dt (s) at this rate, into `out`; one dimension."""
    for i in range(state.shape[0]):
        out[i] = state[i] + dt * rate[i]


@inlined
def weighted(k1: float, k2: float, k3: float, k4: float, dt: float) -> float:
    """The change over dt (s) by the rates at its beginning, twice in its middle, and at its end."""
    return dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@inlined
def length(q0: float, q1: float, q2: float, q3: float) -> float:
    """The length of a quaternion."""
    return math.sqrt(q0**2 + q1**2 + q2**2 + q3**2)
