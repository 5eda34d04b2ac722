"""The mission step by step, without a vehicle: arrival, time, release, giving up."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_settings
from companion.mission import plan as missions
from companion.mission.navigator import Arrival, Judgement, Navigator
from companion.mission.plan import Delivery, Mission, Phase, Waypoint
from companion.reports import CommandReport, MotionReport
from companion.state import Severity, VehicleState
from protocol.arrays import Array

ROOT = Path(__file__).resolve().parents[3]
MISSIONS = sorted(path.stem for path in (ROOT / "missions").glob("*.toml"))
MS, SECOND = 1_000_000, 1_000_000_000
START = np.array([5.0, -7.0, 1.5])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
ALONG = MotionReport(following=False, rests=False, track_start_ned=None, over_map=False)
ON_MAP = MotionReport(following=False, rests=False, track_start_ned=None, over_map=True)
ACCEPTED = CommandReport(True, 1, "accepted")
DEFAULTS = load_settings(None, [])
CURVE_S = 20.0
"""What a track takes here."""


def navigator_of(mission: Mission, *overrides: str) -> Navigator:
    """A mission at its beginning, with the vehicle at `START`."""
    navigator = before(mission, *overrides)
    navigator.begin(START)
    return navigator


def before(mission: Mission, *overrides: str) -> Navigator:
    steps = missions.steps(mission, np.zeros(3))
    durations = [None if step.curve is None else CURVE_S for step in steps]
    return Navigator(load_settings(None, list(overrides)), mission, durations)


def vehicle(place: Array, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> VehicleState:
    return VehicleState(0, np.asarray(place, np.float64), np.array(velocity), UPRIGHT, np.zeros(3), 0)


def target_of(navigator: Navigator) -> Array:
    target = navigator.step.target_ned
    assert target is not None
    return target


def at_step(mission: Mission, phase: Phase, *overrides: str) -> Navigator:
    """A mission at its first step of that phase."""
    navigator = navigator_of(mission, *overrides)
    while navigator.phase is not phase:
        navigator.next_step(0)
    return navigator


ROUTE = Mission(
    name="route",
    waypoints=[Waypoint(10.0, 0.0, 3.0), Waypoint(20.0, 5.0, 4.0, hold_s=2.0), Waypoint(40.0, 5.0, 3.0)],
    delivery=Delivery(),
    speed=4.0,
)
"""Through one waypoint, a stop of 2 s at another one, and a delivery at the last."""


# -- the steps ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MISSIONS)
def test_every_mission_goes_from_preparing_to_the_landing(name: str) -> None:
    mission = missions.load(name)[0]
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


@settings(max_examples=100, deadline=None, derandomize=True)
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


@settings(max_examples=100, deadline=None, derandomize=True)
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
    mission = missions.load("step")[0]
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
    navigator = at_step(missions.load("circle")[0], Phase.TRACK)
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
    """After a hold the track must be joined anew, from where it was left."""
    navigator = at_step(missions.load("circle")[0], Phase.TRACK)
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


# -- time --------------------------------------------------------------------------------------------------------------


def overdue(navigator: Navigator, seconds: float) -> float:
    return navigator.report(round(seconds * SECOND), flying=True).overdue


def test_a_step_is_overdue_after_its_way_its_hold_and_some_time_on_top() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    navigator.start_step(10 * SECOND)
    way = math.dist((10.0, 0.0, 3.0), (20.0, 5.0, 4.0))
    allowed = DEFAULTS.supervision.step_timeout + 2.0 + 3.0 * way / ROUTE.speed
    assert overdue(navigator, 10.0 + allowed - 0.01) == 0.0
    assert overdue(navigator, 10.0 + allowed + 5.0) == pytest.approx(5.0)
    assert navigator.report(round((10.0 + allowed + 5.0) * SECOND), flying=False).overdue == 0.0


def test_a_track_may_take_its_own_time() -> None:
    navigator = at_step(missions.load("circle")[0], Phase.TRACK)
    assert navigator.step_index == 1
    way = math.dist(navigator.steps[0].target_ned, navigator.steps[1].target_ned)  # type: ignore[arg-type]
    allowed = DEFAULTS.supervision.step_timeout + CURVE_S + 3.0 * way / navigator.mission.speed
    assert overdue(navigator, allowed - 0.01) == 0.0 and overdue(navigator, allowed + 1.0) == pytest.approx(1.0)


def test_each_step_has_its_own_time() -> None:
    navigator = navigator_of(ROUTE)
    navigator.start_step(0)
    assert overdue(navigator, 100.0) == pytest.approx(100.0 - DEFAULTS.supervision.step_timeout), "no way before it"
    navigator.next_step(100 * SECOND)
    assert overdue(navigator, 100.0) == 0.0


def test_the_time_that_others_fly_counts_for_nothing() -> None:
    navigator = navigator_of(ROUTE)
    navigator.start_step(0)
    navigator.pause(20 * SECOND)
    navigator.resume(1020 * SECOND)
    assert overdue(navigator, 1060.0 - 0.01) == 0.0
    assert overdue(navigator, 1061.0) == pytest.approx(1.0)


def test_after_a_pause_a_stop_is_reached_anew() -> None:
    navigator = at_step(ROUTE, Phase.ROUTE)
    navigator.next_step(0)
    navigator.advance(ALONG, vehicle(target_of(navigator)), 0)
    navigator.pause(SECOND)
    navigator.resume(100 * SECOND)
    assert navigator.advance(ALONG, vehicle(START), 101 * SECOND) is Arrival.NOT_YET


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
    assert flight.judge(15.0, speed=2.0) is None
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
    assert flight.now == pytest.approx((GIVE_UP_S + 0.2) * SECOND, abs=0.15 * SECOND)


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
    flight = Flight(LONG, "avoidance.heights.above=6.0", "avoidance.give_up_s=20.0")
    navigator, settings_ = flight.navigator, DEFAULTS.avoidance.heights
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


def climbed(*overrides: str) -> Flight:
    """A flight on whose way another altitude was found; it flies 3 m higher now."""
    flight = Flight(LONG, "avoidance.heights.above=6.0", *overrides)
    flight.judge(2.0, detour=math.inf)
    for detour in (math.inf, 0.0, 0.0):
        flight.obey(detour)
    while flight.navigator.leg(flight.place).waits:
        flight.obey(0.0)
    assert flight.navigator.leg(flight.place).goal_ned[2] == target_of(flight.navigator)[2] - 3.0
    return flight


def test_an_altitude_is_kept_past_a_waypoint_and_left_at_a_stop() -> None:
    navigator = (flight := climbed()).navigator
    assert navigator.step.passes
    navigator.next_step(flight.now)
    assert not navigator.step.passes
    assert navigator.leg(flight.place).goal_ned[2] == target_of(navigator)[2] - 3.0
    navigator.next_step(flight.now)
    assert np.array_equal(navigator.leg(flight.place).goal_ned, target_of(navigator))


def test_nothing_is_given_up_while_the_altitude_is_changed() -> None:
    """However long the vehicle takes to stand, to climb or to look around."""
    flight = Flight(LONG, "avoidance.heights.above=6.0")
    assert flight.judge(2.0, detour=math.inf) is not None
    assert flight.judge(3.0 * GIVE_UP_S, detour=math.inf) is None


def test_once_a_goal_is_given_up_no_other_altitude_is_tried() -> None:
    flight = Flight(LONG, "avoidance.heights.above=4.0")
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
    flight = Flight(LONG, "avoidance.heights.above=6.0")
    flight.navigator.start_step(0)
    flight.now = 1000 * SECOND
    assert overdue(flight.navigator, 1000.0) > 0.0
    assert flight.judge(2.0, detour=math.inf) is not None
    assert flight.navigator.report(flight.now, flying=True).overdue == 0.0


def test_a_waypoint_is_passed_at_the_altitude_that_is_flown() -> None:
    """And not 3 m above it, where the search has gone around what stands in the way."""
    flight = Flight(LONG, "avoidance.heights.above=6.0")
    navigator, target = flight.navigator, target_of(flight.navigator)
    flight.judge(2.0, detour=math.inf)
    navigator.advance(ON_MAP, vehicle(flight.place), flight.now)
    goal = navigator.leg(flight.place).goal_ned
    assert goal[2] == target[2] - 2.0 and navigator.step.passes
    assert navigator.advance(ALONG, vehicle(target), flight.now) is Arrival.NOT_YET
    assert navigator.advance(ALONG, vehicle(goal), flight.now) is Arrival.DONE
