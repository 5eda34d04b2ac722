"""The mission step by step, without a vehicle: arrival, release, time."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mission import plan as missions
from companion.mission.navigator import Arrival, Navigator
from companion.mission.orders import obey
from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.reports import CommandReport, MotionReport
from companion.runtime.files import load_mission
from companion.state import Ground, Severity
from protocol.arrays import Array
from tests.companion.mission.navigating import (
    ACCEPTED,
    ALONG,
    CURVE_S,
    DEFAULTS,
    MISSIONS,
    ROUTE,
    SECOND,
    START,
    at_step,
    before,
    navigator_of,
    overdue,
    target_of,
    vehicle,
)

# -- the steps ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_goes_from_preparing_to_the_landing(name: str) -> None:
    mission = load_mission(name)[0]
    navigator = before(mission)
    assert navigator.phase is Phase.PREPARE and not navigator.report(0, flying=False).done
    navigator.begin(START)
    expected = missions.steps(mission, START)
    assert navigator.phase is expected[0].phase is Phase.TAKEOFF and expected[-1].phase is Phase.LAND
    assert navigator.ground_down == START[2]
    place, now, said = START, 0, []
    while navigator.phase is not Phase.LAND:
        leg = navigator.leg(place)
        assert leg.index == navigator.step_index == len(said) and leg.step is navigator.step
        assert (leg.step.phase, leg.speed, leg.waits) == (expected[leg.index].phase, mission.speed, False)
        assert not navigator.report(now, flying=True).done
        if leg.step.target_ned is None:
            assert navigator.release(ACCEPTED)[0] is Arrival.DONE
            assert np.array_equal(leg.goal_ned, place), "where it is, without a target"
        else:
            assert np.array_equal(leg.goal_ned, leg.step.target_ned)
            assert np.array_equal(leg.goal_ned, np.asarray(expected[leg.index].target_ned))
            place = leg.goal_ned
        now += SECOND
        said.append(navigator.next_step(now).text)
    names = [step.phase.name.lower() for step in expected]
    assert said == [f"{name}, step {k + 1} of {len(expected)}" for k, name in enumerate(names) if k]
    assert navigator.released == (mission.delivery is not None)
    assert navigator.report(now, flying=True).done
    assert navigator.phase is Phase.LAND
    navigator.end()
    assert navigator.phase is Phase.DONE


def test_a_mission_that_ends_before_its_start_is_done() -> None:
    navigator = before(ROUTE)
    navigator.end()
    assert navigator.phase is Phase.DONE and not navigator.report(0, flying=False).done


def test_the_ground_is_below_where_returns_count() -> None:
    navigator = navigator_of(ROUTE, "avoidance.ground_height=0.75")
    assert navigator.lowest_return == START[2] - 0.75


# -- arrival -----------------------------------------------------------------------------------------------------------

NEAR, SLOW = DEFAULTS.trajectory.settled_distance, DEFAULTS.trajectory.settled_speed
DIRECTIONS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda way: math.hypot(*way) > 0.1)


def along(way: tuple[float, ...], length: float) -> Array:
    return np.array(way) * (length / math.hypot(*way))


@settings(max_examples=100)
@given(
    way=DIRECTIONS,
    moves=DIRECTIONS,
    distance=st.floats(0.0, 3.0 * NEAR),
    speed=st.floats(0.0, 3.0 * SLOW),
)
def test_a_stop_is_reached_near_to_it_and_slowly(
    way: tuple[float, ...], moves: tuple[float, ...], distance: float, speed: float
) -> None:
    """In three dimensions, and not by one of the two alone."""
    navigator = navigator_of(ROUTE)
    place = target_of(navigator) + along(way, distance)
    north, east, down = along(moves, speed).tolist()
    arrival = navigator.advance(ALONG, vehicle(place, (north, east, down)), 0)
    if abs(distance - NEAR) > 1e-6 and abs(speed - SLOW) > 1e-6:
        assert arrival is (Arrival.DONE if distance < NEAR and speed < SLOW else Arrival.NOT_YET)


def test_a_stop_is_held_for_its_time_from_the_first_arrival_on() -> None:
    """Once there, the vehicle may be blown away a little: the reference holds it."""
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    assert navigator.step.hold_s == 2.0 and not navigator.step.passes
    target = target_of(navigator)
    assert navigator.advance(ALONG, vehicle(np.add(target, (1.0, 0.0, 0.0))), 0) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(target), SECOND) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(np.add(target, (1.0, 0.0, 0.0))), 3 * SECOND - 1) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(target), 3 * SECOND) is Arrival.DONE


def test_an_arrival_counts_for_its_own_step_alone() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    navigator.advance(ALONG, vehicle(target_of(navigator)), 0)
    navigator.next_step(SECOND)
    assert navigator.advance(ALONG, vehicle(START), 60 * SECOND) is Arrival.NOT_YET


@settings(max_examples=100)
@given(way=DIRECTIONS, distance=st.floats(0.0, 4.0), speed=st.floats(0.0, 10.0))
def test_a_waypoint_that_is_passed_is_reached_by_its_radius_alone(
    way: tuple[float, ...], distance: float, speed: float
) -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    assert navigator.step.passes
    place = target_of(navigator) + along(way, distance)
    radius = DEFAULTS.trajectory.acceptance_radius
    arrival = navigator.advance(ALONG, vehicle(place, (speed, 0.0, 0.0)), 0)
    if abs(distance - radius) > 1e-6:
        assert arrival is (Arrival.DONE if distance < radius else Arrival.NOT_YET)


def test_where_the_reference_jumps_nothing_is_waited_for_but_the_hold() -> None:
    mission = load_mission("step")[0]
    navigator = at_step(mission, Phase.ROUTE)
    hold_ns = round(navigator.step.hold_s * SECOND)
    far = vehicle(np.add(target_of(navigator), (50.0, 0.0, 0.0)), (9.0, 0.0, 0.0))
    assert navigator.advance(ALONG, far, SECOND) is Arrival.NOT_YET
    assert navigator.advance(ALONG, far, SECOND + hold_ns - 1) is Arrival.NOT_YET
    assert navigator.advance(ALONG, far, SECOND + hold_ns) is Arrival.DONE


def to_join(place: Array, *, rests: bool) -> MotionReport:
    return MotionReport(following=False, rests=rests, track_start_ned=place, over_map=False)


def following(*, rests: bool) -> MotionReport:
    return MotionReport(following=True, rests=rests, track_start_ned=None, over_map=False)


def test_a_track_is_joined_settled_and_at_rest_and_done_at_its_end() -> None:
    navigator = at_step(load_mission("circle")[0], Phase.TRACK)
    start = np.add(target_of(navigator), (3.0, 0.0, 0.0))  # of what is left of it: not where the step begins
    there = vehicle(start)
    for motion, state in (
        (to_join(start, rests=True), vehicle(target_of(navigator))),
        (to_join(start, rests=True), vehicle(start, (0.5, 0.0, 0.0))),
        (to_join(start, rests=False), there),
    ):
        assert navigator.advance(motion, state, 0) is Arrival.NOT_YET
    assert navigator.advance(to_join(start, rests=True), there, SECOND) is Arrival.AT_TRACK
    for now in (2, 30):
        assert navigator.advance(following(rests=False), there, now * SECOND) is Arrival.NOT_YET
    assert navigator.advance(following(rests=True), vehicle(START, (9.0, 0.0, 0.0)), 40 * SECOND) is Arrival.DONE


def test_an_arrival_at_a_track_does_not_count_again() -> None:
    """After a hold the track must be joined again, from where it was left."""
    navigator = at_step(load_mission("circle")[0], Phase.TRACK)
    start = target_of(navigator)
    assert navigator.advance(to_join(start, rests=True), vehicle(start), 0) is Arrival.AT_TRACK
    away = vehicle(np.add(start, (5.0, 0.0, 0.0)))
    assert navigator.advance(to_join(start, rests=True), away, SECOND) is Arrival.NOT_YET


# -- the release -------------------------------------------------------------------------------------------------------


def test_a_release_that_is_accepted_is_done() -> None:
    navigator = at_step(ROUTE, Phase.RELEASE)
    assert navigator.release(CommandReport(False, 1, "no answer")) == (Arrival.NOT_YET, None)
    assert not navigator.released
    arrival, said = navigator.release(ACCEPTED)
    assert arrival is Arrival.DONE and navigator.released
    assert said is not None and (said.severity, said.text) == (Severity.NOTICE, "parcel released")


def test_a_parcel_that_is_not_released_is_taken_home() -> None:
    navigator = at_step(ROUTE, Phase.RELEASE)
    tries = DEFAULTS.supervision.command_tries
    assert navigator.release(CommandReport(False, tries, "denied")) == (Arrival.NOT_YET, None)
    arrival, said = navigator.release(CommandReport(False, tries + 1, "denied"))
    assert arrival is Arrival.DONE and not navigator.released
    assert said is not None and (said.severity, said.text) == (Severity.ERROR, "parcel not released: denied")


def test_an_answer_that_comes_with_the_last_try_counts() -> None:
    navigator = at_step(ROUTE, Phase.RELEASE)
    tries = DEFAULTS.supervision.command_tries
    assert navigator.release(CommandReport(True, tries + 1, "accepted"))[0] is Arrival.DONE and navigator.released


@pytest.mark.parametrize(("released", "delivered"), [(0, False), (1, False), (2, True)])
def test_a_mission_is_delivered_with_its_last_parcel(released: int, delivered: bool) -> None:
    two = Mission("two", waypoints=[Waypoint(float(north), 0.0, 3.0, release=True) for north in (10, 20)])
    navigator = at_step(two, Phase.RELEASE)
    for answer in [ACCEPTED] * released + [CommandReport(False, 9, "denied")] * (2 - released):
        assert navigator.release(answer)[0] is Arrival.DONE
    assert missions.all_delivered(two, navigator.steps, navigator.released) is delivered


# -- time --------------------------------------------------------------------------------------------------------------


def test_a_step_is_overdue_after_its_way_its_hold_and_some_time_on_top() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    navigator.start_step(10 * SECOND)
    way = math.dist((10.0, 0.0), (20.0, 5.0))
    allowed = DEFAULTS.supervision.step_timeout + 2.0 + 3.0 * way / ROUTE.speed
    assert overdue(navigator, 10.0 + allowed - 0.01) == 0.0
    assert overdue(navigator, 10.0 + allowed + 5.0) == pytest.approx(5.0)
    assert navigator.report(round((10.0 + allowed + 5.0) * SECOND), flying=False).overdue == 0.0


def test_a_track_may_take_three_times_its_own_time() -> None:
    """Who can't keep up with it flies it slower."""
    navigator = at_step(load_mission("circle")[0], Phase.TRACK)
    assert navigator.step_index == 1
    way = math.dist(navigator.steps[0].target_ned, navigator.steps[1].target_ned)  # type: ignore[arg-type]
    allowed = DEFAULTS.supervision.step_timeout + 3.0 * CURVE_S + 3.0 * way / navigator.mission.speed
    assert overdue(navigator, allowed - 0.01) == 0.0 and overdue(navigator, allowed + 1.0) == pytest.approx(1.0)


