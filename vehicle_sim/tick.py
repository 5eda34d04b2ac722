"""One tick of flight: the control laws and the equations of motion, in four integration steps of 1 ms."""

import math

import numpy as np

from protocol.arrays import Array
from protocol.frames import product
from protocol.jit import compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.autopilot.control_laws import Command, Level, position_law, rotor_commands
from vehicle_sim.physics.integrator import step
from vehicle_sim.physics.motion import Feedback
from vehicle_sim.physics.rigid_body import Parameters, depth, derivative, to_world
from vehicle_sim.timing import STEP_S, STEPS_PER_TICK

EXACT = np.zeros(0)
"""An estimate without error."""
COMMANDS = 5
"""Row of the work array that holds the speeds (rad/s) commanded last, in its first four numbers."""


@compiled
def _estimated(state: Array, error: Array, out: Array) -> None:
    """The state (17,) as it is believed: with the estimate's error (13,), the attitude's as a turn in the body."""
    for i in range(6):
        out[i] = state[i] + error[i]
    out[6], out[7], out[8], out[9] = product(state[6:10], error[6:10])
    for i in range(10, 13):
        out[i] = state[i] + error[i]
    out[13:] = state[13:]


@compiled
def begin(seen: Array, command: Command, parameters: Parameters, feedback: Feedback) -> None:
    """What comes before a tick's steps, by the state (17,) as it is believed."""
    if command[0].level == Level.POSITION:
        position_law(seen, command, parameters)
    feedback[0].impact_m_s = 0.0


@compiled
def after_step(state: Array, parameters: Parameters, feedback: Feedback, speed: float, touched: bool) -> bool:
    """Whether a foot is on the ground after a step that began at this speed (m/s); impact and energy go to feedback."""
    p, f = parameters[0], feedback[0]
    touching = depth(state, parameters) > 0.0
    if touching and not touched:
        f.impact_m_s = max(f.impact_m_s, speed)
    for i in range(13, 17):
        f.shaft_energy_j += STEP_S * p.torque_per_thrust_m * p.thrust_constant_ns2 * state[i] ** 3
    return touching


@compiled
def end(
    state: Array, commands: Array, parameters: Parameters, feedback: Feedback, touching: bool, rates: Array
) -> None:
    """The rest of a tick's feedback; `rates` (17,) gets what the state changes by."""
    f = feedback[0]
    f.touching = 1.0 if touching else 0.0
    derivative(state, commands, parameters, rates)
    q0, q1, q2, q3 = state[6], state[7], state[8], state[9]
    v = to_world(q0, -q1, -q2, -q3, state[3], state[4], state[5])
    a = to_world(q0, -q1, -q2, -q3, rates[3], rates[4], rates[5] - GRAVITY)
    for i in range(3):
        f.velocity_frd[i] = v[i]
        f.specific_force_frd[i] = a[i]


@compiled
def speed_of(state: Array) -> float:
    """m/s, of a state (17,)."""
    return math.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2)


@compiled
def advance(
    state: Array, command: Command, parameters: Parameters, feedback: Feedback, work: Array, error: Array
) -> None:
    """Fly one tick: the state (17,) and the feedback change in place, and the command's computed fields are filled in.

    `work` (7, 17) is a work array, see integrator.work_array. The control laws see the state with the estimate's latest
    `error` (13,), or as it is (0,).
    """
    commands = work[COMMANDS]
    seen = work[6] if len(error) else state
    if len(error):
        _estimated(state, error, seen)
    begin(seen, command, parameters, feedback)
    touching = depth(state, parameters) > 0.0
    for _ in range(STEPS_PER_TICK):
        if len(error):
            _estimated(state, error, seen)
        rotor_commands(seen, command, parameters, commands)
        before = speed_of(state)
        step(state, commands, parameters, STEP_S, work)
        touching = after_step(state, parameters, feedback, before, touching)
    end(state, commands, parameters, feedback, touching, work[0])
