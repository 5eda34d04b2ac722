"""Whether gains suit each other and the vehicle: the roots of the linear design about hover, without any delay.

Limits on tilt, thrust and rates keep what runs away here bounded: the vehicle swings from limit to limit, and meets the
ground or an obstacle.
"""

from typing import Any

import numpy as np

from companion.config import Settings
from companion.control.margin import feedback, plant
from companion.control.parameters import controller_parameters, design_of
from companion.state import Output
from protocol.vehicle_parameters import VehicleParameters

_BY_AXIS = "c1", "c2", "assumed_rate_loop", "torque_scale", "full_torque", "inertia", "rates_gain", "torque_gain"
"""Fields of PARAMETERS whose first entries are those of north and east, or of roll and pitch."""


def unstable(settings: Settings, body: VehicleParameters, output: Output) -> str | None:
    """Which motion runs away with these gains, in words; None if none does. Laws of other packages are not judged."""
    control = settings.control
    if control.position.plugin is not None or control.attitude.plugin is not None:
        return None
    record = controller_parameters(settings, body, output)
    for axis, parameters in (("north", record[0]), ("east", _turned(record)[0])):
        design = design_of(parameters)
        A, B = plant(design)
        roots = np.linalg.eigvals(A - np.outer(B, feedback(design, 1.0)))
        worst = complex(roots[np.argmax(roots.real)])
        if worst.real > 0.0:
            return f"along {axis} it swings at {abs(worst.imag):.1f} rad/s, by {worst.real:.1f}/s more and more"
    return None


def _turned(record: Any) -> Any:
    """(1,) of PARAMETERS with east and roll in the place of north and pitch."""
    turned = record.copy()
    for field in _BY_AXIS:
        turned[field][:, :2] = record[field][:, 1::-1]
    turned["gains"][:, :, :2] = record["gains"][:, :, 1::-1]
    return turned