def test_each_step_has_its_own_time() -> None:
    navigator = navigator_of(ROUTE)
    navigator.start_step(0)
    climb_s = ROUTE.takeoff_height / DEFAULTS.trajectory.climb_speed
    allowed = DEFAULTS.supervision.step_timeout + 3.0 * climb_s
    assert overdue(navigator, 100.0) == pytest.approx(100.0 - allowed)
    assert navigator.report(0, flying=True).allowed == pytest.approx(allowed), "up from the ground"
    navigator.next_step(100 * SECOND)
    assert overdue(navigator, 100.0) == 0.0


def test_a_fast_mission_may_sink_as_slowly_as_it_does() -> None:
    high = Mission(
        "high", waypoints=[Waypoint(5.0, 0.0, 100.0)], takeoff_height=100.0, delivery=Delivery(0.5), speed=10.0
    )
    allowed = at_step(high, Phase.DESCEND).report(0, flying=True).allowed
    assert allowed == pytest.approx(DEFAULTS.supervision.step_timeout + 3.0 * 99.5 / DEFAULTS.trajectory.descent_speed)


def test_the_time_that_others_fly_counts_for_nothing() -> None:
    navigator = navigator_of(ROUTE)
    navigator.start_step(0)
    navigator.pause(20 * SECOND)
    navigator.resume(1020 * SECOND)
    allowed = navigator.report(0, flying=True).allowed
    assert overdue(navigator, 1000.0 + allowed - 0.01) == 0.0
    assert overdue(navigator, 1001.0 + allowed) == pytest.approx(1.0)


