"""The reference along a straight leg and a track: no jumps, within its limits, and where it was sent."""

import math
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission import plan as missions
from companion.mission.navigator import Arrival, Leg
from companion.mission.plan import Phase, Step
from companion.reports import MotionReport
from protocol.frames import yaw_of
from tests.companion.reference_flight import (
    CIRCLE,
    DT,
    ROUTE,
    SECOND,
    STEPS,
    ReferenceFlight,
    assert_at_rest,
    assert_same_motion,
    assert_smooth,
    guidance_of,
    leg_to,
    vehicle,
)

# -- begin, hold and jumps ---------------------------------------------------------------------------------------------


@settings(max_examples=50)
@given(
    place=st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    velocity=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
    yaw=st.floats(-math.pi, math.pi),
)
def test_a_hold_is_at_rest_where_the_vehicle_is(
    place: tuple[float, ...], velocity: tuple[float, ...], yaw: float
) -> None:
    guidance, _ = guidance_of(ROUTE)
    state = vehicle(place, velocity, yaw)
    guidance.hold_at(state)
    for time_ns in (0, 7 * SECOND):
        reference = guidance.reference(time_ns)
        assert reference.position_ned.tolist() == list(place)
        assert not reference.rows[1:5].any() and not reference.rows[5, 1:].any()
        assert reference.yaw == yaw_of(state.attitude_ned_frd)


def test_before_the_start_the_decision_is_to_stay() -> None:
    guidance, _ = guidance_of(ROUTE)
    state = vehicle((1.0, 2.0, 0.5))
    guidance.begin(state, state.position_ned)
    decision = guidance.decision
    assert decision.target_ned.tolist() == guidance.reference(0).position_ned.tolist() == [1.0, 2.0, 0.5]
    assert (decision.speed_limit, decision.clearance, decision.blocked) == (ROUTE.speed, math.inf, False)
    assert guidance.free_distance == math.inf


@pytest.mark.parametrize(
    ("passes", "away", "height"), [(False, 30.0, 8.0), (False, 1.0, 3.0), (True, 30.0, 8.0), (True, 1.0, 8.0)]
)
def test_without_a_map_another_height_is_kept_up_to_where_the_vehicle_stops(
    passes: bool, away: float, height: float
) -> None:
    guidance, _ = guidance_of(ROUTE, 'avoidance.method="none"')
    leg = leg_to((60.0, 0.0, -3.0), avoids=True, passes=passes)
    leg = msgspec.structs.replace(leg, goal_ned=np.array([60.0, 0.0, -8.0]))
    state = vehicle((60.0 - away, 0.0, -5.0))
    guidance.begin(state, np.zeros(3))
    guidance.steer(leg, state, 0)
    assert -guidance.reference(60 * SECOND).position_ned[2] == pytest.approx(height, abs=0.01)


def test_another_leg_begins_with_a_decision_of_its_own() -> None:
    flight = ReferenceFlight()
    flight.ranges[[*range(68, 72), *range(5)]] = 6.0
    flight.steer(leg_to((60.0, 0.0, -3.0), avoids=True), 1.0)
    before = flight.guidance.decision
    assert before.blocked
    flight.guidance.begin_leg(msgspec.structs.replace(leg_to((7.0, 8.0, -9.0)), speed=1.3), flight.now)
    decision = flight.guidance.decision
    assert decision.target_ned.tolist() == [7.0, 8.0, -9.0] and not decision.blocked
    assert (decision.speed_limit, decision.clearance) == (1.3, before.clearance)
    nowhere = Leg(Step(Phase.RELEASE), 2, np.array([1.0, 1.0, 1.0]), 4.0, False)
    flight.guidance.begin_leg(nowhere, flight.now)
    assert flight.guidance.decision.target_ned.tolist() == [1.0, 1.0, 1.0], "where it is, without a target"


def test_a_reference_that_jumps_is_at_the_target_at_once() -> None:
    """But for the take-off, which is flown to."""
    flight = ReferenceFlight(STEPS)
    flight.steer(leg_to((0.0, 0.0, -4.0), Phase.TAKEOFF), DT)
    assert flight.reference.position_ned[2] == pytest.approx(-3.0, abs=0.01)
    for target in ((1.0, 0.0, -3.0), (1.0, 1.0, -3.0)):
        leg = leg_to(target, avoids=True)
        motion = flight.guidance.steer(leg, flight.state, flight.now)
        assert flight.reference.position_ned.tolist() == list(target) and not flight.reference.rows[1:5].any()
        assert motion == MotionReport(following=False, rests=True, track_start_ned=None, over_map=False)
        assert flight.guidance.guarded(np.zeros(3), flight.state, leg.step, flight.now, held=False) is None


# -- straight ----------------------------------------------------------------------------------------------------------


