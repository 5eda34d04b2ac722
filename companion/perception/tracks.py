"""Tracks of moving obstacles: a constant-velocity Kalman filter for each small cluster of returns.

- Clusters: see `perception.clusters`.
- Association: tracks and clusters are paired nearest first by their Mahalanobis distance, within a gate.
- Turns: a track that moves and is met elsewhere than expected again and again, by the normalized square of the
  innovations, has turned. Its velocity gets uncertain, so that it follows within a few scans.
- Status: a track is confirmed after some hits, deleted after some misses, and moves if its velocity differs from 0
  significantly for some scans in a row and it was seen to have left its place (`perception.departure`). Its velocity
  must differ from the vehicle's, too: the place where a beam meets a long wall goes along with the vehicle. Of what
  flies beside it at its own speed that can't be told, and need not.
- Moving obstacles are left out of the map; the guard gets them with their velocity.

Source: Bar-Shalom, Li and Kirubarajan 2001 (piecewise constant white-noise acceleration).
"""

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from companion.config_avoidance import AvoidanceTracks
from companion.perception.clusters import Integers, Returns, find_clusters
from companion.perception.departure import (
    SIGHT_EVERY,
    SIGHTS,
    Sight,
    has_left,
    hit_at,
    passes_off,
    seen_level,
    stand,
    take_place,
)
from companion.perception.free_space import MOVER_COLUMNS
from companion.perception.range_noise import RangeNoise
from companion.perception.scans import WIDE_SECTOR, sector_width, world_points
from companion.state import Scan
from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

_GATE = 11.8
"""Squared Mahalanobis distance that holds 99.7 % in two dimensions."""
_LONGEST_STEP_S = 0.5
"""s: a longer time between two scans counts as this."""
_MOST_BEAMS = 72
"""Beams of a ring at most: OBSTACLE_DISTANCE has no more."""
_LEAST_RADIUS_M = 0.2
"""m: a single beam has no extent."""
_SPEED_ALONG_SIGMA, _SPEED_ACROSS_SIGMA = 2.5, 0.8
"""m/s of a new track, along the line of sight and across it. What comes or goes up to four times as fast as the first
is followed from its second return on. Across, the first few returns say little beside the width of a sector: with more,
what comes straight on seems to move to either side, and the vehicle evades to the wrong one."""
_RADIUS_GAIN = 0.2
"""Weight of the latest measurement in a track's radius."""
_SURPRISE_GAIN, _SURPRISE, _NO_SURPRISE = 0.5, 3.0, 2.0
"""Weight of the latest innovation in a track's surprise, the surprise that tells a turn, and its expected value: the
innovation has two dimensions."""
_SETTLED_HITS = 15
"""Scans after which the velocity of a track has settled, so that a surprise tells a turn."""
_TURN_SIGMA = 1.0
"""m/s that is added to the uncertainty of a velocity at a turn."""

TRACK = np.dtype(
    [
        ("number", "i8"),
        ("mean", "f8", 4),  # north, east (m), velocity north and east (m/s)
        ("covariance", "f8", (4, 4)),
        ("radius", "f8"),  # m around the centroid that hold all of it
        ("hits", "i8"),  # scans that saw it
        ("misses", "i8"),  # last scans in a row that did not see it, without those of `hidden`
        ("hidden", "i8"),  # last scans in a row that showed only a part of it, or hid it by their tilt
        ("fast_scans", "i8"),  # last scans in a row in which its velocity was significant
        ("slow_scans", "i8"),  # last scans in a row in which it was not
        ("surprise", "f8"),  # mean of the latest innovations' squares in standard deviations
        ("moving", "b1"),
        ("left", "b1"),  # it was seen to have left the place where it stood
        ("start", "f8", 2),  # north, east (m), that place, as it was seen first
        ("highest", "f8"),  # NED (m): the heights at which it was hit there
        ("lowest", "f8"),
        # Where it was seen: first where it stood, level if it was seen so, then in turn from nearer and nearer.
        ("place", "f8", (SIGHTS, 3)),  # NED (m), the return nearest to the centroid
        ("free", "f8", (SIGHTS, _MOST_BEAMS)),  # the Sight of the ring that saw it there
        ("position", "f8", (SIGHTS, 3)),
        ("attitude", "f8", (SIGHTS, 4)),
    ],
    align=True,
)
"""The state of one track."""
Tracks = NDArray[np.void]
"""(n,) TRACK"""

