"""Clusters of a ring's returns: what is small enough to be an obstacle that moves, a car at the most.

- Neighbouring returns whose ranges differ little form a segment. Their distance along the ring says nothing: at a range
  of 6 m the sectors of 5 degrees are as far apart as a person is wide. So a person beside a wall is a segment of its
  own, unless both are equally far away. A LiDAR that is noisier than usual parts them later: else its walls would fall
  into pieces that seem to move.
- A segment that is small is a cluster, measured by its centroid. Its covariance has the sensor's shape: a few
  centimetres along the beam, and across it as much as the sector is wide. A wide segment such as a wall, or one around
  the vehicle, is no cluster: its visible part travels with the vehicle.
- Of what a nearer return may hide a part, the centroid is known less well across. It continues a track for a while and
  starts none: the piece of a wall between two shadows travels along the wall.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from protocol.arrays import Array, BoolArray
from protocol.jit import compiled

_RANGE_SIGMA_M = 0.08
"""m along the beam: the noise of a usual LiDAR and the round front of an obstacle."""
_NOISE_SHARE = 1.5
"""m along the beam for each m of noise, where that is more."""
_GAP_SIGMAS = 6.0
"""Gap over the noise of one range; neighbours differ by sqrt(2) of it, one standard deviation."""
_HIDDEN_SIGMA_M = 0.3
"""m across the beam that the centroid may be off where a part is hidden: the radius of a person."""
_WIDEST_VIEW = math.radians(120.0)
"""rad that a cluster fills at the most: what fills more is around the vehicle."""

Integers = NDArray[np.int64]


class Returns(NamedTuple):
    """The returns of a ring as points."""

    points: Array
    """(n, 3) NED (m), of all beams."""
    usable: BoolArray
    """(n,) the beam has a return, and not from the ground."""
    ranges: Array
    """(n,) m"""
    position: Array
    """(3,) NED (m) of the sensor."""
    width: float
    """rad of a sector."""
    noise: float
    """m, one standard deviation of the ranges; 0 if it is not known."""


class Clusters(NamedTuple):
    """The clusters of a ring."""

    spans: Integers
    """(k, 2) first beam and number of beams."""
    centroids: Array
    """(k, 2) north, east (m)."""
    covariances: Array
    """(k, 2, 2) m2, of the centroids."""
    extents: Array
    """(k,) m, the largest distance between two returns."""
    middles: Integers
    """(k,) beam of the return nearest to the centroid."""
    hidden: BoolArray
    """(k,) a nearer neighbour may hide a part of it."""


@compiled
def find_clusters(returns: Returns, rule: Any) -> Clusters:
    """The segments that are small, by the settings as a record."""
    closed = returns.ranges.size * returns.width > 2.0 * math.pi - 0.5 * returns.width
    gap = max(rule["range_gap"], _GAP_SIGMAS * returns.noise)
    spans = segments(returns.ranges, returns.usable, gap, closed)
    centroids, covariances = np.empty((spans.shape[0], 2)), np.empty((spans.shape[0], 2, 2))
    extents, middles = np.empty(spans.shape[0]), np.empty(spans.shape[0], np.int64)
    hidden = np.empty(spans.shape[0], np.bool_)
    count = 0
    for k in range(spans.shape[0]):
        first, length = spans[k]
        extent = _extent(returns.points, first, length)
        if extent <= rule["max_extent"] and length * returns.width < _WIDEST_VIEW:
            spans[count], extents[count] = spans[k], extent
            hidden[count] = _is_hidden(returns, first, length, closed)
            centroids[count], covariances[count], middles[count] = _measure(returns, first, length, hidden[count])
            count += 1
    found = spans[:count], centroids[:count], covariances[:count], extents[:count], middles[:count], hidden[:count]
    return Clusters(*found)


@compiled
def segments(ranges: Array, usable: BoolArray, gap: float, closed: bool) -> Integers:
    """(k, 2) first beam and number of beams of each segment: usable returns whose `ranges` (n,) (m) differ from their
    neighbours' by less than `gap` (m). The last beam is the first one's neighbour in a ring that is `closed`; if all
    are connected, that has no segment."""
    count = usable.size
    found = np.empty((count, 2), np.int64)
    number = 0
    for k in range(count):
        if not usable[k] or ((k > 0 or closed) and _connected(ranges, usable, (k - 1) % count, k, gap)):
            continue
        length, most = 1, count if closed else count - k
        while length < most and _connected(ranges, usable, (k + length - 1) % count, (k + length) % count, gap):
            length += 1
        found[number, 0], found[number, 1] = k, length
        number += 1
    return found[:number]


@compiled
def _connected(ranges: Array, usable: BoolArray, a: int, b: int, gap: float) -> bool:
    connected: bool = usable[a] and usable[b] and abs(ranges[a] - ranges[b]) < gap
    return connected


@compiled
def _extent(points: Array, first: int, length: int) -> float:
    """The largest distance (m) between two returns of a segment, in the plane."""
    square = 0.0
    for k in range(first, first + length):
        for m in range(first, k):
            one, other = points[k % points.shape[0]], points[m % points.shape[0]]
            square = max(square, (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2)
    return math.sqrt(square)


@compiled
def _is_hidden(returns: Returns, first: int, length: int, closed: bool) -> bool:
    """Whether a nearer neighbour may hide a part of a segment. At an end of a ring that is not closed none is known."""
    usable, ranges = returns.usable, returns.ranges
    last = (first + length - 1) % ranges.size
    before, after = (first - 1) % ranges.size, (last + 1) % ranges.size
    left: bool = (closed or first > 0) and usable[before] and ranges[before] < ranges[first]
    right: bool = (closed or after > 0) and usable[after] and ranges[after] < ranges[last]
    return left or right


@compiled
def _measure(returns: Returns, first: int, length: int, hidden: bool) -> tuple[Array, Array, int]:
    """Centroid (2,) of a segment, its covariance (2, 2), and the beam of the return nearest to it."""
    points, position = returns.points, returns.position
    centroid = np.zeros(2)
    for k in range(first, first + length):
        centroid += points[k % points.shape[0], :2] / length
    north, east = centroid[0] - position[0], centroid[1] - position[1]
    distance = max(math.hypot(north, east), 1e-6)
    along = max(_RANGE_SIGMA_M, _NOISE_SHARE * returns.noise) ** 2
    across = along + (distance * returns.width) ** 2 / 12.0 + (_HIDDEN_SIGMA_M**2 if hidden else 0.0)
    un, ue = north / distance, east / distance
    cross = (along - across) * un * ue
    # A tuple of tuples: compiled code would take a list of lists from the heap.
    covariance = np.array(((along * un * un + across * ue * ue, cross), (cross, along * ue * ue + across * un * un)))
    middle, least = first, math.inf
    for k in range(first, first + length):
        point = points[k % points.shape[0]]
        away = math.hypot(point[0] - centroid[0], point[1] - centroid[1])
        if away < least:
            middle, least = k % points.shape[0], away
    return centroid, covariance, middle
