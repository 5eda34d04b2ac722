"""Missions are flown as they say; the fence and the rally points count."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.vehicle_sim.foreign_pilot import AIRFRAME, HOLD, LAND, RETURN, ForeignPilot, world_with
from tests.vehicle_sim.mission_uploader import Row, at, do, upload
from vehicle_sim.autopilot import fence
from vehicle_sim.autopilot.fence import Zone

ACCEPTED, REJECTED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_TEMPORARILY_REJECTED
TAKEOFF, WAYPOINT, LANDING = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
MISSION, TERMINATION = 4 << 16 | 4 << 24, 10 << 16
FENCE, RALLY = mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY
HOME_DOWN = -AIRFRAME.rest_height_m


def start(pilot: ForeignPilot, *rows: Row) -> None:
    """Upload, and start by the command that also arms."""
    assert upload(pilot, rows) == mavlink.MAV_MISSION_ACCEPTED
    pilot.fly(1.1)
    assert pilot.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    assert pilot.armed and pilot.mode == MISSION


def in_the_air(*rows: Row) -> ForeignPilot:
    """Flies the items, from 3 m above home."""
    pilot = ForeignPilot()
    pilot.take_off()
    assert upload(pilot, rows) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.set_mode(MISSION) == ACCEPTED
    return pilot


def reached(pilot: ForeignPilot) -> list[int]:
    return [message.seq for message in pilot.all("MISSION_ITEM_REACHED")]


def test_a_whole_flight_passes_each_waypoint_and_ends_disarmed() -> None:
    places = [(12.0, 0.0, 4.0), (12.0, 9.0, 6.0), (0.0, 9.0, 4.0)]
    pilot = ForeignPilot()
    start(
        pilot,
        at(TAKEOFF, 0.0, 0.0, 3.0),
        *(at(WAYPOINT, *place, 0.0, 1.0) for place in places),
        at(LANDING, 0.0, 5.0, 0.0),
    )
    nearest = [math.inf] * len(places)
    height_at_start = 0.0
    while pilot.armed and pilot.time_s < 60.0:
        pilot.fly(0.02)
        north, east, down = pilot.vehicle.motion.position_ned
        if math.hypot(north, east) < 0.3:
            height_at_start = max(height_at_start, HOME_DOWN - down)
        here = (north, east, HOME_DOWN - down)
        nearest = [min(least, math.dist(here, place)) for least, place in zip(nearest, places, strict=True)]
        if pilot.vehicle.motion.touching and not pilot.vehicle.flight.flown:
            assert math.hypot(north, east) < 0.05
    assert max(nearest) < 1.3, "1 m sideways, 0.8 m in height"
    assert height_at_start > 2.0, "first it climbs"
    assert not pilot.armed and pilot.vehicle.summary().outcome == "landed"
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((0.0, 5.0), abs=0.3)
    assert reached(pilot) == [0, 1, 2, 3, 4]
    assert [m.seq for m in pilot.all("MISSION_CURRENT")] == [0, 1, 2, 3, 4, 0], "and from the beginning next time"


def test_a_mission_that_lands_on_its_way_waits_there_and_takes_off_again() -> None:
    """PX4 disarms by a landing only where it ends the mission (landed_amid_mission)."""
    pilot = ForeignPilot()
    start(
        pilot,
        at(TAKEOFF, 0.0, 0.0, 2.0),
        at(LANDING, 0.0, 0.0, 0.0),
        do(mavlink.MAV_CMD_NAV_DELAY, 4.0),
        at(TAKEOFF, 0.0, 0.0, 2.0),
        at(LANDING, 0.0, 0.0, 0.0),
    )
    assert pilot.fly(60.0, until=lambda: not pilot.armed)
    assert reached(pilot) == [0, 1, 2, 3, 4]
    flown = [text for text in pilot.texts if text.endswith("detected")]
    assert flown == 2 * ["Takeoff detected", "Landing detected"] and "Disarmed by landing" in pilot.texts


def test_what_was_learned_of_the_wind_is_kept_from_item_to_item() -> None:
    pilot = ForeignPilot(world_with("wind.mean_ned=[0.0, 8.0, 0.0]"))
    start(
        pilot,
        at(TAKEOFF, 0.0, 0.0, 3.0),
        do(mavlink.MAV_CMD_NAV_DELAY, 15.0),
        at(LANDING, 0.0, 0.0, 0.0),
    )
    assert pilot.fly(60.0, until=lambda: not pilot.armed)
    assert math.hypot(*pilot.vehicle.motion.position_ned[:2]) < 0.2


def test_a_pause_holds_and_the_mission_goes_on_where_it_was() -> None:
    pilot = in_the_air(at(WAYPOINT, 8.0, 0.0, 3.0), at(WAYPOINT, 30.0, 0.0, 3.0))
    assert pilot.fly(10.0, until=lambda: reached(pilot) == [0])
    assert pilot.set_mode(HOLD) == ACCEPTED
    pilot.fly(4.0)
    assert pilot.vehicle.motion.speed < 0.1
    assert pilot.set_mode(MISSION) == ACCEPTED
    assert pilot.fly(12.0, until=lambda: pilot.mode == HOLD)
    assert reached(pilot) == [0, 1] and "Mission finished, holding" in pilot.texts
    pilot.fly(3.0)
    assert 27.0 < pilot.vehicle.motion.position_ned[0] < 32.0


def test_it_takes_off_by_itself_to_a_first_waypoint() -> None:
    pilot = ForeignPilot()
    start(pilot, at(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 9.0, 9.0, 0.0), at(WAYPOINT, 6.0, 0.0, 1.0))
    pilot.fly(0.02)
    assert pilot.disarm() == ACCEPTED and reached(pilot) == [0]
    assert pilot.arm() == ACCEPTED, "and again"
    assert pilot.fly(8.0, until=lambda: pilot.vehicle.motion.position_ned[0] > 0.2)
    assert pilot.height > 2.0, "at least the take-off height, whatever the waypoint's"


@pytest.mark.parametrize(
    ("row", "seconds"),
    [
        (do(mavlink.MAV_CMD_NAV_DELAY, 2.0), 2.0),
        (at(mavlink.MAV_CMD_NAV_LOITER_TIME, 0.0, 0.0, 2.5, 3.0), 3.0),
        (at(WAYPOINT, 0.0, 0.0, 2.5, 1.0), 1.0),
    ],
)
def test_time_is_spent(row: Row, seconds: float) -> None:
    pilot = in_the_air(row, at(mavlink.MAV_CMD_NAV_LOITER_UNLIM, 0.0, 0.0, 2.5))
    began_s = pilot.time_s
    assert pilot.fly(seconds + 1.0, until=lambda: reached(pilot) == [0])
    assert pilot.time_s - began_s == pytest.approx(seconds, abs=0.03)
    pilot.fly(2.0)
    assert pilot.mode == MISSION and reached(pilot) == [0], "the last one has no end"


@pytest.mark.parametrize("radius", [4.0, -4.0])
def test_turns_are_flown_on_their_circle(radius: float) -> None:
    pilot = in_the_air(at(mavlink.MAV_CMD_NAV_LOITER_TURNS, 4.0, 0.0, 2.5, 1.5, 0.0, radius))
    flight = pilot.vehicle.flight
    swept, angle, off = 0.0, None, 0.0
    while pilot.mode == MISSION and pilot.time_s < 60.0:
        pilot.fly(0.1)
        north, east, _ = pilot.vehicle.motion.position_ned
        if pilot.mode == MISSION and flight.guidance.circle and flight.guidance.circle.turned > 1.0:
            now = math.atan2(east, north - 4.0)
            swept += 0.0 if angle is None else math.remainder(now - angle, math.tau)
            angle, off = now, max(off, abs(math.hypot(north - 4.0, east) - 4.0))
            along = now + math.copysign(math.pi / 2.0, radius)
            assert abs(math.remainder(pilot.vehicle.motion.yaw - along, math.tau)) < 0.2
    assert swept == pytest.approx(math.copysign(3.0 * math.pi - 1.0, radius), abs=0.1)
    assert off < 0.5


def test_speed_heading_interest_gripper_and_jumps() -> None:
    pilot = in_the_air(
        do(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1.0, 2.0),
        at(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0.0, 50.0, 0.0),
        at(WAYPOINT, 6.0, 0.0, 2.5),
        do(mavlink.MAV_CMD_DO_GRIPPER, 1.0, mavlink.GRIPPER_ACTION_RELEASE),
        do(mavlink.MAV_CMD_DO_SET_ROI_NONE),
        do(mavlink.MAV_CMD_CONDITION_YAW, 200.0, 0.0, 0.0, 0.0),
        do(mavlink.MAV_CMD_DO_JUMP, 5.0, 2.0),
    )
    fastest = 0.0
    while not pilot.vehicle.summary().released and pilot.time_s < 20.0:
        pilot.fly(0.1)
        fastest = max(fastest, math.hypot(*pilot.vehicle.motion.velocity_ned[:2]))
    assert 1.6 < fastest < 2.05
    assert pilot.vehicle.motion.yaw == pytest.approx(math.radians(90.0), abs=0.15), "towards the point of interest"
    assert pilot.fly(12.0, until=lambda: pilot.mode == HOLD)
    assert reached(pilot) == [0, 1, 2, 3, 4, 5, 6, 5, 6, 5, 6]
    assert math.remainder(pilot.vehicle.motion.yaw - math.radians(200.0), math.tau) == pytest.approx(0.0, abs=0.1)


def test_the_nose_points_along_the_way() -> None:
    pilot = in_the_air(at(WAYPOINT, 0.0, -40.0, 2.5))
    pilot.fly(4.0)
    assert pilot.vehicle.motion.yaw == pytest.approx(math.radians(-90.0), abs=0.1)


def test_a_return_is_the_mode() -> None:
    pilot = in_the_air(at(WAYPOINT, 5.0, 0.0, 2.5), do(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH))
    assert pilot.fly(10.0, until=lambda: pilot.mode == RETURN)
    assert reached(pilot) == [0, 1]


def test_without_a_mission_nothing_is_flown() -> None:
    pilot = ForeignPilot()
    pilot.fly(1.1)
    assert pilot.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == mavlink.MAV_RESULT_DENIED
    assert pilot.set_mode(MISSION) == ACCEPTED, "disarmed it takes any mode"
    assert pilot.arm() == REJECTED
    assert "Arming denied: no mission" in pilot.texts
    pilot.set_mode(HOLD)
    pilot.take_off()
    assert pilot.set_mode(MISSION) == REJECTED
    assert upload(pilot, [at(WAYPOINT, 5.0, 0.0, 3.0)]) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.command(mavlink.MAV_CMD_MISSION_START, 1, 0) == mavlink.MAV_RESULT_DENIED


def test_a_mission_that_is_replaced_in_flight_is_flown_from_its_beginning() -> None:
    pilot = in_the_air(at(WAYPOINT, 40.0, 0.0, 3.0))
    pilot.fly(2.0)
    assert upload(pilot, [at(WAYPOINT, 0.0, 6.0, 3.0)]) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.fly(15.0, until=lambda: pilot.mode == HOLD)
    assert math.dist(pilot.vehicle.motion.position_ned[:2], (0.0, 6.0)) < 2.0


@pytest.mark.parametrize(("action", "mode"), [(0, MISSION), (3, RETURN), (4, TERMINATION), (5, LAND)])
def test_beyond_the_fence_happens_what_the_parameter_says(action: int, mode: int) -> None:
    pilot = in_the_air(at(WAYPOINT, 40.0, 0.0, 3.0))
    assert pilot.vehicle.parameters.set("GF_ACTION", action) is None
    circle = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
    assert upload(pilot, [at(circle, 0.0, 0.0, 0.0, 2.0)], FENCE) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.fly(5.0, until=lambda: pilot.vehicle.motion.position_ned[0] > 2.1)
    assert pilot.mode == mode


def test_a_place_is_reached_within_the_acceptance_radius() -> None:
    pilot = in_the_air(at(WAYPOINT, 10.0, 0.0, 3.0))
    assert pilot.vehicle.parameters.set("NAV_ACC_RAD", 5.0) is None
    assert pilot.fly(10.0, until=lambda: reached(pilot) == [0])
    assert pilot.vehicle.motion.position_ned[0] == pytest.approx(5.0, abs=0.1)


def test_leaving_the_fence_ends_in_hold() -> None:
    pilot = in_the_air(at(WAYPOINT, 40.0, 0.0, 3.0))
    circle = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
    assert upload(pilot, [at(circle, 0.0, 0.0, 0.0, 10.0)], FENCE) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.fly(10.0, until=lambda: pilot.mode == HOLD)
    assert pilot.vehicle.motion.position_ned[0] == pytest.approx(10.0, abs=0.05)
    assert "Failsafe: geofence breached, holding" in pilot.texts
    assert pilot.last("HEARTBEAT").system_status == mavlink.MAV_STATE_CRITICAL
    pilot.fly(6.0)
    assert pilot.mode == HOLD
    assert pilot.set_mode(MISSION) == REJECTED, "its waypoint is outside"
    assert "".join(pilot.texts).endswith("Mission rejected: item 0 is outside of the geofence")
    assert pilot.set_mode(RETURN) == ACCEPTED


def test_what_is_looked_at_may_lie_beyond_the_fence() -> None:
    pilot = in_the_air(at(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0.0, 40.0, 0.0), at(WAYPOINT, 8.0, 0.0, 3.0))
    circle = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
    assert upload(pilot, [at(circle, 0.0, 0.0, 0.0, 20.0)], FENCE) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.set_mode(HOLD) == ACCEPTED and pilot.set_mode(MISSION) == ACCEPTED
    assert pilot.fly(15.0, until=lambda: pilot.mode == HOLD)
    assert reached(pilot) == [0, 1]


def test_a_return_leads_to_the_nearest_of_home_and_the_rally_points() -> None:
    pilot = in_the_air(at(WAYPOINT, 20.0, 0.0, 3.0))
    point = mavlink.MAV_CMD_NAV_RALLY_POINT
    assert upload(pilot, [at(point, 24.0, 3.0, 5.0), at(point, -90.0, 0.0, 5.0)], RALLY) == mavlink.MAV_MISSION_ACCEPTED
    assert pilot.fly(10.0, until=lambda: pilot.mode == HOLD)
    assert pilot.set_mode(RETURN) == ACCEPTED
    assert pilot.fly(20.0, until=lambda: pilot.mode == LAND)
    assert pilot.vehicle.motion.position_ned[:2] == pytest.approx((24.0, 3.0), abs=0.5)


def test_a_place_in_zones() -> None:
    square = Zone(True, ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))
    hole, other = Zone(False, ((5.0, 5.0),), 2.0), Zone(True, ((30.0, 0.0),), 3.0)
    zones = (square, hole, other)
    for place, allowed in (
        ((1.0, 1.0), True),
        ((5.0, 6.0), False),
        ((5.0, 8.0), True),
        ((11.0, 5.0), False),
        ((-1.0, 5.0), False),
        ((5.0, -1.0), False),
        ((31.0, 1.0), True),
    ):
        assert fence.allows(zones, place) is allowed, place
    assert fence.allows((), (1e6, 0.0)) and fence.allows((hole,), (1e6, 0.0))


def test_a_breach_counts_again_in_the_next_flight() -> None:
    pilot = ForeignPilot()
    pilot.take_off()
    limits = pilot.vehicle.flight.limits
    limits.zones = (Zone(True, ((50.0, 0.0),), 5.0),)
    breach = "Failsafe: geofence breached, holding"
    for flight in (1, 2):
        pilot.fly(0.1)
        assert pilot.texts.count(breach) == flight
        pilot.set_mode(LAND)
        assert pilot.fly(20.0, until=lambda: not pilot.armed)
        pilot.take_off()