_RULES = np.dtype([(name, type(value)) for name, value in msgspec.structs.asdict(AvoidanceTracks()).items()])
"""The settings as a record, for compiled functions."""


class _PosedScan(NamedTuple):
    """A scan with its pose."""

    bearings: Array
    """(n,) rad"""
    ranges: Array
    """(n,) m"""
    hit: BoolArray
    """(n,)"""
    known: BoolArray
    """(n,)"""
    position: Array
    """(3,) NED (m)"""
    attitude: Array
    """(4,) NED to FRD"""
    width: float
    """rad of a sector."""
    noise: float
    """m, one standard deviation of the ranges; 0 if it is not known."""


class Tracker:
    """Tracks the clusters of one scan after the other."""

    def __init__(self, settings: AvoidanceTracks) -> None:
        self._rules = np.array([msgspec.structs.astuple(settings)], _RULES)
        self._started = 0
        self._time_ns: int | None = None
        self._position: Array | None = None
        self._bearings: Array = np.empty(0)
        self._noise = RangeNoise()
        self.tracks: Tracks = np.empty(0, TRACK)
        """All tracks, the oldest first."""

    @property
    def moving(self) -> Tracks:
        """The confirmed tracks that move."""
        moving: Tracks = self.tracks[self.tracks["moving"]]
        return moving

    def points(self, seconds: float, keep_out: float) -> Array:
        """(n, MOVER_COLUMNS) of the moving obstacles `seconds` after the last scan; `keep_out` (m) is added to each
        radius."""
        moving = self.moving
        points = np.empty((moving.size, MOVER_COLUMNS))
        points[:, 2:4] = moving["mean"][:, 2:]
        points[:, :2] = moving["mean"][:, :2] + seconds * points[:, 2:4]
        points[:, 4] = moving["radius"] + keep_out
        covariance = moving["covariance"]
        for column, (row, other) in enumerate(((0, 0), (0, 1), (1, 1)), 5):
            place, speed = covariance[:, row, other], covariance[:, row + 2, other + 2]
            both = covariance[:, row, other + 2] + covariance[:, other, row + 2]
            points[:, column] = place + seconds * (both + seconds * speed)
            points[:, column + 3] = both + 2.0 * seconds * speed
            points[:, column + 6] = speed
        return points

    def add(
        self, scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float, slope: float = 0.0
    ) -> BoolArray:
        """Add a scan taken at one pose, (3,) m and (4,); (n,) which of its returns belong to a moving obstacle.

        A scan whose beams look elsewhere than the last one's is another sensor's: all tracks begin anew.
        `ground_down` and `slope`: which returns are the ground, see `scans.obstacle_points`.
        """
        bearings = scan.bearings_frd
        width = sector_width(scan)
        if bearings.size != self._bearings.size or _farthest_turn(bearings, self._bearings) > 0.5 * width:
            self.tracks = self.tracks[:0]
        self._bearings = bearings.copy()
        if width > WIDE_SECTOR:
            return np.zeros(bearings.size, np.bool_)
        elapsed = 0.0 if self._time_ns is None else (scan.time_ns - self._time_ns) * 1e-9
        self._time_ns = scan.time_ns
        own = np.zeros(2)
        if self._position is not None and elapsed > 0.0:
            own = (position_ned[:2] - self._position[:2]) / elapsed
        self._position = position_ned.copy()
        pose, noise = (position_ned, attitude_ned_frd), self._noise.sigma_m
        posed = _PosedScan(bearings, scan.ranges_m, scan.hit, scan.known, *pose, width, noise)
        dt = min(elapsed, _LONGEST_STEP_S)
        self.tracks, self._started, moving, usable = _track(
            self.tracks, self._rules, self._started, dt, tuple(posed), own, (ground_down, slope)
        )
        self._noise.take(scan.ranges_m, usable, *pose)
        return moving


