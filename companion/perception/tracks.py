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
from dataclasses import astuple, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.perception.free_space import POINT
from companion.perception.scans import place
from companion.state import Scan
from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

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


TRACK = np.dtype(
    [
        ("number", "i8"),
        ("mean", "f8", 4),  # north, east (m) and their rates
        ("covariance", "f8", (4, 4)),
        ("radius", "f8"),  # m around the middle that hold all of it
        ("hits", "i8"),
        ("misses", "i8"),
        ("steady", "i8"),
        ("slow", "i8"),
        ("moving", "b1"),
    ],
    align=True,
)
"""One thing that is followed."""
Tracks = NDArray[np.void]
"""(n,) TRACK"""

_RULES = np.dtype([(field.name, field.type) for field in fields(TrackSettings)])


class Tracker:
    """Follows what the rings show, scan by scan."""

    def __init__(self, settings: TrackSettings) -> None:
        self._rules = np.array([astuple(settings)], _RULES)
        self._born = 0
        self._time_ns: int | None = None
        self.tracks: Tracks = np.empty(0, TRACK)
        """All of them, the oldest first."""

    @property
    def moving(self) -> Tracks:
        """Those that are believed and move."""
        moving: Tracks = self.tracks[self.tracks["moving"]]
        return moving

    def points(self, seconds: float, keep_out: float) -> Array:
        """(n, 5) what moves, `seconds` after the last scan, as the guard's POINTs; `keep_out` widens each radius."""
        moving = self.moving
        points = np.empty((moving.size, POINT))
        points[:, 2:4] = moving["mean"][:, 2:]
        points[:, :2] = moving["mean"][:, :2] + seconds * points[:, 2:4]
        points[:, 4] = moving["radius"] + keep_out
        return points

    def add(self, scan: Scan, position_ned: Array, attitude_ned_frd: Array, ground_down: float) -> BoolArray:
        """Take a scan in; which of its returns (n,) belong to something that moves. See `OccupancyGrid.add`."""
        bearings = scan.bearings_frd
        width = abs(bearings[1] - bearings[0]) if bearings.size > 1 else math.radians(5.0)
        if width > _WIDEST_SECTOR:
            return np.zeros(bearings.size, np.bool_)
        elapsed = 0.0 if self._time_ns is None else (scan.time_ns - self._time_ns) * 1e-9
        self._time_ns = scan.time_ns
        self.tracks, self._born, moving = _follow(
            self.tracks,
            self._rules,
            self._born,
            min(elapsed, _LONGEST_STEP_S),
            bearings,
            scan.ranges_m,
            scan.hit,
            position_ned,
            attitude_ned_frd,
            ground_down,
            width,
        )
        return moving


@compiled
def _follow(
    tracks: Tracks,
    rules: NDArray[np.void],
    born: int,
    dt: float,
    bearings: Array,
    ranges: Array,
    hit: BoolArray,
    position: Array,
    attitude: Array,
    ground_down: float,
    width: float,
) -> tuple[Tracks, int, BoolArray]:
    """The tracks after a scan, how many were ever born, and which beams (n,) see something that moves. The tracks of
    before are used up."""
    points = place(bearings, ranges, position, attitude)
    usable = hit & (points[:, 2] < ground_down)
    spans, middles, noises, extents = small_things(points, ranges, usable, position, rules[0], width)
    predict(tracks, dt, rules[0]["acceleration"])
    seen_by = pairs(tracks, middles, noises)
    moving = np.zeros(bearings.size, np.bool_)
    kept = np.empty(tracks.size + middles.shape[0], tracks.dtype)
    count = 0
    for t in range(tracks.size):
        c = seen_by[t]
        if c >= 0:
            correct(tracks[t], middles[c], noises[c], _radius(extents[c]))
            _judge(tracks[t], rules[0])
            for k in range(spans[c, 0], spans[c, 0] + spans[c, 1]):
                moving[k % bearings.size] |= tracks[t]["moving"]
        else:
            tracks[t]["misses"] += 1
        if tracks[t]["misses"] < (rules[0]["misses"] if tracks[t]["hits"] >= rules[0]["hits"] else 1):
            kept[count] = tracks[t]
            count += 1
    for c in range(middles.shape[0]):
        if not np.any(seen_by == c):
            bear(kept[count], born, middles[c], noises[c], _radius(extents[c]))
            count += 1
            born += 1
    return kept[:count], born, moving


@compiled
def pairs(tracks: Tracks, middles: Array, noises: Array) -> Integers:
    """(tracks,) the thing, of middles (c, 2) and noises (c, 2, 2), that each track goes on with; -1: none."""
    squares = np.empty((tracks.size, middles.shape[0]))
    for t in range(tracks.size):
        for c in range(middles.shape[0]):
            spread = tracks[t]["covariance"][:2, :2] + noises[c]
            squares[t, c] = square_in_sigmas(spread, middles[c] - tracks[t]["mean"][:2])
    chosen = np.full(tracks.size, -1)
    while True:
        least, first, second = _GATE, -1, -1
        for t in range(tracks.size):
            for c in range(middles.shape[0]):
                if squares[t, c] < least:
                    least, first, second = squares[t, c], t, c
        if first < 0:
            return chosen
        chosen[first] = second
        squares[first, :] = squares[:, second] = math.inf


