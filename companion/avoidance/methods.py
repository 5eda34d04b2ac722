"""The interfaces of the methods of avoidance, and the chosen one; `companion.avoidance_methods` lists all of them."""

import math
from importlib import import_module
from typing import Any, Protocol

import msgspec
import numpy as np

from companion.avoidance.none import NoAvoidance
from companion.avoidance.path import MOST_VERTICES, Path
from companion.avoidance_methods import METHODS, method_of
from companion.config_avoidance import Avoidance
from companion.perception.map_view import MapView
from companion.plugins import Plugin
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
    if not method_of(name).mapped:
        raise ValueError(f"method {name!r} plans no paths")
    if name == settings.method and settings.plugin is not None:
        return ForeignPlanner(settings.plugin, settings)
    planner: PathPlanner = _made(name, settings)
    return planner


class ForeignPlanner:
    """A planner of another package: what it raises names the package, and its paths are checked."""

    def __init__(self, plugin: Plugin, settings: Avoidance) -> None:
        self._plugin = plugin
        self._planner: PathPlanner = plugin.make(settings, settings.options)
        self._reach = 0.5 * settings.map.cell * settings.map.cells

    def plan(self, view: MapView, position: Array, velocity: Array, goal: Array, speed: float) -> Path | None:
        """See `PathPlanner`. Raises PluginError."""
        with self._plugin.named():
            place = position[:2].copy()  # which a planner may write to
            path = self._planner.plan(view, position, velocity, goal, speed)
            fault = "" if path is None else _unsound(path, speed) or self._astray(path, place)
        if fault:
            raise self._plugin.broken(fault)
        return None if path is None else _in_arrays(path)

    def _astray(self, path: Path, place: Array) -> str:
        """What is wrong with where a sound path begins, seen from a place (2,) (m, NED); empty if nothing is."""
        away = math.dist(path.vertices[0], place) if len(path.vertices) else 0.0
        return f"a path that begins {away:.0f} m from the vehicle, beyond the map" if away > self._reach else ""


def _unsound(path: Path, speed: float) -> str:
    """What is wrong with a path, in words; empty if nothing is."""
    if not isinstance(path, Path):
        return f"{type(path).__name__} in place of a Path"
    vertices, speeds = np.shape(path.vertices), np.shape(path.speeds)
    if vertices[1:] != (2,) or speeds != vertices[:1]:
        return f"vertices {vertices} and speeds {speeds} in place of (k, 2) and (k,)"
    if vertices[0] > MOST_VERTICES:
        return f"a path of {vertices[0]} vertices, where {MOST_VERTICES} are the most"
    if not all(np.isfinite(each).all() for each in (path.vertices, path.speeds, path.bearing or 0.0)):
        return "a vertex, a speed or the bearing is not finite"
    if len(path.speeds) and not 0.0 <= np.min(path.speeds) <= np.max(path.speeds) <= speed + 1e-9:
        return f"a speed is not from 0 to {speed:g} m/s"
    return ""


def _in_arrays(path: Path) -> Path:
    """With the arrays that the loop which flies is compiled for: a path may be made of lists, of integers, or of
    another path that is read backwards."""
    vertices, speeds = (np.ascontiguousarray(each, np.float64) for each in (path.vertices, path.speeds))
    return msgspec.structs.replace(path, vertices=vertices, speeds=speeds)


def _made(name: str, settings: Avoidance) -> Any:
    module, _, factory = METHODS[name].factory.partition(":")
    return getattr(import_module(module), factory)(settings)
