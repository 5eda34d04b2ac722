"""Shapes as functions of a parameter, each with its derivatives up to the fourth.

All start at 0, 0, 0 (m, NED): circle, helix, ellipse and lemniscate are one sum of sines, the square
is straight edges between corners. One lap is 2 pi of the parameter for the former, 4 for the square.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.curves import Shape
from protocol.arrays import Array
from protocol.jit import compiled


@compiled
def harmonic_at(along: float, across: float, twice: float, climb: float, angle: float) -> Array:
    """(5, 3) position and derivatives by the angle: north `along` sin, east `across` (1 - cos) + `twice` sin 2 angle,
    `climb` up for each radian."""
    s, c = math.sin(angle), math.cos(angle)
    s2, c2 = math.sin(2.0 * angle), math.cos(2.0 * angle)
    return np.array(  # compiled, a list of lists would go by the heap
        (
            (along * s, across * (1.0 - c) + twice * s2, -climb * angle),
            (along * c, across * s + 2.0 * twice * c2, -climb),
            (-along * s, across * c - 4.0 * twice * s2, 0.0),
            (-along * c, -across * s - 8.0 * twice * c2, 0.0),
            (along * s, -across * c + 16.0 * twice * s2, 0.0),
        )
    )


@compiled
def square_at(edge: float, parameter: float) -> Array:
    """(5, 3) position and derivatives by the parameter, 1 for each edge: north, east, south, west."""
    side = math.floor(parameter)
    along = edge * (parameter - side)
    out = np.zeros((5, 3))
    turn = side % 4
    if turn == 0:
        out[0, 0], out[1, 0] = along, edge
    elif turn == 1:
        out[0, 0], out[0, 1], out[1, 1] = edge, along, edge
    elif turn == 2:
        out[0, 0], out[0, 1], out[1, 0] = edge - along, edge, -edge
    else:
        out[0, 1], out[1, 1] = edge - along, -edge
    return out


@dataclass(frozen=True, slots=True)
class Harmonic:
    """See `harmonic_at`."""

    along: float
    across: float
    twice: float = 0.0
    climb: float = 0.0

    lap = 2.0 * math.pi

    def at(self, parameter: float) -> Array:
        """(5, 3) position and derivatives by the parameter."""
        return harmonic_at(self.along, self.across, self.twice, self.climb, parameter)

    @property
    def peak_speed(self) -> float:
        """For a parameter that grows by 1 a second: with across <= along it is that at the start."""
        return math.hypot(self.along, 2.0 * self.twice, self.climb)


@dataclass(frozen=True, slots=True)
class Square:
    """See `square_at`."""

    edge: float

    lap = 4.0

    def at(self, parameter: float) -> Array:
        """(5, 3) position and derivatives by the parameter."""
        return square_at(self.edge, parameter)

    @property
    def peak_speed(self) -> float:
        return self.edge


def shape_of(table: Shape) -> Harmonic | Square:
    """The path that a mission's table asks for."""
    size = table.size
    match table.shape:
        case "circle":
            return Harmonic(size, size)
        case "helix":
            pitch = 1.0 if table.pitch is None else table.pitch
            return Harmonic(size, size, climb=pitch / (2.0 * math.pi))
        case "ellipse":
            return Harmonic(size, 0.5 * size if table.minor_radius is None else table.minor_radius)
        case "lemniscate":
            return Harmonic(size, 0.0, twice=0.5 * size)
        case "square":
            return Square(2.0 * size)
