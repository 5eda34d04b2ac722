"""Flights over a link that is late, both sides joined in memory."""

import math

import numpy as np
import pytest

from companion.events import Tick
from companion.outputs import ATTITUDE_IGNORE_RATES
from companion.state import Output
from companion.supervision.operations import LandRequest
from companion.supervision.states import State
from protocol.framing import Framer
from protocol.messages import decode, dialect
from studies.faults.changes import POSITION, late
from studies.faults.injector import Change, Injector, Link, Onset
from studies.joined import Joined, mission_of
from tests.flights.short import landing

SQUARE = mission_of("square", "trajectory.laps=1")
TILT_DEG = 45.0
"""The limit."""


def steepest_deg(joined: Joined) -> float:
    """The vehicle's greatest tilt, of the truth."""
    q = np.array(joined.truths)[:, 6:10]
    return math.degrees(np.arccos(1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2)).max())


@pytest.mark.parametrize(
    ("link", "change"),
    [
        (Link(there=0.1, back=0.1), None),
        (Link(there=0.01, back=0.09, jitter=0.02, loss=0.1), None),
        (Link(), late(POSITION, 0.15)),
    ],
    ids=["100 ms each way", "asymmetric, jitter, losses", "position 150 ms"],
)
def test_a_square_over_a_late_link(link: Link, change: Change | None) -> None:
    joined = Joined(SQUARE, injector=Injector(link, change), remembers=False).fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None
    assert steepest_deg(joined) < TILT_DEG
    joined.fly(until=lambda joined: not joined.autopilot.supervisor.streams).fly(limit_s=0.1)  # after the last setpoint
    flown = joined.trace()["state"][:-1] == State.FLY.value
    error = np.linalg.norm(joined.tracking_error()[flown], axis=1)
    assert error.max() < 1.0


@pytest.mark.parametrize("after_s", [10.5, 10.75, 11.0])
def test_a_link_that_becomes_late_while_the_vehicle_turns_hard(after_s: float) -> None:
    """On rates, which turn it on and on: for 0.18 s nothing is heard, and what is sent meanwhile is 0.18 s later than
    before. The vehicle would fall over if no attitudes were sent in the place of rates."""
    jump = Onset(after_s, Link(there=0.2, back=0.2), None)
    joined = Joined(SQUARE, Output.RATES, injector=Injector(Link(there=0.02, back=0.02), onset=jump), remembers=False)
    joined.fly(limit_s=after_s + 3.0)
    assert joined.vehicle.summary().contacts == 0 and joined.autopilot.supervisor.fault is None
    assert steepest_deg(joined) < 60.0
    assert any("400 ms late: attitudes are commanded" in line for line in joined.said)


@pytest.mark.parametrize("streams", [True, False])
def test_where_no_attitude_comes_attitudes_are_sent_for_a_tenth_of_a_second(streams: bool) -> None:
    """By prediction, on rates too; and none at all where the companion has let go."""
    joined = Joined(SQUARE, Output.RATES, remembers=False)
    joined.fly(until=lambda joined: joined.vehicle.time_ns > 8 * 10**9)
    pilot, now_ns = joined.autopilot, joined.vehicle.time_ns
    assert pilot.supervisor.state is State.FLY
    if not streams:
        pilot.supervisor.state = State.WATCH
    sent = {}
    for late_ms in range(4, 400, 4):
        reaction = pilot.handle(Tick(now_ns + late_ms * 1_000_000))
        frames = Framer(carry_unknown=False).datagram(reaction.datagram)
        setpoints = (
            decode(frame) for frame in frames if frame.message_id == dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET
        )
        masks = [setpoint.type_mask for setpoint in setpoints if setpoint is not None]
        if masks:
            sent[late_ms] = masks
            assert reaction.trace is not None
    assert set(sent) == (set(range(44, 104, 4)) if streams else set())
    assert all(masks == [ATTITUDE_IGNORE_RATES] for masks in sent.values())


def test_too_late_a_link_is_not_flown() -> None:
    joined = Joined(
        mission_of("hover"),
        injector=Injector(Link(there=0.3, back=0.3)),
        remembers=False,
        overrides=("supervision.ready_timeout=5.0",),
    ).fly(limit_s=20.0)
    assert joined.autopilot.ended and joined.vehicle.summary().flight_time_s == 0.0
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and "ms late, 450 ms at most" in fault


def test_a_link_that_becomes_too_late_is_withdrawn_from() -> None:
    between = Injector(Link(there=0.02, back=0.02))
    joined = Joined(SQUARE, injector=between, remembers=False)
    joined.fly(until=lambda joined: joined.vehicle.time_ns > 8 * 10**9)
    assert joined.autopilot.supervisor.state is State.FLY
    between.link = Link(there=0.3, back=0.3)
    joined.fly(limit_s=40.0)
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and ("ms late, 450 ms at most" in fault or "telemetry lost" in fault)
    assert joined.vehicle.summary().outcome == "landed" and steepest_deg(joined) < TILT_DEG


def test_a_link_that_becomes_late_in_flight_is_flown_on() -> None:
    between = Injector(Link(there=0.02, back=0.02))
    joined = Joined(SQUARE, injector=between, remembers=False)
    joined.fly(until=lambda joined: joined.vehicle.time_ns > 8 * 10**9)
    between.link = Link(there=0.15, back=0.15)
    joined.fly(limit_s=0.3)
    assert joined.autopilot.link.delays.known.total == pytest.approx(0.3, abs=0.02), "no round trip could tell yet"
    joined.fly(limit_s=8.0)
    assert joined.autopilot.supervisor.state is State.FLY and joined.autopilot.supervisor.fault is None
    assert steepest_deg(joined) < TILT_DEG


class CommandsLost(Injector):
    """No command reaches the vehicle while `lost`; setpoints do."""

    lost = False

    def to_vehicle(self, data: bytes, now_ns: int) -> None:
        frames = Framer().datagram(data)
        kept = [each.raw for each in frames if not self.lost or each.message_id != dialect.MAVLINK_MSG_ID_COMMAND_LONG]
        super().to_vehicle(b"".join(kept), now_ns)


def test_a_vehicle_that_has_not_heard_of_its_landing_comes_to_rest() -> None:
    between = CommandsLost()
    joined = Joined(mission_of("circle"), injector=between, remembers=False)
    joined.fly(until=lambda joined: joined.vehicle.time_ns > 9 * 10**9)
    assert np.linalg.norm(joined.vehicle.motion.velocity_ned) > 1.0
    between.lost = True
    joined.autopilot.handle(LandRequest(joined.vehicle.time_ns))
    joined.fly(limit_s=3.0)
    assert joined.autopilot.supervisor.state is State.LAND
    assert np.linalg.norm(joined.vehicle.motion.velocity_ned) < 0.05 and steepest_deg(joined) < TILT_DEG
    between.lost = False
    joined.fly(until=lambda joined: not joined.autopilot.supervisor.streams, limit_s=3.0)
    heard = len(joined.traces)
    joined.fly()
    assert len(joined.traces) == heard, "setpoints went on in the landing mode"
    assert joined.vehicle.summary().outcome == "landed"
