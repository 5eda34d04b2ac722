"""Laws of other packages: what they are given, what is expected of them, and how they are flown.

The compiled controller computes everything around the law as ever. The law itself is called from Python, and its
command takes the place of a built-in law's. Disturbance observer, prediction, guard, limits and gate stay as they are.
"""

from typing import Any, NamedTuple, Protocol

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from companion.plugins import Plugin
from protocol.arrays import Array

_MOST = 1e5
"""m/s2, rad/s and rad/s2 beyond which a command is nonsense, and no answer to an error: that of a law with a gain of
10 1/s2 at the far end of the farthest mission. What is less is flown within the limits."""


class PositionLaw(Protocol):
    """A position law. Its factory takes the settings' table [control] and the options of [control.position.options] by
    name; a flight makes more than one."""

    def reset(self) -> None:
        """Forget the flight so far. Called at each step as long as nothing is flown."""

    def acceleration_command(self, error: TrackingError, reference_acceleration: Array, dt: float) -> Array:
        """Acceleration (3,) in m/s2, NED, without gravity.

        `reference_acceleration` (3,) in m/s2; `dt` is the time (s) since the last step, 0 while integrals should stand
        still: on the ground, and while thrust or tilt are at a limit. Nothing that is given may be written to.
        """


class AttitudeError(NamedTuple):
    """How the vehicle turns against its reference, along its own axes (FRD); each (3,)."""

    attitude: Array
    """rad; the rotation vector from the vehicle's attitude to the wanted one."""
    rates: Array
    """rad/s, reference minus measured."""
    reference_rates: Array
    """rad/s"""
    reference_acceleration: Array
    """rad/s2"""


class AttitudeLaw(Protocol):
    """An attitude law. Its factory takes [control] and the options of [control.attitude.options] by name."""

    def reset(self) -> None:
        """Forget the flight so far, as of a position law."""

    def turning_command(self, error: AttitudeError, dt: float) -> tuple[Array, Array]:
        """Rates (3,) in rad/s and an angular acceleration (3,) in rad/s2, FRD, both within the limits later on.

        The output "rates" sends the first, "actuators" makes torques of the second; "attitude" leaves turning to the
        vehicle, and asks for neither. `dt` as of a position law.
        """


class ForeignPosition:
    """A position law of another package on the memory of a controller."""

    def __init__(self, plugin: Plugin, control: Control, parameters: Any, memory: Any) -> None:
        self._plugin, self._control = plugin, control
        self._law = self._made()
        self._pace, self._limited, self._dt = parameters["pace"], memory["limited"], memory["dt"]
        names = ("e1", "velocity_error", "e2", "integral", "wanted", "acceleration")
        self._e1, self._velocity, self._e2, self._integral, self._wanted, self._out = (memory[n][0] for n in names)

    def _made(self) -> PositionLaw:
        law: PositionLaw = self._plugin.make(self._control, self._control.position.options)
        return law

    def reset(self) -> None:
        """Let the law forget the flight so far. Raises PluginError."""
        reset(self._law, self._plugin)

    def command(self, airborne: bool) -> None:
        """Put the law's acceleration in the place of the compiled one. Raises PluginError."""
        pace = float(self._pace[0])
        error = TrackingError(self._e1.copy(), self._velocity.copy(), self._e2 / pace, self._integral.copy())
        dt = pace * float(self._dt[0]) if airborne and not self._limited[0] else 0.0
        self._out[:] = pace * pace * self._ask(self._law, error, self._wanted.copy(), dt)

    def small(self, error: TrackingError) -> Array:
        """The acceleration (3,) in m/s2 by which a law that has just begun answers an error. Raises PluginError."""
        return self._ask(self._made(), error, np.zeros(3), 0.0)

    def _ask(self, law: PositionLaw, error: TrackingError, wanted: Array, dt: float) -> Array:
        with self._plugin.named():
            command = np.asarray(law.acceleration_command(error, wanted, dt), np.float64)
        if command.shape != (3,):
            raise self._plugin.broken(f"an acceleration of shape {command.shape} in place of (3,)")
        if not _makes_sense(command):
            raise self._plugin.broken(f"an acceleration of {command} m/s2")
        return command


class ForeignAttitude:
    """An attitude law of another package on the memory of a controller."""

    def __init__(self, plugin: Plugin, control: Control, memory: Any) -> None:
        self._plugin = plugin
        self._law: AttitudeLaw = plugin.make(control, control.attitude.options)
        names = ("attitude_error", "turning_reference", "rates")
        self._error, self._reference, self._rates = (memory[name][0] for name in names)
        self._dt = memory["dt"]

    def reset(self) -> None:
        """Let the law forget the flight so far. Raises PluginError."""
        reset(self._law, self._plugin)

    def command(self, limited: bool) -> tuple[Array, Array]:
        """The law's rates (3,) in rad/s and angular acceleration (3,) in rad/s2. Raises PluginError."""
        rates, acceleration, _ = self._reference
        error = AttitudeError(self._error.copy(), rates - self._rates, rates.copy(), acceleration.copy())
        dt = 0.0 if limited else float(self._dt[0])
        with self._plugin.named():
            turn, turning = (np.array(each, np.float64) for each in self._law.turning_command(error, dt))
        if turn.shape != (3,) or turning.shape != (3,):
            raise self._plugin.broken(f"a turn of shapes {turn.shape} and {turning.shape} in place of (3,) and (3,)")
        if not _makes_sense(turn, turning):
            raise self._plugin.broken(f"a turn of {turn} rad/s and {turning} rad/s2")
        return turn, turning


def _makes_sense(*commands: Array) -> bool:
    return bool((np.abs(commands) <= _MOST).all())  # nothing compares to nan


def reset(law: PositionLaw | AttitudeLaw, plugin: Plugin) -> None:
    """Let a law forget the flight so far. Raises PluginError."""
    with plugin.named():
        law.reset()


def foreign_laws(
    control: Control, parameters: Any, memory: Any
) -> tuple[ForeignPosition | None, ForeignAttitude | None]:
    """The laws of other packages that the settings name, on the memory of a controller. Raises PluginError."""
    position, attitude = control.position.plugin, control.attitude.plugin
    return (
        None if position is None else ForeignPosition(position, control, parameters, memory),
        None if attitude is None else ForeignAttitude(attitude, control, memory),
    )
