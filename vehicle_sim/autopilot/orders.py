"""What can be asked of the autopilot beside a mode and arming. Each order gives the result for the answer."""

import math

from protocol.arrays import Vector
from vehicle_sim.autopilot import fence
from vehicle_sim.autopilot.circle import MAX_RADIUS_M, MIN_RADIUS_M, Circle
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode, Result
from vehicle_sim.autopilot.plan import Place
from vehicle_sim.autopilot.tracking import course

_MAX_DISTANCE_M = 10_000.0
"""Distance to a commanded place up to which the plane of the local axes is close enough to the earth's surface."""


def reposition(flight: FlightControl, target_ned: Vector, yaw: float | None, speed: float | None) -> Result:
    """Fly to another place (m) and hold there. No obstacle is avoided on the way.

    `yaw` (rad) is the heading, None the present one. `speed` (m/s) is limited to the vehicle's own cruise speed,
    which None stands for.
    """
    problem = _problem(flight, target_ned)
    if problem is not None:
        text, result = problem
        return flight.refuse(f"Reposition rejected: {text}", result)
    flight.failsafe = False
    flight.enter(Mode.HOLD)
    flight.guidance.aim(target_ned)
    if speed is not None:
        flight.guidance.limit_horizontal_speed(speed)
    if yaw is not None:
        flight.guidance.turn(yaw)
    return Result.ACCEPTED


def orbit(flight: FlightControl, circle: Circle) -> Result:
    """Fly a circle until another mode is asked for."""
    problem = _problem(flight, circle.center_ned)
    if problem is None and not MIN_RADIUS_M <= abs(circle.radius_m) <= MAX_RADIUS_M:
        problem = f"radius {circle.radius_m:g} m", Result.DENIED
    if problem is not None:
        text, result = problem
        return flight.refuse(f"Orbit rejected: {text}", result)
    flight.failsafe = False
    flight.enter(Mode.ORBIT)
    flight.guidance.go_round(circle, flight.motion)
    return Result.ACCEPTED


def change_speed(flight: FlightControl, speed_m_s: float | None) -> Result:
    """Fly at most this fast from now on; None: as fast as the vehicle file says."""
    flight.mission.limit_speed(speed_m_s)
    return Result.ACCEPTED


def look_at(flight: FlightControl, place: tuple[float, float] | None) -> Result:
    """Point the nose at a place (m north and east), in hold once; None: in a mission along the way again."""
    flight.mission.interest = None if place is None else Place(*place, 0.0, False)
    if place is not None and flight.mode is Mode.HOLD:
        flight.guidance.turn(course(flight.motion.position_ned, place))
    return Result.ACCEPTED


def set_home(flight: FlightControl, home_ned: Vector) -> Result:
    """Return there (m) from now on, and count heights from it."""
    if not math.dist(home_ned, flight.motion.position_ned) <= _MAX_DISTANCE_M:
        return flight.refuse("Home rejected: too far away", Result.DENIED)
    flight.home_ned = home_ned
    return Result.ACCEPTED


def start_mission(flight: FlightControl, first: int) -> Result:
    """Fly the mission from an item on (-1: from where it was), and arm."""
    problem = flight.missing(Mode.MISSION)
    if problem is not None:
        return flight.refuse(f"Mission start rejected: {problem}", Result.DENIED)
    if first >= 0 and not flight.mission.go_to(first):
        return flight.refuse(f"Mission start rejected: no item {first}", Result.DENIED)
    result = flight.set_mode(Mode.MISSION)
    return flight.arm() if result is Result.ACCEPTED else result


def terminate(flight: FlightControl) -> Result:
    """Stop the motors for good."""
    if not flight.armed:
        return flight.refuse("Termination rejected: not armed", Result.DENIED)
    flight.enter(Mode.TERMINATION)
    return Result.ACCEPTED


def _problem(flight: FlightControl, target_ned: Vector) -> tuple[str, Result] | None:
    """Why a place can't be flown to, and the answer."""
    if flight.crash is not None or not flight.armed or flight.landed or flight.mode is Mode.TERMINATION:
        return "not in the air", Result.TEMPORARILY_REJECTED
    distance = math.dist(target_ned, flight.motion.position_ned)
    if not distance <= _MAX_DISTANCE_M:
        return f"{distance:.0f} m away", Result.DENIED
    if target_ned[2] > -flight.airframe.ground.foot_height_m:
        return "under the ground", Result.DENIED
    if not fence.allows(flight.limits.zones, target_ned):
        return "outside of the geofence", Result.DENIED
    return None
