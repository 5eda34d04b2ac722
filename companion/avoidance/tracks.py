"""What moves: a track for each small thing that the rings show, with a constant-velocity Kalman filter.

A return belongs to its neighbour's cluster if the two are nearer to each other than `gap`. A cluster that is small and
in full view is measured by its middle, with the sensor's own shape of error: a few centimetres along the beam, and
across it as wide as the sector. Tracks and clusters are paired in the order of their distance in standard deviations
(nearest pair first, gated). A track is believed after some hits, dropped after some misses, and moves if its velocity
is well above its own uncertainty for some scans in a row. What moves is left out of the map, and the guard gets it with
its velocity.

The filter is the textbook's (Bar-Shalom, Li and Kirubarajan 2001, white-noise acceleration). A wide thing, a wall, has
no middle that could be followed: its visible part travels with the vehicle.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.guard import POINT
from companion.state import BoolArray, Scan
from protocol.compiled import compiled
from protocol.frames import Array, rotate

_GATE = 11.8
"""Squared distance in standard deviations, two dimensions: 99.7 %."""
_LONGEST_STEP_S = 0.5
_WIDEST_SECTOR = math.radians(15.0)
"""Where a nearest return stands within a wider one is not known well enough to say that it moves."""
_RANGE_SIGMA = 0.08
"""m along the beam: the sensor's noise and the round front of what it sees."""

_LEAST_RADIUS = 0.2
"""m; a single beam has no width."""

Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """Of the tracks."""

    gap: float
    """m between neighbouring returns from which on they are two things."""
    widest: float
    """m; what is wider is not followed."""
    acceleration: float
    """m/s2, standard deviation of what is followed: a person's change of mind."""
    hits: int
    """After so many a track is believed."""
    misses: int
    """After so many in a row it is dropped."""
    slowest: float
    """m/s; what is slower stands still."""
    certainty: float
    """Standard deviations by which a velocity must differ from 0."""
    steady: int
    """Scans in a row for which it must."""
    rest: int
    """Scans in a row without it after which what moved stands: a walker who turns is slow for a moment."""


@dataclass(slots=True)
class Track:
    """One thing. Mean (4,): north, east (m) and their rates; `covariance` (4, 4)."""

    number: int
    mean: Array
    covariance: Array
    radius: float
    """m around the middle that hold all of it."""
    hits: int = 1
    misses: int = 0
    steady: int = 0
    slow: int = 0
    moving: bool = False

    def at(self, seconds: float) -> Array:
        """(2,) where it will be."""
        place: Array = self.mean[:2] + seconds * self.mean[2:]
        return place


@dataclass(frozen=True, slots=True)
class Cluster:
    """One thing in one scan."""

    middle: Array
    """(2,) NED."""
    noise: Array
    """(2, 2) covariance of `middle`."""
    radius: float
    members: Integers
    """Indices of its beams."""


