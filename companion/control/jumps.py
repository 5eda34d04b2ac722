"""Jumps of the reference's rates, which come where its jerk jumps, let through smoothly."""

import math
from typing import Any

from protocol.arrays import Vector
from protocol.jit import compiled

_FADING_S = 0.05
"""Time constant with which jumps of the reference's rates are let through."""


@compiled
def fade_jumps(rates: Vector, turning: Vector, dt: float, memory: Any) -> None:
    """Hold back jumps of the reference's rates (rad/s), which come where its jerk jumps.

    `memory.rate_jump` is what is held back. It decays like the step response of a critically damped filter, so neither
    the rates nor their derivative (`memory.rate_jump_change`) have a step. Rates that agree with their own derivative
    `turning` (rad/s2) pass unchanged.
    """
    left = math.exp(-dt / _FADING_S)
    for i in range(3):
        if dt > 0.0:
            expected = memory.reference_rates[i] + 0.5 * dt * (memory.reference_turning[i] + turning[i])
            jump = memory.rate_jump[i] + rates[i] - expected
            pull = (jump / _FADING_S - memory.rate_jump_change[i]) * dt
            memory.rate_jump[i] = left * (jump + pull)
            memory.rate_jump_change[i] = left * (memory.rate_jump_change[i] + pull / _FADING_S)
        memory.reference_rates[i] = rates[i]
        memory.reference_turning[i] = turning[i]
