"""A vehicle that waits in the air is told what to fly next."""

import json
from typing import Any

import numpy as np
import pytest

from companion.autopilot import Autopilot
from companion.mission.plan import Mission, Phase
from companion.outcomes import Outcome
from companion.supervision.operations import LandRequest, OrderRequest
from companion.supervision.states import State
from protocol.messages import dialect
from studies.joined import Joined
from vehicle_sim.autopilot.modes import Result

SCRIPT = Mission("script", takeoff_height=2.0, waits=True)
PLANLESS = ("avoidance.method=none", "geofence.radius=20.0")


def waits(joined: Joined) -> bool:
    return joined.autopilot.navigator.phase is Phase.WAIT


def order(joined: Joined, **what: Any) -> str:
    """Give an order, and fly for a second; what was said to it."""
    answer = joined._driver.handle(OrderRequest(joined.vehicle.time_ns, json.dumps(what)))
    joined.sent.append(answer)
    joined.vehicle.receive(answer)
    said = joined.said[-1]
    until_ns = joined.vehicle.time_ns + 1_000_000_000
    joined.fly(until=lambda flight: flight.vehicle.time_ns >= until_ns)
    return said


def to(north: float, east: float, height: float, **more: Any) -> dict[str, Any]:
    places = [{"north": north, "east": east, "height": height}]
    return {"do": "fly", "mission": {"name": "order", "waypoints": places, "waits": True, **more}}


@pytest.fixture(scope="module")
def flown() -> Joined:
    """Up, six metres north, a delivery there, back half the way, stopped, landed."""
    joined = Joined(SCRIPT, overrides=PLANLESS).fly(until=waits)
    order(joined, **to(6.0, 0.0, 3.0))
    joined.fly(until=waits)
    order(joined, do="deliver")
    joined.fly(until=waits)
    order(joined, **to(0.0, 0.0, 2.0))
    order(joined, do="hold")
    order(joined, do="land")
    return joined.fly()


def test_what_is_ordered_is_flown(flown: Joined) -> None:
    supervisor, navigator = flown.autopilot.supervisor, flown.autopilot.navigator
    assert supervisor.verdict is None or supervisor.verdict.outcome is Outcome.FLOWN
    assert navigator.released
    summary = flown.vehicle.summary()
    assert summary.outcome == "landed" and summary.released_at_ned is not None
    north, east, down = summary.released_at_ned
    assert np.hypot(north - 6.0, east) < 0.2 and -0.8 < down < -0.3
    assert 1.0 < summary.final_position_ned[0] < 5.9, "it was stopped on the way"


def test_a_second_delivery_has_an_answer_of_its_own() -> None:
    joined = Joined(SCRIPT, overrides=PLANLESS).fly(until=waits)
    commands = joined.vehicle._services._commands._commands
    opens = commands[dialect.MAV_CMD_DO_GRIPPER]
    commands[dialect.MAV_CMD_DO_GRIPPER] = lambda message: Result.FAILED
    order(joined, do="deliver")
    joined.fly(until=waits)
    assert any("parcel not released: failed" in said for said in joined.said)
    assert not joined.autopilot.navigator.released
    commands[dialect.MAV_CMD_DO_GRIPPER] = opens
    order(joined, do="deliver")
    joined.fly(until=waits)
    assert joined.vehicle.summary().released and joined.autopilot.navigator.released


def test_orders_are_events_which_give_the_same_bytes_again(flown: Joined) -> None:
    old = flown.autopilot
    again = Autopilot(old.settings, old.body, flown.mission, flown.output)
    assert b"".join(again.handle(event).datagram for event in flown.events) == b"".join(flown.sent)


@pytest.fixture(scope="module")
def hovering() -> Joined:
    return Joined(SCRIPT, overrides=PLANLESS).fly(until=waits)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"do": "dance"}, "dance"),
        ({"do": "fly"}, "no mission"),
        (to(30.0, 0.0, 2.0), "route at north 30.0"),
        (
            {"do": "fly", "mission": {"name": "x", "trajectory": {"shape": "circle", "speed": 1.0, "radius": 2.0}}},
            "curve",
        ),
    ],
)
def test_what_can_not_be_flown_is_refused_and_changes_nothing(
    what: dict[str, Any], words: str, hovering: Joined
) -> None:
    before = hovering.autopilot.navigator.step_index
    said = order(hovering, **what)
    assert "order refused: " in said and words in said
    assert hovering.autopilot.navigator.step_index == before and waits(hovering)


def test_there_is_a_time_for_orders() -> None:
    joined = Joined(SCRIPT, overrides=PLANLESS).fly(limit_s=0.1)
    assert "order refused" in order(joined, do="land")
    joined.fly(until=lambda flight: flight.autopilot.navigator.phase is Phase.TAKEOFF)
    assert "the take-off is not done" in order(joined, do="hold")
    joined.fly(until=waits)
    order(joined, do="land")
    assert "the flight is ending" in order(joined, do="hold")


def test_a_flight_that_is_called_off_takes_no_orders() -> None:
    joined = Joined(SCRIPT, overrides=PLANLESS).fly(until=waits)
    joined._driver.handle(LandRequest(joined.vehicle.time_ns))
    joined.fly(until=lambda flight: flight.autopilot.supervisor.state is State.LAND)
    assert "the flight is ending" in order(joined, **to(6.0, 0.0, 3.0))
    assert "the flight is ending" in order(joined, do="hold")
    assert "refused" not in order(joined, do="land"), "that is what it does"
