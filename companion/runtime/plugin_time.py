"""How long the laws and the output of other packages take, measured before they fly."""

import functools
import time
from collections.abc import Callable, Iterator

import numpy as np

from companion.config import Control
from companion.control.foreign import AttitudeError, AttitudeLaw, PositionLaw, reset
from companion.control.tracking_error import TrackingError
from companion.outputs import encoders
from companion.plugins import Plugin
from companion.state import Output, Setpoint

_CALLS = 8
"""The least time of so many counts: what else the machine does lengthens some."""
_DT_S = 0.004
_AWAY = np.array((1.0, -0.5, 0.2))
_LEVEL = Setpoint((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.4)

Step = Callable[[], object]


def refuse_slow_plugins(control: Control, outputs: tuple[Output, ...], most_s: float) -> None:
    """Raises PluginError for a law or an output whose step alone takes as long as the loop has for all of it (s)."""
    for plugin, step in _steps(control, outputs):
        with plugin.named():
            step()
            taken_s = min(_seconds(step) for _ in range(_CALLS))
        if taken_s >= most_s:
            raise plugin.broken(f"a step takes {1e3 * taken_s:.1f} ms, and the loop that flies has {1e3 * most_s:g} ms")


def _steps(control: Control, outputs: tuple[Output, ...]) -> Iterator[tuple[Plugin, Step]]:
    """What each of them is asked at each step, for a vehicle that is beside its reference."""
    still = np.zeros(3)
    if control.position.plugin is not None:
        position: PositionLaw = control.position.plugin.make(control, control.position.options)
        reset(position, control.position.plugin)
        error = TrackingError(_AWAY, _AWAY, _AWAY, still)
        yield control.position.plugin, lambda: position.acceleration_command(error, still, _DT_S)
    if control.attitude.plugin is not None:
        attitude: AttitudeLaw = control.attitude.plugin.make(control, control.attitude.options)
        reset(attitude, control.attitude.plugin)
        turned = AttitudeError(0.1 * _AWAY, _AWAY, still, still)
        yield control.attitude.plugin, lambda: attitude.turning_command(turned, _DT_S)
    if control.output.plugin is not None:
        for output in outputs:
            encode = encoders(control)(output)
            yield control.output.plugin, functools.partial(encode, _LEVEL, 0, (1, 1))


def _seconds(step: Step) -> float:
    began = time.perf_counter()
    step()
    return time.perf_counter() - began
