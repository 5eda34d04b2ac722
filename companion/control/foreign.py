"""Laws of other packages: what they are given, what is expected of them, and how they are flown.

The compiled controller computes everything around the law as ever. The law itself is called from Python, and its
command takes the place of a built-in law's. Disturbance observer, prediction, guard, limits and gate stay as they are.
"""

from typing import Any, Protocol

import numpy as np

from companion.config import Control
from companion.control.tracking_error import TrackingError
from companion.plugins import Plugin
from protocol.arrays import Array


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
        """Nothing is flown."""
        self._law.reset()

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
        try:
            command = np.asarray(law.acceleration_command(error, wanted, dt), np.float64)
        except Exception as error_raised:
            raise self._plugin.broken(error_raised) from error_raised
        if command.shape != (3,):
            raise self._plugin.broken(f"an acceleration of shape {command.shape} in place of (3,)")
        return command
