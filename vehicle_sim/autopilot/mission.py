"""The uploaded mission: which items there are, and how each of them is flown, one row of a table each."""

import math
from collections.abc import Callable
from typing import NamedTuple

from protocol.arrays import Vector
from protocol.messages import dialect
from vehicle_sim.autopilot.circle import ALONG, Circle
from vehicle_sim.autopilot.guidance import Guidance
from vehicle_sim.autopilot.modes import Mode, Trigger
from vehicle_sim.autopilot.plan import Item, Place
from vehicle_sim.autopilot.settings import Settings
from vehicle_sim.autopilot.tracking import course, turned
from vehicle_sim.physics.motion import Motion
from vehicle_sim.timing import TICK_S

_FACING = math.radians(5.0)
_COURSE_M = 1.0
"""The heading follows the course as far as this before the target."""
_TURNS_M_S = 2.0
"""Speed on a circle."""


class Kind(NamedTuple):
    """A kind of item."""

    placed: bool
    """It takes a place on earth, in a global frame; the others come in the frame MISSION."""
    start: "Callable[[Mission, Item], None]"
    done: "Callable[[Mission, Item], bool]"
    needs: tuple[int, ...] = ()
    """Numbers (from 1) of the parameters that must be given."""


class Mission:
    """Flies the items one after the other, through the guidance."""

    def __init__(self, settings: Settings, guidance: Guidance, motion: Motion) -> None:
        self._settings = settings
        self._guidance = guidance
        self._motion = motion
        self._home_ned: Vector = motion.position_ned
        self._landed = True
        self.items: tuple[Item, ...] = ()
        self.current = 0
        self.finished = False
        self._begun = False
        """The current item has been started."""
        self.reached: list[int] = []
        """Numbers of the items that are done, until MISSION_ITEM_REACHED has said so."""
        self.release: Callable[[], bool] = lambda: False
        """Opens the gripper."""
        self.phase = Mode.HOLD
        """What is being flown: TAKEOFF, LAND, or HOLD for everything else."""
        self._speed_m_s: float | None = None
        self.interest: Place | None = None
        """The nose points there."""
        self._yaw: float | None = None
        self._since_ns: int | None = None
        """When the item's place was reached, or its time began."""
        self._jumps: dict[int, int] = {}

    def load(self, items: tuple[Item, ...]) -> None:
        """Take a new mission, from its first item on."""
        self.items = items
        self.rewind()

    def rewind(self) -> None:
        """Back to the first item."""
        self.current = 0
        self.finished = self._begun = False
        self._jumps, self._speed_m_s, self.interest = {}, None, None

    def disarm(self) -> None:
        """The motors stop: the item begins anew when they start, or the mission if it was finished."""
        self._begun = False
        if self.finished:
            self.rewind()

    def go_to(self, number: int) -> bool:
        """Go on with an item; False if there is none with this number."""
        if not 0 <= number < len(self.items):
            return False
        self.current, self.finished, self._begun = number, False, False
        return True

    def problem(self) -> str | None:
        """Why the mission can't be flown, or None."""
        return None if self.items else "no mission"

    # --- flying ---

    def start(self, motion: Motion, home_ned: Vector, *, landed: bool) -> None:
        """Begin, or go on after a pause."""
        self._motion, self._home_ned, self._landed = motion, home_ned, landed
        self._begun = False
        self._enter(Mode.HOLD)

    def update(self, motion: Motion, home_ned: Vector, *, landed: bool) -> Trigger | None:
        """Fly one tick; tells when another mode must follow."""
        self._motion, self._home_ned, self._landed = motion, home_ned, landed
        if self.finished or not self.items:
            return None if landed else Trigger.MISSION_FINISHED
        if not self._begun:
            self._begin()
        arrival = self._guidance.update(self.phase, motion, home_ned, landed=landed)
        if self.phase is Mode.TAKEOFF:
            if arrival is not None:
                self._begin()
            return None
        item = self.items[self.current]
        if item.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            self._advance(item)
            return Trigger.MISSION_RETURNS
        if not KINDS[item.command].done(self, item):
            self._steer()
        elif item.autocontinue or item.place is None:
            self._advance(item)
        return None

    def _advance(self, item: Item) -> None:
        self.reached.append(self.current)
        following = self.current + 1
        if item.command == dialect.MAV_CMD_DO_JUMP:
            following = self._jump(item)
        if following < len(self.items):
            self.current = following
            self._begin()
        else:
            self.finished = True

    def _jump(self, item: Item) -> int:
        """The number of the item after a jump, which is made as often as it says (-1: always)."""
        made, repeats = self._jumps.get(self.current, 0), int(item.params[1])
        if 0 <= repeats <= made or not 0 <= item.params[0] < len(self.items):
            return self.current + 1
        self._jumps[self.current] = made + 1
        return int(item.params[0])

    def _begin(self) -> None:
        item = self.items[self.current]
        self._begun, self._since_ns, self._yaw = True, None, None
        must_fly = item.is_flown_to and item.command != dialect.MAV_CMD_NAV_LAND
        if self._landed and must_fly and item.place is not None:
            north, east, down = self._motion.position_ned
            top = min(item.place.ned(self._home_ned)[2], down - self._settings.auto.takeoff_height_m)
            if item.command == dialect.MAV_CMD_NAV_TAKEOFF:
                top = min(item.place.ned(self._home_ned)[2], down - self._settings.height_acceptance_m)
            self._guidance.takeoff_ned = (north, east, top)
            self._enter(Mode.TAKEOFF)
            return
        if self._guidance.circle is not None or self.phase is not Mode.HOLD:
            self._enter(Mode.HOLD)
        KINDS[item.command].start(self, item)

    def _enter(self, phase: Mode) -> None:
        self.phase = phase
        self._guidance.start(phase, self._motion, self._home_ned, landed=self._landed)
        self._limit_speed()

    def limit_speed(self, speed_m_s: float | None) -> None:
        """Fly at most this fast, also on the way to the following items; None: as the vehicle file says."""
        self._speed_m_s = speed_m_s
        self._limit_speed()

    def _limit_speed(self) -> None:
        self._guidance.limit_horizontal_speed(math.inf if self._speed_m_s is None else self._speed_m_s)

    def _steer(self) -> None:
        """Turn the nose: to what is of interest, as the item says, or along the way."""
        here, now = self._motion.position_ned, float(self._guidance.command["yaw"][0])
        wanted = self._yaw
        target: list[float] = self._guidance.command["position_ned"][0].tolist()
        if self.interest is not None:
            wanted = course(here, (self.interest.north, self.interest.east))
        elif wanted is None and math.dist(here[:2], target[:2]) > _COURSE_M:
            wanted = course(here, (target[0], target[1]))
        if wanted is not None:
            self._guidance.turn(turned(now, wanted, math.radians(self._settings.yaw_rate_deg_s) * TICK_S))

    # --- how items begin ---

    def _target(self, item: Item) -> Vector:
        """The item's place (m); where the vehicle is if the item does not say."""
        assert item.place is not None, "a kind of item that is placed is uploaded with a place"
        north, east, down = item.place.ned(self._home_ned)
        here = self._motion.position_ned
        return (here[0], here[1], down) if math.isnan(north) else (north, east, down)

    def _go(self, item: Item) -> None:
        self._guidance.aim(self._target(item))
        if math.isfinite(item.params[3]):
            self._yaw = math.radians(item.params[3])

    def _land(self, item: Item) -> None:
        """First to the place, at the present height."""
        north, east, _ = self._target(item)
        if not self._landed:
            self._guidance.aim((north, east, self._motion.position_ned[2]))

    def _go_round(self, item: Item) -> None:
        radius = item.params[2] if math.isfinite(item.params[2]) and item.params[2] != 0.0 else _TURNS_M_S
        speed = _TURNS_M_S if self._speed_m_s is None else self._speed_m_s
        self._guidance.go_round(Circle(self._target(item), radius, speed, ALONG), self._motion)

    def _face(self, item: Item) -> None:
        """CONDITION_YAW: a heading (degrees), or a turn to a side from the present one."""
        self._yaw = math.radians(item.params[0])
        if item.params[3] > 0.0:
            self._yaw = self._motion.yaw + math.copysign(self._yaw, item.params[2] or 1.0)

    def _look_at(self, item: Item) -> None:
        self.interest = item.place

    def _change_speed(self, item: Item) -> None:
        self.limit_speed(item.params[1] if item.params[1] > 0.0 else None)

    def _grip(self, item: Item) -> None:
        if item.params[1] == dialect.GRIPPER_ACTION_RELEASE:
            self.release()

    def _do_nothing(self, item: Item) -> None:
        pass

    # --- when items end ---

    def _is_there(self, item: Item) -> bool:
        radius = self._settings.acceptance_m
        if item.command == dialect.MAV_CMD_NAV_WAYPOINT and item.params[1] > 0.0:
            radius = item.params[1]
        here, target = self._motion.position_ned, self._target(item)
        return (
            math.dist(here[:2], target[:2]) <= radius and abs(here[2] - target[2]) <= self._settings.height_acceptance_m
        )

    def _has_waited(self, item: Item) -> bool:
        """For the seconds of its first parameter."""
        now_ns = self._motion.time_ns
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        return now_ns - self._since_ns >= (item.params[0] if item.params[0] > 0.0 else 0.0) * 1e9

    def _is_held(self, item: Item) -> bool:
        return (self._since_ns is not None or self._is_there(item)) and self._has_waited(item)

    def _has_turned(self, item: Item) -> bool:
        circle = self._guidance.circle
        return circle is None or circle.turned >= item.params[0] * math.tau

    def _is_facing(self, item: Item) -> bool:
        return self._yaw is None or abs(math.remainder(self._yaw - self._motion.yaw, math.tau)) < _FACING

    def _is_landed(self, item: Item) -> bool:
        if self.phase is not Mode.LAND and not self._landed:
            if math.dist(self._motion.position_ned[:2], self._target(item)[:2]) < self._settings.acceptance_m:
                self._enter(Mode.LAND)
                north, east, _ = self._target(item)
                below = float(self._guidance.command["position_ned"][0][2])
                self._guidance.aim((north, east, below))
            return False
        return self._landed

    def _never(self, item: Item) -> bool:
        return False

    def _at_once(self, item: Item) -> bool:
        return True


