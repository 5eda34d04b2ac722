"""The mission where the vehicle gets no nearer: other altitudes, and giving up."""

import math

import numpy as np
import pytest

from companion.mission.navigator import Arrival, Judgement
from companion.mission.plan import Mission, Phase, Step, Waypoint
from companion.state import EVERY_HEIGHT, Severity
from tests.companion.mission.navigating import (
    ALONG,
    DEFAULTS,
    ON_MAP,
    SECOND,
    START,
    at_step,
    overdue,
    target_of,
    vehicle,
)

# -- giving up ---------------------------------------------------------------------------------------------------------

GIVE_UP_S = DEFAULTS.avoidance.give_up_s


class Flight:
    """A vehicle on the way to the first goal of a mission, judged each tenth of a second."""

    def __init__(self, mission: Mission, *overrides: str) -> None:
        self.navigator = at_step(mission, Phase.ROUTE, *overrides)
        self.now = 0
        self.place = np.add(START, (0.0, 0.0, -3.0))

    def judge(self, seconds: float, speed: float = 0.0, detour: float = 0.0) -> Judgement | None:
        """The first judgement that changes anything, while the vehicle flies north."""
        for _ in range(round(10 * seconds)):
            self.now += SECOND // 10
            self.place = np.add(self.place, (0.1 * speed, 0.0, 0.0))
            self.navigator.report(self.now, vehicle(self.place), flying=True)
            judgement = self.navigator.judge(self.place, detour, self.now)
            if judgement != Judgement():
                return judgement
        return None

    def obey(self, detour: float) -> Judgement:
        """A tenth of a second in which the vehicle stands and is at once at the altitude that is wanted."""
        self.now += SECOND // 10
        judgement = self.navigator.judge(self.place, detour, self.now)
        for _ in range(2):
            self.navigator.advance(ON_MAP, vehicle(self.place), self.now)
            self.place = np.array([*self.place[:2], self.navigator.leg(self.place).goal_ned[2]])
        return judgement


LONG = Mission(name="long", waypoints=[Waypoint(100.0, 0.0, 3.0), Waypoint(100.0, 100.0, 3.0)])


def test_a_goal_is_given_up_after_so_long_without_a_metre_of_progress() -> None:
    flight = Flight(LONG)
    assert flight.judge(15.5, speed=2.0) is None, "to the middle of a square"
    assert flight.judge(GIVE_UP_S - 1.0, speed=0.02) is None
    judgement = flight.judge(3.0, speed=0.0)
    assert judgement is not None and judgement.failure is not None
    assert judgement.failure == "no progress for 40 s: the goal is given up, back the way it came"
    assert [each.text for each in judgement.announcements] == [
        judgement.failure,
        f"return, step 3 of {len(flight.navigator.steps)}",
    ]
    assert judgement.announcements[0].severity is Severity.ERROR


def test_a_metre_nearer_is_progress() -> None:
    flight = Flight(LONG)
    for _ in range(5):
        assert flight.judge(0.9 * GIVE_UP_S) is None
        assert flight.judge(0.1, speed=11.0) is None


def test_farther_and_back_again_is_no_progress() -> None:
    flight = Flight(LONG)
    assert flight.judge(0.1, speed=0.0) is None
    speeds = [-2.0, 2.0] * 10
    assert any(flight.judge(4.0, speed=speed) is not None for speed in speeds)
    assert flight.now == pytest.approx((GIVE_UP_S + 3.1) * SECOND, abs=1.1 * SECOND), "the first time, all was new"


def test_near_to_a_goal_nothing_is_given_up() -> None:
    flight = Flight(LONG)
    flight.place = np.add(target_of(flight.navigator), (1.9, 0.0, 5.0))
    assert flight.judge(3.0 * GIVE_UP_S) is None


