"""From errors to an acceleration: what is learned of them, and where."""

import numpy as np
import pytest

from companion.control.controller import Controller
from companion.runtime.files import load_body, load_settings
from companion.state import Output, Reference, VehicleState

BODY = load_body("paper_quad")
TICK_NS = 4_000_000
START_NS = 1_000_000_000


def test_of_a_tied_reference_nothing_is_learned_but_the_altitude() -> None:
    """A reference that leads the vehicle on and on: by its errors north and east there is no wind. Nor does the first
    step after a reset teach, which has no time before it."""
    state = VehicleState(0, np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 0)
    learned = []
    for tied in (False, True):
        controller = Controller(load_settings(None, ["control.estimation.disturbance=false"]), BODY, Output.RATES)
        rows = np.zeros((6, 3))
        rows[0] = 0.1, -0.2, 0.3
        for tick in range(250):
            now = START_NS + tick * TICK_NS
            reference = Reference(rows.copy(), tied)
            wanted = controller.acceleration_command(state, now, now, reference, BODY.mass_kg, True)
            out, limited = controller.attitude_command(wanted, now, reference, BODY.mass_kg)
            assert not limited
        learned.append(out[29:32])
    assert learned[0][:2] == pytest.approx(-0.3 * 2.5 * rows[0, :2] * 249 * 0.004)
    assert learned[1] == pytest.approx([0.0, 0.0, learned[0][2]]) and learned[1][2] < -0.2
