"""Joined circles of a vehicle with its centre of mass aside or a weak rotor, which the companion does not know."""

import numpy as np
import pytest

from companion.mission.plan import Phase
from companion.state import Output
from studies.joined import Joined, mission_of
from tests.flights.short import returning

ASIDE = "unmodelled.centre_of_mass_m=[0.014, -0.014]"
"""2 cm."""
WEAK = "rotors.thrust_share=[0.8, 1.0, 1.0, 1.0]"


def error(output: Output, *vehicle: str, bandwidth: float | None = None) -> float:
    """m, RMSE of the true place on the track."""
    overrides = ['avoidance.method="none"']
    if bandwidth is not None:
        overrides.append(f"control.estimation.torque_bandwidth={bandwidth}")
    mission = mission_of("circle", "trajectory.laps=1", "takeoff_height=1.5")
    joined = Joined(mission, output, tuple(overrides), vehicle_overrides=vehicle, remembers=False)
    joined.fly(until=returning)
    assert joined.autopilot.navigator.phase is Phase.RETURN and joined.autopilot.supervisor.fault is None
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


def test_a_vehicle_that_turns_slowly_about_its_yaw_axis_is_not_swung() -> None:
    """As ArduCopter's own loops do: what was made up for there came on top, and swung up."""
    turned = []
    for bandwidth in (0.0, 2.0):
        overrides = ('avoidance.method="none"', f"control.estimation.torque_bandwidth={bandwidth}")
        mission = mission_of("circle", "trajectory.laps=1", "trajectory.speed=4.0", "takeoff_height=1.5")
        slow = ("inner_loop.rate_gain_1_s=[20.0, 20.0, 1.5]",)
        joined = Joined(mission, Output.RATES, overrides, vehicle_overrides=slow, remembers=False)
        joined.fly(until=returning)
        turned.append(np.abs(joined.trace()["rates_frd"][:, 2]).max())
    assert turned[1] < 1.1 * turned[0]