def _farthest_turn(bearings: Array, others: Array) -> float:
    """The greatest difference (rad) of n bearings from others."""
    return float(abs(np.remainder(bearings - others + math.pi, 2.0 * math.pi) - math.pi).max(initial=0.0))


@compiled
def _track(
    tracks: Tracks,
    rules: NDArray[np.void],
    started: int,
    dt: float,
    posed: tuple[Any, ...],
    own: Array,
    ground: tuple[float, float],
) -> tuple[Tracks, int, BoolArray, BoolArray]:
    """The tracks after a scan, the number of tracks ever started, and which beams (n,) see a moving obstacle, and which
    more than the ground.

    `own` is the vehicle's velocity (2,) north and east (m/s), `ground` as of `Tracker.add`.

    The tracks passed in are overwritten. `posed` is a _PosedScan as a plain tuple: numba needs 2 us to find the type of
    a named one.
    """
    scan = _PosedScan(*posed)
    beams = scan.bearings.size
    points = world_points(scan.bearings, scan.ranges, scan.position, scan.attitude)
    usable = scan.hit & (points[:, 2] < ground[0] - ground[1] * scan.ranges)
    clusters = find_clusters(Returns(points, usable, scan.ranges, scan.position, scan.width, scan.noise), rules[0])
    spans, centroids, covariances, extents, middles, hidden = clusters
    step = scan.bearings[1] - scan.bearings[0] if beams > 1 else scan.width
    free = np.zeros(min(beams, _MOST_BEAMS))  # by a loop: np.where takes a second to compile
    for k in range(free.size):
        if scan.known[k]:
            free[k] = scan.ranges[k]
    sight = Sight(free, scan.position, scan.attitude, scan.bearings[0], step)
    predict(tracks, dt, rules[0]["acceleration_noise"])
    seen_as = associate(tracks, centroids, covariances, hidden)
    moving = np.zeros(beams, np.bool_)
    kept = np.empty(tracks.size + centroids.shape[0], tracks.dtype)
    count = 0
    for t in range(tracks.size):
        c = seen_as[t]
        if c >= 0 and not (hidden[c] and tracks[t]["hidden"] >= rules[0]["hidden_scans"]):
            correct(tracks[t], centroids[c], covariances[c], _radius(extents[c]))
            tracks[t]["hidden"] = tracks[t]["hidden"] + 1 if hidden[c] else 0
            whole = not hidden[c]
            if whole:
                hit_at(tracks[t], points[middles[c], 2])
            tracks[t]["left"] = tracks[t]["left"] or (whole and has_left(tracks[t], points[middles[c]], sight))
            update_status(tracks[t], rules[0], own, whole)
            _keep_place(tracks[t], rules[0], points[middles[c]], sight)
            for k in range(spans[c, 0], spans[c, 0] + spans[c, 1]):
                moving[k % beams] |= tracks[t]["moving"]
        else:
            miss(tracks[t], rules[0], sight)
        if tracks[t]["misses"] < (rules[0]["delete_misses"] if tracks[t]["hits"] >= rules[0]["confirm_hits"] else 1):
            kept[count] = tracks[t]
            count += 1
    for c in range(centroids.shape[0]):
        if not np.any(seen_as == c) and not hidden[c]:
            start_track(kept[count], started, centroids[c], covariances[c], _radius(extents[c]), scan.position)
            stand(kept[count], points[middles[c]], sight)
            count += 1
            started += 1
    return kept[:count], started, moving, usable


