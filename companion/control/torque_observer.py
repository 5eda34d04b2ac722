"""Torque observer: what turns the vehicle beside the commands, as a weak rotor or a centre of mass aside does.

    w' = a + f m        a: as the commands in force ask for, through the rotors' lag

With the rates w that are measured, a Luenberger observer estimates the angular acceleration m at hover thrust; f is the
present thrust in hovers, since both causes act in proportion to it. Each is driven by the error of the estimated rates,
with both poles at the bandwidth b: 2 b for the rates, b^2 for m. The commands that `prediction` remembers are those
without what makes up for m, so what is estimated is what is left of it.

About the yaw axis m is estimated where torques are commanded alone. Flight controllers turn much more slowly there than
is assumed, and integrate their errors: yaw rates that make up for what they do already swing up, at ArduCopter to 400
degrees a second.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from companion.control.prediction import ANGULAR_ACCELERATION, HISTORY, Measured, Model, lag_share, turning_asked
from protocol.arrays import Array
from protocol.jit import compiled

TORQUE_OBSERVER = np.dtype(
    [("time_ns", "i8"), ("measured", "f8", 3), ("rates", "f8", 3), ("turning", "f8", 3), ("offset", "f8", 3)],
    align=True,
)
"""`measured` rates (rad/s) of the last update; `rates` (rad/s) and `turning` (rad/s2) as they are estimated; `offset`
(rad/s2) is m. All FRD."""

SHARE_OF_FULL = 1 / 3
"""Greatest size of each axis of m, of what the vehicle's full torque gives. Where the vehicle hovers on half of its
thrust, a rotor that lacks a fifth of its own takes 0.1 of that, and a centre of mass a tenth of an arm aside 0.2."""
_LONGEST_S = 0.1
"""After a longer gap the rates are set anew, and nothing is estimated from it."""
_SHARES = (0.2, 2.0)
"""Bounds of f."""


@compiled
def thrust_share(thrust_n: float, hover_n: float) -> float:
    """f of a thrust."""
    return min(max(thrust_n / hover_n, _SHARES[0]), _SHARES[1])


@compiled
def update(
    observer: Any,
    time_ns: int,
    measured: Measured,
    commands: NDArray[np.void],
    count: int,
    model: Model,
    tuning: tuple[float, float, Array],
) -> None:
    """Update a record of TORQUE_OBSERVER with a state measured at `time_ns`, under the commands of
    `prediction.remember`. `tuning`: f, the bandwidth (1/s), and the bounds of m (3,) in rad/s2."""
    share, bandwidth, bound = tuning
    dt = (time_ns - observer.time_ns) * 1e-9
    middle_ns = (time_ns + observer.time_ns) // 2
    observer.time_ns = time_ns
    if dt > _LONGEST_S:
        observer.rates[:] = measured.rates
        observer.turning[:] = 0.0
    elif dt > 0.0:
        number = count - 1
        while number > max(count - HISTORY, 0) and commands[number % HISTORY].time_ns > middle_ns:
            number -= 1
        rates = 0.5 * (observer.measured + measured.rates)
        command = commands[number % HISTORY]
        asked = turning_asked(command, measured.attitude, rates, model)
        follows, pull = lag_share(dt, model.rotor_lag), -math.expm1(-2.0 * bandwidth * dt)
        for i in range(3 if command.turning_input == ANGULAR_ACCELERATION else 2):
            before = observer.turning[i]
            observer.turning[i] += follows * (asked[i] - before)
            observer.rates[i] += 0.5 * dt * (before + observer.turning[i])
            error = measured.rates[i] - observer.rates[i]
            observer.rates[i] += pull * error
            offset = observer.offset[i] + dt * bandwidth * bandwidth * share * error
            observer.offset[i] = min(max(offset, -bound[i]), bound[i])
    observer.measured[:] = measured.rates