_DELAY = Kind(False, Mission._do_nothing, Mission._has_waited, needs=(1,))
_FOR_OTHER_PARTS = (
    dialect.MAV_CMD_DO_SET_ACTUATOR,
    dialect.MAV_CMD_DO_CONTROL_VIDEO,
    dialect.MAV_CMD_DO_DIGICAM_CONTROL,
    dialect.MAV_CMD_DO_MOUNT_CONFIGURE,
    dialect.MAV_CMD_DO_MOUNT_CONTROL,
    dialect.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
    dialect.MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL,
    dialect.MAV_CMD_OBLIQUE_SURVEY,
    dialect.MAV_CMD_SET_CAMERA_MODE,
    dialect.MAV_CMD_SET_CAMERA_ZOOM,
    dialect.MAV_CMD_SET_CAMERA_FOCUS,
    dialect.MAV_CMD_SET_CAMERA_SOURCE,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
    dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
    dialect.MAV_CMD_IMAGE_START_CAPTURE,
    dialect.MAV_CMD_IMAGE_STOP_CAPTURE,
    dialect.MAV_CMD_DO_TRIGGER_CONTROL,
    dialect.MAV_CMD_VIDEO_START_CAPTURE,
    dialect.MAV_CMD_VIDEO_STOP_CAPTURE,
    dialect.MAV_CMD_DO_WINCH,
)
"""What PX4 takes for cameras, gimbals, winches and actuators, whether they are there or not. Here they are not."""
KINDS: dict[int, Kind] = dict.fromkeys(_FOR_OTHER_PARTS, Kind(False, Mission._do_nothing, Mission._at_once)) | {
    dialect.MAV_CMD_NAV_WAYPOINT: Kind(True, Mission._go, Mission._is_held),
    dialect.MAV_CMD_NAV_LOITER_UNLIM: Kind(True, Mission._go, Mission._never),
    dialect.MAV_CMD_NAV_LOITER_TURNS: Kind(True, Mission._go_round, Mission._has_turned, needs=(1,)),
    dialect.MAV_CMD_NAV_LOITER_TIME: Kind(True, Mission._go, Mission._is_held),
    dialect.MAV_CMD_NAV_LOITER_TO_ALT: Kind(True, Mission._go, Mission._is_there),
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: Kind(False, Mission._do_nothing, Mission._never),
    dialect.MAV_CMD_NAV_LAND: Kind(True, Mission._land, Mission._is_landed),
    dialect.MAV_CMD_NAV_TAKEOFF: Kind(True, Mission._go, Mission._is_there),
    dialect.MAV_CMD_NAV_DELAY: _DELAY,
    dialect.MAV_CMD_CONDITION_DELAY: _DELAY,
    dialect.MAV_CMD_CONDITION_YAW: Kind(False, Mission._face, Mission._is_facing, needs=(1, 3, 4)),
    dialect.MAV_CMD_DO_JUMP: Kind(False, Mission._do_nothing, Mission._at_once, needs=(1, 2)),
    dialect.MAV_CMD_DO_CHANGE_SPEED: Kind(False, Mission._change_speed, Mission._at_once, needs=(2,)),
    dialect.MAV_CMD_DO_LAND_START: Kind(False, Mission._do_nothing, Mission._at_once),
    dialect.MAV_CMD_DO_SET_ROI_LOCATION: Kind(True, Mission._look_at, Mission._at_once),
    dialect.MAV_CMD_DO_SET_ROI_NONE: Kind(False, Mission._look_at, Mission._at_once),
    dialect.MAV_CMD_DO_GRIPPER: Kind(False, Mission._grip, Mission._at_once, needs=(2,)),
}
"""By MAV_CMD. What is not here is refused at the upload."""
