"""The tilt limit in the inner loop: no command turns the vehicle beyond it.

A command that is within the limit is not enough. A vehicle whose turning can be braked only so fast swings past it.
The tilt is seen as a vector in the body's plane, along the axis about which the tilt grows (rad), which changes by the
rates about x and y. It must stay within a circle of the limit's radius. With the angular acceleration `braking` that
the vehicle surely brakes with, and a lag until it does, the rates are reduced to those from which it stops in time,

    rate lag + rate^2 / (2 braking) = way to the circle

along the rates' own direction: what turns the tilt's direction counts as well as what makes it grow. The tilt is taken
a moment ahead, at the present rates, since the vehicle's own loops follow that late.
"""

import math
from typing import NamedTuple

import numpy as np

from protocol.arrays import Array
from protocol.frames import product, to_body
from protocol.jit import compiled

_LAG_S = 0.05
"""From a command to the braking that it asks for."""
_AHEAD_S = 0.08
"""How far ahead the tilt is taken: lag of the rotors and of the rate loop."""
_RATE_GAIN = 20.0
"""1/s; an angular acceleration is judged by the rate that it leads to within the inverse of this."""
_UPRIGHT = 1e-6
"""Sine of the tilt below which its direction is not defined."""


class Tilt(NamedTuple):
    """The vehicle's, and its limit."""

    x: float
    y: float
    """rad, in the body's plane, a moment ahead."""
    limit: float
    """rad."""
    braking: float
    """rad/s2."""


@compiled
def tilt_ahead(attitude_ned_frd: Array, turns: Array, limit: float, braking: float) -> Tilt:
    """The tilt of a vehicle with an attitude (4,) that turns with `turns` (3,) in rad/s; `limit` in rad, `braking` in
    rad/s2."""
    down = to_body(attitude_ned_frd, (0.0, 0.0, 1.0))
    sine = math.sqrt(down[0] * down[0] + down[1] * down[1])
    size = math.atan2(sine, down[2]) / max(sine, _UPRIGHT)
    return Tilt(size * down[1] + _AHEAD_S * turns[0], -size * down[0] + _AHEAD_S * turns[1], limit, braking)


@compiled
def rate_allowed(way: float, braking: float) -> float:
    """The rate (rad/s) from which a stop takes `way` (rad); the negative one for a negative way."""
    lost = braking * _LAG_S
    return math.copysign(math.sqrt(lost * lost + 2.0 * braking * abs(way)) - lost, way)


@compiled
def limit_rates(rates: Array, tilt: Tilt) -> None:
    """Reduce commanded rates (3,) in rad/s, FRD, in place, to those that keep the tilt within its limit, if it has one
    (less than pi)."""
    if tilt.limit >= math.pi:
        return
    x, y = tilt.x, tilt.y
    size = math.sqrt(x * x + y * y)
    if size > tilt.limit:  # back to the limit; from there on as if it were there
        out_x, out_y = x / size, y / size
        excess = out_x * rates[0] + out_y * rates[1] - rate_allowed(tilt.limit - size, tilt.braking)
        if excess > 0.0:
            rates[0] -= excess * out_x
            rates[1] -= excess * out_y
        x, y = tilt.limit * out_x, tilt.limit * out_y
    speed = math.sqrt(rates[0] * rates[0] + rates[1] * rates[1])
    if speed < _UPRIGHT:
        return
    along = (x * rates[0] + y * rates[1]) / speed
    way = math.sqrt(max(tilt.limit * tilt.limit - x * x - y * y + along * along, 0.0)) - along
    allowed = rate_allowed(way, tilt.braking)
    if speed > allowed:
        rates[0] *= allowed / speed
        rates[1] *= allowed / speed


@compiled
def limit_acceleration(turning: Array, turns: Array, tilt: Tilt) -> None:
    """The same for angular accelerations (3,) in rad/s2 of a vehicle that turns with `turns` (3,) in rad/s."""
    rates = np.array([turns[0] + turning[0] / _RATE_GAIN, turns[1] + turning[1] / _RATE_GAIN])
    x, y = rates[0], rates[1]
    limit_rates(rates, tilt)
    if rates[0] != x or rates[1] != y:
        turning[0] = _RATE_GAIN * (rates[0] - turns[0])
        turning[1] = _RATE_GAIN * (rates[1] - turns[1])


@compiled
def within(attitude: Array, limit: float) -> Array:
    """The attitude (4,) itself, or turned back to the tilt `limit` (rad) in the direction of its tilt."""
    down = to_body(attitude, (0.0, 0.0, 1.0))
    sine = math.sqrt(down[0] * down[0] + down[1] * down[1])
    excess = math.atan2(sine, down[2]) - limit
    if excess <= 0.0 or sine < _UPRIGHT:
        return attitude
    # by -excess about the axis of the body about which the tilt grows
    size = math.sin(-0.5 * excess) / sine
    w, x, y = math.cos(0.5 * excess), size * down[1], -size * down[0]
    return np.array(product(attitude, (w, x, y, 0.0)))
