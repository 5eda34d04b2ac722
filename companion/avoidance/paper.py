"""The paper's rule, (26)-(31), one box an obstacle, with a speed limit from the braking distance.

The rule: an obstacle's returns are boxed, and if the box stands in the way, the lateral setpoint moves
`lateral_margin` (3 m) outside the box's edge that is nearer to the vehicle. Differences from the print, each for a
reason:

- The points are rotated into the world with the pose at which the scan was taken (the paper adds the position only).
- The box's axes are along and across the course to the target, not north and east; for a course along an axis they
  are the same.
- Every obstacle (cluster of neighbouring returns) has its own box: one box around all returns closes every street.
- (31) is printed with its inequalities the other way round; a tie belongs to the lower side.
- The setpoint's other coordinate is the near face of the box, so that the way there does not lead through its corner.
- Boxes that leave no room to pass between them are one box; in a gap narrower than twice the margin the setpoint is
  its middle.
- A side that was chosen is kept while the same obstacle stands in the way, or noise would turn the vehicle to and
  fro.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.avoidance.braking import free_distance, stopping_speed
from companion.config import Avoidance
from companion.state import AvoidanceDecision
from protocol.frames import Array


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """An obstacle: its returns (n, 2) along and across the course (m, from the vehicle, across to the right), boxed."""

    points: Array
    near: float
    far: float
    left: float
    right: float

    @classmethod
    def around(cls, points: Array) -> "Box":
        """The smallest box around the points."""
        near, left = points.min(axis=0).tolist()
        far, right = points.max(axis=0).tolist()
        return cls(points, near, far, left, right)

    def blocks(self, length: float, half_width: float) -> bool:
        """A return of it lies in the corridor ahead, `length` long and twice `half_width` wide."""
        along, across = self.points.T
        return bool(np.any((along > 0.0) & (along < length) & (np.abs(across) < half_width)))

    def gap(self, other: "Box") -> float:
        """Distance between the two boxes (m), 0 if they touch."""
        along = max(self.near - other.far, other.near - self.far, 0.0)
        across = max(self.left - other.right, other.left - self.right, 0.0)
        return math.hypot(along, across)


def clusters(points: Array, gap: float) -> list[Array]:
    """Neighbouring returns (n, 2), in the order of bearing, that are less than `gap` (m) apart belong together."""
    steps = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    starts = np.flatnonzero(steps >= gap)
    if starts.size == 0:
        return [points]
    turned = np.roll(points, -starts[0], axis=0)
    return np.split(turned, starts[1:] - starts[0])


class PaperRule:
    """Decides at each scan; remembers the side on which it passes."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._passing: tuple[Array, float] | None = None
        """Where the obstacle stood (NED) and the side (-1 left, +1 right) on which it is passed."""

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """What to fly to instead of `goal_ned`, and how fast at the most; points (n, 3) in the order of bearing."""
        settings = self._settings
        offsets = points_ned[:, :2] - position_ned[:2]
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        clearance = float(distances.min()) - settings.vehicle_radius if len(distances) else math.inf
        way = goal_ned[:2] - position_ned[:2]
        length = float(np.hypot(way[0], way[1]))
        if length < 0.5 or len(points_ned) == 0:
            self._passing = None
            limit = self._speed_limit(points_ned, position_ned, velocity_ned, goal_ned, speed)
            return AvoidanceDecision(goal_ned, limit, clearance, False)
        ahead = way / length
        right = np.array([-ahead[1], ahead[0]])
        half_width = settings.vehicle_radius + settings.safe_distance
        boxes = self._boxes(offsets @ np.column_stack([ahead, right]))
        blocking = [box for box in boxes if box.blocks(length + half_width, half_width)]
        target = goal_ned
        if blocking:
            box = min(blocking, key=lambda box: box.near)
            lateral = self._lateral(box, boxes, position_ned, ahead, right)
            along = min(max(box.near, 0.5), length)
            target = goal_ned.copy()
            target[:2] = position_ned[:2] + along * ahead + lateral * right
        else:
            self._passing = None
        limit = self._speed_limit(points_ned, position_ned, velocity_ned, target, speed)
        return AvoidanceDecision(target, limit, clearance, bool(blocking))

    def _boxes(self, offsets: Array) -> list[Box]:
        """(26)-(29) on each cluster of points (n, 2) along and across; boxes too close to pass between are one."""
        passage = 2.0 * (self._settings.vehicle_radius + self._settings.safe_distance)
        joined: list[Box] = []
        for cluster in clusters(offsets, self._settings.cluster_gap):
            box = Box.around(cluster)
            while close := [other for other in joined if box.gap(other) < passage]:
                for other in close:
                    joined.remove(other)
                    box = Box.around(np.concatenate([box.points, other.points]))
            joined.append(box)
        return joined

    def _lateral(self, box: Box, boxes: list[Box], position_ned: Array, ahead: Array, right: Array) -> float:
        """(30), (31): the lateral setpoint (m to the right of the vehicle)."""
        side = -1.0 if -box.left <= box.right else 1.0
        place = position_ned[:2] + (box.near + box.far) / 2.0 * ahead + (box.left + box.right) / 2.0 * right
        if self._passing is not None:
            reach = self._settings.lateral_margin + max(box.far - box.near, box.right - box.left) / 2.0
            if float(np.hypot(*(self._passing[0] - place))) < reach:
                side = self._passing[1]
        self._passing = (place, side)
        edge = box.right if side > 0.0 else box.left
        margin = self._settings.lateral_margin
        for other in boxes:
            beside = other.near < box.far + margin and other.far > box.near - margin
            room = (other.left - edge) if side > 0.0 else (edge - other.right)
            if other is not box and beside and room > 0.0:
                margin = min(margin, room / 2.0)
        return edge + side * margin

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
                free = free_distance(points_ned, position_ned, direction / length, half_width)
                limit = min(limit, stopping_speed(free, settings.braking_acceleration, settings.braking_delay))
        return max(limit, settings.least_speed)
