"""Joined circles of a vehicle with its centre of mass aside or a weak rotor, which the companion does not know."""

import numpy as np
import pytest

from companion.state import Output
from studies.joined import Joined, mission_of

ASIDE = "unmodelled.centre_of_mass_m=[0.014, -0.014]"
"""2 cm."""
WEAK = "rotors.thrust_share=[0.8, 1.0, 1.0, 1.0]"


def error(output: Output, *vehicle: str, bandwidth: float | None = None) -> float:
    """m, RMSE of the true place on the track."""
    overrides = ['avoidance.method="none"']
    if bandwidth is not None:
        overrides.append(f"control.estimation.torque_bandwidth={bandwidth}")
    mission = mission_of("circle", "trajectory.laps=1")
    joined = Joined(mission, output, tuple(overrides), vehicle_overrides=vehicle, remembers=False).fly()
    assert joined.vehicle.summary().outcome == "landed"
    on_track = np.linalg.norm(joined.trace()["reference_velocity_ned"][:-1, :2], axis=1) > 0.5
    return float(np.sqrt((joined.tracking_error()[on_track] ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize(
    ("output", "vehicle"),
    [(Output.RATES, ASIDE), (Output.RATES, WEAK), (Output.ATTITUDE, WEAK), (Output.ACTUATORS, ASIDE)],
)
def test_a_disturbing_torque_is_made_up_for(output: Output, vehicle: str) -> None:
    assert error(output, vehicle) < 0.02 < 0.035 < error(output, vehicle, bandwidth=0.0)


def test_a_sound_vehicle_flies_as_before() -> None:
    assert error(Output.RATES) == pytest.approx(error(Output.RATES, bandwidth=0.0), abs=5e-4)
