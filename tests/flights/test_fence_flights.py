"""Whole flights within a fence: the reference never leaves it, and the vehicle keeps within the margin."""

import numpy as np
import pytest

from companion.fence import Fence, fence_of
from companion.mission.plan import Mission, Phase, Waypoint
from companion.runtime.files import load_settings
from companion.state import FlightMode
from companion.supervision.states import State
from protocol.messages import Encoder, dialect
from studies.joined import Joined, mission_of
from tests.flights.short import SMALL_MAP, landing, returning
from vehicle_sim.autopilot import orders

FREE = 'avoidance.method="none"'
MARGIN = 1.0
OUT = Mission(name="out", waypoints=[Waypoint(25.0, 0.0, 5.0, hold_s=2.0)], speed=4.0)
FENCE = ("geofence.radius=30.0", "geofence.east=[-12.0, 15.0]", "geofence.max_height=9.0")
OF_SETTINGS, OF_VEHICLE = FENCE[1:2], ("fence.radius_m=30.0", "fence.max_height_m=9.0")
"""The same fence, of which the vehicle has a part."""


def fence_in(joined: Joined) -> Fence:
    home = joined.truths[0][:3]
    fence = fence_of(load_settings(None, list(FENCE)).geofence, home)
    assert fence is not None
    return fence


def least_room(joined: Joined, what: str, *states: State) -> float:
    """The least room (m) to the fence of the vehicle or of the reference, while it flew itself."""
    fence, trace = fence_in(joined), joined.trace()
    flown = trace[np.isin(trace["state"], [state.value for state in states or (State.FLY, State.HOLD)])]
    return min(fence.room(place) for place in flown[what].astype(float))


def random_mission(seed: int) -> tuple[Mission, tuple[float, float, float]]:
    """Waypoints anywhere in the fence, up to its margin; and a wind (m/s, NED)."""
    random = np.random.default_rng(seed)
    fence = fence_of(load_settings(None, list(FENCE)).geofence, np.zeros(3))
    assert fence is not None
    inner = fence.shrunk(MARGIN)
    places = [inner.nearest(np.array((*random.uniform(-40.0, 40.0, 2), random.uniform(-12.0, -2.0)))) for _ in range(4)]
    waypoints = [Waypoint(float(place[0]), float(place[1]), -float(place[2]) - 1e-3) for place in places]
    north, east = random.uniform(-4.0, 4.0, 2).tolist()
    speed = float(random.uniform(3.0, 9.0))
    return Mission(name="random", waypoints=waypoints, speed=speed, return_home=False), (north, east, 0.0)


@pytest.mark.parametrize("seed", range(2))
def test_no_flight_leaves_the_fence(seed: int) -> None:
    mission, wind = random_mission(seed)
    ours, its = (OF_SETTINGS, OF_VEHICLE) if seed % 2 else (FENCE, ())
    world = (f"wind.mean_ned={list(wind)}",)
    joined = Joined(mission, overrides=(*ours, FREE), vehicle_overrides=its, world_overrides=world, seed=seed)
    joined.remembers = False
    joined.fly(until=landing)
    assert landing(joined) and joined.autopilot.supervisor.fault is None
    assert least_room(joined, "reference_position_ned") >= MARGIN - 0.005, "home is known to a millimetre"
    assert least_room(joined, "position_ned") >= 0.0


@pytest.mark.parametrize(
    ("mission", "fence", "words"),
    [
        (Mission(name="far", waypoints=[Waypoint(20.0, 0.0, 3.0), Waypoint(40.0, 5.0, 3.0)]), "radius=30.0", "40.0"),
        (Mission(name="high", waypoints=[Waypoint(20.0, 0.0, 13.0)]), "max_height=10.0", "height 13.0"),
        (mission_of("lemniscate"), "radius=2.0", "track"),
        (Mission(name="edge", waypoints=[Waypoint(29.5, 0.0, 3.0)]), "north=[-5.0, 30.0]", "0.5 m beyond"),
    ],
)
def test_a_mission_that_leaves_the_fence_is_refused_and_the_place_named(
    mission: Mission, fence: str, words: str
) -> None:
    joined = Joined(mission, overrides=(f"geofence.{fence}", FREE)).fly(limit_s=60.0)
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and "the mission leaves the fence" in fault and words in fault
    assert joined.vehicle.flight.airborne_ns == 0 and joined.vehicle.time_ns < 5e9, "at once"


