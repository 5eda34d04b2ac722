"""The paper's rule, (26)-(31), one box an obstacle, with a speed limit from the braking distance.

The rule: an obstacle's returns are boxed, and if the obstacle stands in the way, the lateral setpoint moves
`lateral_margin` (3 m) outside the box's edge that is nearer to the vehicle. Differences from the print, each for a
reason:

- The points are rotated into the world with the pose at which the scan was taken (the paper adds the position only).
- Returns are remembered for a while: a ring that tilts with the vehicle looks under a billboard that it saw before.
- Every obstacle (cluster of returns with no room to pass between them) has its own box: one box around all returns
  closes every street.
- The box's axes are along and across the course to the target, not north and east; for a course along an axis they
  are the same.
- The setpoint's other coordinate lies before or behind the box, so that the straight way there does not lead through
  it.
- Of the setpoints that the rule gives for the obstacles in sight, on either side, the one with the shortest way to the
  goal is taken that can be reached in a straight line; alone on a free field that is the nearer edge, as printed in
  (30). (31) is printed with its inequalities the other way round. Where there are no three metres, less will do.
- A setpoint that is chosen is kept unless another is shorter by `decisiveness`, or noise would turn the vehicle to and
  fro.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.braking import free_distance, stopping_speed
from companion.config import Avoidance
from companion.state import AvoidanceDecision
from protocol.compiled import compiled
from protocol.frames import Array

_LESS_MARGIN = (1.0, 0.7, 0.45)
"""Shares of the lateral margin that are tried."""
_ROUNDING = 0.05
_NEAREST = 0.5
"""m; a setpoint nearer than this leads nowhere."""


@dataclass(frozen=True, slots=True)
class Box:
    """An obstacle's extent along and across the course (m, from the vehicle; across to the right)."""

    near: float
    far: float
    left: float
    right: float

    @classmethod
    def around(cls, points: Array) -> "Box":
        """The smallest box around points (n, 2): (26)-(29)."""
        near, left = points.min(axis=0).tolist()
        far, right = points.max(axis=0).tolist()
        return cls(near, far, left, right)

    def setpoints(self, margin: float, standoff: float) -> Iterator[tuple[float, float]]:
        """(30), (31) on both sides: places (along, across) before the box and behind it."""
        for across in (self.left - margin, self.right + margin):
            yield self.near - standoff, across
            yield self.far + standoff, across


def clusters(points: Array, gap: float) -> list[Array]:
    """Points (n, 2) that a chain of steps shorter than `gap` (m) connects belong together."""
    labels = _label(points, gap)
    return [points[labels == label] for label in range(labels.max() + 1)] if len(points) else []


@compiled
def _label(points: Array, gap: float) -> NDArray[np.int64]:
    """Number of the cluster of each point, by flooding from each point that has none."""
    count = points.shape[0]
    labels = np.full(count, -1)
    queue = np.empty(count, np.int64)
    label = 0
    for start in range(count):
        if labels[start] >= 0:
            continue
        labels[start] = label
        queue[0] = start
        head, tail = 0, 1
        while head < tail:
            at = queue[head]
            head += 1
            for other in range(count):
                if labels[other] < 0:
                    along = points[other, 0] - points[at, 0]
                    across = points[other, 1] - points[at, 1]
                    if along * along + across * across < gap * gap:
                        labels[other] = label
                        queue[tail] = other
                        tail += 1
        label += 1
    return labels


def _stands_in_corridor(points: Array, half_width: float) -> bool:
    """Some of the points (n, 2), along and across, lie ahead within the width."""
    return bool(np.any((points[:, 0] > 0.0) & (np.abs(points[:, 1]) < half_width)))