def test_after_a_pause_a_stop_is_reached_again() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    navigator.advance(ALONG, vehicle(target_of(navigator)), 0)
    navigator.pause(SECOND)
    navigator.resume(100 * SECOND)
    assert navigator.advance(ALONG, vehicle(START), 101 * SECOND) is Arrival.NOT_YET


def flown_along(mission: Mission, phase: Phase, north: float) -> Navigator:
    """At the first step of a phase, having flown north at 3 m for so long."""
    navigator = at_step(mission, phase)
    for there in np.arange(0.0, north, 0.5):
        navigator.report(0, vehicle(np.add(START, (there, 0.0, -3.0))), flying=True)
    return navigator


LONG_WAY = Mission(name="long", waypoints=[Waypoint(200.0, 0.0, 3.0)], speed=4.0)


def test_home_is_the_way_it_came_and_down_again() -> None:
    navigator = flown_along(LONG_WAY, Phase.ROUTE, 100.0)
    here = np.add(START, (100.0, 0.0, -3.0))
    report = navigator.report(0, vehicle(here), flying=True)
    assert not report.homeward
    assert 100.0 / 4.0 < report.landing_s < 100.0 / 4.0 + 3.0 / 0.5
    said = navigator.go_home(here, SECOND)
    assert "return" in said.text and navigator.report(0, vehicle(here), flying=True).homeward
    rest = navigator.steps[navigator.step_index :]
    assert [step.phase for step in rest] == [Phase.RETURN, Phase.LAND]
    assert rest[0].target_ned is not None and rest[0].target_ned.tolist() == np.add(START, (0, 0, -3.0)).tolist()


