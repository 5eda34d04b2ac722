"""Exact distances to obstacles and exact ray hits, compiled.

An obstacle is a row of an array: a box (8,) or an upright cylinder (6,), see the columns below. A cylinder with a
sphere for its top is the cap of that sphere down to the cylinder's bottom: a hill. All coordinates are NED in metres.
The down axis points downwards, so `down_top` < `down_bottom` <= 0 for an obstacle on or above the ground.
"""

import math

from protocol.arrays import Array
from protocol.jit import compiled

BOX_COLUMNS = 8
"""north, east, half_along, half_across, cos_yaw, sin_yaw, down_top, down_bottom."""
CYLINDER_COLUMNS = 6
"""north, east, radius, down_top, down_bottom, sphere_radius; the last is 0 where the top is flat."""

_PARALLEL = 1e-12
"""A direction component below this never crosses the slab within a range that is asked for."""


@compiled
def _signed_norm(a: float, b: float, c: float) -> float:
    """Signed distance to a solid from those to its faces along three orthogonal axes (-inf for an unused axis)."""
    deepest = max(a, b, c)
    if deepest <= 0.0:
        return deepest
    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    return math.sqrt(a * a + b * b + c * c)


@compiled
def _distance_to_cap(aside: float, down: float, cap: Array) -> float:
    """Signed distance to a cylinder (6,) with a sphere for its top, from a place so far `aside` (m) of its axis."""
    below = down - cap[3] - cap[5]
    from_centre = math.sqrt(aside * aside + below * below)
    if from_centre > cap[5] and below * cap[5] > (cap[4] - cap[3] - cap[5]) * from_centre:  # the rim is nearest
        outside, under = max(aside - cap[2], 0.0), float(down - cap[4])
        return math.sqrt(outside * outside + under * under) if outside > 0.0 else under
    return float(max(from_centre - cap[5], down - cap[4]))


@compiled
def nearest_obstacle(boxes: Array, cylinders: Array, position_ned: Array) -> tuple[int, float]:
    """Row (boxes first, then cylinders; -1: none) and signed distance (m) of the obstacle nearest to a point (3,).

    The distance is negative inside an obstacle, inf without obstacles.
    """
    north, east, down = position_ned[0], position_ned[1], position_ned[2]
    index, nearest = -1, math.inf
    for i in range(boxes.shape[0]):
        box = boxes[i]
        dn, de = north - box[0], east - box[1]
        distance = _signed_norm(
            abs(dn * box[4] + de * box[5]) - box[2],
            abs(de * box[4] - dn * box[5]) - box[3],
            max(box[6] - down, down - box[7]),
        )
        if distance < nearest:
            index, nearest = i, distance
    for i in range(cylinders.shape[0]):
        cylinder = cylinders[i]
        dn, de = north - cylinder[0], east - cylinder[1]
        aside = math.sqrt(dn * dn + de * de)
        if cylinder[5] > 0.0:
            distance = _distance_to_cap(aside, down, cylinder)
        else:
            distance = _signed_norm(aside - cylinder[2], -math.inf, max(cylinder[3] - down, down - cylinder[4]))
        if distance < nearest:
            index, nearest = boxes.shape[0] + i, distance
    return index, nearest


@compiled
def _slab(origin: float, direction: float, low: float, high: float) -> tuple[float, float]:
    """Interval (m along the ray) in which a ray is between two parallel planes; its start exceeds its end if never."""
    if abs(direction) < _PARALLEL:
        return (-math.inf, math.inf) if low <= origin <= high else (math.inf, -math.inf)
    a, b = (low - origin) / direction, (high - origin) / direction
    return (a, b) if a <= b else (b, a)


@compiled
def _disc(north: float, east: float, dn: float, de: float, radius: float) -> tuple[float, float]:
    """The same for an infinite upright cylinder; `north` and `east` are the ray's origin relative to its axis."""
    square = dn * dn + de * de
    excess = north * north + east * east - radius * radius
    if square < _PARALLEL * _PARALLEL:
        return (-math.inf, math.inf) if excess <= 0.0 else (math.inf, -math.inf)
    along = -(north * dn + east * de) / square
    discriminant = along * along - excess / square
    if discriminant < 0.0:
        return math.inf, -math.inf
    half = math.sqrt(discriminant)
    return along - half, along + half


@compiled
def _entry(enter: float, leave: float) -> float:
    """Distance to the start of an interval inside a solid: 0 from inside, inf if it is empty or behind the origin."""
    return max(enter, 0.0) if enter <= leave and leave >= 0.0 else math.inf


@compiled
def ray_box(box: Array, origin: Array, dn: float, de: float, dd: float) -> float:
    """Distance (m) from `origin` (3,) along the unit vector (dn, de, dd) to a box (8,); 0 inside, inf without a hit."""
    north, east = origin[0] - box[0], origin[1] - box[1]
    a = _slab(north * box[4] + east * box[5], dn * box[4] + de * box[5], -box[2], box[2])
    b = _slab(east * box[4] - north * box[5], de * box[4] - dn * box[5], -box[3], box[3])
    c = _slab(origin[2], dd, box[6], box[7])
    return _entry(max(a[0], b[0], c[0]), min(a[1], b[1], c[1]))


@compiled
def ray_cylinder(cylinder: Array, origin: Array, dn: float, de: float, dd: float) -> float:
    """The same for a cylinder (6,)."""
    if cylinder[5] > 0.0:
        below = origin[2] - cylinder[3] - cylinder[5]
        north, east = origin[0] - cylinder[0], origin[1] - cylinder[1]
        along = -(north * dn + east * de + below * dd)
        square = along * along - (north * north + east * east + below * below - cylinder[5] * cylinder[5])
        if square < 0.0:
            return math.inf
        half = math.sqrt(square)
        b = _slab(origin[2], dd, -math.inf, cylinder[4])
        return _entry(max(along - half, b[0]), min(along + half, b[1]))
    a = _disc(origin[0] - cylinder[0], origin[1] - cylinder[1], dn, de, cylinder[2])
    b = _slab(origin[2], dd, cylinder[3], cylinder[4])
    return _entry(max(a[0], b[0]), min(a[1], b[1]))


@compiled
def ray_ground(origin: Array, dd: float) -> float:
    """Distance (m) from `origin` (3,) to the ground, along a unit vector with the down component `dd`.

    0 from below the ground, inf if the vector does not point downwards.
    """
    return max(-origin[2] / dd, 0.0) if dd > _PARALLEL else math.inf


@compiled
def cast_ray(boxes: Array, cylinders: Array, origin: Array, direction: Array, max_range: float) -> float:
    """Distance (m) from `origin` (3,) along the unit vector `direction` (3,) to the first surface, the ground included.

    0 from inside an obstacle, inf if nothing is hit within `max_range` (m).
    """
    dn, de, dd = direction[0], direction[1], direction[2]
    nearest = ray_ground(origin, dd)
    for i in range(boxes.shape[0]):
        nearest = min(nearest, ray_box(boxes[i], origin, dn, de, dd))
    for i in range(cylinders.shape[0]):
        nearest = min(nearest, ray_cylinder(cylinders[i], origin, dn, de, dd))
    return nearest if nearest <= max_range else math.inf
