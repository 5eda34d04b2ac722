"""The method "none": straight to the goal, whatever is in the way."""

import math

import numpy as np

from companion.config_avoidance import Avoidance
from companion.state import AvoidanceDecision
from protocol.arrays import Array


class NoAvoidance:
    """Measures the clearance and changes nothing."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """See `methods.GoalRule`."""
        offsets = points_ned[:, :2] - position_ned[:2]
        nearest = float(np.hypot(offsets[:, 0], offsets[:, 1]).min()) if len(points_ned) else math.inf
        return AvoidanceDecision(goal_ned, speed, nearest - self._settings.vehicle_radius, False)
