"""Integration of the equations of motion: classical Runge-Kutta of fourth order."""

import math

import numpy as np

from protocol.arrays import Array
from protocol.jit import compiled
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
    for i in range(STATES):
        at[i] = state[i] + 0.5 * dt * k1[i]
    derivative(at, commands, parameters, k2)
    for i in range(STATES):
        at[i] = state[i] + 0.5 * dt * k2[i]
    derivative(at, commands, parameters, k3)
    for i in range(STATES):
        at[i] = state[i] + dt * k3[i]
    derivative(at, commands, parameters, k4)
    for i in range(STATES):
        state[i] += dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])
    norm = math.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    for i in range(6, 10):
        state[i] /= norm