class PaperRule:
    """Decides at each scan; remembers the setpoint that it chose."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._chosen: Array | None = None
        """(2,) north and east of the setpoint that is being flown to."""

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """What to fly to instead of `goal_ned`, and how fast at the most; points (n, 3)."""
        settings = self._settings
        offsets = points_ned[:, :2] - position_ned[:2]
        nearest = float(np.hypot(offsets[:, 0], offsets[:, 1]).min()) if len(points_ned) else math.inf
        # Where the vehicle is nearer to something than it should be, it may still leave.
        half_width = settings.vehicle_radius + settings.safe_distance
        half_width = max(min(half_width, nearest - _ROUNDING), settings.vehicle_radius)
        target = goal_ned
        blocked = not self._reaches(points_ned, position_ned, goal_ned[:2], half_width)
        if blocked:
            target = goal_ned.copy()
            target[:2] = self._around(points_ned, position_ned, goal_ned[:2], half_width)
        else:
            self._chosen = None
        limit = self._speed_limit(points_ned, position_ned, velocity_ned, target, speed)
        return AvoidanceDecision(target, limit, nearest - settings.vehicle_radius, blocked)

    def _reaches(self, points_ned: Array, position_ned: Array, place: Array, half_width: float) -> bool:
        """The straight way to a place (2,) is free for a disc of that radius."""
        north, east = (place - position_ned[:2]).tolist()
        length = math.hypot(north, east)
        if length < _ROUNDING:
            return True
        direction = np.array([north / length, east / length, 0.0])
        return free_distance(points_ned, position_ned, direction, half_width) >= length

    def _around(self, points_ned: Array, position_ned: Array, goal: Array, half_width: float) -> Array:
        """The setpoint (2,) to fly to while the way to the goal is blocked; where there is none, stay."""
        settings = self._settings
        here = position_ned[:2]
        ahead = (goal - here) / np.hypot(*(goal - here))
        axes = np.array([ahead, [-ahead[1], ahead[0]]])  # rows: along, across
        standoff = settings.vehicle_radius + settings.safe_distance
        found = clusters((points_ned[:, :2] - here) @ axes.T, 2.0 * standoff)
        in_the_way = [_stands_in_corridor(points, half_width) for points in found]
        boxes = [Box.around(points) for points in found]
        for asked in ([box for box, blocks in zip(boxes, in_the_way, strict=True) if blocks], boxes):
            place = self._best(asked, points_ned, position_ned, goal, axes, half_width)
            if place is not None:
                self._chosen = place
                return place
        return here

    def _best(
        self, boxes: list[Box], points_ned: Array, position_ned: Array, goal: Array, axes: Array, half_width: float
    ) -> Array | None:
        """The setpoint around one of the boxes with the shortest way to the goal, of those that can be reached."""
        settings = self._settings
        here = position_ned[:2]
        best, least = None, math.inf
        for share in _LESS_MARGIN:
            margin = share * settings.lateral_margin
            for box in boxes:
                for setpoint in box.setpoints(margin, settings.vehicle_radius + settings.safe_distance):
                    if math.hypot(*setpoint) < _NEAREST:
                        continue
                    place = here + np.array(setpoint) @ axes
                    way = math.hypot(*setpoint) + float(np.hypot(*(goal - place)))
                    way += settings.lateral_margin - margin  # a metre less of margin is worth a metre of way
                    if self._chosen is not None and np.hypot(*(self._chosen - place)) < settings.lateral_margin:
                        way -= settings.decisiveness
                    if way < least and self._reaches(points_ned, position_ned, place, half_width):
                        best, least = place, way
        return best

    def _speed_limit(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, target_ned: Array, speed: float
    ) -> float:
        """The smaller of what may be flown the way the vehicle moves and the way it is sent."""
        settings = self._settings
        half_width = settings.vehicle_radius + 0.5 * settings.safe_distance
        limit = speed
        for direction in (velocity_ned, target_ned - position_ned):
            length = math.hypot(direction[0], direction[1])
            if length > 0.3:
                ahead = np.array([direction[0] / length, direction[1] / length, 0.0])
                free = free_distance(points_ned, position_ned, ahead, half_width)
                limit = min(limit, stopping_speed(free, settings.braking_acceleration, settings.braking_delay))
        return max(limit, settings.least_speed)
