"""Where the ground is, by a beam downward."""

import math
from collections.abc import Callable
from typing import NamedTuple

from protocol.arrays import Array
from vehicle_sim.estimation import kalman

WALK = 0.3
"""m by which the ground's height changes on a metre of way; it grows with the root of the way. Ours: what is flown over
may be uneven, and what stands on it is refused at first."""
_UPRIGHT = 0.7071
"""Cosine of the tilt beyond which a range tells nothing: PX4's range_cos_max_tilt."""
_KNOWN_NS = 1_000_000_000
"""Without a range that was taken for this time the ground is not known."""


class RangeFinder(NamedTuple):
    """A beam along the body's z axis."""

    read: Callable[[], tuple[int, float]]
    """The time (ns) of the last distance (m) that is known; inf: nothing was met, or nothing was measured."""
    rate_hz: float
    noise_m: float
    shortest_m: float
    """Nothing nearer is told from it."""


class Ground:
    """What a filter knows of the ground."""

    def __init__(self, finder: RangeFinder) -> None:
        self.finder = finder
        self.ratio = 0.0
        """Squared innovation over its variance, of the last range."""
        self._taken_ns = -_KNOWN_NS

    def take(self, nominal: Array, P: Array, rates_frd: Array, time_ns: int, gate: float) -> None:
        """Fuse the present range of a vehicle that is upright. Where the ground is not known it is believed."""
        at_ns, distance = self.finder.read()
        if not self.finder.shortest_m < distance < math.inf:
            return
        late, noise = (time_ns - at_ns) * 1e-9, self.finder.noise_m
        below, _, _, upright = kalman.depth(nominal, rates_frd, late, distance)
        if upright < _UPRIGHT:
            return
        if not self.known(time_ns):
            kalman.find_ground(nominal, P, below, noise)
            self._taken_ns = time_ns
            return
        self.ratio = kalman.take_range(nominal, P, rates_frd, late, distance, noise, gate)
        if self.ratio <= gate * gate:
            self._taken_ns = time_ns

    def known(self, time_ns: int) -> bool:
        return time_ns - self._taken_ns < _KNOWN_NS
