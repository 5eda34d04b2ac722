"""What a mission's flat scan does not show."""

import numpy as np
import pytest
from msgspec.structs import replace

from companion.avoidance.braking import stopping_speed
from companion.config_avoidance import Avoidance
from companion.mission.plan import Delivery, Mission, Waypoint, steps
from companion.runtime.files import load_body
from companion.view.unseen import seen_too_late, sight_m, thinnest, unseen, words

AVOIDANCE = Avoidance()
BODY = load_body("paper_quad")
MISSION = Mission("there", waypoints=[Waypoint(20.0, 0.0, 3.0)], delivery=Delivery(0.5), speed=5.0)
WORLD = """
[[box]]
name = "{name}"
center = [{north}, {east}]
size = [1.0, 1.0]
height = {height}
"""


def found(mission: Mission = MISSION, /, **box: object) -> list[str]:
    world = WORLD.format(**{"name": "box", "east": 0.0, **box}).encode() if box else b""
    return unseen(mission, steps(mission, np.zeros(3)), world, AVOIDANCE, BODY)


def test_poles_are_as_thin_as_the_stop_allows() -> None:
    """From where one beam in 5 degrees meets it the guard's own stop is as long as the way to the hull."""
    for speed in (3.0, 5.0, 7.0):
        seen_from = thinnest(speed, AVOIDANCE) / np.radians(5.0)
        free = seen_from - AVOIDANCE.vehicle_radius
        guard = AVOIDANCE.guard
        assert stopping_speed(free, guard.braking, guard.reaction_time) == pytest.approx(speed)
    assert found()[0].startswith("poles thinner than 34 cm at 5 m/s")
    fast = replace(MISSION, waypoints=[Waypoint(20.0, 0.0, 3.0, speed=7.0)])
    assert "at 7 m/s" in found(fast)[0]


def test_who_comes_ahead_on_before_a_fast_low_flight() -> None:
    """The vehicle leans until its thrust holds drag and weight; the scan goes with it."""
    lean = np.arctan2(BODY.drag_kg_s[0] * 8.0, BODY.mass_kg * 9.81)
    assert sight_m(8.0, 2.0, BODY) == pytest.approx(2.0 / np.tan(lean)) == pytest.approx(7.1, abs=0.05)
    assert sight_m(8.0, 2.0, replace(BODY, drag_kg_s=(0.0, 0.0, 0.0))) == np.inf
    for speed, height, late in ((8.0, 2.0, True), (6.0, 2.0, False), (8.0, 4.0, False)):
        there = replace(MISSION, waypoints=[Waypoint(20.0, 0.0, height)], takeoff_height=height, speed=speed)
        assert any("comes ahead on" in each and "(step 2, 6)" in each for each in found(there)) is late


def test_what_hangs_in_the_way_of_a_fast_flight() -> None:
    """In the demo's street three of four flights at 8 m/s hit the billboard, whose lower edge is 1 m below them."""
    for speed, height, layer, late in (
        (8.0, [2.0, 5.5], 3.0, True),
        (5.0, [2.0, 5.5], 3.0, False),
        (8.0, [0.0, 5.5], 3.0, False),
        (8.0, [2.8, 5.5], 3.0, True),
        (8.0, [2.0, 5.5], 0.9, False),
    ):
        mission = replace(MISSION, speed=speed)
        avoidance = replace(AVOIDANCE, map=replace(AVOIDANCE.map, layer=layer))
        world = WORLD.format(name="box", north=10.0, east=0.0, height=height).encode()
        told = unseen(mission, steps(mission, np.zeros(3)), world, avoidance, BODY)
        assert any("box, which hangs from 2" in each and "(step 2, 6)" in each for each in told) is late
        flown = seen_too_late(mission, steps(mission, np.zeros(3)), world, avoidance, BODY)
        assert len(flown) == late and all("box, which hangs" in each for each in flown), "once, not for each step"
        remedy = "with avoidance.map.layer=0.9" if height[0] == 2.0 else "fly at another height"
        assert all(each.endswith(remedy) for each in flown)


def test_descents_and_landings_are_named() -> None:
    descent, landing = found()[1:]
    assert "(step 3)" in descent and "range finder" in descent
    assert landing == "what stands where it lands (step 7)"


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ({"north": 20.0, "height": 1.2}, ["box, which ends 1.8 m below the scan (step 3)"]),
        ({"north": 10.0, "height": 2.5}, ["box, which ends 0.5 m below the scan (step 2)",
                                          "box, which ends 0.5 m below the scan (step 6)"]),
        ({"north": 10.0, "height": [3.2, 5.0]}, ["box, which hangs 0.2 m above the scan (step 2)",
                                                 "box, which hangs 0.2 m above the scan (step 6)"]),
        ({"north": 10.0, "height": 1.2}, []),
        ({"north": 10.0, "height": 4.0}, []),
        ({"north": 10.0, "east": 3.0, "height": 2.5}, []),
        ({"north": 0.0, "east": 0.9, "height": 2.0}, ["box, which ends 1.0 m below the scan (step 7)"]),
    ],
)  # fmt: skip
def test_obstacles_beside_the_way_that_the_scan_misses(box: dict[str, object], said: list[str]) -> None:
    """Below and above the route, and under a descent and a landing; what the scan meets is not told of."""
    assert found(MISSION, **box)[3:] == said


def test_the_words_have_a_line_for_each() -> None:
    assert words(["a", "b"]).splitlines()[1:] == ["- a", "- b"]
