"""The paper's rule, (26)-(31), with one box for each obstacle and a speed limit from the braking distance.

The rule: the returns of an obstacle are boxed, and if the obstacle blocks the course, the lateral setpoint moves
`lateral_margin` (3 m) outside the edge of the box that is nearer to the vehicle. Differences from the print, with the
reason of each:

- The points are rotated into the world with the pose at which the scan was taken (the paper adds the position only).
- Returns are remembered for a while: a scan that tilts with the vehicle looks under a billboard that it saw before.
- Every obstacle (cluster of returns with no room to pass between them) has its own box: one box around all returns
  closes every street.
- The axes of the box are along and across the course to the target, not north and east; for a course along an axis they
  are the same.
- The other coordinate of the setpoint lies before or behind the box, so that the straight line to it does not lead
  through the box.
- Of the setpoints on both sides of the obstacles in sight that can be reached in a straight line, the one with the
  shortest path to the goal is taken. For a single obstacle that is the nearer edge, as printed in (30); the
  inequalities of (31) are printed the other way round. Where there is no room for the margin, a smaller one is used.
- The chosen setpoint is kept until the path over another is shorter by `switch_margin`; otherwise noise would make the
  vehicle turn back and forth.
"""

import math

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.braking import free_distance, stopping_speed
from companion.config_avoidance import Avoidance
from companion.state import AvoidanceDecision
from protocol.arrays import Array
from protocol.jit import compiled

_MARGIN_SHARES = (1.0, 0.7, 0.45)
"""Shares of the lateral margin that are tried."""
_ROUNDING = 0.05
"""m of tolerance in distances."""
_MIN_DISTANCE = 0.5
"""m; a setpoint nearer than this is not used."""
_MIN_VECTOR = 0.3
"""Length of a velocity (m/s) or an offset (m) below which it gives no direction."""


def box_around(points: Array) -> Array:
    """(26)-(29): near, far, left and right end (4,) (m) of points (n, 2) (m) along and across the course.

    They count from the vehicle; across is positive to the right.
    """
    near, left = points.min(axis=0)
    far, right = points.max(axis=0)
    return np.array([near, far, left, right])


def setpoints(boxes: Array, margin: float, standoff: float) -> Array:
    """(30), (31) on both sides of boxes (k, 4) (m): places (4 k, 2) (m) along and across, before and behind each."""
    near, far, left, right = boxes.T
    along = np.concatenate([near - standoff, far + standoff, near - standoff, far + standoff])
    across = np.concatenate([left - margin, left - margin, right + margin, right + margin])
    return np.column_stack([along, across])


def clusters(points: Array, gap: float) -> list[Array]:
    """Groups (k, 2) of the points (n, 2) (m) that are connected by steps shorter than `gap` (m)."""
    labels = _label(points, gap)
    return [points[labels == label] for label in range(labels.max() + 1)] if len(points) else []


@compiled
def _label(points: Array, gap: float) -> NDArray[np.int64]:
    """Number (n,) of the cluster of each point (n, 2), by flooding from each point that has none."""
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


def _stands_in_corridor(points: Array, length: float, half_width: float) -> bool:
    """Whether one of the points (n, 2) (m), along and across, lies in the corridor ahead."""
    along, across = points.T
    return bool(np.any((along > 0.0) & (along < length) & (np.abs(across) < half_width)))


class PaperRule:
    """Decides at each scan; remembers the chosen setpoint."""

    def __init__(self, settings: Avoidance) -> None:
        self._settings = settings
        self._chosen: Array | None = None
        """(2,) m, NED: the setpoint that the vehicle flies to."""

    def decide(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, goal_ned: Array, speed: float
    ) -> AvoidanceDecision:
        """See `methods.GoalRule`."""
        settings = self._settings
        offsets = points_ned[:, :2] - position_ned[:2]
        nearest = float(np.hypot(offsets[:, 0], offsets[:, 1]).min()) if len(points_ned) else math.inf
        # A vehicle that is already too near to an obstacle must be able to leave it.
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
        """Whether the straight line to a place (2,) (m, NED) is free for a disc of radius `half_width` (m)."""
        north, east = (place - position_ned[:2]).tolist()
        length = math.hypot(north, east)
        if length < _ROUNDING:
            return True
        direction = np.array([north / length, east / length, 0.0])
        return free_distance(points_ned, position_ned, direction, half_width) >= length

    def _around(self, points_ned: Array, position_ned: Array, goal: Array, half_width: float) -> Array:
        """The setpoint (2,) (m, NED) while the line to the goal (2,) is blocked; the vehicle's place if there is
        none."""
        settings = self._settings
        here = position_ned[:2]
        length = math.hypot(*(goal - here).tolist())
        ahead = (goal - here) / length
        axes = np.array([ahead, [-ahead[1], ahead[0]]])  # rows: along, across
        standoff = settings.vehicle_radius + settings.safe_distance
        found = clusters((points_ned[:, :2] - here) @ axes.T, 2.0 * standoff)
        boxes = np.array([box_around(points) for points in found])
        blocking = np.array([_stands_in_corridor(points, length + half_width, half_width) for points in found])
        for asked in (boxes[blocking], boxes):
            place = self._best(asked, points_ned, position_ned, goal, axes, half_width)
            if place is not None:
                self._chosen = place
                return place
        return here

    def _best(
        self, boxes: Array, points_ned: Array, position_ned: Array, goal: Array, axes: Array, half_width: float
    ) -> Array | None:
        """The reachable one of the setpoints (2,) (m, NED) around the boxes (k, 4) that has the shortest path to
        the goal; `axes` (2, 2): unit vectors along and across the course."""
        settings = self._settings
        here = position_ned[:2]
        places, lengths = [], []
        for share in _MARGIN_SHARES:
            margin = share * settings.lateral_margin
            offsets = setpoints(boxes, margin, settings.vehicle_radius + settings.safe_distance)
            there = np.hypot(*offsets.T)
            place = here + offsets @ axes
            length = there + np.hypot(*(goal - place).T)
            length += settings.lateral_margin - margin  # a metre of margin counts as a metre of path
            length[there < _MIN_DISTANCE] = math.inf
            if self._chosen is not None:
                length -= settings.switch_margin * (np.hypot(*(self._chosen - place).T) < settings.lateral_margin)
            places.append(place)
            lengths.append(length)
        all_places, all_lengths = np.concatenate(places), np.concatenate(lengths)
        for index in np.argsort(all_lengths, kind="stable"):
            if not math.isfinite(all_lengths[index]):
                break
            if self._reaches(points_ned, position_ned, all_places[index], half_width):
                return np.asarray(all_places[index])
        return None

    def _speed_limit(
        self, points_ned: Array, position_ned: Array, velocity_ned: Array, target_ned: Array, speed: float
    ) -> float:
        """The lower of the speeds (m/s) that are allowed in the direction of motion and towards the target."""
        settings = self._settings
        half_width = settings.vehicle_radius + 0.5 * settings.safe_distance
        limit = speed
        for direction in (velocity_ned, target_ned - position_ned):
            length = math.hypot(direction[0], direction[1])
            if length > _MIN_VECTOR:
                ahead = np.array([direction[0] / length, direction[1] / length, 0.0])
                free = free_distance(points_ned, position_ned, ahead, half_width)
                limit = min(limit, stopping_speed(free, settings.braking_acceleration, settings.braking_delay))
        return max(limit, settings.least_speed)