def test_from_the_take_off_home_is_below() -> None:
    navigator = navigator_of(LONG_WAY)
    navigator.go_home(np.add(START, (0.0, 0.0, -1.0)), 0)
    assert navigator.report(0, flying=True).done


def test_from_the_delivery_it_climbs_before_it_flies_home() -> None:
    navigator = at_step(ROUTE, Phase.DESCEND)
    navigator.go_home(np.add(target_of(navigator), (0.0, 0.0, -1.0)), 0)
    assert navigator.phase is Phase.CLIMB and not navigator.released
    phases = [step.phase for step in navigator.steps[navigator.step_index :]]
    assert Phase.RELEASE not in phases and phases[-2:] == [Phase.RETURN, Phase.LAND]


@pytest.mark.parametrize(("phase", "homeward"), [(Phase.DESCEND, False), (Phase.RELEASE, False), (Phase.CLIMB, True)])
def test_after_the_last_delivery_the_mission_leads_home(phase: Phase, homeward: bool) -> None:
    """A battery that gets low then is said, and cuts nothing: the parcel is delivered."""
    navigator = at_step(ROUTE, phase)
    assert navigator.report(0, vehicle(np.add(START, (9.0, 0.0, -1.0))), flying=True).homeward is homeward


def test_between_two_deliveries_it_does_not() -> None:
    two = [Waypoint(9.0, 0.0, 3.0, release=True), Waypoint(20.0, 0.0, 3.0)]
    navigator = at_step(msgspec.structs.replace(ROUTE, waypoints=two), Phase.RELEASE)
    assert not navigator.report(0, vehicle(np.add(START, (9.0, 0.0, -3.0))), flying=True).homeward


@pytest.mark.parametrize("lands", [False, True])
def test_a_vehicle_that_is_only_landed_leaves_no_fence_by_its_mission(lands: bool) -> None:
    navigator = Navigator(DEFAULTS, ROUTE, [None] * len(missions.steps(ROUTE, START)), lands=lands)
    outside = navigator.report(0, outside="route at north 9.0", flying=False).outside
    assert outside == (None if lands else "route at north 9.0")


@pytest.mark.parametrize(("north", "homeward"), [(90.0, False), (110.0, True)])
def test_a_mission_that_does_not_return_lands_where_it_is_nearer(north: float, homeward: bool) -> None:
    one_way = msgspec.structs.replace(LONG_WAY, return_home=False)
    navigator = flown_along(one_way, Phase.ROUTE, north)
    report = navigator.report(0, vehicle(np.add(START, (north, 0.0, -3.0))), flying=True)
    assert report.homeward is homeward
    assert report.landing_s == pytest.approx(90.0 / 4.0 + 3.0 / 0.7, abs=1.0)


HOLD_S = 120.0
STATION = Mission(
    "station",
    waypoints=[Waypoint(40.0, 0.0, 3.0, hold_s=HOLD_S), Waypoint(0.0, 0.0, 3.0)],
    return_home=False,
    speed=4.0,
)
"""As a ground station's that ends with a return to launch."""


@pytest.mark.parametrize(("held_s", "homeward"), [(0.0, False), (100.0, False), (HOLD_S, True)])
def test_who_holds_before_the_way_home_is_not_on_it(held_s: float, homeward: bool) -> None:
    navigator = flown_along(STATION, Phase.ROUTE, 40.0)
    there = target_of(navigator)
    resting = msgspec.structs.replace(ALONG, rests=True)
    assert navigator.advance(resting, vehicle(there), 0) is Arrival.NOT_YET
    report = navigator.report(round(held_s * SECOND), vehicle(there), flying=True)
    assert report.homeward is homeward
    assert report.landing_s == pytest.approx(40.0 / 4.0 + 3.0 / 0.7, abs=0.5)


def test_who_waits_for_orders_is_on_no_way_home() -> None:
    waits = Mission("waits", waypoints=[Waypoint(0.0, 10.0, 3.0)], waits=True, return_home=False)
    navigator = at_step(waits, Phase.WAIT)
    assert not navigator.report(0, vehicle(target_of(navigator)), flying=True).homeward