def test_a_straight_leg_is_smooth_and_ends_at_rest_at_its_target() -> None:
    flight = ReferenceFlight()
    limits = flight.settings.trajectory
    target = (12.0, -7.0, -5.0)
    flight.steer(leg_to(target), 12.0)
    assert flight.motion == MotionReport(following=False, rests=True, track_start_ned=None, over_map=False)
    assert_smooth(flight.references, limits.acceleration, limits.jerk)
    speeds = [float(np.linalg.norm(reference.velocity_ned)) for reference in flight.references]
    assert 2.0 < max(speeds) <= ROUTE.speed + 1e-6
    assert max(abs(float(reference.velocity_ned[2])) for reference in flight.references) <= limits.climb_speed + 1e-6
    last = flight.references[-1]
    assert last.position_ned == pytest.approx(target, abs=1e-6) and np.abs(last.rows[1:3]).max() < 1e-6


def test_a_straight_leg_is_flown_at_its_own_speed() -> None:
    """Which a late link or a search for another altitude makes less than the mission's."""
    flight = ReferenceFlight()
    flight.steer(msgspec.structs.replace(leg_to((12.0, 0.0, -3.0)), speed=1.5), 8.0)
    speeds = [float(np.linalg.norm(reference.velocity_ned)) for reference in flight.references]
    assert max(speeds) == pytest.approx(1.5, abs=1e-3) and ROUTE.speed > 2.0


@pytest.mark.parametrize("rings", [False, True])
@pytest.mark.parametrize("method", ["none", "paper"])
def test_off_the_map_a_leg_is_flown_at_its_own_speed(method: str, rings: bool) -> None:
    """As it is now, with and without anything that is seen: a late link may slow it down, and be in time again."""
    flight = ReferenceFlight(ROUTE, f"avoidance.method={method}")
    leg = leg_to((200.0, 0.0, -3.0), avoids=True)
    flight.guidance.begin_leg(msgspec.structs.replace(leg, speed=1.5), flight.now)
    for speed in (1.5, 3.0, 1.0, 2.0) if method == "none" or rings else (1.5, 1.0):
        for tick in range(2000):
            now = msgspec.structs.replace(leg, speed=speed)
            if rings and tick % 16 == 0:
                flight.see(now)
            flight.guidance.steer(now, flight.state, flight.now)
            flight.move()
        assert flight.speed == pytest.approx(speed, abs=1e-3)


def test_the_descent_has_a_speed_of_its_own() -> None:
    flight = ReferenceFlight()
    flight.steer(leg_to((0.0, 0.0, 5.0), Phase.DESCEND), 6.0)
    fastest = max(float(reference.velocity_ned[2]) for reference in flight.references)
    assert fastest == pytest.approx(flight.settings.trajectory.descent_speed)


@pytest.mark.parametrize("after_s", [0.3, 1.2, 3.0])
def test_a_halt_brakes_from_the_motion_as_it_is(after_s: float) -> None:
    """Without a jump, within twice the jerk of the route, no harder than it was accelerating, and to a standstill."""
    flight = ReferenceFlight()
    limits = flight.settings.trajectory
    leg = leg_to((60.0, 20.0, -6.0))
    flight.steer(leg, after_s)
    before = flight.reference
    flight.guidance.halt(flight.now)
    assert_same_motion(before, flight.reference)
    flight.drift(5.0)
    hardest = max(limits.acceleration, float(np.linalg.norm(before.acceleration_ned)))
    assert_smooth(flight.references, hardest, 2.0 * limits.jerk)
    assert_at_rest(flight.reference)
    stopped = flight.references[-1].position_ned
    flight.steer(leg, 30.0)
    assert_smooth(flight.references, hardest, 2.0 * limits.jerk)
    assert flight.references[-1].position_ned == pytest.approx([60.0, 20.0, -6.0], abs=1e-6)
    assert stopped[0] < 60.0


def test_braking_from_others_begins_with_the_vehicles_own_motion() -> None:
    flight = ReferenceFlight()
    state = vehicle((30.0, -4.0, -8.0), (3.0, -1.0, 0.5))
    flight.guidance.brake_from(state, flight.now)
    assert flight.reference.position_ned == pytest.approx(state.position_ned)
    assert flight.reference.velocity_ned == pytest.approx(state.velocity_ned)
    limits = flight.settings.trajectory
    flight.drift(5.0)
    assert_smooth(flight.references, limits.acceleration, 2.0 * limits.jerk)
    assert_at_rest(flight.reference)


# -- along a track -----------------------------------------------------------------------------------------------------


def track_leg() -> Leg:
    """The circle's own, 1 m east of the vehicle."""
    step = missions.steps(CIRCLE, np.array([0.0, 1.0, 0.0]))[1]
    assert step.curve is not None and step.target_ned is not None
    return Leg(step, 1, step.target_ned, CIRCLE.speed, False)


