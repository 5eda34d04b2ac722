"""Many vehicles at once fly as each by itself."""

import numpy as np
import pytest

from protocol.toml_files import find
from studies.batch import Fleet, hovers_and_steps
from vehicle_sim.airframe import Airframe
from vehicle_sim.physics.integrator import work_array
from vehicle_sim.tick import EXACT, advance
from vehicle_sim.timing import TICK_S

PAPER_QUAD = Airframe.load(find("vehicles", "paper_quad"))


def test_a_batch_flies_as_each_vehicle_by_itself_to_the_bit() -> None:
    together, alone = (Fleet.hovering(PAPER_QUAD, 20) for _ in range(2))
    for fleet in (together, alone):
        fleet.disturb(np.random.default_rng(3))
        fleet.commands["position_ned"][:, 0] += np.arange(20)
        fleet.states[0, 2] = -0.05  # on its feet
    way = together.fly(0.4)
    for i in range(20):
        rows = (alone.commands[i : i + 1], alone.parameters[i : i + 1], alone.feedback[i : i + 1])
        for tick in range(100):
            advance(alone.states[i], *rows, work_array(), EXACT)
            assert (alone.states[i, :3] == way[i, tick]).all()
    assert (together.states == alone.states).all() and (together.feedback == alone.feedback).all()
    assert len(np.unique(together.states[:, 0])) == 20


def test_a_hover_gives_way_to_a_force_as_far_as_its_gains_say() -> None:
    """At rest the laws' acceleration, position gain times velocity gain times the offset, holds against the force."""
    fleet, p = Fleet.hovering(PAPER_QUAD, 3), Fleet.hovering(PAPER_QUAD, 1).parameters[0]
    fleet.parameters["force_ned"][:, 0] = (0.0, 0.3, -0.6)
    offset = fleet.fly(12.0, last_s=TICK_S)[:, 0, 0]
    stiffness = p["mass_kg"] * p["position_gain"] * p["velocity_gain"]
    assert offset == pytest.approx(np.array([0.0, 0.3, -0.6]) / stiffness, rel=1e-3)


def test_responses_to_steps() -> None:
    found = hovers_and_steps(PAPER_QUAD, 50)
    assert (found.settling_s > 0.5).all() and (found.settling_s < 6.0).all()
    assert np.median(found.overshoot_m) < 0.05 and 0.1 < np.median(found.offset_m) < 2.0
