"""Turns in a costmap: what a fast vehicle can't reach without braking costs more.

A place beside the way that the velocity leads is reached by a lateral acceleration, after some time; who must be
slower than now to have that time loses speed. So of two ways around what appears ahead the one that is within reach is
flown, and not now the one and now the other. Beyond the stopping distance any place can be reached.
"""

import math

import numpy as np

from companion.avoidance.clearance import Place
from companion.perception.distance_field import Floats
from protocol.jit import compiled

_COST = 0.5
"""Cost of a cell that is reached at half of the present speed; it grows with the time that this takes."""
_MOST = 1.5
"""The most that it grows to."""
_LEAST_SPEED = 3.0
"""m/s; a slower vehicle turns as it likes."""


@compiled
def add_turns(
    costmap: Floats,
    here: Place,
    velocity: Place,
    limits: tuple[float, float, float],
    corner: tuple[int, int],
    cell: float,
) -> None:
    """Add the costs of turns to a costmap, for a vehicle at a place (m, NED) with a velocity (m/s, NED).

    `limits`: lateral acceleration and braking (m/s2), and the time (s) from a command to them; `corner`: world index of
    `costmap[0, 0]`; `cell`: its side (m).
    """
    acceleration, braking, lag = limits
    speed = math.hypot(velocity[0], velocity[1])
    if speed < _LEAST_SPEED:
        return
    un, ue = velocity[0] / speed, velocity[1] / speed
    north, east = here[0] + lag * velocity[0], here[1] + lag * velocity[1]
    rows, columns = costmap.shape
    stopping = 0.5 * speed * speed / braking
    top, bottom = math.floor((north - stopping) / cell) - corner[0], math.ceil((north + stopping) / cell) - corner[0]
    left, right = math.floor((east - stopping) / cell) - corner[1], math.ceil((east + stopping) / cell) - corner[1]
    for i in range(max(top, 0), min(bottom, rows)):
        for j in range(max(left, 0), min(right, columns)):
            dn, de = (corner[0] + i + 0.5) * cell - north, (corner[1] + j + 0.5) * cell - east
            along, across = dn * un + de * ue, max(abs(de * un - dn * ue) - cell, 0.0)
            if dn * dn + de * de > stopping * stopping or (across == 0.0 and along >= 0.0):
                continue
            lost = _MOST
            if along > cell:
                lost = min(_COST * (speed * math.sqrt(2.0 * across / acceleration) / along - 1.0), _MOST)
            if lost > 0.0:
                costmap[i, j] += np.float32(lost)
