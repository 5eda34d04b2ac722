"""Shapes as functions of a parameter, each with its derivatives up to the fourth.

All start at 0, 0, 0 (m, NED). Circle, helix, ellipse and lemniscate are one sum of sines, and a lap is 2 pi of the
parameter. The square consists of straight edges, and a lap is 4 of the parameter.
"""

import math
from dataclasses import dataclass

import numpy as np

from companion.curves import Shape
from companion.trajectory.timing import Phases, law_at, motion
from protocol.arrays import Array
from protocol.jit import compiled

_AT_CORNER = 1e-9
"""A parameter so much beyond a corner of the square is there, but for rounding."""


@compiled
def harmonic_at(along: float, across: float, twice: float, climb: float, rise: float, angle: float) -> Array:
    """(5, 3) position (m) and derivatives by the angle (rad): north `along` sin, east `across` (1 - cos) + `twice` sin
    of twice the angle, and up `climb` (m) for each radian. A `rise` (m) turns the circle up: east `rise` sin, up `rise`
    (1 - cos)."""
    s, c = math.sin(angle), math.cos(angle)
    s2, c2 = math.sin(2.0 * angle), math.cos(2.0 * angle)
    return np.array(  # in compiled code a list of lists would be taken from the heap
        (
            (along * s, across * (1.0 - c) + twice * s2 + rise * s, -climb * angle - rise * (1.0 - c)),
            (along * c, across * s + 2.0 * twice * c2 + rise * c, -climb - rise * s),
            (-along * s, across * c - 4.0 * twice * s2 - rise * s, -rise * c),
            (-along * c, -across * s - 8.0 * twice * c2 - rise * c, rise * s),
            (along * s, -across * c + 16.0 * twice * s2 + rise * s, rise * c),
        )
    )


@compiled
def square_at(edge: float, parameter: float) -> Array:
    """(5, 3) position (m) and derivatives by the parameter, which grows by 1 along each edge: north, east, south,
    west. A corner belongs to the edge that leads there: who stops there does not turn to the next one."""
    side = max(math.ceil(parameter - _AT_CORNER) - 1, 0)
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


@compiled
def _harmonic_flown(
    shape: tuple[float, float, float, float, float], phases: Phases, time: float, origin: Array
) -> Array:
    law = law_at(phases[0], phases[1], phases[2], phases[3], phases[4], time)
    return motion(harmonic_at(shape[0], shape[1], shape[2], shape[3], shape[4], law[0]), law, origin)


@compiled
def _square_flown(edge: float, phases: Phases, time: float, origin: Array) -> Array:
    law = law_at(phases[0], phases[1], phases[2], phases[3], phases[4], time)
    return motion(square_at(edge, law[0]), law, origin)


@dataclass(frozen=True, slots=True)
class Harmonic:
    """A path of `harmonic_at`; all in m."""

    along: float
    across: float
    twice: float = 0.0
    climb: float = 0.0
    rise: float = 0.0

    lap = 2.0 * math.pi

    def at(self, parameter: float) -> Array:
        """(5, 3) position and derivatives by the parameter."""
        return harmonic_at(self.along, self.across, self.twice, self.climb, self.rise, parameter)

    def flown(self, phases: Phases, time_s: float, origin_ned: Array) -> Array:
        """See `Path.flown`."""
        shape = self.along, self.across, self.twice, self.climb, self.rise
        return _harmonic_flown(shape, phases, time_s, origin_ned)

    @property
    def peak_speed(self) -> float:
        """m/s where the parameter grows by 1 a second. With across <= along it is the speed at the start."""
        return math.hypot(self.along, 2.0 * self.twice, self.climb, self.rise)


@dataclass(frozen=True, slots=True)
class Square:
    """A path of `square_at`."""

    edge: float
    """m."""

    lap = 4.0

    def at(self, parameter: float) -> Array:
        """(5, 3) position and derivatives by the parameter."""
        return square_at(self.edge, parameter)

    def flown(self, phases: Phases, time_s: float, origin_ned: Array) -> Array:
        """See `Path.flown`."""
        return _square_flown(self.edge, phases, time_s, origin_ned)

    @property
    def peak_speed(self) -> float:
        return self.edge


def shape_of(table: Shape) -> Harmonic | Square:
    """The path for a mission's table."""
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
        case "loop":
            return Harmonic(0.0, 0.0, rise=size)
        case "square":
            return Square(2.0 * size)
