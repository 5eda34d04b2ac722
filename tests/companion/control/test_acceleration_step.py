"""From errors to an acceleration: what is learned of them, and where; and what is sent where nothing is flown."""

import numpy as np
import pytest

from companion.control.controller import SIZE, Controller
from companion.reports import LinkDelay
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


def test_what_the_integrals_have_given_they_go_on_to_give_at_another_pace() -> None:
    settings = load_settings(None, ['control.position.law="pid"', "control.estimation.velocity_settling=0.0"])
    controller, upright = Controller(settings, BODY, Output.RATES), np.array([1.0, 0.0, 0.0, 0.0])
    reference, now = Reference(np.zeros((6, 3))), START_NS

    def commanded(north: float) -> float:
        nonlocal now
        now += TICK_NS
        state = VehicleState(now, np.array([north, 0.0, 0.0]), np.zeros(3), upright, np.zeros(3), 0)
        return float(controller.acceleration_command(state, now, now, reference, BODY.mass_kg, north != 0.0)[0])

    for _ in range(50):
        commanded(-1.0)
    before = commanded(0.0)
    assert before == pytest.approx(0.4, rel=0.05), "2 1/s3 for 0.2 s"
    controller.follow(LinkDelay(age=0.1, command=0.1))
    assert controller.pace.share < 0.9
    assert commanded(0.0) == pytest.approx(before)


def test_what_is_sent_where_nothing_is_flown_moves_nothing() -> None:
    control = np.arange(1.0, SIZE + 1.0)
    sent = Controller(load_settings(None, []), BODY, Output.ACTUATORS).setpoint(control, idle=True)
    assert (sent.rates_frd, sent.torque, sent.thrust) == ([0.0] * 3, [0.0] * 3, 0.0)
