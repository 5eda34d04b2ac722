"""Loops: the vehicle is inverted, and whatever ends them ends on its feet."""

import numpy as np
import pytest

from companion.mission.plan import Mission, Phase
from companion.state import Output
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from protocol.arrays import Array
from studies.joined import Joined
from studies.loops import FREE, LOOP, OUTPUTS, VEHICLE
from studies.tracks import AGILE
from tests.flights.short import returning

MISSION = Mission("loop", trajectory=LOOP, vehicle=VEHICLE, takeoff_height=5.0)


def joined_of(output: Output) -> Joined:
    return Joined(MISSION, output, (*AGILE, *FREE), remembers=False)


def tilts_deg(joined: Joined, since: int = 0) -> Array:
    """The truth's, tick by tick, from the tick `since` on."""
    q = np.array(joined.truths[since:])[:, 6:10]
    return np.degrees(np.arccos(np.clip(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2), -1.0, 1.0)))


def passes(joined: Joined) -> int:
    """How often the vehicle was inverted."""
    return int(np.diff(tilts_deg(joined) > 150.0).sum()) // 2


@pytest.mark.parametrize("output", OUTPUTS)
def test_loops_are_flown(output: Output) -> None:
    joined = joined_of(output).fly(until=returning)
    assert joined.autopilot.navigator.phase is Phase.RETURN and joined.autopilot.supervisor.fault is None
    on_it = joined.trace()["phase"][:-1] == Phase.TRACK.value
    assert np.linalg.norm(joined.tracking_error()[on_it], axis=1).max() < 0.02
    assert max(tilts_deg(joined)) > 175.0
    assert passes(joined) == LOOP.laps, "once each lap"


@pytest.mark.parametrize("tilt_deg", [90.0, 170.0])
def test_a_landing_that_is_asked_for_upside_down(tilt_deg: float) -> None:
    """It turns over and lands."""
    joined = joined_of(Output.RATES)
    joined.fly(until=lambda joined: bool(joined.truths) and tilts_deg(joined, -1)[0] > tilt_deg)
    joined.autopilot.handle(LandRequest(joined.vehicle.time_ns))
    asked = len(joined.truths)
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed" and joined.vehicle.summary().contacts == 0
    assert tilts_deg(joined, asked + 250).max() < 60.0, "within a second"


def test_a_loop_that_was_left_is_flown_again_from_its_beginning() -> None:
    """After a hold the vehicle goes to where the lap began: from rest on its side no loop can be gone on with."""
    joined = joined_of(Output.RATES)
    joined.fly(until=lambda joined: bool(joined.truths) and tilts_deg(joined, -1)[0] > 150.0)
    pilot = joined.autopilot
    pilot.guidance.halt(joined.vehicle.time_ns)
    rest = pilot.guidance._rest_of_track
    assert rest is not None and pilot.supervisor.state is State.FLY
    assert np.allclose(rest.start_ned, (0.0, 0.0, rest.start_ned[2])) and rest.start_yaw == 0.0
    joined.fly(until=returning)
    assert joined.autopilot.navigator.phase is Phase.RETURN and joined.vehicle.summary().contacts == 0
    assert passes(joined) == LOOP.laps + 1, "the lap that was left, and all of them"
