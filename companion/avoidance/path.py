"""The path that a mapped method plans."""

import msgspec
import numpy as np

from protocol.arrays import Array

PATH_BYTES = 1 << 15
"""Room for a path where the planner's process hands it over."""
MOST_VERTICES = PATH_BYTES // 24
"""A vertex takes 24 bytes with its speed."""


class Path(msgspec.Struct, frozen=True):
    """What to fly along, as of one scan: a polyline, or a direction only."""

    vertices: Array
    """(k, 2) m, NED, from where the vehicle was; (0, 2) if there is only a bearing, or nothing at all."""
    speeds: Array
    """(k,) m/s at the vertices."""
    bearing: float | None = None
    """rad, clockwise from north; None with vertices, or if the vehicle is to stop."""
    tight: bool = False
    """The path leads through a passage narrower than the inflation, or to where such a passage may be."""
    smooth: bool = False
    """The vertices are points of a curve, which can be flown at the speeds: see `smoothing`."""
    detour: float = 0.0
    """m, the cost beyond the least that was expected; inf if there is no path; 0 if it is not known."""


NO_PATH = Path(np.empty((0, 2)), np.empty(0))
