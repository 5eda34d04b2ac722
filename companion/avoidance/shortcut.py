"""From a path along cells to one that can be flown: few vertices, each with the speed at which it can be turned.

A stretch of the path is replaced by a straight line where the line keeps the inflation and costs no more than the
stretch, so that it does not undo the room that the search kept. The effect is that of any-angle search (Theta*, Nash et
al. 2007), in one pass behind the search.
"""

import math

import numpy as np
from numpy.typing import NDArray

from companion.avoidance.astar import GridPath
from companion.avoidance.path import Path
from companion.config_avoidance import AvoidanceCourse
from companion.perception.distance_field import Floats, between
from companion.perception.map_view import MapView
from protocol.arrays import Array
from protocol.jit import compiled

Integers = NDArray[np.int64]

_SAMPLE = 0.5
"""Cells between two samples of a line."""
_TOLERATED = 1.02
"""Ratio of the cost of a line to that of the stretch that it replaces, at most."""
_HULL_M = 0.6
"""m from the centre of an occupied cell to where a vertex may be cut."""
_MIN_ROOM, _MAX_ROOM = 0.15, 1.5
"""m of room at a vertex, at least and at most."""
_ROOM_BEYOND = 0.5
"""m of room at a vertex beyond the window."""


def shorten(path: GridPath, view: MapView, costmap: Floats, inflation: float) -> Array:
    """Vertices (k, 2) (m, NED) of the shortened path, the first in the start's cell."""
    cells = path.cells.astype(np.float64)
    kept = _keep(cells, path.costs, costmap, view.to_occupied, inflation, view.cell)
    vertices: Array = (cells[kept] + np.array(view.corner) + 0.5) * view.cell
    return vertices


def timed_path(vertices: Array, view: MapView, speed: float, course: AvoidanceCourse, detour: float) -> Path:
    """The path through vertices (k, 2) (m, NED) with the speeds of `vertex_speeds`, at most `speed` (m/s)."""
    room = np.array([_room(view, vertex) for vertex in vertices])
    speeds = vertex_speeds(vertices, room, speed, course.acceleration, course.braking)
    return Path(vertices, speeds, detour=detour)


def _room(view: MapView, vertex: Array) -> float:
    """m by which the path may cut a vertex (2,)."""
    cell = view.cell_of(vertex)
    if not view.contains(cell):
        return _ROOM_BEYOND
    return float(min(max(view.to_occupied[cell] - _HULL_M, _MIN_ROOM), _MAX_ROOM))


@compiled
def line_cost(
    costmap: Floats, to_occupied: Floats, inflation: float, cell: float, row: float, column: float, to: Array
) -> float:
    """Cost (m) of the straight line from (`row`, `column`) to `to` (2,), in cells, whole numbers at their centres.

    It is inf if the line comes nearer to an occupied cell than the inflation (m), or than its start if that is nearer.
    Beyond the window a metre costs 1.
    """
    rows, columns = costmap.shape
    dr, dc = to[0] - row, to[1] - column
    length = math.hypot(dr, dc)
    samples = max(math.ceil(length / _SAMPLE), 1)
    least = inflation
    total = 0.0
    for s in range(samples + 1):
        share = s / samples
        at_row, at_column = row + share * dr, column + share * dc
        i, j = math.floor(at_row + 0.5), math.floor(at_column + 0.5)
        cost = 1.0
        if 0 < i < rows - 1 and 0 < j < columns - 1:
            room = between(to_occupied, at_row, at_column)
            if s == 0:
                least = min(inflation, room)
            if room < least:
                return math.inf
            cost = costmap[i, j]
        total += cost * (0.5 if s in (0, samples) else 1.0)
    return cell * length * total / samples


@compiled
def _keep(cells: Array, costs: Array, costmap: Floats, to_occupied: Floats, inflation: float, cell: float) -> Integers:
    """Indices (k,) of the cells (n, 2) to keep: from each one the farthest that a line reaches at no more cost.

    It is found by doubling and bisection, so that a long path takes few lines.
    """
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
            line = line_cost(costmap, to_occupied, inflation, cell, cells[at, 0], cells[at, 1], cells[far])
            if line <= _TOLERATED * (costs[far] - costs[at]):
                good = far
                step *= 2
            else:
                bad = far
        kept[count] = good
        count += 1
        at = good
    return kept[:count]


@compiled
def vertex_speeds(vertices: Array, room: Array, speed: float, acceleration: float, braking: float) -> Array:
    """Speed (k,) (m/s) at each of the vertices (k, 2) (m) of a path that ends at rest, at most `speed` (m/s).

    The vehicle may cut a vertex by an arc that stays within its `room` (k,) (m): radius = room / (1 / cos(turn / 2) -
    1). The arc takes no more than half of either leg, and is flown with the lateral `acceleration` (m/s2). Between
    vertices the vehicle slows down with `braking` (m/s2).
    """
    count = vertices.shape[0]
    speeds = np.full(count, speed)
    speeds[count - 1] = 0.0
    for k in range(1, count - 1):
        before, after = vertices[k] - vertices[k - 1], vertices[k + 1] - vertices[k]
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
        leg = math.hypot(vertices[k + 1, 0] - vertices[k, 0], vertices[k + 1, 1] - vertices[k, 1])
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + 2.0 * braking * leg))
    return speeds
