"""Loops: the vehicle is inverted, and whatever ends them ends on its feet."""

import math

import numpy as np
import pytest

from companion.mission.plan import Mission, Phase
from companion.state import Output
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from studies.joined import Joined
from studies.loops import FREE, LOOP, OUTPUTS, VEHICLE
from studies.tracks import AGILE

MISSION = Mission("loop", trajectory=LOOP, vehicle=VEHICLE, takeoff_height=10.0)


def joined_of(output: Output) -> Joined:
    return Joined(MISSION, output, (*AGILE, *FREE), remembers=False)


def tilts_deg(joined: Joined) -> list[float]:
    """The truth's, tick by tick."""
    q = np.array(joined.truths)[:, 6:10]
    found: list[float] = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2), -1.0, 1.0))).tolist()
    return found


@pytest.mark.parametrize("output", OUTPUTS)
def test_loops_are_flown(output: Output) -> None:
    joined = joined_of(output).fly()
    assert joined.vehicle.summary().outcome == "landed" and joined.autopilot.supervisor.fault is None
    on_it = joined.trace()["phase"][:-1] == Phase.TRACK.value
    assert np.linalg.norm(joined.tracking_error()[on_it], axis=1).max() < 0.02
    assert max(tilts_deg(joined)) > 175.0
    passes = np.diff(np.array(tilts_deg(joined)) > 150.0).sum()
    assert passes == 2 * LOOP.laps, "once each lap"


@pytest.mark.parametrize("tilt_deg", [90.0, 170.0])
def test_a_landing_that_is_asked_for_upside_down(tilt_deg: float) -> None:
    """It turns over and lands."""
    joined = joined_of(Output.RATES)
    joined.fly(until=lambda joined: len(joined.truths) > 0 and tilt_of(joined) > tilt_deg)
    joined.autopilot.handle(LandRequest(joined.vehicle.time_ns))
    asked = len(joined.truths)
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed" and joined.vehicle.summary().contacts == 0
    upright = [tilt < 60.0 for tilt in tilts_deg(joined)[asked:]]
    assert all(upright[250:]), "within a second"


def tilt_of(joined: Joined) -> float:
    q = joined.vehicle.motion.attitude_ned_frd
    return math.degrees(math.acos(1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2)))


def test_a_loop_that_was_left_is_flown_again_from_its_beginning() -> None:
    """After a hold the vehicle goes to where the lap began: from rest on its side no loop can be gone on with."""
    joined = joined_of(Output.RATES)
    joined.fly(until=lambda joined: joined.autopilot.navigator.phase is Phase.TRACK and tilt_of(joined) > 150.0)
    pilot = joined.autopilot
    pilot.guidance.halt(joined.vehicle.time_ns)
    rest = pilot.guidance._rest_of_track
    assert rest is not None and pilot.supervisor.state is State.FLY
    assert np.allclose(rest.start_ned, (0.0, 0.0, rest.start_ned[2])) and rest.start_yaw == 0.0
    joined.fly()
    assert joined.vehicle.summary().outcome == "landed" and joined.vehicle.summary().contacts == 0
    assert np.diff(np.array(tilts_deg(joined)) > 150.0).sum() >= 2 * LOOP.laps
