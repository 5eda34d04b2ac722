"""The reference over the map, what is asked of the planner, and what the guard makes of it."""

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from companion.avoidance.guard import Verdict
from companion.mission.navigator import Leg
from companion.mission.plan import Phase
from companion.state import Certainty, Reason, Scan
from protocol.arrays import Array
from tests.companion.reference_flight import (
    BEARINGS,
    DT,
    ROUTE,
    SECOND,
    START,
    ReferenceFlight,
    assert_same_motion,
    guidance_of,
    leg_to,
    vehicle,
)

# -- over the map ------------------------------------------------------------------------------------------------------


FAR = leg_to((60.0, 0.0, -3.0), avoids=True)


@pytest.fixture(scope="module")
def flown() -> Callable[[], ReferenceFlight]:
    """Makes flights that have gone 3 s over the map in open space."""
    ReferenceFlight().steer(FAR, 3.0)  # whatever is compiled is compiled now
    return lambda: ReferenceFlight().steer(FAR, 3.0)


def test_over_the_map_it_goes_where_the_way_leads_within_its_limits(flown: Callable[[], ReferenceFlight]) -> None:
    flight = flown()
    course = flight.settings.avoidance.course
    assert flight.speed > 2.0 and flight.reference.velocity_ned[0] == pytest.approx(flight.speed, rel=0.01)
    assert 5.0 < flight.guidance.free_distance < math.inf
    assert flight.guidance.decision.target_ned[2] == -3.0 and not flight.guidance.decision.blocked
    assert abs(flight.reference.yaw) < 0.01
    rows = np.array([reference.rows for reference in flight.references])
    assert np.hypot(*rows[:, 1, :2].T).max() <= FAR.speed + 1e-6
    assert np.hypot(*rows[:, 2, :2].T).max() <= course.acceleration + 1e-6
    assert np.hypot(*np.diff(rows[:, 2, :2], axis=0).T).max() <= course.jerk * DT + 1e-6
    assert np.abs(np.diff(rows[:, 0], axis=0) - rows[1:, 1] * DT).max() < course.acceleration * DT**2


def test_it_flies_no_faster_than_what_is_seen_free_allows() -> None:
    """By a LiDAR that sees 1.5 m far, at the speed from which the vehicle stops within that."""
    flight = ReferenceFlight()
    flight.sees_m, flight.ranges = 1.5, np.full(72, 1.5)
    flight.steer(FAR, 4.0)
    limit, guard = flight.guidance.decision.speed_limit, flight.settings.avoidance.guard
    free = flight.guidance.free_distance
    assert 0.3 < free < 1.5 and not flight.guidance.decision.blocked
    assert limit * guard.reaction_time + limit**2 / (2.0 * guard.braking) == pytest.approx(free, rel=0.01)
    assert 1.0 < flight.speed < 1.1 * limit < 0.8 * FAR.speed


def test_the_way_is_looked_at_often_but_not_at_each_step(flown: Callable[[], ReferenceFlight]) -> None:
    flight = flown()
    looked = []
    for _ in range(64):
        flight.steer(FAR, DT)
        assert flight.motion is not None
        looked.append(flight.motion.over_map)
    assert 16 <= sum(looked) <= 24 and not any(one and other for one, other in pairwise(looked))


@pytest.mark.parametrize("ending", ["another leg", "halt"])
def test_leaving_the_course_hands_the_motion_over_without_a_jump(ending: str) -> None:
    """Position, velocity and acceleration, in full flight and while it speeds up."""
    for seconds in (0.8, 3.0):
        flight = ReferenceFlight().steer(FAR, seconds)
        before = flight.reference
        assert flight.guidance.free_distance < math.inf
        if ending == "halt":
            flight.guidance.halt(flight.now)
        else:
            flight.guidance.steer(leg_to((4.0, 3.0, -3.0)), flight.state, flight.now)
        assert flight.guidance.free_distance == math.inf
        assert_same_motion(before, flight.reference)
        limits, braking = flight.settings.trajectory, flight.settings.avoidance.guard.braking
        flight.drift(6.0)
        rows = np.array([reference.rows for reference in flight.references[-1500:]])
        assert np.abs(rows[:, 2]).max() <= max(limits.acceleration, braking, np.abs(before.acceleration_ned).max())
        assert np.abs(np.diff(rows[:, 2], axis=0)).max() < 0.5
        assert np.abs(np.diff(rows[:, 1], axis=0)).max() <= np.abs(rows[:, 2]).max() * DT + 1e-9
        assert np.abs(rows[-1, 1:3]).max() < 1e-6


