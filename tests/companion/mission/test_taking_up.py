"""A vehicle that others have flown elsewhere: how it takes the mission up again, and in what time."""

import msgspec
import numpy as np
import pytest

from companion.mission.navigator import Arrival, Navigator
from companion.mission.orders import Order, obey
from companion.mission.plan import Delivery, Mission, Phase, Step, Waypoint, nearest_step, steps
from companion.state import NO_FENCE
from protocol.arrays import Array
from tests.companion.mission.navigating import ALONG, DEFAULTS, ROUTE, SECOND, START, at_step, before, vehicle

RELEASES = Mission("releases", waypoints=[Waypoint(10.0, 0.0, 3.0, release=True), Waypoint(20.0, 0.0, 3.0)])
ENDS_THERE = msgspec.structs.replace(ROUTE, return_home=False)
STEP_TIMEOUT = DEFAULTS.supervision.step_timeout


def at(north: float, east: float, height: float) -> Array:
    """A place (3,) so far from the start."""
    place: Array = START + np.array((north, east, -height))
    return place


def given_back(mission: Mission, phase: Phase, here: Array) -> Navigator:
    """In that phase a pilot took the vehicle over, and gave it back 100 s later at a place (3,)."""
    navigator = at_step(mission, phase)
    navigator.pause(SECOND)
    navigator.resume(101 * SECOND)
    navigator.go_on(here, 102 * SECOND)
    return navigator


def flown(navigator: Navigator, until: Phase) -> list[Step]:
    """What is flown from now on up to the first step of a phase, that included."""
    said = [navigator.step]
    while navigator.phase is not until:
        navigator.next_step(200 * SECOND)
        said.append(navigator.step)
    return said


def places(legs: list[Step]) -> list[tuple[Phase, bool, list[float] | None]]:
    """Phase, whether obstacles are flown around, and place from the start (north, east, height)."""
    told = []
    for leg in legs:
        there = None if leg.target_ned is None else ((leg.target_ned - START) * (1.0, 1.0, -1.0)).round(6).tolist()
        told.append((leg.phase, leg.avoids, there))
    return told


def route_to(north: float, east: float, height: float) -> tuple[Phase, bool, list[float]]:
    return Phase.ROUTE, True, [north, east, height]


def up_to(north: float, east: float, height: float) -> tuple[Phase, bool, list[float]]:
    return Phase.CLIMB, False, [north, east, height]


DOWN = Phase.DESCEND, False, [40.0, 5.0, 0.5]
LET_GO = Phase.RELEASE, False, None


@pytest.mark.parametrize("phase", [Phase.DESCEND, Phase.RELEASE])
@pytest.mark.parametrize("height", [3.0, 18.0])
def test_the_parcel_is_released_at_its_place_and_height_alone(phase: Phase, height: float) -> None:
    navigator = given_back(ROUTE, phase, at(40.0, 23.0, height))
    assert places(flown(navigator, Phase.RELEASE)) == [route_to(40.0, 5.0, 3.0), DOWN, LET_GO]
    navigator.next_step(300 * SECOND)
    assert places([navigator.step]) == [up_to(40.0, 5.0, 3.0)]


def test_a_vehicle_that_is_low_elsewhere_climbs_before_it_goes_anywhere() -> None:
    navigator = given_back(ROUTE, Phase.DESCEND, at(30.0, 5.0, 0.8))
    there = [up_to(30.0, 5.0, 3.0), route_to(40.0, 5.0, 3.0), DOWN]
    assert places(flown(navigator, Phase.DESCEND)) == there


def test_above_its_place_the_parcel_is_brought_down_again() -> None:
    navigator = given_back(ROUTE, Phase.RELEASE, at(40.2, 5.0, 2.0))
    assert places(flown(navigator, Phase.RELEASE)) == [DOWN, LET_GO]


def test_a_parcel_that_is_released_at_a_waypoint_is_brought_there_again() -> None:
    navigator = given_back(RELEASES, Phase.RELEASE, at(10.0, 30.0, 3.0))
    assert places(flown(navigator, Phase.RELEASE)) == [route_to(10.0, 0.0, 3.0), LET_GO]


@pytest.mark.parametrize(
    ("mission", "height", "expected"),
    [
        (ROUTE, 1.0, [up_to(0.0, 50.0, 3.0), (Phase.RETURN, True, [20.0, 5.0, 4.0])]),
        (ROUTE, 9.0, [(Phase.RETURN, True, [20.0, 5.0, 4.0])]),
        (ENDS_THERE, 1.0, [up_to(0.0, 50.0, 3.0), route_to(40.0, 5.0, 3.0), (Phase.LAND, False, None)]),
        (ENDS_THERE, 9.0, [route_to(40.0, 5.0, 3.0), (Phase.LAND, False, None)]),
    ],
)
def test_after_the_delivery_it_climbs_straight_up_wherever_it_is(
    mission: Mission, height: float, expected: list[tuple[Phase, bool, list[float] | None]]
) -> None:
    navigator = given_back(mission, Phase.CLIMB, at(0.0, 50.0, height))
    assert places(flown(navigator, expected[-1][0])) == expected


def test_the_take_off_ends_above_home_around_obstacles() -> None:
    navigator = given_back(ROUTE, Phase.TAKEOFF, at(-20.0, 0.0, 3.0))
    assert places([navigator.step]) == [route_to(0.0, 0.0, 3.0)]
    assert navigator.next_step(200 * SECOND).text.startswith("route, step 2 of")