def joined(flight: ReferenceFlight) -> Leg:
    """Settle where the track begins, and follow it."""
    leg = track_leg()
    flight.steer(leg, 20.0, until=lambda each: each.motion is not None and each.motion.rests)
    assert flight.motion is not None and not flight.motion.following and flight.motion.track_start_ned is not None
    assert flight.state.position_ned == pytest.approx(flight.motion.track_start_ned, abs=1e-6)
    flight.guidance.arrive(Arrival.AT_TRACK, leg, flight.now)
    flight.motion = None
    return leg


def test_a_track_is_flown_from_rest_to_rest() -> None:
    flight = ReferenceFlight(CIRCLE)
    assert flight.guidance.durations[0] is None
    duration = flight.guidance.durations[1]
    assert duration is not None
    leg = joined(flight)
    began = flight.tick
    flight.references.clear()
    flight.steer(leg, 2.0 * duration, until=lambda each: each.motion is not None and each.motion.rests)
    assert flight.motion == MotionReport(following=True, rests=True, track_start_ned=None, over_map=False)
    assert (flight.tick - began) * DT == pytest.approx(duration, abs=3 * DT)
    speeds = [float(np.linalg.norm(reference.velocity_ned)) for reference in flight.references]
    assert max(speeds) == pytest.approx(4.0, rel=0.01) and speeds[-1] == pytest.approx(0.0, abs=1e-6)
    jumps = [np.abs(late.rows[:2] - early.rows[:2]).max() for early, late in pairwise(flight.references)]
    assert max(jumps) < 0.05
    end = flight.reference.position_ned
    flight.guidance.arrive(Arrival.DONE, leg, flight.now)
    assert flight.reference.position_ned == pytest.approx(end) and not flight.reference.rows[1:5].any()
    motion = flight.guidance.steer(leg_to((50.0, 0.0, -3.0)), flight.state, flight.now)
    assert not motion.following and motion.track_start_ned is None, "another leg may follow"


def test_what_is_left_of_a_track_is_taken_up_where_it_was_left() -> None:
    flight = ReferenceFlight(CIRCLE)
    duration, leg = flight.guidance.durations[1], joined(flight)
    assert duration is not None
    flight.steer(leg, 0.5 * duration)
    left = flight.reference
    flight.guidance.halt(flight.now)
    assert_same_motion(left, flight.reference)
    flight.drift(5.0)
    assert_at_rest(flight.reference)
    assert np.linalg.norm(flight.reference.position_ned - left.position_ned) > 0.5, "it brakes past where it left"
    flight.motion = None
    flight.steer(leg, 20.0, until=lambda each: each.motion is not None and each.motion.rests)
    assert flight.motion is not None
    start = flight.motion.track_start_ned
    assert start == pytest.approx(left.position_ned, abs=1e-9) and flight.state.position_ned == pytest.approx(start)
    flight.guidance.arrive(Arrival.AT_TRACK, leg, flight.now)
    began = flight.tick
    flight.motion = None
    flight.steer(leg, 2.0 * duration, until=lambda each: each.motion is not None and each.motion.rests)
    assert (flight.tick - began) * DT < 0.75 * duration
    whole = missions.steps(CIRCLE, np.array([0.0, 1.0, 0.0]))[1]
    assert flight.reference.position_ned == pytest.approx(whole.target_ned, abs=1e-6), "three whole laps"


def test_a_track_that_is_left_twice_is_taken_up_where_it_was_left_last() -> None:
    flight = ReferenceFlight(CIRCLE)
    duration, leg = flight.guidance.durations[1], joined(flight)
    assert duration is not None
    places = []
    for _ in range(2):
        flight.steer(leg, 0.3 * duration)
        places.append(flight.reference.position_ned)
        flight.guidance.halt(flight.now)
        flight.drift(5.0)
        flight.motion = None
        flight.steer(leg, 0.5)
        flight.guidance.halt(flight.now)  # on the way back to the track, of which nothing more is flown
        flight.steer(leg, 20.0, until=lambda each: each.motion is not None and each.motion.rests)
        assert flight.motion is not None
        assert flight.motion.track_start_ned == pytest.approx(places[-1], abs=1e-9)
        flight.guidance.arrive(Arrival.AT_TRACK, leg, flight.now)
    assert np.linalg.norm(places[1] - places[0]) > 1.0


def test_a_track_that_was_left_is_forgotten_with_its_leg() -> None:
    flight = ReferenceFlight(CIRCLE)
    leg = joined(flight)
    flight.steer(leg, 3.0)
    flight.guidance.halt(flight.now)
    flight.guidance.begin_leg(leg, flight.now)
    motion = flight.guidance.steer(leg, flight.state, flight.now)
    assert motion.track_start_ned == pytest.approx(leg.goal_ned), "it begins from its beginning"
