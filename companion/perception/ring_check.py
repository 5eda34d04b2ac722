"""Whether a ring can be what stands around the vehicle: against the ring before it, and against the vehicle's way.

A ring that repeats to the last digit while the vehicle moves past what it shows is frozen. Where things look the same
from both places (between walls, in the open), equal rings may be true. Those of a sensor with noise never are: where
each ring was another one although the vehicle stood still, a few that repeat are frozen wherever it is. A ring whose
returns stand nowhere near those of the ring before is incoherent; one such may be new surroundings, several in a row
are noise.
"""

import math

from companion.perception.scans import WIDE_SECTOR, obstacle_points, sector_width
from companion.state import Pose, Scan
from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

_MOVED_M, _TURNED = 0.2, 0.05
"""A ring is expected to change on a way of m, or a turn of rad,"""
_CHANGED_M, _CHANGED_SHARE = 0.08, 0.3
"""if so much of it would stand elsewhere by so many m."""
_STILL_M, _STILL = 0.02, 0.01
"""A vehicle that moved by less (m) and turned by less (rad) stood still from ring to ring."""
_NOISY = 15
"""So many rings in a row that differ at rest are those of a sensor with noise."""
_MOST_REPEATS = 2
"""How often a ring of a sensor with noise may come again."""
_JOINED_M = 2.0
"""Neighbouring returns no farther apart are one surface."""
_FEWEST = 12
"""Fewer returns say nothing of coherence."""
_NEAR_M, _NEAR_SHARE = 0.4, 0.09
"""A return comes again within so many m, and so much of its range: the distance of beams."""
_COHERENT_SHARE = 0.55
_MOST_INCOHERENT = 2
"""Rings in a row that are still believed."""


class RingCheck:
    """The check of one sensor's rings."""

    def __init__(self) -> None:
        self.sure_ns: int | None = None
        """When the latest ring arrived that nothing speaks against."""
        self._sure_before_ns: int | None = None
        """The one before that."""
        self.refused = 0
        self.ground_down = math.inf
        """m, NED: what a ring shows below this is the ground."""
        self.ground_slope = 0.0
        """By which it may rise away from the vehicle."""
        self._first: tuple[Scan, Array, Pose, int] | None = None
        """The first of the latest rings that are equal, with its returns (n, 3) in the world and its arrival."""
        self._frozen = False
        self._incoherent = 0
        self._noisy = self._repeats = 0
        """Rings in a row that differed at rest, up to _NOISY, and those that are equal to the first."""

    def believes(self, scan: Scan, pose: Pose, now_ns: int) -> bool:
        """Whether the ring, taken at a pose, counts as one."""
        points = obstacle_points(scan, *pose, self.ground_down, self.ground_slope)
        first = self._first
        if first is not None and _same(scan, first[0]):
            self._repeats += 1
            self._listen(pose, first[2], changed=False)
            stuck = self._noisy == _NOISY and self._repeats > _MOST_REPEATS and len(points) >= _FEWEST
            if not self._frozen and (stuck or _is_elsewhere(pose, first[2])):
                spread = _spread(scan)
                self._frozen = stuck or _must_have_changed(points, first[1], pose[0], spread)
                if self._frozen or not spread:  # wide sectors take a longer way to show it
                    self.sure_ns = first[3]
                    self._first = (scan, points, pose, now_ns)
        else:
            if first is not None:
                self._listen(pose, first[2], changed=True)
            self._repeats = 0
            coherent = first is None or _coherent(points, first[1], pose[0])
            self._incoherent = 0 if coherent else self._incoherent + 1
            self._first, self._frozen = (scan, points, pose, now_ns), False
        believed = not self._frozen and self._incoherent <= _MOST_INCOHERENT
        if not believed:
            self.refused += 1
        elif not self._incoherent:
            self._sure_before_ns, self.sure_ns = self.sure_ns, now_ns
        elif (
            self._incoherent == 1 and self._sure_before_ns is not None
        ):  # of two rings that contradict each other either may be wrong
            self.sure_ns = self._sure_before_ns
        return believed

    @property
    def doubt(self) -> str:
        """How the ring that was not believed last is bad, in a word."""
        return "frozen" if self._frozen else "incoherent"

    def _listen(self, pose: Pose, since: Pose, *, changed: bool) -> None:
        """Find out whether the sensor has noise, from rings at rest. Once it has, it goes on to have it."""
        if self._noisy < _NOISY and not _is_elsewhere(pose, since, _STILL_M, _STILL):
            self._noisy = self._noisy + 1 if changed else 0


def _spread(scan: Scan) -> float:
    """rad to each side of its middle within which a return of a wide sector may be; it may stay there, and its range
    the same, while the vehicle turns or moves. 0 where sectors are narrow."""
    width = sector_width(scan)
    return 0.5 * width if width > WIDE_SECTOR else 0.0


def _same(one: Scan, other: Scan) -> bool:
    return _equal((one.ranges_m, one.hit, one.known), (other.ranges_m, other.hit, other.known))


@compiled
def _equal(one: tuple[Array, BoolArray, BoolArray], other: tuple[Array, BoolArray, BoolArray]) -> bool:
    if one[0].size != other[0].size:
        return False
    for i in range(one[0].size):
        if one[0][i] != other[0][i] or one[1][i] != other[1][i] or one[2][i] != other[2][i]:
            return False
    return True


def _is_elsewhere(pose: Pose, since: Pose, moved_m: float = _MOVED_M, turned: float = _TURNED) -> bool:
    by = 2.0 * math.acos(min(abs(float(pose[1] @ since[1])), 1.0))
    return by > turned or math.dist(pose[0].tolist(), since[0].tolist()) > moved_m


@compiled
def _must_have_changed(points: Array, before: Array, here: Array, spread: float) -> bool:
    """Seen from another place (3,) than before, the same ranges make other surroundings: returns (n, 3) away from the
    surfaces between those of before (m, 3), each by more than it may be aside within its sector (`spread`, rad)."""
    if len(points) == 0 or len(before) == 0:
        return False
    changed = 0
    for point in points:
        nearest = math.inf
        for i in range(len(before)):
            start, end = before[i], before[(i + 1) % len(before)]
            square = along = 0.0
            for axis in range(3):
                square += (end[axis] - start[axis]) ** 2
                along += (end[axis] - start[axis]) * (point[axis] - start[axis])
            part = 0.0 if square == 0.0 or square >= _JOINED_M**2 else min(max(along / square, 0.0), 1.0)
            away = 0.0
            for axis in range(3):
                away += (point[axis] - start[axis] - part * (end[axis] - start[axis])) ** 2
            nearest = min(nearest, away)
        aside = 0.0
        for axis in range(3):
            aside += (point[axis] - here[axis]) ** 2
        changed += nearest > (_CHANGED_M + spread * math.sqrt(aside)) ** 2
    return changed > _CHANGED_SHARE * len(points)


@compiled
def _coherent(points: Array, before: Array, here: Array) -> bool:
    """Most of the returns (n, 3), seen from a place (3,), stand where the ring before (m, 3) had some."""
    if len(points) < _FEWEST or len(before) < _FEWEST:
        return True
    again = 0
    for point in points:
        north, east, down = point[0] - here[0], point[1] - here[1], point[2] - here[2]
        near = _NEAR_M + _NEAR_SHARE * math.sqrt(north * north + east * east + down * down)
        for other in before:
            if (point[0] - other[0]) ** 2 + (point[1] - other[1]) ** 2 < near * near:
                again += 1
                break
    return again > _COHERENT_SHARE * len(points)