class Tracker:
    """Follows what the rings show, scan by scan."""

    def __init__(self, settings: TrackSettings) -> None:
        self._settings = settings
        self._tracks: list[Track] = []
        self._born = 0
        self._time_ns: int | None = None

    @property
    def tracks(self) -> tuple[Track, ...]:
        """All of them, the oldest first."""
        return tuple(self._tracks)

    @property
    def moving(self) -> tuple[Track, ...]:
        """Those that are believed and move."""
        return tuple(track for track in self._tracks if track.moving)

    def points(self, seconds: float, keep_out: float) -> Array:
        """(n, 5) what moves, `seconds` after the last scan, as the guard's POINTs; `keep_out` widens each radius."""
        rows = [[*track.at(seconds), *track.mean[2:], track.radius + keep_out] for track in self.moving]
        return np.array(rows).reshape(-1, POINT)

    def add(self, scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float) -> BoolArray:
        """Take a scan in; which of its returns (n,) belong to something that moves. See `OccupancyGrid.add`."""
        count = scan.bearings_frd.size
        points = place(scan.bearings_frd, scan.ranges_m, position_ned, attitude_ned_frd)
        usable = scan.hit & (points[:, 2] < ground_down)
        width = abs(scan.bearings_frd[1] - scan.bearings_frd[0]) if count > 1 else math.radians(5.0)
        if width > _WIDEST_SECTOR:
            return np.zeros(count, np.bool_)
        found = clusters(points, scan.ranges_m, usable, position_ned, self._settings, width)
        elapsed = 0.0 if self._time_ns is None else (scan.time_ns - self._time_ns) * 1e-9
        self._time_ns = scan.time_ns
        for track in self._tracks:
            predict(track, min(elapsed, _LONGEST_STEP_S), self._settings.acceleration)
        moving = np.zeros(count, np.bool_)
        for track, cluster in self._pairs(found):
            if track.moving:
                moving[cluster.members] = True
        return moving

    def _pairs(self, found: list[Cluster]) -> list[tuple[Track, Cluster]]:
        """Pair tracks and clusters, update, bear and drop tracks; the pairs."""
        squares = squared_distances(
            np.array([track.mean for track in self._tracks]).reshape(-1, 4),
            np.array([track.covariance for track in self._tracks]).reshape(-1, 4, 4),
            np.array([cluster.middle for cluster in found]).reshape(-1, 2),
            np.array([cluster.noise for cluster in found]).reshape(-1, 2, 2),
        )
        costs = sorted((squares[t, c], t, c) for t, c in np.argwhere(squares < _GATE).tolist())
        of_track: dict[int, int] = {}
        taken: set[int] = set()
        for _, t, c in costs:
            if t not in of_track and c not in taken:
                of_track[t] = c
                taken.add(c)
        pairs = []
        for t, track in enumerate(self._tracks):
            if t in of_track:
                cluster = found[of_track[t]]
                correct(track, cluster)
                self._judge(track)
                pairs.append((track, cluster))
            else:
                track.misses += 1
        s = self._settings
        self._tracks = [each for each in self._tracks if each.misses < (s.misses if each.hits >= s.hits else 1)]
        for c, cluster in enumerate(found):
            if c not in taken:
                self._tracks.append(born(self._born, cluster))
                self._born += 1
        return pairs

    def _judge(self, track: Track) -> None:
        s = self._settings
        fast = math.hypot(track.mean[2], track.mean[3]) > s.slowest
        fast = fast and square_in_sigmas(track.covariance[2:, 2:], track.mean[2:]) > s.certainty**2
        track.steady, track.slow = (track.steady + 1, 0) if fast else (0, track.slow + 1)
        known = track.hits >= s.hits
        track.moving = known and (track.steady >= s.steady or (track.moving and track.slow < s.rest))


def born(number: int, cluster: Cluster) -> Track:
    """At rest as far as is known, within a walker's speeds."""
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = cluster.noise
    covariance[2, 2] = covariance[3, 3] = 1.5**2
    return Track(number, np.array([*cluster.middle, 0.0, 0.0]), covariance, cluster.radius)


def predict(track: Track, dt: float, acceleration: float) -> None:
    """The track `dt` s later; `acceleration` (m/s2) is the white noise's standard deviation, held over the step."""
    track.mean, track.covariance = _predicted(track.mean, track.covariance, dt, acceleration)


def correct(track: Track, cluster: Cluster) -> None:
    """Take a measurement in."""
    track.mean, track.covariance = _corrected(track.mean, track.covariance, cluster.middle, cluster.noise)
    track.radius += 0.2 * (cluster.radius - track.radius)
    track.hits += 1
    track.misses = 0


@compiled
def square_in_sigmas(covariance: Array, offset: Array) -> float:
    """offset' covariance^-1 offset, two dimensions."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    x, y = offset[0], offset[1]
    square: float = (d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b)
    return square


@compiled
def squared_distances(means: Array, covariances: Array, middles: Array, noises: Array) -> Array:
    """(tracks, clusters) squared distances in standard deviations; means (t, 4), covariances (t, 4, 4), middles (c, 2),
    noises (c, 2, 2)."""
    result = np.empty((means.shape[0], middles.shape[0]))
    for t in range(means.shape[0]):
        for c in range(middles.shape[0]):
            spread = covariances[t, :2, :2] + noises[c]
            result[t, c] = square_in_sigmas(spread, middles[c] - means[t, :2])
    return result


@compiled
def _predicted(mean: Array, covariance: Array, dt: float, acceleration: float) -> tuple[Array, Array]:
    step = np.eye(4)
    step[0, 2] = step[1, 3] = dt
    result = _sandwich(step, covariance)
    place, speed = 0.5 * dt * dt * acceleration, dt * acceleration
    for k in range(2):
        result[k, k] += place * place
        result[k + 2, k + 2] += speed * speed
        result[k, k + 2] += place * speed
        result[k + 2, k] += place * speed
    moved = mean.copy()
    moved[0] += dt * mean[2]
    moved[1] += dt * mean[3]
    return moved, result


@compiled
def _corrected(mean: Array, covariance: Array, middle: Array, noise: Array) -> tuple[Array, Array]:
    """Joseph's form, which stays symmetric and positive."""
    spread = covariance[:2, :2] + noise
    determinant = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    gain = np.empty((4, 2))
    for i in range(4):
        gain[i, 0] = (covariance[i, 0] * spread[1, 1] - covariance[i, 1] * spread[1, 0]) / determinant
        gain[i, 1] = (covariance[i, 1] * spread[0, 0] - covariance[i, 0] * spread[0, 1]) / determinant
    left = np.eye(4)
    left[:, :2] -= gain
    north, east = middle[0] - mean[0], middle[1] - mean[1]
    return mean + gain[:, 0] * north + gain[:, 1] * east, _sandwich(left, covariance) + _sandwich(gain, noise)


