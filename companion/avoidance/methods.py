"""What every method of avoidance is asked, and the choice of one."""

from typing import Protocol

from companion.avoidance.none import NoAvoidance
from companion.avoidance.paper import PaperRule
from companion.avoidance.paper_literal import LiteralPaperRule
from companion.config import Avoidance
from companion.state import AvoidanceDecision
from protocol.arrays import Array


class Method(Protocol):
    """Asked at each scan; may remember."""

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """Where to fly to instead of `goal_ned` and how fast at the most (m/s, at most `speed`).

        `points_ned` (n, 3) are the returns of late, the ground left out.
        """


def choose(settings: Avoidance) -> Method:
    """The method that the settings name."""
    match settings.method:
        case "paper":
            return PaperRule(settings)
        case "paper-literal":
            return LiteralPaperRule(settings)
        case _:
            return NoAvoidance(settings)