@compiled
def _keep_place(track: Any, rule: Any, place: Array, sight: Sight) -> None:
    """Keep where a ring sees a TRACK, (3,) NED (m), if that is to be looked at by later ones."""
    if track["slow_scans"] >= rule["stopped_scans"]:
        stand(track, place, sight)
    elif seen_level(track, place, sight):
        take_place(track, 0, place, sight)
    if track["hits"] % SIGHT_EVERY == 0:
        take_place(track, 1 + track["hits"] // SIGHT_EVERY % (SIGHTS - 1), place, sight)


@compiled
def miss(track: Any, rule: Any, sight: Sight) -> None:
    """A ring does not show a TRACK: what moves is expected to go on for a while where the ring could not show it, as it
    is tilted and passes that place far from the sensor's height. Who is behind something else may turn there."""
    place = np.array((track["mean"][0], track["mean"][1], sight.position[2]))
    if track["moving"] and track["hidden"] < rule["hidden_scans"] and passes_off(sight, place):
        track["hidden"] += 1
    else:
        track["misses"] += 1


@compiled
def associate(tracks: Tracks, centroids: Array, covariances: Array, hidden: BoolArray) -> Integers:
    """(tracks,) index of the cluster, of centroids (c, 2) and their covariances (c, 2, 2), that each track continues
    with; -1: none. The nearest pair is chosen first, of clusters of which a part is `hidden` (c,) after the others:
    the edge of an obstacle, which is farther away than its front, may be such a one beside it."""
    squares = np.empty((tracks.size, centroids.shape[0]))
    for t in range(tracks.size):
        for c in range(centroids.shape[0]):
            spread = tracks[t]["covariance"][:2, :2] + covariances[c]
            square = mahalanobis_squared(spread, centroids[c] - tracks[t]["mean"][:2])
            squares[t, c] = math.inf if square >= _GATE else square + _GATE if hidden[c] else square
    chosen = np.full(tracks.size, -1)
    while True:
        least, first, second = math.inf, -1, -1
        for t in range(tracks.size):
            for c in range(centroids.shape[0]):
                if squares[t, c] < least:
                    least, first, second = squares[t, c], t, c
        if first < 0:
            return chosen
        chosen[first] = second
        squares[first, :] = squares[:, second] = math.inf


@compiled
def update_status(track: Any, rule: Any, own: Array, whole: bool) -> None:
    """Decide whether a TRACK that was seen is moving, by the settings as a record and the vehicle's velocity (2,). It
    does not begin to where something hides a part of it: the place of that part is not its own."""
    mean, significant = track["mean"], rule["min_speed_sigmas"] ** 2
    fast = math.hypot(mean[2], mean[3]) > rule["min_speed"]
    fast = fast and mahalanobis_squared(track["covariance"][2:, 2:], mean[2:]) > significant
    track["fast_scans"] = track["fast_scans"] + 1 if fast else 0
    track["slow_scans"] = 0 if fast else track["slow_scans"] + 1
    begins = whole and track["left"] and track["fast_scans"] >= rule["moving_scans"]
    begins = begins and mahalanobis_squared(track["covariance"][2:, 2:], mean[2:] - own) > significant
    goes_on = begins or (track["moving"] and track["slow_scans"] < rule["stopped_scans"])
    track["moving"] = track["hits"] >= rule["confirm_hits"] and goes_on


@compiled
def start_track(track: Any, number: int, centroid: Array, covariance: Array, radius: float, seen_from: Array) -> None:
    """Fill in a new TRACK: at rest, with the uncertainty of its speed as `seen_from` (2,) or more (m, NED)."""
    track["number"], track["radius"], track["moving"] = number, radius, False
    track["hits"], track["misses"], track["hidden"] = 1, 0, 0
    track["fast_scans"], track["slow_scans"], track["surprise"] = 0, 0, _NO_SURPRISE
    track["mean"][:2], track["mean"][2:] = centroid, 0.0
    track["covariance"][:] = 0.0
    track["covariance"][:2, :2] = covariance
    n, e = centroid[0] - seen_from[0], centroid[1] - seen_from[1]
    more = (_SPEED_ALONG_SIGMA**2 - _SPEED_ACROSS_SIGMA**2) / max(n * n + e * e, 1e-12)
    track["covariance"][2, 2] = _SPEED_ACROSS_SIGMA**2 + more * n * n
    track["covariance"][3, 3] = _SPEED_ACROSS_SIGMA**2 + more * e * e
    track["covariance"][2, 3] = track["covariance"][3, 2] = more * n * e


@compiled
def predict(tracks: Tracks, dt: float, acceleration: float) -> None:
    """Predict all tracks by `dt` (s); `acceleration` (m/s2) is the standard deviation of the white noise, constant
    over the step."""
    step = np.eye(4)
    step[0, 2] = step[1, 3] = dt
    place, speed = 0.5 * dt * dt * acceleration, dt * acceleration
    for t in range(tracks.size):
        mean, covariance = tracks[t]["mean"], tracks[t]["covariance"]
        covariance[:] = _congruent(step, covariance[:])
        for k in range(2):
            covariance[k, k] += place * place
            covariance[k + 2, k + 2] += speed * speed
            covariance[k, k + 2] += place * speed
            covariance[k + 2, k] += place * speed
            mean[k] += dt * mean[k + 2]


@compiled
def correct(track: Any, centroid: Array, noise: Array, radius: float) -> None:
    """Correct a TRACK by a measured centroid (2,) with its covariance (2, 2) and the measured radius (m).

    Joseph's form keeps the covariance symmetric and positive definite.
    """
    mean, covariance = track["mean"], track["covariance"]
    spread = covariance[:2, :2] + noise
    determinant = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    _notice_turn(track, mahalanobis_squared(spread, centroid - mean[:2]))
    gain = np.empty((4, 2))
    for i in range(4):
        gain[i, 0] = (covariance[i, 0] * spread[1, 1] - covariance[i, 1] * spread[1, 0]) / determinant
        gain[i, 1] = (covariance[i, 1] * spread[0, 0] - covariance[i, 0] * spread[0, 1]) / determinant
    left = np.eye(4)
    left[:, :2] -= gain
    north, east = centroid[0] - mean[0], centroid[1] - mean[1]
    covariance[:] = _congruent(left, covariance[:]) + _congruent(gain, noise)
    mean[:] = mean + gain[:, 0] * north + gain[:, 1] * east
    track["radius"] += _RADIUS_GAIN * (radius - track["radius"])
    track["hits"] += 1
    track["misses"] = 0


@compiled
def _notice_turn(track: Any, innovation: float) -> None:
    """Make the velocity of a TRACK uncertain if it has turned, as the square of its innovation in standard deviations
    tells (the white-noise level is adjusted: Bar-Shalom, Li and Kirubarajan 2001)."""
    track["surprise"] += _SURPRISE_GAIN * (innovation - track["surprise"])
    if track["moving"] and track["hits"] >= _SETTLED_HITS and track["surprise"] > _SURPRISE:
        track["covariance"][2, 2] += _TURN_SIGMA * _TURN_SIGMA
        track["covariance"][3, 3] += _TURN_SIGMA * _TURN_SIGMA
        track["surprise"] = _NO_SURPRISE


@compiled
def mahalanobis_squared(covariance: Array, offset: Array) -> float:
    """offset' covariance^-1 offset, of (2,) and (2, 2)."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    x, y = offset[0], offset[1]
    square: float = (d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b)
    return square


@compiled
def _congruent(left: Array, middle: Array) -> Array:
    """left middle left', of (m, n) and (n, n)."""
    rows, inner = left.shape
    result = np.zeros((rows, rows))
    for i in range(rows):
        for j in range(rows):
            for k in range(inner):
                for m in range(inner):
                    result[i, j] += left[i, k] * middle[k, m] * left[j, m]
    return result


@compiled
def _radius(extent: float) -> float:
    """Radius (m) of a cluster of that extent (m)."""
    return max(0.5 * extent, _LEAST_RADIUS_M)