@pytest.mark.parametrize("phase", [Phase.TAKEOFF, Phase.ROUTE, Phase.DESCEND, Phase.RELEASE, Phase.CLIMB])
def test_a_vehicle_at_its_place_goes_on_as_before(phase: Phase) -> None:
    navigator = at_step(ROUTE, phase)
    index, step = navigator.step_index, navigator.step
    place = navigator.steps[index - 1].target_ned if step.target_ned is None else step.target_ned
    assert place is not None
    navigator.pause(SECOND)
    navigator.resume(2 * SECOND)
    assert navigator.go_on(place, 2 * SECOND) is None
    assert (navigator.step_index, navigator.step) == (index, step)


def test_what_was_flown_first_is_left_out_by_an_order_and_by_the_way_home() -> None:
    navigator = given_back(ROUTE, Phase.DESCEND, at(40.0, 23.0, 3.0))
    navigator.fly([Step(Phase.LAND)], 110 * SECOND, at(40.0, 23.0, 3.0))
    assert navigator.phase is Phase.LAND
    navigator = given_back(ROUTE, Phase.DESCEND, at(30.0, 23.0, 1.0))
    assert navigator.phase is Phase.CLIMB
    navigator.go_home(at(30.0, 23.0, 1.5), 110 * SECOND)
    assert places([navigator.step]) == [up_to(30.0, 23.0, 3.0)], "straight up"


def test_a_vehicle_in_the_air_is_not_adopted_in_its_take_off() -> None:
    plan = steps(ROUTE, START)
    assert plan[nearest_step(plan, START, at(-20.0, 0.0, 3.0))].phase is Phase.ROUTE
    assert plan[nearest_step(plan, START, at(0.5, 0.0, 1.0))].phase is Phase.TAKEOFF, "above home"


def test_an_adopted_vehicle_beside_a_descent_comes_there_around_obstacles() -> None:
    navigator = before(ROUTE)
    navigator.adopt(START, at(42.2, 5.0, 0.6), NO_FENCE, SECOND)
    expected = [up_to(42.2, 5.0, 3.0), route_to(40.0, 5.0, 3.0), DOWN]
    assert places(flown(navigator, Phase.DESCEND)) == expected
    assert navigator.advance(ALONG, vehicle(at(40.0, 5.0, 0.5)), 300 * SECOND) is Arrival.DONE


# -- the time that it may take -----------------------------------------------------------------------------------------

FAR = Mission("far", waypoints=[Waypoint(1000.0, 0.0, 30.0), Waypoint(5.0, 5.0, 30.0)], takeoff_height=30.0, speed=4.0)


def allowed(navigator: Navigator) -> float:
    return navigator.report(0, flying=True).allowed


def test_the_way_home_may_take_as_long_as_it_is_from_the_vehicle() -> None:
    navigator = at_step(FAR, Phase.ROUTE)
    navigator.next_step(0)
    navigator.go_home(at(700.0, 0.0, 30.0), SECOND)
    assert allowed(navigator) == pytest.approx(STEP_TIMEOUT + 3.0 * 700.0 / 4.0, abs=1.0)


@pytest.mark.parametrize("phase", [Phase.ROUTE, Phase.DESCEND, Phase.TAKEOFF])
def test_given_back_far_away_it_may_take_the_time_from_there(phase: Phase) -> None:
    navigator = given_back(ROUTE, phase, at(30.0, 605.0, 3.0))
    assert allowed(navigator) > STEP_TIMEOUT + 3.0 * 595.0 / ROUTE.speed
    assert navigator.report(102 * SECOND + round(STEP_TIMEOUT * 1e9), flying=True).overdue == 0.0


def test_adopted_far_away_it_may_take_the_time_from_there() -> None:
    navigator = before(ROUTE)
    navigator.adopt(START, at(0.0, 600.0, 3.0), NO_FENCE, SECOND)
    assert allowed(navigator) > STEP_TIMEOUT + 3.0 * 590.0 / ROUTE.speed


# -- orders ------------------------------------------------------------------------------------------------------------


def test_an_ordered_mission_is_flown_at_its_own_speed() -> None:
    navigator = at_step(Mission("script", waits=True), Phase.WAIT)
    slow = Mission("slow", waypoints=[Waypoint(30.0, 0.0, 3.0), Waypoint(60.0, 0.0, 3.0, speed=2.0)], speed=1.0)
    here = at(0.0, 500.0, 3.0)
    obey(msgspec.json.encode(Order("fly", slow)).decode(), navigator, here, None, SECOND)
    assert navigator.leg(here).speed == 1.0
    assert allowed(navigator) > STEP_TIMEOUT + 3.0 * 500.0 / 1.0, "and may take the time that this takes"
    navigator.next_step(2 * SECOND)
    assert navigator.leg(here).speed == 2.0
    navigator.next_step(3 * SECOND)
    assert navigator.phase is Phase.RETURN and navigator.leg(here).speed == 1.0


def test_a_delivery_by_order_is_begun_where_it_was_ordered() -> None:
    navigator = at_step(Mission("script", waits=True), Phase.WAIT)
    here = at(0.0, 0.0, 3.0)
    obey(msgspec.json.encode(Order("deliver", delivery=Delivery(0.5))).decode(), navigator, here, None, SECOND)
    navigator.pause(2 * SECOND)
    navigator.resume(3 * SECOND)
    navigator.go_on(at(0.0, 18.0, 9.0), 3 * SECOND)
    expected = [route_to(0.0, 0.0, 3.0), (Phase.DESCEND, False, [0.0, 0.0, 0.5])]
    assert places(flown(navigator, Phase.DESCEND)) == expected
