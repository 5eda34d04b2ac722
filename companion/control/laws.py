"""The position laws, in the one place where a law is registered.

A law of another package is flown by `companion.control.foreign`. To add one here: write its module
(`acceleration_command`, compiled, and `gains`), give it a table and its name in `companion.config`, and add an entry to
`LAWS` and a branch to `acceleration_command`. Compiled code chooses by a number, which costs one comparison; a call
through a function pointer could not be inlined.
"""

from collections.abc import Callable
from dataclasses import dataclass

from companion.config import Control
from companion.control import backstepping, pid, se3, sliding_mode
from companion.control.tracking_error import TrackingError
from protocol.arrays import Array
from protocol.jit import compiled

GAINS = 3
"""Most rows of gains that a law has."""


@dataclass(frozen=True, slots=True)
class Law:
    """A position law."""

    number: int
    """Its number in compiled code."""
    acceleration_command: Callable[[TrackingError, Array, Array], Array]
    """(3,) m/s2, NED, from the errors, the reference's acceleration (3,) and the gains (GAINS, 3)."""
    gains: Callable[[Control], tuple[tuple[float, float, float], ...]]
    """The gains' rows, at most GAINS, from the settings."""
    adaptive: bool = False
    """The adaptive term of backstepping is subtracted from the command."""
    lee_attitude_error: bool = False
    """The attitude error is `se3.attitude_error`, not `lqr.attitude_error`."""


_BACKSTEPPING, _SE3, _SLIDING_MODE, _PID, _FOREIGN = range(5)

LAWS = {
    "backstepping": Law(_BACKSTEPPING, backstepping.acceleration_command, backstepping.gains, adaptive=True),
    "se3": Law(_SE3, se3.acceleration_command, se3.gains, lee_attitude_error=True),
    "sliding_mode": Law(_SLIDING_MODE, sliding_mode.acceleration_command, sliding_mode.gains),
    "pid": Law(_PID, pid.acceleration_command, pid.gains),
}
"""By name, as `control.position.law` has it."""
FOREIGN = Law(_FOREIGN, backstepping.acceleration_command, backstepping.gains)
"""Stands for a law of another package, whose command takes the place of this one's."""


@compiled
def acceleration_command(law: int, error: TrackingError, reference_acceleration: Array, gains: Array) -> Array:
    """Acceleration (3,) in m/s2, NED, of the law with this number; see `Law`."""
    if law == _SE3:
        return se3.acceleration_command(error, reference_acceleration, gains)
    if law == _SLIDING_MODE:
        return sliding_mode.acceleration_command(error, reference_acceleration, gains)
    if law == _PID:
        return pid.acceleration_command(error, reference_acceleration, gains)
    return backstepping.acceleration_command(error, reference_acceleration, gains)
