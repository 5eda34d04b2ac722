"""Vehicles that the companion believes to be another: it takes off, hovers and lands without a file of their own."""

import math

import numpy as np
import pytest

from companion.mission.plan import Phase
from companion.supervision.states import State
from studies.joined import Joined, mission_of

MASS_KG, PARCEL_KG, ROTOR_N = 1.3, 0.25, 8.0


@pytest.mark.parametrize(("heavier", "stronger"), [(0.3, 1.0), (1.6, 1.0), (3.0, 3.0), (0.3, 0.3)])
def test_it_takes_off_and_hovers(heavier: float, stronger: float) -> None:
    """Mass and full thrust from 0.3 to 3 times the believed ones, where that can hover between the lowest and the
    highest thrust."""
    joined = Joined(
        mission_of("hover"),
        overrides=('avoidance.method="none"',),
        vehicle_overrides=(
            f"body.mass_kg={MASS_KG * heavier}",
            f"body.parcel_mass_kg={PARCEL_KG * heavier}",
            f"body.rotor_max_thrust_n={ROTOR_N * stronger}",
        ),
    )
    joined.fly(limit_s=40.0, until=lambda joined: joined.autopilot.supervisor.state is State.LAND)
    assert joined.autopilot.supervisor.state is State.LAND and joined.autopilot.supervisor.fault is None
    assert joined.vehicle.flight.crash is None
    trace = joined.trace()
    flown = trace[trace["state"] == State.FLY]
    error = np.linalg.norm(flown["position_ned"] - flown["reference_position_ned"], axis=1)
    assert error.max() < 0.3
    hovering = flown[flown["phase"] == Phase.ROUTE]
    assert error[flown["phase"] == Phase.ROUTE].max() < 0.05
    scale = float(np.median(hovering["thrust_scale"]))
    assert math.log(scale * heavier / stronger) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("damping_kg_s", [0.0, 1.5])
def test_what_a_climb_takes_from_the_thrust_does_not_pass_for_weight_for_long(damping_kg_s: float) -> None:
    """Drag along the rotors' axis that is none, or twice as large as believed: 0.8 m/s2 at the climb's speed. Three
    seconds after its end, next to nothing of that is left in the height."""
    joined = Joined(
        mission_of("hover"),
        overrides=('avoidance.method="none"',),
        vehicle_overrides=(f"body.drag_kg_s=[0.449, 0.484, {damping_kg_s}]",),
    )
    joined.fly(limit_s=40.0, until=lambda joined: joined.autopilot.supervisor.state is State.LAND)
    trace = joined.trace()[:-1]
    reference_down = trace["reference_position_ned"][:, 2]
    hovering = (trace["state"] == State.FLY) & (reference_down < reference_down.min() + 1e-3)
    down = joined.tracking_error()[hovering, 2]
    assert hovering.sum() > 1000 and np.abs(down).max() < 0.008
    assert np.abs(down[750:]).max() < 0.002
    assert np.abs(trace["thrust_scale"][hovering][750:] - 1.0).max() < 0.003
