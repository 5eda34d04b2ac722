"""Lift-off: from motors that were just armed to a vehicle in the air.

The thrust rises until the vehicle moves up. Neither the weight nor the motors' delay is known: the vehicle may be
three times as heavy as believed or a third of it, and some makes give no thrust for seconds after arming, nor say so.
So the thrust rises quickly to what should hover, then creeps for the time that motors may take, and only then goes on:

    share of the believed hover thrust: 0.25 at 0 s, 1 at 1.5 s, 1.14 at 5 s, then 0.5 more with each second

A vehicle that slides is light on its feet, and the wind takes it along: its motors do follow, and it does not creep.
Whether the vehicle flies is told by its motion, not by the landed state that it reports, which comes early with one
make, late or never with another. The thrust at which it rose is the weight, to begin with.
"""

import math

from companion.config import Limits
from companion.state import VehicleState
from protocol.vehicle_parameters import GRAVITY, VehicleParameters

_BEGIN, _QUICK_S, _CREEP_S = 0.25, 1.5, 3.5
_CREEP, _RISE = 0.04, 0.5
"""Shares of the hover thrust by second."""
_SLIDING = 0.2
"""m/s over the ground."""
_LONGEST_SPOOL_S = 6.0
"""So long is a vehicle believed that its motors don't follow yet."""
_PATIENCE_S = 4.0
"""With the highest thrust for so long, it does not fly."""
_CLIMB, _CLIMB_SPEED = 0.02, 0.2
"""m above the ground and m/s, together: it flies."""
_CLEAR = 0.15
"""m above the ground; whatever its speed, it flies."""
_SINKING_S = 0.3
"""Time constant with which the ground follows an estimate of the height that sinks: what stands does not."""
_STEP_NS = 100_000_000


class LiftOff:
    """The lift-off of one flight. Until `begin` the vehicle is in the air."""

    def __init__(self, limits: Limits, body: VehicleParameters) -> None:
        self.thrust: float | None = None
        """Fraction of the full thrust, for a vehicle on the ground; None: it flies."""
        self._limits = limits
        self._full_n = body.max_thrust_n
        self._clock_s = self._slid_s = 0.0
        """For how long the thrust has been rising, and the vehicle sliding meanwhile in place of a creep."""
        self._spooling_s = 0.0
        self._at_most_s = 0.0
        self._time_ns: int | None = None
        self._ground_down: float | None = None
        self._stood_down: float | None = None
        """m: the ground, as it was known last."""

    def begin(self) -> None:
        """The motors were armed on the ground."""
        self.thrust = 0.0
        self._clock_s = self._slid_s = self._spooling_s = self._at_most_s = 0.0
        self._time_ns = self._ground_down = self._stood_down = None

    def given_back(self, state: VehicleState, *, airborne: bool) -> None:
        """Others had the vehicle: above where it stood it flies, whoever made it do so, and below, down a slope, if it
        says that it is `airborne`."""
        above = self._stood_down is not None and self._stood_down - float(state.position_ned[2]) > _CLEAR
        if airborne or above:
            self.thrust = None

    def update(self, state: VehicleState, now_ns: int, mass: float, rises: bool, spooling: bool) -> float | None:
        """The scale of the thrust if the vehicle has just left the ground, else None.

        `rises`: it is wanted to fly; `spooling`: it says that its motors don't follow yet. `mass` in kg.
        """
        down, speed = float(state.position_ned[2]), float(state.velocity_ned[2])
        dt = 0.0 if self._time_ns is None else min(now_ns - self._time_ns, _STEP_NS) * 1e-9
        self._time_ns = now_ns
        hover = mass * GRAVITY / self._full_n
        waits = rises and spooling and self._spooling_s < _LONGEST_SPOOL_S
        if waits:
            self._spooling_s += dt
        if waits or not rises:
            self._clock_s = self._slid_s = 0.0
            self._ground_down = None
        elif self._clock_s >= _QUICK_S and math.hypot(*state.velocity_ned[:2]) > _SLIDING:
            self._slid_s += dt
        else:
            self._clock_s += dt
        if self._ground_down is None:
            self._ground_down = down
        self._ground_down += min(dt / _SINKING_S, 1.0) * max(down - self._ground_down, 0.0)
        if rises or self._stood_down is None:
            self._stood_down = self._ground_down
        thrust = self._raised(hover, dt)
        climb = self._ground_down - down
        if rises and ((climb > _CLIMB and speed < -_CLIMB_SPEED) or climb > _CLEAR) and self.thrust:
            scale, self.thrust = hover / self.thrust, None
            return scale
        self.thrust = thrust
        return None

    def _raised(self, hover: float, dt: float) -> float:
        """The thrust that belongs to the clock; the lowest if the highest has not lifted the vehicle."""
        t = self._clock_s
        share = _BEGIN + (1.0 - _BEGIN) * min(t / _QUICK_S, 1.0)
        share += _CREEP * min(max(t - _QUICK_S, 0.0), _CREEP_S)
        share += _RISE * (max(t - _QUICK_S - _CREEP_S, 0.0) + self._slid_s)
        if share * hover >= self._limits.highest_thrust:
            self._at_most_s += dt
        if self._at_most_s > _PATIENCE_S:
            return self._limits.lowest_thrust
        return min(share * hover, self._limits.highest_thrust)
