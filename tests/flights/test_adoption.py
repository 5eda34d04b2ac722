"""A companion is killed in flight, and another one takes the vehicle over: by --adopt alone, and never by itself."""

import numpy as np
import pytest

from companion.autopilot import Autopilot
from companion.events import Datagram
from companion.mission.plan import Mission, Phase
from companion.outcomes import Outcome
from companion.runtime.driver import Driver, nobody
from companion.runtime.planning import InProcessPlanner, Planning
from companion.state import Adoption, Output, VehicleRequest
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from studies.faults import changes
from studies.joined import Joined, mission_of
from tests.flights.test_gaps import HOVER, NO_WAY_TO_FIND, in_phase
from vehicle_sim.autopilot.modes import Mode

SQUARE = mission_of("square", "trajectory.laps=1", "trajectory.radius=1.0")


def killed(mission: Mission, phase: Phase, alone_s: float) -> Joined:
    """A flight whose companion was killed, and whose vehicle has been alone for so long."""
    joined = Joined(mission, overrides=NO_WAY_TO_FIND).fly(until=in_phase(phase, 1.0))
    for _ in range(round(alone_s / 0.004)):
        joined.truths.append(joined.vehicle.state.copy())
        joined.vehicle.advance()
    return joined


def restarted(joined: Joined, adoption: Adoption | None) -> Joined:
    old = joined.autopilot
    joined.autopilot = Autopilot(old.settings, old.body, joined.mission, Output.RATES, adoption)
    joined.fly_with(InProcessPlanner(old.settings.avoidance))
    joined.said.clear()
    return joined


@pytest.mark.parametrize("alone_s", [0.2, 2.5])
def test_what_is_left_of_the_mission_is_flown(alone_s: float) -> None:
    """From its own failsafe, too, and from external control."""
    joined = restarted(killed(SQUARE, Phase.TRACK, alone_s), Adoption.MISSION)
    began = len(joined.truths)
    joined.fly()
    summary, supervisor = joined.vehicle.summary(), joined.autopilot.supervisor
    assert supervisor.state is State.ENDED and supervisor.fault is None, joined.said
    assert summary.outcome == "landed" and np.hypot(*summary.final_position_ned[:2]) < 0.3
    heights = -np.array(joined.truths)[began:, 2]
    assert heights[: round(2.0 / 0.004)].min() > 1.0, "it neither falls nor lands at first"
    assert any("from step" in text for text in joined.said)


def test_a_vehicle_is_landed_where_it_is() -> None:
    joined = restarted(killed(SQUARE, Phase.TRACK, 2.5), Adoption.LAND)
    here = joined.vehicle.state[:2].copy()
    joined.fly()
    assert joined.autopilot.supervisor.fault is None and joined.vehicle.summary().outcome == "landed"
    assert np.hypot(*(joined.vehicle.state[:2] - here)) < 2.0


def test_a_vehicle_that_another_companion_flies_is_not_taken_over() -> None:
    """Its heartbeat comes once a second, and all else that a take-over needs within a tenth of that."""
    joined = Joined(HOVER, overrides=NO_WAY_TO_FIND).fly(until=in_phase(Phase.ROUTE, 1.0))
    first, now_ns = joined.autopilot, joined.vehicle.time_ns
    second = Autopilot(first.settings, first.body, HOVER, Output.RATES, Adoption.MISSION)
    planner = Planning(InProcessPlanner(first.settings.avoidance), first.settings.avoidance.answer_delay)
    said = list[str]()
    driver = Driver(
        second, planner, nobody, lambda _, reaction: said.extend(each.text for each in reaction.announcements)
    )
    heard = list[bytes]()

    def overheard(_: int, data: bytes) -> bytes:
        heard.append(data)
        return data

    joined.meddle = overheard
    while joined.vehicle.time_ns < now_ns + 3_000_000_000:
        joined.tick()
        now, datagrams = joined.vehicle.time_ns, [*heard, joined.sent[-1]]
        heard.clear()
        answers = [driver.handle(Datagram(now, data)) for data in datagrams]
        joined.vehicle.receive(b"".join(answers) + driver.tick(now))
    assert second.supervisor.state is State.CHECK and not any("take" in text for text in said), said
    assert "another companion" in (second.supervisor.waiting_for or "")
    assert first.supervisor.state is State.FLY
    joined.fly()
    assert first.supervisor.fault is None and joined.vehicle.summary().outcome == "landed"


def test_another_attempt_has_all_its_tries() -> None:
    """Telemetry that was lost ends an attempt, whatever it has asked for by then."""
    joined = restarted(killed(HOVER, Phase.ROUTE, 0.2), Adoption.LAND)
    joined.fly(until=lambda joined: joined.autopilot.link.vehicle is not None)
    requests, now_ns = joined.autopilot.link.requests, joined.vehicle.time_ns
    for tries in range(5):
        requests.ask(VehicleRequest.EXTERNAL_CONTROL, now_ns + tries * 1_000_000_000, (1, 1))
    assert requests.answer(VehicleRequest.EXTERNAL_CONTROL).tries == 5
    joined.fly(until=lambda joined: joined.autopilot.supervisor.state is State.ADOPT)
    assert requests.answer(VehicleRequest.EXTERNAL_CONTROL).tries == 0


def test_an_armed_vehicle_is_refused_and_stays_refused_after_it_disarmed() -> None:
    joined = restarted(killed(HOVER, Phase.ROUTE, 2.5), None).fly(limit_s=60.0)
    assert joined.autopilot.supervisor.state is State.ENDED
    assert "armed already" in (joined.autopilot.supervisor.fault or "")
    assert joined.vehicle.flight.armed, "it is refused at once"
    joined.drift(30.0)
    assert not joined.vehicle.flight.armed and joined.vehicle.flight.landed


def test_there_is_nothing_to_take_over_on_the_ground() -> None:
    joined = Joined(HOVER, overrides=NO_WAY_TO_FIND)
    restarted(joined, Adoption.MISSION).fly(limit_s=60.0)
    assert "not armed" in (joined.autopilot.supervisor.fault or "") and not joined.vehicle.flight.armed


def test_who_has_asked_for_control_lands_the_vehicle_when_it_is_called_off() -> None:
    """It has changed its mode already, and nobody else flies it then."""
    joined = restarted(killed(HOVER, Phase.ROUTE, 2.5), Adoption.MISSION)
    joined.fly(until=lambda joined: joined.vehicle.flight.mode is Mode.OFFBOARD)
    assert joined.autopilot.supervisor.state is State.ADOPT
    joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    joined.fly(limit_s=60.0)
    verdict = joined.autopilot.supervisor.verdict
    assert verdict is not None and verdict.outcome is Outcome.CALLED_OFF, joined.said
    assert joined.vehicle.summary().outcome == "landed" and not joined.vehicle.flight.armed


def test_telemetry_that_is_lost_is_waited_for_before_another_attempt() -> None:
    joined = restarted(killed(HOVER, Phase.ROUTE, 1.5), Adoption.LAND)
    joined.fly(until=lambda joined: joined.autopilot.supervisor.state is State.ADOPT).fly(limit_s=0.3)
    joined.meddle = changes.missing(changes.ATTITUDE + changes.POSITION, 2.0)
    joined.fly(limit_s=60.0)
    assert sum("taking the vehicle over" in said for said in joined.said) == 2, joined.said
    assert joined.vehicle.summary().outcome == "landed" and joined.autopilot.supervisor.fault is None
