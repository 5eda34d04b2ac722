"""What a position law knows of the vehicle's motion: its errors against the reference."""

from typing import NamedTuple

from protocol.arrays import Array


class TrackingError(NamedTuple):
    """Errors on the axes north, east, down; each (3,)."""

    position: Array
    """m, reference minus measured: the paper's e1."""
    velocity: Array
    """m/s, reference minus measured."""
    virtual: Array
    """m/s, measured velocity minus the virtual rate of backstepping: the paper's e2."""
    integral: Array
    """m s, integral of `position` within a bound."""
