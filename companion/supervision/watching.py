"""A vehicle that lands, or is in its own failsafe, watched to the ground."""

import math
from typing import NamedTuple

from companion.state import FlightMode, VehicleState, VehicleStatus
from protocol.arrays import Array

_LOWER_M = 0.5
_NEARER_M = 1.0
"""Steps that noise does not make."""
_WAY_HOME = frozenset({FlightMode.RETURN, FlightMode.MISSION, FlightMode.TAKEOFF})
"""Modes in which a vehicle may fly far before it comes down."""


class Watched(NamedTuple):
    """What has become of a mode that was commanded, or that the vehicle's own failsafe chose."""

    taken_over: bool
    """It was reached, and others have changed it since."""
    still: float
    """s that it has come no nearer to the ground or home."""


UNWATCHED = Watched(False, 0.0)


class Descent:
    """The descent of a vehicle that lands, or is in its own failsafe."""

    def __init__(self) -> None:
        self._mode: FlightMode | None = None
        """That the failsafe chose last."""
        self._place: Array | None = None
        """Where it was when it had last come nearer."""
        self._since_ns: int | None = None

    def watch(self, status: VehicleStatus, current: bool, vehicle: VehicleState | None, now_ns: int) -> Watched:
        """Look at it again. A mode counts as changed by others only once the failsafe is over."""
        if current and (status.failsafe or self._mode is None):
            self._mode = status.mode
        others = current and status.mode not in (self._mode, FlightMode.EXTERNAL)
        nearer = vehicle is not None and self._comes_nearer(vehicle.position_ned, status.mode)
        if nearer or self._since_ns is None:
            self._since_ns = now_ns
        return Watched(others, (now_ns - self._since_ns) * 1e-9)

    def _comes_nearer(self, position_ned: Array, mode: FlightMode) -> bool:
        place = self._place
        if place is None or position_ned[2] > place[2] + _LOWER_M:
            self._place = position_ned
            return True
        if mode in _WAY_HOME and math.dist(place.tolist(), position_ned.tolist()) > _NEARER_M:
            self._place = position_ned
            return True
        return False