def test_the_time_that_others_fly_is_no_lack_of_progress() -> None:
    flight = Flight(LONG)
    assert flight.judge(0.9 * GIVE_UP_S) is None
    flight.navigator.pause(flight.now)
    flight.now += 100 * SECOND
    flight.navigator.resume(flight.now)
    assert flight.judge(0.9 * GIVE_UP_S) is None


def test_a_step_may_take_as_long_as_what_was_explored_needs() -> None:
    """30 m east and west of a straight way of 100 m at 4 m/s, then along it."""
    flight = Flight(LONG)
    allowed = flight.navigator.report(flight.now, flying=True).allowed
    assert allowed == pytest.approx(DEFAULTS.supervision.step_timeout + 3.0 * 100.0 / LONG.speed)
    for east in (*range(30), *range(30, -30, -1), *range(-30, 0)):
        flight.place = np.add(START, (0.0, float(east), -3.0))
        flight.judge(0.1)
    assert flight.navigator.report(flight.now, flying=True).allowed == allowed, "60 m are less"
    flight.judge(40.0, speed=2.0)
    further = 3.0 * (60.0 + 80.0 - 100.0) / LONG.speed
    assert flight.navigator.report(flight.now, flying=True).allowed == pytest.approx(allowed + further, abs=3.0)
    flight.navigator.next_step(flight.now, flight.place)
    away = float(np.linalg.norm(target_of(flight.navigator) - flight.place))
    expected = DEFAULTS.supervision.step_timeout + 3.0 * away / LONG.speed
    assert flight.navigator.report(flight.now, flying=True).allowed <= expected, "of another goal nothing yet"


def test_the_way_home_is_the_trail_backwards_and_then_the_landing() -> None:
    flight = Flight(LONG)
    flight.judge(20.0, speed=1.0)
    before_it = flight.navigator.steps
    flight.judge(2.0 * GIVE_UP_S)
    navigator = flight.navigator
    assert navigator.steps[:2] == before_it[:2] and navigator.step_index == 2
    *back, home, land = navigator.steps[2:]
    assert [step.phase for step in (*back, home, land)] == [Phase.RETURN] * (len(back) + 1) + [Phase.LAND]
    assert all(step.passes and step.avoids for step in back) and home.avoids and not home.passes
    assert home.target_ned is before_it[0].target_ned
    norths = [float(step.target_ned[0]) for step in back if step.target_ned is not None]
    assert norths == sorted(norths, reverse=True) and len(norths) >= 4
    assert max(norths) <= flight.place[0] and min(norths) == pytest.approx(START[0] + 0.1)
    assert navigator.report(flight.now, flying=True) == navigator.report(flight.now, flying=False), "not overdue"


@pytest.mark.parametrize(("speed", "least", "most"), [(1.0, 60.0, 80.0), (LONG.speed, 19.0, 22.0)])
def test_the_way_home_takes_as_long_as_the_way_flown(speed: float, least: float, most: float) -> None:
    """76 m; the last 3 m of height are a landing's."""
    flight = Flight(LONG)
    flight.judge(76.0 / speed, speed=speed)
    report = flight.navigator.report(flight.now, vehicle(flight.place), flying=True)
    assert least < report.landing_s - 3.0 / 0.7 < most


def test_a_station_s_mission_that_ends_at_home_goes_back_there_too() -> None:
    there_and_back = Mission("station", waypoints=[*LONG.waypoints, Waypoint(0.0, 0.0, 3.0)], return_home=False)
    flight = Flight(there_and_back)
    flight.judge(20.0, speed=1.0)
    flight.judge(2.0 * GIVE_UP_S)
    assert [step.phase for step in flight.navigator.steps[-2:]] == [Phase.RETURN, Phase.LAND]


def test_what_is_given_up_twice_is_the_flight() -> None:
    flight = Flight(LONG)
    flight.judge(2.0 * GIVE_UP_S)
    flight.navigator.next_step(flight.now)  # past the trail's one place
    assert flight.navigator.step.phase is Phase.RETURN
    flight.place = np.add(START, (60.0, 0.0, -3.0))
    judgement = flight.judge(2.0 * GIVE_UP_S)
    assert judgement is not None and judgement.failure is not None and judgement.failure.endswith("landing")
    assert flight.navigator.phase is Phase.LAND and flight.navigator.report(flight.now, flying=True).done
    assert flight.navigator.steps[-1] is flight.navigator.step


