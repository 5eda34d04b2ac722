"""A vehicle that is disarmed, in the air or on the ground, while somebody else than the companion flies it."""

import pytest

from companion.mission.plan import Mission, Waypoint
from companion.outcomes import Outcome
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from studies.faults import changes
from studies.joined import Joined
from vehicle_sim.autopilot.modes import Mode

UP = Mission("up", waypoints=[Waypoint(0.0, 0.0, 5.0, hold_s=1.0)], takeoff_height=5.0)
PLANLESS = ("avoidance.method=none",)


def up() -> Joined:
    return Joined(UP, overrides=PLANLESS, remembers=False).fly(
        until=lambda joined: joined.vehicle.motion.position_ned[2] < -4.5
    )


@pytest.mark.parametrize("by_hand", [True, False])
def test_motors_that_are_stopped_in_the_air_are_no_landing(by_hand: bool) -> None:
    joined = up()
    if by_hand:
        joined.vehicle.flight.set_mode(Mode.HOLD)
    else:
        joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    flown_by = State.RELINQUISHED if by_hand else State.LAND
    joined.fly(until=lambda joined: joined.autopilot.supervisor.state is flown_by).fly(limit_s=0.5)
    assert joined.autopilot.supervisor.state is flown_by
    joined.vehicle.flight.disarm(force=True)
    verdict = joined.fly(limit_s=3.0).autopilot.supervisor.verdict
    assert joined.autopilot.ended and verdict is not None and verdict.outcome is Outcome.CRASHED, joined.said


def test_a_mode_that_follows_the_disarming_is_nobodys_choice() -> None:
    """Telemetry is gone in the last half metre of the landing, so the end of the flight is waited for."""
    joined = up().fly(until=lambda joined: joined.autopilot.supervisor.state is State.LAND)
    joined.fly(until=lambda joined: joined.vehicle.motion.position_ned[2] > -0.5)
    joined.meddle = changes.missing(changes.ATTITUDE + changes.POSITION)
    joined.fly(limit_s=20.0)
    assert joined.autopilot.ended and joined.autopilot.supervisor.fault is None, joined.said
    assert not any("by others" in said for said in joined.said)


def test_a_take_off_that_is_called_off_on_the_ground_leaves_no_motors_running() -> None:
    joined = Joined(UP, overrides=PLANLESS, remembers=False)
    joined.fly(until=lambda joined: joined.autopilot.supervisor.state is State.FLY).fly(limit_s=0.5)
    joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    joined.fly(limit_s=2.0)
    assert not joined.vehicle.flight.armed, joined.said
    verdict = joined.fly(limit_s=10.0).autopilot.supervisor.verdict
    assert verdict is not None and verdict.text == "called off before it rose"
