"""One tick of flight: four steps of 1 ms, each the control laws and then classical Runge-Kutta of fourth order."""

import math

import numpy as np
from numpy.typing import NDArray

from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.inner_loop import Command, Level, position_law, rotor_commands
from vehicle_sim.rigid_body import STATES, Array, Parameters, depth, derivative, to_world

TICK_NS = 4_000_000
STEPS_PER_TICK = 4
STEP_S = TICK_NS * 1e-9 / STEPS_PER_TICK

FEEDBACK = np.dtype(
    [
        ("touching", "f8"),  # 1: a foot is on the ground
        ("impact_m_s", "f8"),  # speed (m/s) at which the ground was touched in this tick, or 0
        ("velocity_frd", "f8", 3),
        ("specific_force_frd", "f8", 3),  # m/s2, what an accelerometer feels
        ("shaft_energy_j", "f8"),  # all rotors, since the start
    ]
)
Feedback = NDArray[np.void]
"""(1,) of FEEDBACK: what a tick says beside the state."""


def scratch() -> Array:
    """Room for `step` and `advance`: (6, 17)."""
    return np.zeros((6, STATES))


@compiled
def step(state: Array, commands: Array, parameters: Parameters, dt: float, room: Array) -> None:
    """One Runge-Kutta step of the state (17,) in place, under commanded rotor speeds (4,); `room` is (>= 5, 17)."""
    k1, k2, k3, k4, at = room[0], room[1], room[2], room[3], room[4]
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


@compiled
def advance(state: Array, command: Command, parameters: Parameters, feedback: Feedback, room: Array) -> None:
    """Fly one tick: state (17,) and feedback in place; the command's computed parts are filled in too."""
    p, f = parameters[0], feedback[0]
    commands = room[5]
    if command[0].level == Level.POSITION:
        position_law(state, command, parameters)
    f.impact_m_s = 0.0
    touching = depth(state, parameters) > 0.0
    for _ in range(STEPS_PER_TICK):
        rotor_commands(state, command, parameters, commands)
        speed = math.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2)
        step(state, commands, parameters, STEP_S, room)
        touched = touching
        touching = depth(state, parameters) > 0.0
        if touching and not touched:
            f.impact_m_s = max(f.impact_m_s, speed)
        for i in range(13, 17):
            f.shaft_energy_j += STEP_S * p.torque_per_thrust_m * p.thrust_constant_ns2 * state[i] ** 3
    f.touching = 1.0 if touching else 0.0

    rates = room[0]
    derivative(state, commands, parameters, rates)
    q0, q1, q2, q3 = state[6], state[7], state[8], state[9]
    v = to_world(q0, -q1, -q2, -q3, state[3], state[4], state[5])
    a = to_world(q0, -q1, -q2, -q3, rates[3], rates[4], rates[5] - GRAVITY)
    for i in range(3):
        f.velocity_frd[i] = v[i]
        f.specific_force_frd[i] = a[i]
