"""From a way along cells to one that can be flown: few corners, each with the speed at which it can be turned.

A stretch of the way is replaced by a straight line where the line costs no more than the stretch (so that it is no
shorter way past an obstacle that the search went around with room) and keeps the inflation. Any-angle in effect, after
Theta* (Nash et al. 2007), in one pass behind the search.
"""

import math

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.astar import GridPath
from companion.perception.distance_field import Floats, between
from companion.perception.map_view import MapView
from protocol.arrays import Array
from protocol.jit import compiled

Integers = NDArray[np.int64]

_SAMPLE = 0.5
"""Cells between two samples of a line."""
_INDIFFERENCE = 1.02
"""A line may cost so much more than the stretch that it replaces."""


def shorten(path: GridPath, view: MapView, prices: Floats, inflation: float) -> Array:
    """Corners (k, 2) NED (m) of the shortened way, the first in the start's cell."""
    cells = path.cells.astype(np.float64)
    kept = _keep(cells, path.costs, prices, view.to_occupied, inflation, view.cell)
    corners: Array = (cells[kept] + np.array(view.corner) + 0.5) * view.cell
    return corners


@compiled
def line_cost(
    prices: Floats, to_occupied: Floats, inflation: float, cell: float, row: float, column: float, to: Array
) -> float:
    """Cost (m) of the straight line between two places in cells, whole numbers at their centres.

    inf where it is nearer to an occupied cell than the inflation (or than its start, if that is nearer); beyond the
    window a metre costs 1.
    """
    rows, columns = prices.shape
    dr, dc = to[0] - row, to[1] - column
    length = math.hypot(dr, dc)
    samples = max(math.ceil(length / _SAMPLE), 1)
    least = inflation
    total = 0.0
    for s in range(samples + 1):
        share = s / samples
        at_row, at_column = row + share * dr, column + share * dc
        i, j = math.floor(at_row + 0.5), math.floor(at_column + 0.5)
        price = 1.0
        if 0 < i < rows - 1 and 0 < j < columns - 1:
            room = between(to_occupied, at_row, at_column)
            if s == 0:
                least = min(inflation, room)
            if room < least:
                return math.inf
            price = prices[i, j]
        total += price * (0.5 if s in (0, samples) else 1.0)
    return cell * length * total / samples


@compiled
def _keep(cells: Array, costs: Array, prices: Floats, to_occupied: Floats, inflation: float, cell: float) -> Integers:
    """Indices of the corners: from each, the farthest cell that a line reaches at no more cost. The search goes by
    doubling and halving, so that a long way costs few lines."""
    last = cells.shape[0] - 1
    kept = np.empty(last + 1, np.int64)
    kept[0] = 0
    count, at = 1, 0
    while at < last:
        good, bad = at + 1, last + 1
        step = 2
        while good < last:
            far = min(at + step, last) if bad > last else (good + bad) // 2
            if bad <= last and far == good:
                break
            line = line_cost(prices, to_occupied, inflation, cell, cells[at, 0], cells[at, 1], cells[far])
            if line <= _INDIFFERENCE * (costs[far] - costs[at]):
                good = far
                step *= 2
            else:
                bad = far
        kept[count] = good
        count += 1
        at = good
    return kept[:count]


@compiled
def corner_speeds(corners: Array, room: Array, speed: float, acceleration: float, braking: float) -> Array:
    """Speed (k,) (m/s) at each of the corners (k, 2) of a way that ends at rest.

    A corner may be cut by an arc that stays within its `room` (k,) (m): radius = room / (1 / cos(turn / 2) - 1), and
    the arc takes no more than half of either leg; it is flown at `acceleration` (m/s2) sideways. Between corners the
    vehicle slows down with `braking`.
    """
    count = corners.shape[0]
    speeds = np.full(count, speed)
    speeds[count - 1] = 0.0
    for k in range(1, count - 1):
        before, after = corners[k] - corners[k - 1], corners[k + 1] - corners[k]
        a, b = math.hypot(before[0], before[1]), math.hypot(after[0], after[1])
        cosine = (before[0] * after[0] + before[1] * after[1]) / max(a * b, 1e-12)
        half = 0.5 * math.acos(min(max(cosine, -1.0), 1.0))
        if half < 1e-3:
            continue
        if half > 0.5 * math.pi - 1e-3:
            speeds[k] = 0.0
            continue
        radius = min(room[k] / (1.0 / math.cos(half) - 1.0), 0.5 * min(a, b) / math.tan(half))
        speeds[k] = min(speed, math.sqrt(acceleration * radius))
    for k in range(count - 2, -1, -1):
        leg = math.hypot(corners[k + 1, 0] - corners[k, 0], corners[k + 1, 1] - corners[k, 1])
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + 2.0 * braking * leg))
    return speeds
