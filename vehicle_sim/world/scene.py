"""A world in the course of one flight."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle_sim.world.world import World


class Scene:
    """A world whose dynamic obstacles move and appear. Time counts from the vehicle's boot."""

    def __init__(self, world: World) -> None:
        self.world = world
        """The world as its file says."""
        self._absent = [each for each in world.dynamic if each.appears_within is not None]
        self._appeared_ns: dict[int, int] = {}
        self._last: tuple[int, World] | None = None

    def update(self, time_ns: int, position_ned: Sequence[float]) -> None:
        """Let obstacles appear that the vehicle at this position (3,) (m) has come near enough to."""
        for each in self._absent.copy():
            north, east, radius = self.world.cylinders[each.row, :3].tolist()
            distance = math.hypot(position_ned[0] - north, position_ned[1] - east) - radius
            if each.appears_within is not None and distance <= each.appears_within:
                self._absent.remove(each)
                self._appeared_ns[each.row] = time_ns
                self._last = None

    def at(self, time_ns: int) -> World:
        """The static world at a time up to now."""
        world = self.world
        if not world.dynamic:
            return world
        if self._last is None or self._last[0] != time_ns:
            self._last = time_ns, self._snapshot(time_ns)
        return self._last[1]

    def _snapshot(self, time_ns: int) -> World:
        world = self.world
        cylinders, absent = world.cylinders.copy(), []
        for each in world.dynamic:
            since_ns: int | None = 0
            if each.appears_within is not None:
                since_ns = self._appeared_ns.get(each.row)
            if since_ns is None or time_ns < since_ns:
                absent.append(each.row)
            elif each.route is not None:
                cylinders[each.row, :2] = each.route.at((time_ns - since_ns) * 1e-9)
        if not absent:
            return replace(world, cylinders=cylinders, dynamic=())
        absent_names = {len(world.boxes) + row for row in absent}
        names = tuple(name for number, name in enumerate(world.names) if number not in absent_names)
        return replace(world, cylinders=np.delete(cylinders, absent, axis=0), names=names, dynamic=())