def test_a_mission_that_does_not_return_ends_where_it_is_given_up() -> None:
    flight = Flight(Mission(name="away", waypoints=[Waypoint(100.0, 0.0, 3.0)], return_home=False))
    judgement = flight.judge(2.0 * GIVE_UP_S)
    assert judgement is not None and "landing" in str(judgement.failure)
    assert flight.navigator.phase is Phase.LAND


# -- other altitudes ---------------------------------------------------------------------------------------------------


def test_the_goal_follows_the_altitude_search() -> None:
    """The vehicle brakes, climbs, looks around and goes on: the goal's altitude, the speed and the wait say so."""
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=6.0", "avoidance.give_up_s=20.0")
    navigator, settings_ = flight.navigator, DEFAULTS.avoidance.altitude_search
    target = target_of(navigator)
    leg = navigator.leg(flight.place)
    assert np.array_equal(leg.goal_ned, target) and not leg.waits and leg.speed == LONG.speed
    judgement = flight.judge(2.0, detour=math.inf)
    assert judgement is not None and judgement.failure is None
    assert judgement.announcements[0].text.endswith("5.0 m of height")
    assert navigator.leg(flight.place).waits
    navigator.advance(ALONG, vehicle(flight.place), flight.now)
    assert np.array_equal(navigator.leg(flight.place).goal_ned, target), "only where the way over the map is looked at"
    navigator.advance(ON_MAP, vehicle(flight.place, (1.0, 0.0, 0.0)), flight.now)
    assert np.array_equal(navigator.leg(flight.place).goal_ned, target), "it brakes first"
    navigator.advance(ON_MAP, vehicle(flight.place), flight.now)
    leg = navigator.leg(flight.place)
    assert leg.goal_ned.tolist() == pytest.approx([*target[:2], target[2] - settings_.step])
    assert leg.waits and leg.speed == settings_.speed
    flight.place = np.array([*flight.place[:2], leg.goal_ned[2]])
    navigator.advance(ON_MAP, vehicle(flight.place), flight.now)
    judgement = flight.judge(2.0)
    assert judgement is not None and "going on" in judgement.announcements[0].text
    flight.place = np.subtract(flight.place, (0.0, 0.0, settings_.margin))
    navigator.advance(ON_MAP, vehicle(flight.place), flight.now)
    leg = navigator.leg(flight.place)
    assert not leg.waits and leg.goal_ned[2] == pytest.approx(target[2] - settings_.step - settings_.margin)
    assert target_of(navigator) is target, "the mission's own is kept"


def test_no_altitude_is_tried_from_which_the_way_on_leaves_the_fence() -> None:
    """A margin of the fence's own, and one that is climbed beyond where a way was seen."""
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=20.0", "geofence.max_height=9.0")
    tried = set[float]()
    for _ in range(100):
        flight.obey(math.inf)
        tried.add(float(START[2] - flight.place[2]))
    assert tried == {3.0, 5.0, 7.0}


def climbed(mission: Mission = LONG) -> Flight:
    """A flight on whose way another altitude was found; it flies 3 m higher now."""
    flight = Flight(mission, "avoidance.altitude_search.max_climb=6.0")
    flight.judge(2.0, detour=math.inf)
    for detour in (math.inf, 0.0, 0.0):
        flight.obey(detour)
    while flight.navigator.leg(flight.place).waits:
        flight.obey(0.0)
    leg, edge = flight.navigator.leg(flight.place), DEFAULTS.avoidance.altitude_search.edge_distance
    assert leg.goal_ned[2] == target_of(flight.navigator)[2] - 3.0 and leg.in_the_way == (math.inf, edge)
    return flight


