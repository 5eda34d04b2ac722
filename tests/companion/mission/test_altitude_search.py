"""The order in which heights are tried, what they are left for, and where the vehicle may come back."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from companion.config_avoidance import AvoidanceAltitudeSearch
from companion.mission.altitude_search import AltitudeSearch, Place
from companion.state import EVERY_HEIGHT

SECOND = 1_000_000_000
ROUTE = -3.0
GROUND = -1.5
"""The lowest, down."""
DEAR = math.inf
GIVE_UP_S = 40.0
STUCK_S = 41.0


class Flight:
    """A vehicle that does what it is told at once, with an answer each tenth of a second."""

    def __init__(self, route: float = ROUTE, lowest: float = GROUND, **settings: float) -> None:
        self.heights = AltitudeSearch(AvoidanceAltitudeSearch(**settings), GIVE_UP_S)
        self.route, self.lowest = route, lowest
        self.north = 0.0
        self.down = route
        self.now = 0
        self.went: list[tuple[float, str]] = []

    def go(self, seconds: float, detour: float = DEAR, stalled_s: float = 0.0, speed: float = 0.0) -> "Flight":
        for _ in range(round(10 * seconds)):
            self.now += SECOND // 10
            place = Place(np.array([self.north, 0.0, self.down]), self.route, self.lowest)
            change = self.heights.consider(detour, stalled_s, place, self.now)
            if change is not None:
                self.went.append((round(change.down, 6), change.why.split()[-1]))
            self.heights.advance(self.down, speed, self.now)
            self.down = self.heights.flown(self.route)
            self.heights.advance(self.down, speed, self.now)
        return self

    def leg(self, route: float, stopped: bool) -> "Flight":
        self.heights.next_leg(stopped=stopped)
        self.route = route
        return self


def test_up_first_then_down_and_back_in_the_end() -> None:
    flight = Flight(-6.0, max_climb=5.0, max_descent=3.0).go(30.0)
    assert [down for down, _ in flight.went] == [-8.0, -10.0, -4.0, -6.0]
    assert flight.went[-1][1] == "back" and flight.heights.flown(-6.0) == -6.0 and not flight.heights.busy


def test_none_is_tried_unless_allowed() -> None:
    flight = Flight().go(10.0).go(10.0, stalled_s=STUCK_S)
    assert flight.went == [] and not flight.heights.busy


def test_a_way_is_flown_a_margin_beyond_where_it_was_seen() -> None:
    flight = Flight(max_climb=6.0).go(1.5)
    assert flight.went == [(-5.0, "trying")] and flight.heights.busy
    flight.go(2.0, detour=0.0)
    assert flight.went[1:] == [(-6.0, "on")] and not flight.heights.busy
    assert flight.heights.flown(ROUTE) == -6.0 and flight.heights.slowed(9.0) == AvoidanceAltitudeSearch().speed


@given(
    route=st.floats(-20.0, -1.6), above=st.floats(0.0, 20.0), below=st.floats(0.0, 20.0), step=st.floats(0.5, 5.0),
    seen=st.integers(0, 8),
)  # fmt: skip
def test_never_beyond_what_is_allowed_nor_too_low(
    route: float, above: float, below: float, step: float, seen: int
) -> None:
    """Whichever of the heights shows a way."""
    flight = Flight(route, max_climb=above, max_descent=below, step=step)
    for _ in range(300):
        flight.go(0.1, detour=0.0 if len(flight.went) > seen else DEAR)
        assert route - above - 1e-6 <= flight.down <= max(min(route + below, GROUND), route) + 1e-6


def test_limits_that_are_no_multiple_of_the_step_are_used() -> None:
    assert [down for down, _ in Flight(max_climb=1.5).go(9.0).went] == [-3.5, -3.0]
    assert [down for down, _ in Flight(max_climb=4.5).go(9.0).went] == [-5.0, -6.5, -3.0]


def test_a_height_is_left_only_if_its_way_was_dear_for_a_while() -> None:
    flight = Flight(max_climb=4.0, height_cost=5.0).go(9.0, detour=9.9)
    assert flight.went == []
    flight.go(0.5, detour=10.1).go(0.1, detour=3.0).go(0.9, detour=10.1)
    assert flight.went == []
    flight.now += 5 * SECOND  # nobody looked
    flight.go(0.9, detour=10.1)
    assert flight.went == []
    assert Flight(max_climb=4.0).go(0.1, detour=0.0, stalled_s=STUCK_S).went == [(-5.0, "trying")]


def test_another_height_is_left_sooner_without_progress_while_there_is_a_next_one() -> None:
    """The route's own, and the last one, only as late as the goal would be given up."""
    settings = AvoidanceAltitudeSearch()
    patient, impatient = settings.patience_s - 0.1, settings.patience_s + 0.1
    flight = Flight(max_climb=7.0).go(3.0, detour=0.0, stalled_s=impatient)
    assert flight.went == []
    flight.go(1.5).go(2.0, detour=0.0).go(3.0, detour=0.0, stalled_s=patient)
    assert flight.went == [(-5.0, "trying"), (-6.0, "on")]
    flight.north = 12.0
    flight.go(3.0, detour=0.0, stalled_s=impatient)
    assert flight.went[2:4] == [(-7.0, "trying"), (-8.0, "on")]
    flight.go(3.0, detour=0.0, stalled_s=impatient).go(3.0, detour=0.0, stalled_s=GIVE_UP_S - 0.1)
    assert [down for down, _ in flight.went[4:]] == [-9.0, -10.0], "the last one"
    assert flight.go(3.0, detour=0.0, stalled_s=impatient).down == -10.0
    early = Flight(max_climb=7.0, patience_s=2.0 * GIVE_UP_S).go(1.5).go(2.0, detour=0.0)
    assert early.go(0.1, detour=0.0, stalled_s=STUCK_S).went[-1] == (-7.0, "trying"), "never later than that"