def test_the_way_home_is_flown_at_the_mission_s_speed_not_the_leg_s() -> None:
    quick = Mission("quick", waypoints=[Waypoint(40.0, 0.0, 3.0, speed=8.0)], speed=1.5)
    report = at_step(quick, Phase.ROUTE).report(0, vehicle(np.add(START, (40.0, 0.0, -3.0))), flying=True)
    assert report.landing_s == pytest.approx(40.0 / 1.5 + 3.0 / 0.7)


def test_the_way_home_is_slow_where_the_vehicle_has_to_be() -> None:
    navigator, here = at_step(LONG_WAY, Phase.ROUTE), vehicle(np.add(START, (40.0, 0.0, -3.0)))
    quick = navigator.report(0, here, flying=True).landing_s - 3.0 / 0.7
    navigator.slow_down(DEFAULTS.trajectory.blind_way / (0.5 * LONG_WAY.speed))
    assert navigator.report(0, here, flying=True).landing_s - 3.0 / 0.7 == pytest.approx(2.0 * quick)


def test_from_low_under_a_high_route_it_climbs_and_sinks_again() -> None:
    high = Mission(
        "high", waypoints=[Waypoint(20.0, 0.0, 40.0)], takeoff_height=40.0, delivery=Delivery(0.5), speed=5.0
    )
    navigator = at_step(high, Phase.RELEASE)
    low = np.add(START, (20.0, 0.0, -0.5))
    report = navigator.report(0, vehicle(low), flying=True)
    assert report.landing_s == pytest.approx(39.5 / DEFAULTS.trajectory.climb_speed + 40.0 / 0.7, abs=0.1)


@pytest.mark.parametrize("height", [2.0, 3.9, 8.0])
def test_given_back_well_above_its_route_it_keeps_that_height_up_to_a_stop(height: float) -> None:
    """What is below was not seen."""
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.pause(0)
    here = np.add(START, (2.0, 0.0, -height))
    navigator.resume(SECOND)
    said = navigator.go_on(here, SECOND)
    flown = height if height > 4.0 else 3.0
    assert (said is not None and "keeping 8.0 m of height" in said.text) is (height > 4.0)
    for passed in (False, True):
        if passed:  # through the first waypoint, to the second, which is 4 m high
            navigator.next_step(SECOND, here)
            flown = max(flown, 4.0)
        leg = navigator.leg(here)
        assert START[2] - leg.goal_ned[2] == pytest.approx(flown)
    navigator.next_step(SECOND, here)
    assert START[2] - navigator.leg(here).goal_ned[2] == pytest.approx(3.0), "after the stop"


def test_it_keeps_no_height_beyond_the_fence() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE, "geofence.max_height=6.0", "geofence.margin=0.5")
    navigator.pause(0)
    navigator.resume(SECOND)
    navigator.go_on(np.add(START, (2.0, 0.0, -8.0)), SECOND)
    assert START[2] - navigator.leg(START).goal_ned[2] == pytest.approx(5.5)


@pytest.mark.parametrize("late_s", [0.0, 0.2, 0.5])
def test_over_a_late_link_it_goes_no_farther_blind(late_s: float) -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    most = DEFAULTS.trajectory.blind_way / late_s if late_s else math.inf
    navigator.slow_down(0.4)
    navigator.slow_down(late_s)
    assert navigator.leg(START).speed == pytest.approx(min(ROUTE.speed, most))


def test_orders_on_shifted_ground_keep_the_height_and_deliver_above_it() -> None:
    """On a hill of 3.6 m: what is ordered from where the vehicle waits is shifted once."""
    waits = Mission("waits", waypoints=[Waypoint(32.0, 0.0, 3.0)], waits=True)
    navigator = at_step(waits, Phase.WAIT, "avoidance.ground_slope=0.25")
    hill = START[2] - 3.6
    here = np.add(START, (32.0, 0.0, -6.6))
    navigator.follow(Ground(hill, hill), here, SECOND)
    for number in range(3):
        obey('{"do": "hold"}', navigator, here, None, number * SECOND)
        assert target_of(navigator)[2] == pytest.approx(here[2])
    obey('{"do": "deliver"}', navigator, here, None, 3 * SECOND)
    assert navigator.phase is Phase.DESCEND and target_of(navigator)[2] == pytest.approx(
        hill - Delivery().release_height
    )
    obey('{"do": "hold"}', navigator, here, None, 4 * SECOND)
    assert target_of(navigator)[2] == pytest.approx(here[2]), "from wherever it is"
