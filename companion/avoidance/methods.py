"""The interfaces of the methods of avoidance, and the chosen one; `companion.avoidance_methods` lists all of them."""

from importlib import import_module
from typing import Any, Protocol

from companion.avoidance.none import NoAvoidance
from companion.avoidance.path import Path
from companion.avoidance_methods import METHODS
from companion.config_avoidance import Avoidance
from companion.perception.map_view import MapView
from companion.state import AvoidanceDecision
from protocol.arrays import Array


class GoalRule(Protocol):
    """Moves the goal at each scan, in the control process. It may keep a state."""

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """Where to fly to instead of `goal_ned` (3,), and how fast at most (m/s, at most `speed`).

        `points_ned` (n, 3): the recent returns without the ground; all in m and m/s, NED.
        """


class PathPlanner(Protocol):
    """Plans a path at each scan, in the planner's process. It may keep a state."""

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        """The path from a position with a velocity to a goal, (3,) each, m and m/s NED, at most at `speed` (m/s).

        None if there is none.
        """


def goal_rule(settings: Avoidance) -> GoalRule:
    """The rule that the settings name. With a mapped method it leaves the goal alone, and measures the clearance."""
    rule: GoalRule = NoAvoidance(settings) if settings.mapped else _made(settings.method, settings)
    return rule


def path_planner(name: str, settings: Avoidance) -> PathPlanner:
    """The mapped method of that name. Raises ValueError if it is not a mapped one."""
    if not METHODS[name].mapped:
        raise ValueError(f"method {name!r} plans no paths")
    planner: PathPlanner = _made(name, settings)
    return planner


def _made(name: str, settings: Avoidance) -> Any:
    module, _, factory = METHODS[name].factory.partition(":")
    return getattr(import_module(module), factory)(settings)