@compiled
def _judge(track: Any, rule: Any) -> None:
    """Whether it is believed, and moves."""
    mean = track["mean"]
    fast = math.hypot(mean[2], mean[3]) > rule["slowest"]
    fast = fast and square_in_sigmas(track["covariance"][2:, 2:], mean[2:]) > rule["certainty"] ** 2
    track["steady"] = track["steady"] + 1 if fast else 0
    track["slow"] = 0 if fast else track["slow"] + 1
    goes_on = track["steady"] >= rule["steady"] or (track["moving"] and track["slow"] < rule["rest"])
    track["moving"] = track["hits"] >= rule["hits"] and goes_on


@compiled
def bear(track: Any, number: int, middle: Array, noise: Array, radius: float) -> None:
    """Fill in a new track: at rest as far as is known, within a walker's speeds."""
    track["number"], track["radius"], track["moving"] = number, radius, False
    track["hits"], track["misses"], track["steady"], track["slow"] = 1, 0, 0, 0
    track["mean"][:2], track["mean"][2:] = middle, 0.0
    track["covariance"][:] = 0.0
    track["covariance"][:2, :2] = noise
    track["covariance"][2, 2] = track["covariance"][3, 3] = 1.5**2


@compiled
def predict(tracks: Tracks, dt: float, acceleration: float) -> None:
    """Move the tracks on by `dt` s; `acceleration` (m/s2) is the white noise's standard deviation, held over the
    step."""
    step = np.eye(4)
    step[0, 2] = step[1, 3] = dt
    place, speed = 0.5 * dt * dt * acceleration, dt * acceleration
    for t in range(tracks.size):
        mean, covariance = tracks[t]["mean"], tracks[t]["covariance"]
        covariance[:] = _sandwich(step, covariance)
        for k in range(2):
            covariance[k, k] += place * place
            covariance[k + 2, k + 2] += speed * speed
            covariance[k, k + 2] += place * speed
            covariance[k + 2, k] += place * speed
            mean[k] += dt * mean[k + 2]


@compiled
def correct(track: Any, middle: Array, noise: Array, radius: float) -> None:
    """Take a measurement into the track. Joseph's form, which stays symmetric and positive."""
    mean, covariance = track["mean"], track["covariance"]
    spread = covariance[:2, :2] + noise
    determinant = spread[0, 0] * spread[1, 1] - spread[0, 1] * spread[1, 0]
    gain = np.empty((4, 2))
    for i in range(4):
        gain[i, 0] = (covariance[i, 0] * spread[1, 1] - covariance[i, 1] * spread[1, 0]) / determinant
        gain[i, 1] = (covariance[i, 1] * spread[0, 0] - covariance[i, 0] * spread[0, 1]) / determinant
    left = np.eye(4)
    left[:, :2] -= gain
    north, east = middle[0] - mean[0], middle[1] - mean[1]
    covariance[:] = _sandwich(left, covariance) + _sandwich(gain, noise)
    mean[:] = mean + gain[:, 0] * north + gain[:, 1] * east
    track["radius"] += 0.2 * (radius - track["radius"])
    track["hits"] += 1
    track["misses"] = 0


@compiled
def square_in_sigmas(covariance: Array, offset: Array) -> float:
    """offset' covariance^-1 offset, two dimensions."""
    a, b, d = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    x, y = offset[0], offset[1]
    square: float = (d * x * x - 2.0 * b * x * y + a * y * y) / (a * d - b * b)
    return square


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


@compiled
def _radius(extent: float) -> float:
    """m: of a thing that is so wide."""
    return max(0.5 * extent, _LEAST_RADIUS)


@compiled
def small_things(
    points: Array, ranges: Array, usable: BoolArray, position: Array, rule: Any, width: float
) -> tuple[Integers, Array, Array, Array]:
    """The small things of a ring: runs of neighbouring returns (n, 3) NED, with what is behind or nothing on both
    sides. What another thing hides a part of has no known middle and is left out. Of each its first beam and length
    (k, 2), middle (k, 2), that one's covariance (k, 2, 2) and its extent (k,) m."""
    spans = runs(points, usable, rule["gap"])
    middles, noises = np.empty((spans.shape[0], 2)), np.empty((spans.shape[0], 2, 2))
    extents = np.empty(spans.shape[0])
    count = 0
    for k in range(spans.shape[0]):
        middle, noise, extent, hidden = _measured(points, ranges, usable, position, spans[k, 0], spans[k, 1], width)
        if not hidden and extent <= rule["widest"]:
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
    # compiled, a list of lists would go by the heap
    noise = np.array(((along * un * un + across * ue * ue, cross), (cross, along * ue * ue + across * un * un)))
    extent = math.hypot(points[last, 0] - points[first, 0], points[last, 1] - points[first, 1])
    return middle, noise, extent, hidden


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