def test_a_leg_on_which_nothing_is_avoided_begins_with_a_stop_within_what_was_seen_free() -> None:
    """There the guard does not brake: an order to deliver, in full flight."""
    flight = ReferenceFlight().steer(FAR, 3.0)
    before, guard = flight.reference, flight.settings.avoidance.guard
    place, speed = float(before.position_ned[0]), flight.speed
    flight.steer(leg_to((place, 0.0, -1.0), Phase.DESCEND), 6.0)
    farthest = max(float(reference.position_ned[0]) for reference in flight.references)
    assert speed > 3.9 and farthest - place < speed**2 / (2.0 * guard.braking) + speed * guard.reaction_time
    assert flight.reference.position_ned == pytest.approx((place, 0.0, -1.0), abs=1e-6)


def test_the_course_begins_with_the_motion_that_there_is() -> None:
    flight = ReferenceFlight()
    flight.steer(leg_to((60.0, 10.0, -3.0)), 1.5)
    before = flight.reference
    flight.see(FAR)
    flight.guidance.steer(FAR, flight.state, flight.now)
    assert flight.guidance.free_distance < math.inf
    assert np.abs(flight.reference.rows[:2] - before.rows[:2]).max() < 1e-9
    change = np.abs(flight.reference.acceleration_ned - before.acceleration_ned).max()
    assert change <= flight.settings.avoidance.course.jerk * DT + 1e-9


def test_a_leg_that_waits_stops_where_it_is_and_changes_its_altitude(flown: Callable[[], ReferenceFlight]) -> None:
    flight = flown()
    waits = Leg(FAR.step, 1, np.array([60.0, 0.0, -6.0]), 2.0, True)
    flight.steer(waits, 6.0)
    assert flight.speed < 0.01 and flight.reference.position_ned[0] < 20.0
    assert flight.reference.position_ned[2] == pytest.approx(-6.0, abs=1e-3)


def test_a_goal_that_is_stopped_at_is_approached_straight() -> None:
    """From less than 2 m away no way over the map is needed; a goal that is passed is always flown to over it."""
    for north, over_map in ((1.9, False), (2.1, True)):
        flight = ReferenceFlight()
        leg = leg_to((north, 0.0, -3.0), avoids=True)
        flight.see(leg)
        assert flight.guidance.steer(leg, flight.state, flight.now).over_map is over_map
    flight = ReferenceFlight()
    leg = leg_to((1.0, 0.0, -3.0), avoids=True, passes=True)
    flight.see(leg)
    assert flight.guidance.steer(leg, flight.state, flight.now).over_map


@pytest.mark.parametrize(("north", "over_map"), [(1.9, True), (0.95, True), (0.5, False)])
def test_what_stands_before_a_near_goal_is_flown_around(north: float, over_map: bool) -> None:
    """But for the last metre: a goal beside an obstacle has it in the way to its end. One in the obstacle is not flown
    to straight even then."""
    flight, leg = ReferenceFlight(), leg_to((north, 0.0, -3.0), avoids=True)
    flight.ranges[[*range(60, 72), *range(13)]] = 1.0
    flight.see(leg)
    assert flight.guidance.decision.blocked
    assert flight.guidance.steer(leg, flight.state, flight.now).over_map is over_map


def test_nothing_moves_before_anything_was_seen() -> None:
    flight = ReferenceFlight()
    for _ in range(500):
        flight.guidance.steer(FAR, flight.state, flight.now)
        flight.move()
    assert np.abs(flight.reference.position_ned - START).max() < 1e-6


# -- requests and plans ------------------------------------------------------------------------------------------------