@pytest.mark.parametrize(
    ("fence", "words"),
    [("radius_m=20.0", "north 25.0, east 0.0"), ("max_height_m=5.5", "height 5.0 is 0.5 m beyond")],
)
def test_a_mission_that_leaves_the_vehicle_s_own_fence_is_refused(fence: str, words: str) -> None:
    """Which only its parameters tell, before it is armed."""
    joined = Joined(OUT, overrides=(FREE,), vehicle_overrides=(f"fence.{fence}",)).fly(limit_s=60.0)
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and "the mission leaves the fence" in fault and words in fault
    assert joined.vehicle.flight.airborne_ns == 0 and joined.vehicle.time_ns < 5e9, "at once"
    assert not joined.vehicle.flight.armed


def ask(joined: Joined, command: int, *parameters: float) -> None:
    padded = parameters + (0.0,) * (7 - len(parameters))
    fields = (1, 1, command, 0, *padded)
    joined.vehicle.receive(Encoder(1, 190).encode_fields(dialect.MAVLink_command_long_message, *fields))


@pytest.mark.parametrize("method", ["none", "astar"])
def test_given_back_beyond_the_fence_it_comes_back_without_a_jump(method: str) -> None:
    """Straight, and over the map, in which the fence stands."""
    joined = Joined(OUT, overrides=(*FENCE, f"avoidance.method={method}", SMALL_MAP))
    joined.fly(until=lambda flight: flight.autopilot.navigator.phase is Phase.ROUTE)
    orders.reposition(joined.vehicle.flight, (3.0, 40.0, -5.0), None, None)
    fence = fence_in(joined)
    joined.fly(limit_s=20.0, until=lambda flight: fence.room(flight.vehicle.state[:3]) < -4.0)
    assert fence.room(joined.vehicle.state[:3]) < -4.0
    assert joined.autopilot.link.said.status.mode is not FlightMode.EXTERNAL
    ask(joined, dialect.MAV_CMD_DO_SET_MODE, 1.0, 6.0)
    given_back = len(joined.traces)
    joined.fly(until=returning)
    assert joined.autopilot.navigator.phase is Phase.RETURN and joined.autopilot.supervisor.fault is None
    assert sum("beyond the fence" in text for text in joined.said) == 1
    assert sum("within the fence again" in text for text in joined.said) == 1
    trace = joined.trace()[given_back:]
    reference = trace["reference_position_ned"].astype(float)
    assert np.abs(reference - trace["position_ned"])[:200].max() < 0.1, (
        "it begins where the vehicle is, not at the fence"
    )
    assert np.abs(np.diff(reference[5:], axis=0)).max() < 0.1, "25 m/s"


def test_a_waypoint_at_the_edge_of_a_narrow_margin_is_reached() -> None:
    """The margin is less than what the way over the map keeps from obstacles."""
    edge = Mission(name="edge", waypoints=[Waypoint(9.7, 0.0, 4.0)], speed=3.0)
    joined = Joined(edge, overrides=("geofence.radius=10.0", "geofence.margin=0.25", SMALL_MAP))
    joined.fly(until=returning)
    assert joined.autopilot.navigator.phase is Phase.RETURN and joined.autopilot.supervisor.fault is None
    assert max(truth[0] - joined.truths[0][0] for truth in joined.truths) > 9.5


def test_blown_out_of_the_fence_for_good_it_lands() -> None:
    """A wind that it can't fly against, where that alone is no reason to hold."""
    far = "supervision.stray_distance=1000.0"
    joined = Joined(OUT, overrides=(*FENCE, FREE, "geofence.land_after=3.0", "limits.tilt_deg=10.0", far))
    joined.fly(until=lambda flight: flight.autopilot.navigator.phase is Phase.ROUTE)
    joined.vehicle._wind_ned[:] = (0.0, 14.0, 0.0)
    joined.vehicle._wind.advance = lambda state: None  # type: ignore[method-assign]
    joined.fly(limit_s=60.0)
    fault = joined.autopilot.supervisor.fault
    assert fault is not None and fault.startswith("landed early: beyond the fence by")
    assert any("not coming back: landing" in text for text in joined.said)
