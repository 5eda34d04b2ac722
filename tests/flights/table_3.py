"""Table 3 of the paper in flight: what a trace of the mission "step" must look like."""

from typing import Any

import control
import numpy as np
import pytest

from companion.supervision.states import State

RISE_AND_OVERSHOOT = {1.0: (1.519, 4.321), 2.5: (1.628, 0.0246), 5.0: (1.836, 0.0)}
"""Rise (s) and overshoot (%) of the paper's position loop for each c."""


def check(trace: Any, c: float) -> None:
    """Each axis: rise within 20 %, overshoot within a point, 5 mm at the end."""
    rise, overshoot = RISE_AND_OVERSHOOT[c]
    for axis in range(3):
        step = trace[(trace["step"] == 2 + axis) & (trace["state"] == State.FLY.value)]
        path = step["position_ned"][:, axis]
        target = step["reference_position_ned"][-1, axis]
        assert abs(target - path[0]) == pytest.approx(1.0, abs=0.01)
        info = control.step_info((path - path[0]) / (target - path[0]), np.arange(len(path)) * 0.004, final_output=1.0)
        assert info["RiseTime"] == pytest.approx(rise, rel=0.2)
        assert info["Overshoot"] == pytest.approx(overshoot, abs=1.0)
        assert abs(path[-1] - target) < 0.005