def ask(flight: ReferenceFlight, leg: Leg) -> "tuple[int, int, Array | None]":
    """Number, time and goal of the request that a scan becomes."""
    known = np.ones(72, np.bool_)
    scan = Scan(flight.now, flight.now // 1000, BEARINGS, np.full(72, 15.0), ~known, known)
    pose = flight.state.position_ned, flight.state.attitude_ned_frd
    request = flight.guidance.look(scan, pose, -0.5, flight.state, leg, flight.now)
    assert request is not None and request.scan is scan and request.pose == pose
    assert (request.ground_down, request.speed, request.in_the_way) == (-0.5, leg.speed, leg.in_the_way)
    assert request.here is flight.state.position_ned and request.velocity is flight.state.velocity_ned
    return request.number, request.asked_ns, request.goal


def test_each_scan_is_one_request_and_a_way_is_asked_for_where_obstacles_are_avoided() -> None:
    flight = ReferenceFlight()
    flight.drift(1.0)
    number, asked_ns, goal = ask(flight, FAR)
    assert (number, asked_ns) == (1, flight.now) and goal is FAR.goal_ned
    assert ask(flight, leg_to((0.0, 0.0, -4.0)))[::2] == (2, None)
    assert ask(flight, replace(FAR, in_the_way=(math.inf, 0.4)))[0] == 3


def test_obstacles_are_asked_for_larger_where_the_vehicle_is_uncertain_of_its_velocity() -> None:
    guidance, _ = guidance_of(ROUTE)
    known = np.ones(72, np.bool_)
    scan, state = Scan(0, 0, BEARINGS, np.full(72, 15.0), ~known, known), vehicle(START)
    uncertain = replace(state, certainty=Certainty(np.square((0.03, 0.13, 0.5))))
    margins = []
    for one in (uncertain, state):
        request = guidance.look(scan, (one.position_ned, one.attitude_ned_frd), -0.5, one, FAR, 0)
        assert request is not None
        margins.append(request.margin)
    assert margins[0] == pytest.approx(0.2) and 0.19 < margins[1] < 0.2


PUSH = np.array([1.0, 0.0, 0.0])


def test_nothing_is_asked_where_there_is_no_map() -> None:
    for method in ("paper", "none"):
        guidance, _ = guidance_of(ROUTE, f"avoidance.method={method}")
        known = np.ones(72, np.bool_)
        scan = Scan(0, 0, BEARINGS, np.full(72, 15.0), ~known, known)
        state = vehicle(START)
        pose = state.position_ned, state.attitude_ned_frd
        assert guidance.look(scan, pose, 0.0, state, FAR, 0) is None
        assert not guidance.over_map and guidance.guarded(PUSH, state, FAR.step, 0, held=False) is None
        assert guidance.decision.target_ned == pytest.approx(FAR.goal_ned), "the method decides at once"


def test_the_map_is_as_old_as_the_scan_of_the_latest_plan() -> None:
    flight = ReferenceFlight()
    assert flight.guidance.map_age(SECOND) == 0.0, "nothing was asked for"
    flight.drift(1.0)
    asked = flight.now
    ask(flight, FAR)
    assert flight.guidance.map_age(asked + SECOND) == 1.0
    flight.drift(1.0)
    ask(flight, FAR)
    assert flight.guidance.map_age(asked + 3 * SECOND) == 3.0, "since the first, until one is answered"
    flight.see(FAR)
    assert flight.guidance.map_age(flight.now + SECOND) == 1.0
    assert flight.results[-1].asked_ns == flight.now


def test_a_plan_says_clearance_and_obstruction_for_the_decision() -> None:
    flight = ReferenceFlight()
    flight.see(FAR)
    decision = flight.guidance.decision
    assert decision.clearance == flight.results[-1].clearance and decision.blocked == flight.results[-1].blocked
    climb = leg_to((0.0, 0.0, -9.0))
    flight.see(climb)
    assert flight.guidance.decision.target_ned is climb.goal_ned
    assert flight.guidance.decision.speed_limit == ROUTE.speed


# -- the fence ---------------------------------------------------------------------------------------------------------

RADIUS = 12.0
INSIDE = leg_to((0.0, 6.0, -3.0), avoids=True)


def begun_at(place: tuple[float, float], *overrides: str) -> ReferenceFlight:
    """A flight that begins at rest at a place, with a circle of a fence around (0, 0)."""
    flight = ReferenceFlight(ROUTE, f"geofence.radius={RADIUS}", *overrides)
    flight.state = vehicle((*place, -3.0))
    flight.guidance.begin(flight.state, np.zeros(3))
    flight.guidance.brake_from(flight.state, flight.now)
    return flight


@pytest.mark.parametrize("beyond", [10.0, 1.5, 0.6, 0.0, -0.1, -0.3, -0.5, -0.7])
def test_from_outside_of_the_fence_it_comes_back(beyond: float) -> None:
    """From far off, from within the band in the map, and from between that and what the reference keeps to; straight
    back, and as the guard lets it."""
    flight = begun_at((RADIUS + beyond, 0.0))
    before = flight.state
    flight.see(INSIDE)
    inwards = flight.guidance.guarded(np.array([-2.0, 0.0, 0.0]), before, INSIDE.step, flight.now, held=False)
    assert inwards is not None and inwards.acceleration_ned[0] <= -2.0 + 1e-9
    flight.steer(INSIDE, 15.0, until=lambda each: math.dist(each.state.position_ned[:2], (0.0, 6.0)) < 0.5)
    assert math.dist(flight.state.position_ned[:2], (0.0, 6.0)) < 0.5 and flight.now < 14 * SECOND
    away = [math.hypot(*reference.position_ned[:2]) for reference in flight.references]
    assert max(away) <= RADIUS + beyond + 0.01


@pytest.mark.parametrize("margin", [0.2, 1.0, 3.0])
def test_what_the_reference_may_reach_is_clear_of_the_fence_in_the_map(margin: float) -> None:
    """Whatever the margin is, the guard lets the vehicle stand where the mission may have a waypoint."""
    at = RADIUS - margin
    flight = begun_at((at, 0.0), f"geofence.margin={margin}")
    flight.see(leg_to((at, 0.0, -3.0), avoids=True))
    room = flight.planning.local_map.clearance(flight.state.position_ned)
    settings = flight.settings.avoidance
    assert room + settings.vehicle_radius > settings.guard.keep_out
    for _ in range(5):
        flight.see(leg_to((at, 0.0, -3.0), avoids=True))
        found = flight.guidance.guarded(np.zeros(3), flight.state, FAR.step, flight.now, held=False)
        assert found is not None and found.reason is Reason.NONE


# -- the guard ---------------------------------------------------------------------------------------------------------


def test_the_guard_has_the_last_word_where_obstacles_are_avoided() -> None:
    """Without anything seen it brakes; on a vertical step, or held, it would only evade."""
    guidance, _ = guidance_of(ROUTE)
    state = vehicle(START)
    for step, held, reason in (
        (FAR.step, False, Reason.STALE),
        (FAR.step, True, Reason.NONE),
        (leg_to((0.0, 0.0, -4.0)).step, False, Reason.NONE),
    ):
        found = guidance.guarded(PUSH, state, step, 0, held=held)
        assert found is not None and found.reason is reason
    unguarded, _ = guidance_of(ROUTE, "avoidance.guard.enabled=false")
    assert unguarded.guarded(PUSH, state, FAR.step, 0, held=False) is None


def verdict(changed: float, acceleration: tuple[float, float, float] = (-3.0, 1.0, 0.0)) -> Verdict:
    return Verdict(np.array(acceleration), changed, Reason.BARRIER)


@pytest.mark.parametrize("over_map", [True, False])
def test_the_reference_gives_in_where_the_guard_changes_much(
    flown: Callable[[], ReferenceFlight], over_map: bool
) -> None:
    """It moves towards the vehicle, which lags behind it, and not at all where the change is small."""
    flight = flown()
    if not over_map:
        flight.guidance.steer(leg_to((60.0, 0.0, -3.0)), flight.state, flight.now)
    threshold = flight.settings.avoidance.course.yield_threshold
    before = flight.reference
    behind = vehicle(before.position_ned - np.array([0.2, 0.1, 0.0]), before.velocity_ned - np.array([1.0, 0.0, 0.0]))
    flight.guidance.yield_to(verdict(threshold), behind, flight.now)
    assert np.array_equal(flight.reference.rows, before.rows)
    flight.guidance.yield_to(verdict(threshold + 1e-6), behind, flight.now)
    after = flight.reference
    for row, own in ((0, behind.position_ned), (1, behind.velocity_ned)):
        was, now = (np.abs(each.rows[row, :2] - own[:2]) for each in (before, after))
        assert (now <= was + 1e-3).all() and now.max() < 0.99 * was.max()
        between = (after.rows[row, :2] - before.rows[row, :2]) * (own[:2] - before.rows[row, :2])
        assert (between >= -1e-12).all(), "towards the vehicle, not past it"
    assert after.position_ned[2] == pytest.approx(before.position_ned[2])
    assert after.velocity_ned[2] == pytest.approx(before.velocity_ned[2]), "the altitude stays the reference's"


@pytest.mark.parametrize("over_map", [True, False])
def test_the_reference_takes_over_no_more_than_it_may_of_an_emergency(
    flown: Callable[[], ReferenceFlight], over_map: bool
) -> None:
    """The barriers of what is too near ask for 30 m/s2; a reference that took them over would go on backwards."""
    flight = flown()
    if not over_map:
        flight.guidance.steer(leg_to((60.0, 0.0, -3.0)), flight.state, flight.now)
    most = flight.settings.avoidance.course.max_yield
    taken = []
    for _ in range(50):
        if over_map:
            flight.guidance.steer(FAR, flight.state, flight.now)
        flight.guidance.yield_to(verdict(27.0, (-30.0, 0.0, 0.0)), flight.state, flight.now)
        taken.append(math.hypot(*flight.reference.acceleration_ned[:2]))
        flight.move()
    assert 0.3 * most < max(taken) <= most + 1e-6


@pytest.mark.parametrize("late_ns", [2_000_000, 50_000_000])
def test_the_altitude_runs_no_faster_while_the_reference_gives_in(late_ns: int) -> None:
    """On a descent with something moving around it, however late a command takes effect."""
    flight, descent = ReferenceFlight(), leg_to((0.0, 0.0, 15.0), Phase.DESCEND)
    flight.steer(descent, 2.0)
    heights = []
    for _ in range(100):
        flight.guidance.steer(descent, flight.state, flight.now)
        flight.guidance.reference(flight.now + late_ns)
        flight.guidance.yield_to(verdict(3.0), flight.state, flight.now)
        heights.append(float(flight.reference.position_ned[2]))
        flight.move()
    assert np.diff(heights).max() <= DT * flight.settings.trajectory.descent_speed + 1e-9
