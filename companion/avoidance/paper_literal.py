"""The paper's rule, (26)-(31), as it is printed, for the reproduction of its Figs. 6-9.

One box with its edges to north and east (the paper's x and y) stands around all returns, (26)-(29). The setpoint moves
`lateral_margin` (3 m) outside the box on both axes: (30) takes the edge nearer to the vehicle, (31), with its
inequalities the other way round, the edge farther from it. Read so, the two are one manoeuvre for a course along the
paper's y: beside the obstacle on the nearer side, and past it. Nothing limits the speed. Differences from the print,
and assumptions where the paper leaves something open:

- The returns are rotated into the world before the vehicle's position is added; the paper adds the position only.
- `x_abs` in (30), (31) is read as `x_obs`, and (31) sets y_av from y.
- (30) applies to the axis across the course and (31) to the one along it. The course is along the axis on which the
  goal is farther away. The setpoint is never past the goal.
- Along the course it is the edge towards the goal, which is the farther one until the vehicle is beside the middle of
  the obstacle. From there on (31) would turn the vehicle back.
- Both branches of the print apply at a tie; here the lower edge (south or west) counts as the nearer one.
- The condition to move is in Fig. 1, which the text does not contain. Here it is that the box meets the rectangle
  between vehicle and goal, widened by the vehicle's radius and the safe distance.

This method reproduces the paper. `avoidance.paper` is made to be flown, and lists what has to change for that.
"""

import math

import numpy as np

from companion.config_avoidance import Avoidance
from companion.state import AvoidanceDecision
from protocol.arrays import Array


def outside_nearer_edge(position: float, least: float, most: float, margin: float) -> float:
    """(30): the coordinate (m) that is `margin` (m) outside the edge nearer to `position` (m)."""
    return least - margin if position - least <= most - position else most + margin


def past_edge_towards(goal: float, position: float, least: float, most: float, margin: float) -> float:
    """(31): the coordinate (m) that is `margin` (m) outside the edge farther on from `position` to `goal` (m), but not
    past the goal."""
    return min(most + margin, goal) if goal >= position else max(least - margin, goal)


class LiteralPaperRule:
    """Decides at each scan; keeps no state."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """See `methods.GoalRule`; the speed limit is always `speed`."""
        if not len(points_ned):
            return AvoidanceDecision(goal_ned, speed, math.inf, False)
        settings = self._settings
        here, goal, places = position_ned[:2], goal_ned[:2], points_ned[:, :2]
        clearance = float(np.hypot(*(places - here).T).min()) - settings.vehicle_radius
        least, most = places.min(axis=0), places.max(axis=0)  # (26)-(29)
        room = settings.vehicle_radius + settings.safe_distance
        nearest, farthest = np.minimum(here, goal), np.maximum(here, goal)
        if not np.all((least < farthest + room) & (most > nearest - room)):
            return AvoidanceDecision(goal_ned, speed, clearance, False)
        distance = np.abs(goal - here)
        along, across = (0, 1) if distance[0] >= distance[1] else (1, 0)
        target = goal_ned.copy()
        at, to, low, high = (values.tolist() for values in (here, goal, least, most))
        margin = settings.lateral_margin
        target[across] = outside_nearer_edge(at[across], low[across], high[across], margin)
        target[along] = past_edge_towards(to[along], at[along], low[along], high[along], margin)
        return AvoidanceDecision(target, speed, clearance, True)
