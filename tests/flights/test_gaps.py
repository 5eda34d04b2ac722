"""The companion stands still in flight, as after SIGSTOP: the mission goes on, or the vehicle lands and disarms."""

from collections.abc import Callable

import numpy as np
import pytest

from companion.mission.plan import Mission, Phase
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from protocol.framing import Framer
from protocol.messages import dialect
from studies.joined import Joined, mission_of

HOVER, CIRCLE = mission_of("hover"), mission_of("circle", "trajectory.laps=1.5")
NO_WAY_TO_FIND = ('avoidance.method="none"',)


def in_phase(phase: Phase, seconds: float = 1.0) -> Callable[[Joined], bool]:
    """For so long."""
    since: list[int] = []

    def holds(joined: Joined) -> bool:
        if joined.autopilot.navigator.phase is phase and joined.autopilot.supervisor.state is State.FLY:
            since.append(joined.vehicle.time_ns)
        return bool(since) and joined.vehicle.time_ns - since[0] > seconds * 1e9

    return holds


def frozen(mission: Mission, phase: Phase, seconds: float) -> Joined:
    """A flight of which the companion sleeps so long in the middle of a phase."""
    joined = Joined(mission, overrides=NO_WAY_TO_FIND).fly(until=in_phase(phase, 2.0))
    assert joined.autopilot.supervisor.state is State.FLY
    joined.freeze(seconds)
    return joined


def setpoints(joined: Joined, since: int) -> int:
    ids = [frame.message_id for data in joined.sent[since:] for frame in Framer().datagram(data)]
    return ids.count(dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET)


@pytest.mark.parametrize(("mission", "phase"), [(HOVER, Phase.ROUTE), (CIRCLE, Phase.TRACK)])
@pytest.mark.parametrize("seconds", [0.9, 1.0, 10.0])
def test_a_gap_ends_in_the_mission_or_on_the_ground(mission: Mission, phase: Phase, seconds: float) -> None:
    joined = frozen(mission, phase, seconds).fly(limit_s=200.0)
    summary, supervisor = joined.vehicle.summary(), joined.autopilot.supervisor
    assert supervisor.state is State.ENDED and summary.outcome == "landed" and summary.contacts == 0, joined.said
    assert not joined.vehicle.flight.armed
    assert (supervisor.fault is None) == (seconds < 1.0), joined.said
    tilt = np.degrees(2.0 * np.arcsin(np.hypot(*np.array(joined.truths)[:, 7:9].T)))
    assert tilt.max() < 45.0


def test_a_gap_over_the_end_of_a_figure_ends_on_the_ground() -> None:
    """The rest of the figure that is kept for later has no length."""
    mission = mission_of("circle", "trajectory.laps=1")
    joined = Joined(mission, overrides=NO_WAY_TO_FIND).fly(until=in_phase(Phase.TRACK, 6.0))
    joined.freeze(2.5)
    joined.fly(limit_s=200.0)
    assert joined.autopilot.supervisor.fault is not None
    assert joined.autopilot.supervisor.state is State.ENDED and joined.vehicle.summary().outcome == "landed", (
        joined.said
    )


@pytest.mark.parametrize(("late_s", "between_s"), [(0.3, 0.1), (0.85, 0.5)])
def test_a_loop_that_stands_still_again_and_again_lands_after_its_hold(late_s: float, between_s: float) -> None:
    """A hold that began anew with each pause would last until the battery ends, or lead on between two of them."""
    joined = Joined(HOVER, overrides=NO_WAY_TO_FIND, remembers=False).fly(until=in_phase(Phase.ROUTE, 2.0))
    began_ns = joined.vehicle.time_ns
    while joined.autopilot.supervisor.state is not State.LAND and joined.vehicle.time_ns - began_ns < 8e9:
        joined.freeze(late_s)
        joined.fly(limit_s=between_s)
    assert joined.autopilot.supervisor.state is State.LAND, joined.said
    assert not any("cured" in said or "the link is" in said for said in joined.said)
    joined.fly(limit_s=60.0)
    assert joined.vehicle.summary().outcome == "landed" and not joined.vehicle.flight.armed


def test_a_landing_that_is_asked_for_while_the_failsafe_flies_is_answered() -> None:
    joined = frozen(HOVER, Phase.ROUTE, 1.5).fly(limit_s=1.0)
    assert joined.autopilot.supervisor.state is State.WATCH
    joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    assert "left to it (interrupt again to abandon)" in joined.said[-1]
