"""Many vehicles in one compiled call, for Monte Carlo of control laws without MAVLink.

Each vehicle is a row of every array. It flies by the same equations and laws as the simulated vehicle, to the bit; the
equations of motion of LANES vehicles are computed at once (`vehicle_sim.physics.lanes`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numba
import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array
from protocol.jit import CACHE_FOLDER, compiled
from protocol.vehicle_parameters import GRAVITY
from vehicle_sim.airframe import Airframe, parameters
from vehicle_sim.autopilot.control_laws import COMMAND, Level, rotor_commands
from vehicle_sim.physics import lanes
from vehicle_sim.physics.lanes import LANES
from vehicle_sim.physics.motion import FEEDBACK
from vehicle_sim.physics.rigid_body import STATES, depth
from vehicle_sim.tick import after_step, begin, end, speed_of
from vehicle_sim.timing import STEP_S, STEPS_PER_TICK, TICK_S

F = TypeVar("F", bound=Callable[..., Any])

SPEED_LIMITS = (5.0, 3.0, 3.0)
"""m/s: horizontal, up, down."""
_SETTLED_M = 0.05


def _parallel(function: F) -> F:
    """As protocol.jit.compiled, with numba's loops over all cores."""
    result: F = numba.njit(parallel=True, cache=CACHE_FOLDER is not None, error_model="numpy")(function)
    return result


@_parallel
def fly(
    states: Array,
    commands: NDArray[np.void],
    parameter_rows: NDArray[np.void],
    feedback: NDArray[np.void],
    works: Array,
    ticks: int,
    positions: Array,
) -> None:
    """Advance n vehicles by so many ticks; `positions` (n, last, 3) gets where they are (m, NED) at the last of them.

    In place: states (n, 17), commands (n,) of COMMAND, feedback (n,) of FEEDBACK. `works` are those of
    `lanes.loaded`.
    """
    for group in numba.prange(len(works)):
        first = group * LANES
        count = min(LANES, len(states) - first)
        group_states, rows = states[first : first + count], slice(first, first + count)
        silent = ticks - positions.shape[1]
        for tick in range(ticks):
            _fly_tick(group_states, commands[rows], parameter_rows[rows], feedback[rows], works[group])
            if tick >= silent:
                positions[rows, tick - silent] = group_states[:, :3]


@compiled
def _fly_tick(
    states: Array, commands: NDArray[np.void], parameters: NDArray[np.void], feedback: NDArray[np.void], work: Array
) -> None:
    """`vehicle_sim.tick.advance` of up to LANES vehicles on exact estimates."""
    count = len(states)
    touching, speeds, rotors = np.empty(count, np.bool_), np.empty(count), np.empty((count, 4))
    for i in range(count):
        begin(states[i], commands[i : i + 1], parameters[i : i + 1], feedback[i : i + 1])
        touching[i] = depth(states[i], parameters[i : i + 1]) > 0.0
    for _ in range(STEPS_PER_TICK):
        for i in range(count):
            rotor_commands(states[i], commands[i : i + 1], parameters[i : i + 1], rotors[i])
            lanes.command(work, i, rotors[i])
            speeds[i] = speed_of(states[i])
        lanes.step(work, STEP_S)
        for i in range(count):
            lanes.take(work, i, states[i])
            touching[i] = after_step(states[i], parameters[i : i + 1], feedback[i : i + 1], speeds[i], touching[i])
    rates = np.empty(STATES)
    for i in range(count):
        end(states[i], rotors[i], parameters[i : i + 1], feedback[i : i + 1], touching[i], rates)


@dataclass
class Fleet:
    """n vehicles in the air, in hover, commanded to hold position by the vehicle's own laws."""

    states: Array
    """(n, 17)"""
    commands: NDArray[np.void]
    parameters: NDArray[np.void]
    """(n,) of airframe.PARAMETERS"""
    feedback: NDArray[np.void]

    @classmethod
    def hovering(cls, airframe: Airframe, count: int, height_m: float = 10.0) -> "Fleet":
        """All alike, at the origin."""
        p = np.repeat(parameters(airframe), count)
        states = np.zeros((count, STATES))
        states[:, 2], states[:, 6] = -height_m, 1.0
        hover = np.sqrt(p["mass_kg"] * GRAVITY / (4.0 * p["thrust_constant_ns2"]))
        states[:, 13:] = hover[:, None]
        commands = np.zeros(count, COMMAND)
        commands["level"] = Level.POSITION
        commands["position_ned"] = states[:, :3]
        commands["speed_limits"] = SPEED_LIMITS
        return cls(states, commands, p, np.zeros(count, FEEDBACK))

    def disturb(self, rng: np.random.Generator, wind_m_s: float = 6.0, force_n: float = 2.0, load: float = 0.1) -> None:
        """For each a wind and a force of random direction and size up to these, and a load of up to so large a share of
        its weight, to either side, which its laws don't know of."""
        p = self.parameters
        p["wind_ned"] = wind_m_s * _in_a_ball(rng, len(p))
        p["force_ned"] = force_n * _in_a_ball(rng, len(p))
        p["force_ned"][:, 2] += p["mass_kg"] * GRAVITY * rng.uniform(-load, load, len(p))

    def fly(self, seconds: float, last_s: float | None = None) -> Array:
        """Positions (n, ticks, 3), m, NED: of all of the time, or of the last of it."""
        ticks = round(seconds / TICK_S)
        kept = ticks if last_s is None else round(last_s / TICK_S)
        positions = np.empty((len(self.states), kept, 3))
        works = lanes.loaded(self.states, self.parameters)
        fly(self.states, self.commands, self.parameters, self.feedback, works, ticks, positions)
        return positions


def _in_a_ball(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) evenly spread in the unit ball."""
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    vectors: Array = directions * rng.random((count, 1)) ** (1.0 / 3.0)
    return vectors


@dataclass(frozen=True, slots=True)
class Responses:
    """One value a vehicle."""

    offset_m: Array
    """Distance from where it was to hover, at the end of the hover."""
    overshoot_m: Array
    """Overshoot of the step, in its direction, beyond where it came to rest."""
    settling_s: Array
    """Until it stays within 5 cm of where it came to rest."""


def hovers_and_steps(
    airframe: Airframe, count: int, seed: int = 1, seconds: float = 6.0, step_m: float = 2.0
) -> Responses:
    """Each vehicle hovers against its disturbance, then steps to the north, `seconds` of each."""
    fleet = Fleet.hovering(airframe, count)
    fleet.disturb(np.random.default_rng(seed))
    held = fleet.fly(seconds, last_s=TICK_S)[:, 0]
    offset = np.linalg.norm(held - fleet.commands["position_ned"], axis=1)
    fleet.commands["position_ned"][:, 0] += step_m
    way = fleet.fly(seconds)
    rest = way[:, -1]
    outside = np.linalg.norm(way - rest[:, None], axis=2) > _SETTLED_M
    ticks = outside.shape[1] - np.argmax(outside[:, ::-1], axis=1)
    return Responses(offset, (way[:, :, 0].max(axis=1) - rest[:, 0]), np.where(outside.any(axis=1), ticks, 0) * TICK_S)