def test_a_height_that_is_not_past_what_is_in_the_way_is_flown_at_only_if_it_is_the_last() -> None:
    """Around a wall that is seen there, and just over one that is not any more a margin higher."""
    short = AvoidanceAltitudeSearch().short_detour
    flight = Flight(max_climb=8.0).go(1.5).go(1.5, detour=short + 0.1)
    assert flight.went == [(-5.0, "trying"), (-7.0, "trying")]
    assert flight.go(2.0, detour=short - 0.1).went[2:] == [(-8.0, "on")]
    last = Flight(max_climb=7.0).go(1.5).go(10.0, detour=short + 0.1)
    assert last.went == [(-5.0, "trying"), (-7.0, "trying"), (-9.0, "trying"), (-10.0, "on")]


def test_past_edges_what_is_beyond_them_on_the_side_of_the_route_is_not_in_the_way() -> None:
    edge = AvoidanceAltitudeSearch().edge_distance
    over, under = Flight(max_climb=6.0), Flight(-8.0, max_descent=4.0)
    assert over.heights.in_the_way(ROUTE) == under.heights.in_the_way(-8.0) == EVERY_HEIGHT
    over.go(1.5).go(2.0, detour=0.0)
    under.go(1.5).go(2.0, detour=0.0)
    assert over.heights.in_the_way(ROUTE) == (math.inf, edge) and under.heights.in_the_way(-8.0) == (edge, math.inf)
    assert over.heights.in_the_way(-10.0) == EVERY_HEIGHT, "the route's own height is farther out"
    assert over.leg(ROUTE, stopped=True).heights.in_the_way(ROUTE) == EVERY_HEIGHT


def test_it_stands_before_it_goes_up_and_nothing_is_judged_on_the_way() -> None:
    flight = Flight(max_climb=6.0).go(1.2, speed=5.0).go(3.0, speed=5.0, stalled_s=STUCK_S)
    assert flight.went == [(-5.0, "trying")] and flight.down == ROUTE and flight.heights.busy
    assert flight.go(0.1).down == -5.0


def test_it_comes_back_nowhere_but_where_it_left() -> None:
    """Over a roof, where a tower stands: outward only, and then on at that height."""
    flight = Flight(max_climb=5.0, max_descent=1.0).go(1.5).go(2.0, detour=0.0)
    assert flight.down == -6.0
    flight.north = 12.0
    flight.go(20.0)
    assert [down for down, _ in flight.went] == [-5.0, -6.0, -7.0] and flight.down == -7.0
    assert not flight.heights.busy


def test_over_goals_that_are_flown_through_the_height_is_kept_and_may_grow() -> None:
    flight = Flight(max_climb=5.0).go(1.5).go(2.0, detour=0.0)
    flight.north = 12.0
    flight.leg(-2.0, stopped=False).go(0.5, detour=0.0)
    assert flight.down == -6.0
    flight.leg(-10.0, stopped=False).go(0.5, detour=0.0)
    assert flight.down == -10.0, "the route's own is farther out"
    flight.go(1.5)
    assert flight.went[-1] == (-12.0, "trying")
    flight.leg(-3.0, stopped=True).go(0.5, detour=0.0)
    assert flight.down == -3.0 and flight.go(1.5).went[-1] == (-5.0, "trying"), "all may be tried again"


def test_under_things_the_next_legs_are_never_flown_into_the_ground() -> None:
    flight = Flight(-6.0, max_descent=5.0).go(1.5).go(2.0, detour=0.0)
    assert flight.down == -3.0
    for route in (-10.0, -3.0, -2.0):
        assert flight.leg(route, stopped=False).go(0.5, detour=0.0).down == max(-3.0, route)


def test_after_others_flew_it_keeps_the_height_it_was_on_over_or_under_things() -> None:
    over = Flight(max_climb=5.0).go(2.0)
    under = Flight(-6.0, max_descent=3.0).go(2.0)
    for flight, least in ((over, -5.0), (under, -4.0)):
        assert flight.heights.flown(flight.route) == least and flight.heights.busy
        assert flight.heights.resume(least + 0.5, flight.route) and not flight.heights.busy
        assert flight.heights.flown(flight.route) == least
        assert not flight.heights.resume(flight.route, flight.route)
        assert flight.heights.flown(flight.route) == flight.route


def test_after_giving_up_the_height_is_kept_and_no_other_tried() -> None:
    flight = Flight(max_climb=5.0).go(1.5).go(2.0, detour=0.0)
    flight.heights.forbid()
    flight.go(10.0, stalled_s=STUCK_S)
    assert flight.down == -6.0 and flight.went[-1] == (-6.0, "on")
    assert flight.leg(ROUTE, stopped=True).go(10.0).down == ROUTE
