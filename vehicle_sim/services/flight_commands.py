"""The commands that fly the vehicle: arming, modes, places, speeds, the mission, the gripper."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from protocol.arrays import Vector
from protocol.messages import dialect
from vehicle_sim.autopilot import orders
from vehicle_sim.autopilot.circle import FACE_CENTER, Circle
from vehicle_sim.autopilot.flight_control import FlightControl
from vehicle_sim.autopilot.modes import Mode, Result, Severity
from vehicle_sim.services.places import ABOVE_HOME, ON_EARTH, UNSET_E7, Geodetic, horizontal

Command = Callable[[Any], Result]
"""A message -> the result for the COMMAND_ACK."""

FORCE = 21196
"""param2 of an arming command that skips the checks."""

_MODE_BY_STANDARD = {mode.standard: mode for mode in Mode if mode.standard}
_AUTO, _MANUAL = dialect.MAV_MODE_FLAG_AUTO_ENABLED, dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
_GUIDED, _STABILIZED = dialect.MAV_MODE_FLAG_GUIDED_ENABLED, dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
_BASE_MODES = (
    (_AUTO, Mode.MISSION),
    (_MANUAL | _GUIDED, Mode.POSITION),
    (_MANUAL | _STABILIZED, Mode.STABILIZED),
    (_MANUAL, Mode.MANUAL),
)
"""The modes that are meant by flags alone: the first whose flags are all set."""


def whole(value: float) -> int:
    """A parameter that must be a whole number; -2 for any other value, also for NaN, which means that it is unset."""
    return int(value) if math.isfinite(value) and value == int(value) else -2


def _given(value: float) -> float | None:
    return value if math.isfinite(value) else None


class Actions(NamedTuple):
    """What is done to the vehicle itself."""

    release: Callable[[], bool]
    """Drops the parcel; False if there is none."""
    inject: Callable[[int, int, int], Result]
    """Lets a part fail: unit, failure, instance."""


class FlightCommands:
    """`table` has them by number. `origin`: the place of the local axes on earth."""

    def __init__(
        self, flight: FlightControl, origin: Geodetic, actions: Actions, reset_parameters: Callable[[], None]
    ) -> None:
        self._flight = flight
        self._origin = origin
        self._actions = actions
        self._reset_parameters = reset_parameters
        flight.mission.release = self._open_gripper
        self.table: dict[int, Command] = {
            dialect.MAV_CMD_NAV_TAKEOFF: self._take_off,
            dialect.MAV_CMD_NAV_LAND: lambda _: flight.set_mode(Mode.LAND),
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: flight.set_mode(Mode.RETURN),
            dialect.MAV_CMD_DO_SET_MODE: lambda m: self.set_mode(
                whole(m.param1), whole(m.param2), 0 if math.isnan(m.param3) else whole(m.param3)
            ),
            dialect.MAV_CMD_DO_SET_STANDARD_MODE: self._set_standard_mode,
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_DO_ORBIT: self._orbit,
            dialect.MAV_CMD_DO_CHANGE_ALTITUDE: self._change_altitude,
            dialect.MAV_CMD_DO_CHANGE_SPEED: lambda m: orders.change_speed(
                flight, m.param2 if m.param2 > 0.0 else None
            ),
            dialect.MAV_CMD_DO_SET_HOME: self._set_home,
            dialect.MAV_CMD_MISSION_START: lambda m: orders.start_mission(flight, whole(m.param1)),
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            dialect.MAV_CMD_DO_PAUSE_CONTINUE: self._pause_or_continue,
            dialect.MAV_CMD_DO_FLIGHTTERMINATION: lambda m: (
                orders.terminate(flight) if m.param1 > 0.5 else Result.DENIED
            ),
            dialect.MAV_CMD_DO_GRIPPER: self._gripper,
            dialect.MAV_CMD_DO_SET_ROI_LOCATION: self._look_at,
            dialect.MAV_CMD_DO_SET_ROI_NONE: lambda _: orders.look_at(flight, None),
            dialect.MAV_CMD_DO_SET_ROI: self._set_roi,
            dialect.MAV_CMD_INJECT_FAILURE: self._inject,
            dialect.MAV_CMD_RUN_PREARM_CHECKS: self._check,
            dialect.MAV_CMD_PREFLIGHT_STORAGE: self._store,
        }

    def _take_off(self, message: Any) -> Result:
        """Home of a landed vehicle is where it stands, whatever was set before."""
        flight = self._flight
        home_ned = flight.motion.position_ned if flight.landed else flight.home_ned
        return flight.take_off(self._height_above(home_ned, message))

    def _height_above(self, home_ned: Vector, message: Any) -> float | None:
        """The height (m) above home that a command's altitude is; None if it is unset."""
        altitude = _altitude(message)
        if not math.isfinite(altitude):
            return None
        if _is_int(message) and message.frame in ABOVE_HOME:
            return altitude
        return altitude - self._origin[2] + home_ned[2]

    # --- modes and arming ---

    def set_mode(self, base_mode: int, main: int, sub: int) -> Result:
        """By PX4's numbers of modes, or by the flags of `base_mode` alone."""
        if base_mode < 0:
            return Result.DENIED
        if base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            mode = Mode.numbered(main, sub)
        else:
            mode = next((mode for flags, mode in _BASE_MODES if base_mode & flags == flags), None)
        if mode is not None:
            return self._flight.set_mode(mode)
        self._flight.announce(Severity.CRITICAL, f"Mode {main}/{sub} is not available")
        return Result.DENIED

    def _set_standard_mode(self, message: Any) -> Result:
        mode = _MODE_BY_STANDARD.get(whole(message.param1))
        return Result.FAILED if mode is None else self._flight.set_mode(mode)

    def _arm_disarm(self, message: Any) -> Result:
        force = message.param2 == FORCE
        match whole(message.param1):
            case 1:
                return self._flight.arm(force=force)
            case 0:
                return self._flight.disarm(force=force)
        return Result.UNSUPPORTED

    def _check(self, _: Any) -> Result:
        """Say what speaks against arming; accepted in either case, as by PX4."""
        problem = None if self._flight.armed else self._flight.arming_problem()
        if problem is not None:
            self._flight.announce(Severity.CRITICAL, f"Preflight Fail: {problem}")
        return Result.ACCEPTED

    # --- places ---

    def _reposition(self, message: Any) -> Result:
        """Fly to a place on earth and hold there. A value that is unset stays as it is. As for PX4, the flag to change
        the mode must be set, and no other."""
        if whole(message.param2) != dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE:
            return Result.UNSUPPORTED
        target = self._target(message)
        if target is None:
            return self._flight.refuse("Reposition rejected: no such place", Result.DENIED)
        speed = message.param1 if math.isfinite(message.param1) and message.param1 > 0.0 else None
        return orders.reposition(self._flight, target, _given(message.param4), speed)

    def _orbit(self, message: Any) -> Result:
        """About a place on earth; what is unset is as in the orbit that is flown, or that of the mode."""
        flight = self._flight
        before = flight.guidance.circle or Circle(flight.motion.position_ned)
        center = self._over_sea(message, before.center_ned)
        if center is None:
            return flight.refuse("Orbit rejected: no such place", Result.DENIED)
        radius, speed = _given(message.param1), _given(message.param2)
        return orders.orbit(
            flight,
            Circle(
                center,
                before.radius_m if radius is None else radius,
                before.speed_m_s if speed is None else abs(speed),
                round(message.param3) if math.isfinite(message.param3) else FACE_CENTER,
            ),
        )

    def _change_altitude(self, message: Any) -> Result:
        """Climb or descend to an altitude above mean sea level, or above home, where the vehicle is."""
        flight, altitude = self._flight, message.param1
        north, east, down = flight.guidance.stopping_point(flight.motion, landed=flight.landed)
        if math.isfinite(altitude):
            above_home = whole(message.param2) in ABOVE_HOME
            down = flight.home_ned[2] - altitude if above_home else self._origin[2] - altitude
        return orders.reposition(flight, (north, east, down), None, None)

    def _set_home(self, message: Any) -> Result:
        if message.param1 > 0.5:
            return orders.set_home(self._flight, self._flight.motion.position_ned)
        home = self._over_sea(message, (math.nan,) * 3)
        if home is None or any(map(math.isnan, home)):
            return self._flight.refuse("Home rejected: no such place", Result.DENIED)
        return orders.set_home(self._flight, home)

    def _over_sea(self, message: Any, else_ned: Vector) -> Vector | None:
        """Where a command's place is (m), its altitude above mean sea level in any frame, as for PX4 (MAVSDK relies on
        it). What is unset is as in `else_ned`; None if there is no such place."""
        place, altitude = self._horizontal(message), _altitude(message)
        if place is None or math.isinf(altitude):
            return None
        north, east = else_ned[:2] if math.isnan(place[0]) else place
        return north, east, else_ned[2] if math.isnan(altitude) else self._origin[2] - altitude

    def _target(self, message: Any) -> Vector | None:
        """Where a command's place is (m); what is unset is as the vehicle is. None if there is no such place."""
        here, home_ned = self._flight.motion.position_ned, self._flight.home_ned
        place, altitude, height = self._horizontal(message), _altitude(message), self._height_above(home_ned, message)
        if place is None or (height is None and not math.isnan(altitude)):
            return None
        north, east = here[:2] if math.isnan(place[0]) else place
        return north, east, here[2] if height is None else home_ned[2] - height

    def _horizontal(self, message: Any) -> tuple[float, float] | None:
        """North and east (m) of a command's latitude and longitude; NaN if both are unset, None for no place."""
        if _is_int(message):
            if message.frame not in ON_EARTH:
                return None
            given = tuple(math.nan if value == UNSET_E7 else value * 1e-7 for value in (message.x, message.y))
        else:
            given = message.param5, message.param6
        if all(map(math.isnan, given)):
            return math.nan, math.nan
        return horizontal(given[0], given[1], self._origin)

    # --- mission and payload ---

    def _set_mission_current(self, message: Any) -> Result:
        mission, number, anew = self._flight.mission, whole(message.param1), message.param2 == 1.0
        if number == -1:
            number = 0 if anew else mission.current
        if not 0 <= number < len(mission.items):
            return self._flight.refuse(f"Mission item {number} is not in the list", Result.DENIED)
        if anew:
            mission.rewind()
        mission.go_to(number)
        return Result.ACCEPTED

    def _pause_or_continue(self, message: Any) -> Result:
        modes = {0: Mode.HOLD, 1: Mode.MISSION}
        mode = modes.get(whole(message.param1))
        return Result.DENIED if mode is None else self._flight.set_mode(mode)

    def _look_at(self, message: Any) -> Result:
        place = self._horizontal(message)
        if place is None or math.isnan(place[0]):
            return self._flight.refuse("ROI rejected: no such place", Result.DENIED)
        return orders.look_at(self._flight, place)

    def _set_roi(self, message: Any) -> Result:
        match whole(message.param1):
            case dialect.MAV_ROI_LOCATION:
                return self._look_at(message)
            case dialect.MAV_ROI_NONE:
                return orders.look_at(self._flight, None)
        return Result.DENIED

    def _inject(self, message: Any) -> Result:
        instance = 0 if math.isnan(message.param3) else whole(message.param3)
        result = self._actions.inject(whole(message.param1), whole(message.param2), instance)
        if result is Result.DENIED:
            return self._flight.refuse("Failure injection rejected: SYS_FAILURE_EN is 0", result)
        return result

    def _store(self, message: Any) -> Result:
        """Parameters. 0, read, and 1, write: there is nothing to do, since each change is kept at once. 2: reset."""
        if self._flight.armed:
            return self._flight.refuse("Parameters: not while armed")
        match whole(message.param1):
            case 0 | 1:
                return Result.ACCEPTED
            case 2:
                self._reset_parameters()
                return Result.ACCEPTED
        return Result.DENIED

    def _gripper(self, message: Any) -> Result:
        match whole(message.param2):
            case dialect.GRIPPER_ACTION_RELEASE:
                self._open_gripper()
            case dialect.GRIPPER_ACTION_GRAB:
                self._flight.announce(Severity.INFO, "Gripper closed")
            case _:
                return Result.DENIED
        return Result.ACCEPTED  # also the second time: it may be the same command, sent again for lack of an answer

    def _open_gripper(self) -> bool:
        released = self._actions.release()
        self._flight.announce(Severity.INFO, "Parcel released" if released else "Gripper: no parcel left")
        return released


def _is_int(message: Any) -> bool:
    return bool(message.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_INT)


def _altitude(message: Any) -> float:
    value: float = message.z if _is_int(message) else message.param7
    return value
