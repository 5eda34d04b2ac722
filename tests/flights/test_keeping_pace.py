"""Whole flights of vehicles that can't keep the speed that is asked for: they are flown slower, to the end."""

import numpy as np
import pytest

from companion.mission.plan import Mission, Waypoint
from companion.state import Output
from companion.supervision.states import State
from studies.joined import Joined
from tests.flights.short import returning

SAID = "does not keep up"


def flown(drag: float, wind: float, speed: float, output: Output = Output.RATES) -> Joined:
    """60 m north against a wind (m/s), with a drag (kg/m) that the companion does not know."""
    return Joined(
        Mission("far", waypoints=[Waypoint(60.0, 0.0, 5.0)], takeoff_height=5.0, speed=speed),
        output,
        overrides=("avoidance.method=none",),
        vehicle_overrides=(f"unmodelled.quadratic_drag_kg_m=[{drag}, {drag}, {drag}]",),
        world_overrides=(f"wind.mean_ned=[{-wind}, 0.0, 0.0]",),
        remembers=False,
    ).fly(limit_s=90.0, until=returning)


@pytest.mark.parametrize(
    ("drag", "wind", "speed", "output"),
    [(0.3, 0.0, 10.0, Output.RATES), (0.08, 8.0, 8.0, Output.ATTITUDE), (0.1, 6.0, 12.0, Output.ACTUATORS)],
    ids=["drag", "head wind", "both"],
)
def test_it_arrives_and_the_reference_stays_near(drag: float, wind: float, speed: float, output: Output) -> None:
    joined = flown(drag, wind, speed, output)
    trace = joined.trace()[joined.trace()["state"] == State.FLY.value]
    assert returning(joined) and joined.autopilot.supervisor.fault is None
    away = np.linalg.norm(trace["position_ned"] - trace["reference_position_ned"], axis=1)
    assert 1.0 < away.max() < 2.0
    assert trace["position_ned"][:, 0].max() < 60.6
    assert sum(SAID in text for text in joined.said) == 1


def test_who_keeps_up_hears_nothing_of_it() -> None:
    joined = flown(0.0, 6.0, 8.0)
    assert returning(joined) and not any(SAID in text for text in joined.said)


def test_a_step_of_the_reference_waits_for_nobody() -> None:
    """As in the paper's tests: the vehicle is metres away from it, and follows as fast as it can."""
    holds = [Waypoint(0.0, 0.0, 3.0, hold_s=4.0), Waypoint(40.0, 0.0, 3.0, hold_s=8.0)]
    mission = Mission("step", waypoints=holds, takeoff_height=3.0, profile="step")
    joined = Joined(mission, overrides=("avoidance.method=none",), remembers=False).fly(limit_s=60.0, until=returning)
    flown = joined.trace()["position_ned"][:, 0]
    assert returning(joined) and flown.max() > 39.0
    assert np.count_nonzero((flown > 0.5) & (flown < 39.0)) > 500, "it takes more than 2 s"
    assert not any(SAID in text for text in joined.said)