@compiled
def _sandwich(left: Array, middle: Array) -> Array:
    """left middle left'."""
    rows, inner = left.shape
    result = np.zeros((rows, rows))
    for i in range(rows):
        for j in range(rows):
            for k in range(inner):
                for m in range(inner):
                    result[i, j] += left[i, k] * middle[k, m] * left[j, m]
    return result


def clusters(
    points: Array, ranges: Array, usable: BoolArray, position_ned: Array, settings: TrackSettings, width: float
) -> list[Cluster]:
    """The small things of a ring: runs of neighbouring returns (n, 3) NED, with what is behind or nothing on both
    sides. What another thing hides a part of has no known middle and is left out."""
    spans, middles, noises, extents = _small_things(
        points, ranges, usable, position_ned, settings.gap, settings.widest, width
    )
    found = []
    for k, ((first, length), extent) in enumerate(zip(spans.tolist(), extents.tolist(), strict=True)):
        members = (first + np.arange(length)) % ranges.size
        found.append(Cluster(middles[k], noises[k], max(0.5 * extent, _LEAST_RADIUS), members))
    return found


@compiled
def _small_things(
    points: Array, ranges: Array, usable: BoolArray, position: Array, gap: float, widest: float, width: float
) -> tuple[Integers, Array, Array, Array]:
    """Of each run of beams that is one: its first beam and length (n, 2), middle (n, 2), its covariance (n, 2, 2) and
    its extent (n,)."""
    spans = runs(points, usable, gap)
    middles, noises = np.empty((spans.shape[0], 2)), np.empty((spans.shape[0], 2, 2))
    extents = np.empty(spans.shape[0])
    count = 0
    for k in range(spans.shape[0]):
        middle, noise, extent, hidden = _measured(points, ranges, usable, position, spans[k, 0], spans[k, 1], width)
        if not hidden and extent <= widest:
            spans[count], middles[count], noises[count], extents[count] = spans[k], middle, noise, extent
            count += 1
    return spans[:count], middles[:count], noises[:count], extents[:count]


@compiled
def _measured(
    points: Array, ranges: Array, usable: BoolArray, position: Array, first: int, length: int, width: float
) -> tuple[Array, Array, float, bool]:
    """Middle (2,), its covariance (2, 2), extent (m) of a run of beams, and whether a neighbour stands before it."""
    count = ranges.size
    last = (first + length - 1) % count
    before, after = (first - 1) % count, (last + 1) % count
    hidden = (usable[before] and ranges[before] < ranges[first]) or (usable[after] and ranges[after] < ranges[last])
    middle = np.zeros(2)
    for k in range(first, first + length):
        middle += points[k % count, :2] / length
    north, east = middle[0] - position[0], middle[1] - position[1]
    distance = max(math.hypot(north, east), 1e-6)
    along = _RANGE_SIGMA * _RANGE_SIGMA
    across = along + (distance * width) ** 2 / 12.0
    un, ue = north / distance, east / distance
    cross = (along - across) * un * ue
    noise = np.array([[along * un * un + across * ue * ue, cross], [cross, along * ue * ue + across * un * un]])
    extent = math.hypot(points[last, 0] - points[first, 0], points[last, 1] - points[first, 1])
    return middle, noise, extent, hidden


@compiled
def place(bearings: Array, ranges: Array, position: Array, attitude: Array) -> Array:
    """(n, 3) NED of each return."""
    points = np.empty((bearings.size, 3))
    for k in range(bearings.size):
        beam = np.array([ranges[k] * math.cos(bearings[k]), ranges[k] * math.sin(bearings[k]), 0.0])
        points[k] = position + rotate(attitude, beam)
    return points


@compiled
def _joined(points: Array, usable: BoolArray, a: int, b: int, gap: float) -> bool:
    return usable[a] and usable[b] and math.hypot(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1]) < gap


@compiled
def runs(points: Array, usable: BoolArray, gap: float) -> Integers:
    """(n, 2) first beam and length of each run of neighbours around the ring that belong together; a ring that closes
    has none."""
    count = usable.size
    found = np.empty((count, 2), np.int64)
    number = 0
    for k in range(count):
        if not usable[k] or _joined(points, usable, (k - 1) % count, k, gap):
            continue
        length = 1
        while length < count and _joined(points, usable, (k + length - 1) % count, (k + length) % count, gap):
            length += 1
        found[number, 0], found[number, 1] = k, length
        number += 1
    return found[:number]