def test_an_altitude_is_kept_past_a_waypoint_and_left_at_a_stop() -> None:
    navigator = (flight := climbed()).navigator
    assert navigator.step.passes
    navigator.next_step(flight.now)
    assert not navigator.step.passes
    assert navigator.leg(flight.place).goal_ned[2] == target_of(navigator)[2] - 3.0
    navigator.next_step(flight.now)
    leg = navigator.leg(flight.place)
    assert np.array_equal(leg.goal_ned, target_of(navigator)) and leg.in_the_way == EVERY_HEIGHT


@pytest.mark.parametrize("why", ["home", "given up", "ordered"])
def test_an_altitude_is_kept_where_another_leg_begins_on_the_way_to_a_stop(why: str) -> None:
    """Over a roof, in the middle of a leg: lower was seen free only where the vehicle came up."""
    flight = climbed(Mission(name="one", waypoints=[Waypoint(100.0, 0.0, 3.0)]))
    navigator = flight.navigator
    assert not navigator.step.passes
    assert flight.judge(13.0, speed=1.0) is None
    if why == "home":
        navigator.go_home(flight.place, flight.now)
    elif why == "given up":
        while flight.obey(math.inf).failure is None:
            assert flight.now < 1000 * SECOND
    else:
        step = Step(Phase.ROUTE, np.add(START, (50.0, 50.0, -3.0)), avoids=True)
        navigator.fly([step, Step(Phase.LAND)], flight.now, flight.place)
    altitude = flight.place[2]
    assert altitude <= START[2] - 6.0
    while navigator.step.passes:
        assert navigator.leg(flight.place).goal_ned[2] <= altitude
        navigator.next_step(flight.now, flight.place)
    assert navigator.phase in (Phase.RETURN, Phase.ROUTE)
    assert navigator.leg(flight.place).goal_ned[2] == pytest.approx(altitude)


def test_nothing_is_given_up_while_the_altitude_is_changed() -> None:
    """However long the vehicle takes to stand, to climb or to look around."""
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=6.0")
    assert flight.judge(2.0, detour=math.inf) is not None
    assert flight.judge(3.0 * GIVE_UP_S, detour=math.inf) is None


def test_once_a_goal_is_given_up_no_other_altitude_is_tried() -> None:
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=4.0")
    said: list[str] = []
    while not any("no progress" in text for text in said):
        said += [each.text for each in flight.obey(math.inf).announcements]
        assert flight.now < 1000 * SECOND
    altitudes = [text.split(":")[0] for text in said[:-2]]
    assert altitudes == ["no way or a long one, trying", "no way or a long one, trying", "no better way, back"]
    flight.place = np.add(START, (60.0, 0.0, -3.0))
    for _ in range(100):
        assert flight.obey(math.inf) == Judgement()
    assert not flight.navigator.leg(flight.place).waits


def test_a_change_of_altitude_gives_the_step_its_time_again() -> None:
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=6.0")
    flight.navigator.start_step(0)
    flight.now = 1000 * SECOND
    assert overdue(flight.navigator, 1000.0) > 0.0
    assert flight.judge(2.0, detour=math.inf) is not None
    assert flight.navigator.report(flight.now, flying=True).overdue == 0.0


def test_a_waypoint_is_passed_at_the_altitude_that_is_flown() -> None:
    """And not 3 m above it, where the search has gone around what stands in the way."""
    flight = Flight(LONG, "avoidance.altitude_search.max_climb=6.0")
    navigator, target = flight.navigator, target_of(flight.navigator)
    flight.judge(2.0, detour=math.inf)
    navigator.advance(ON_MAP, vehicle(flight.place), flight.now)
    goal = navigator.leg(flight.place).goal_ned
    assert goal[2] == target[2] - 2.0 and navigator.step.passes
    assert navigator.advance(ALONG, vehicle(target), flight.now) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(goal), flight.now) is Arrival.DONE
