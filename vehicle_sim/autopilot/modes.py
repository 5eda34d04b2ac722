"""Flight modes, what changes them by itself, and the MAVLink enumerations of the vehicle's answers."""

from enum import Enum, IntEnum


class Flies(Enum):
    """What a mode makes the vehicle follow."""

    TARGET = "a target of its own"
    MISSION = "the uploaded mission"
    SETPOINTS = "the setpoints of a companion"
    STICKS = "a pilot's sticks"
    NOTHING = "nothing: the motors are off"


class Mode(Enum):
    """Main and sub mode as PX4 numbers them, PX4's name, what is flown, MAV_STANDARD_MODE, and whether one can arm."""

    MANUAL = (1, 0, "Manual", Flies.STICKS, 0, True)
    ALTITUDE = (2, 0, "Altitude", Flies.STICKS, 4, True)
    POSITION = (3, 0, "Position", Flies.STICKS, 1, True)
    ORBIT = (3, 1, "Orbit", Flies.TARGET, 2, False)
    TAKEOFF = (4, 2, "Takeoff", Flies.TARGET, 8, True)
    HOLD = (4, 3, "Hold", Flies.TARGET, 0, True)
    MISSION = (4, 4, "Mission", Flies.MISSION, 6, True)
    RETURN = (4, 5, "Return", Flies.TARGET, 5, False)
    LAND = (4, 6, "Land", Flies.TARGET, 7, False)
    DESCEND = (4, 6, "Descend", Flies.TARGET, 0, False)
    ACRO = (5, 0, "Acro", Flies.STICKS, 0, True)
    OFFBOARD = (6, 0, "Offboard", Flies.SETPOINTS, 0, True)
    STABILIZED = (7, 0, "Stabilized", Flies.STICKS, 0, True)
    TERMINATION = (10, 0, "Termination", Flies.NOTHING, 0, False)

    def __init__(self, main: int, sub: int, label: str, flies: Flies, standard: int, arms: bool) -> None:
        self.main = main
        self.sub = sub
        self.label = label
        self.flies = flies
        self.standard = standard
        """MAV_STANDARD_MODE; 0: none of them."""
        self.arms = arms
        """The vehicle can be armed in this mode."""

    @property
    def custom_mode(self) -> int:
        """HEARTBEAT's custom_mode."""
        return self.main << 16 | self.sub << 24

    @classmethod
    def numbered(cls, main: int, sub: int) -> "Mode | None":
        """The mode that PX4 enters for these numbers, None if there is none; the sub mode counts in AUTO alone."""
        if (main, sub) == (_AUTO, 0):
            return cls.MISSION
        wanted = main, sub if main == _AUTO else 0
        return next((mode for mode in cls if (mode.main, mode.sub) == wanted and mode.is_selectable), None)

    @property
    def is_selectable(self) -> bool:
        """A user can ask for it."""
        return self.flies is not Flies.NOTHING and self is not Mode.DESCEND

    @property
    def needs_position(self) -> bool:
        """It can't be flown without an estimate of the position."""
        return self is Mode.POSITION or (self.flies in (Flies.TARGET, Flies.MISSION) and self is not Mode.DESCEND)


_AUTO = 4
"""Main mode of all modes that fly by themselves."""


class Trigger(Enum):
    """What can change the mode without a command."""

    STREAM_LOST = "no setpoint for some time"
    STILL_LOST = "some time in hold without a command after the stream was lost: land"
    STILL_LOST_RETURN = "some time in hold without a command after the stream was lost: return"
    LINK_LOST = "no heartbeat for some time: land"
    LINK_LOST_RETURN = "no heartbeat for some time: return"
    STICKS_LOST = "no sticks for some time"
    FENCE_BREACHED = "beyond the fence: hold"
    FENCE_BREACHED_RETURN = "beyond the fence: return"
    FENCE_BREACHED_TERMINATE = "beyond the fence: stop the motors"
    FENCE_BREACHED_LAND = "beyond the fence: land"
    MISSION_FINISHED = "no item is left"
    MISSION_RETURNS = "an item of the mission is the return"
    CLIMBED = "at the take-off height"
    ABOVE_HOME = "above home"
    DISARMED = "motors off"
    POSITION_LOST = "no position to fly by"
    BATTERY_HOLDS = "a low battery: hold first"
    BATTERY_RETURNS = "a low battery: return"
    BATTERY_LANDS = "a low battery: land"
    ATTITUDE_FAILED = "too much tilt"
    ATTITUDE_FAILED_EARLY = "too much tilt just after arming"


_BEYOND_FENCE = {
    Trigger.FENCE_BREACHED: (Mode.HOLD, "holding"),
    Trigger.FENCE_BREACHED_RETURN: (Mode.RETURN, "returning"),
    Trigger.FENCE_BREACHED_TERMINATE: (Mode.TERMINATION, "motors stop"),
    Trigger.FENCE_BREACHED_LAND: (Mode.LAND, "landing"),
}
"""The mode that follows, and what is said."""
FAILSAFES = frozenset(
    {
        Trigger.STREAM_LOST,
        Trigger.LINK_LOST,
        Trigger.LINK_LOST_RETURN,
        Trigger.STICKS_LOST,
        *_BEYOND_FENCE,
        Trigger.POSITION_LOST,
        Trigger.BATTERY_HOLDS,
        Trigger.BATTERY_RETURNS,
        Trigger.BATTERY_LANDS,
        Trigger.ATTITUDE_FAILED,
    }
)
"""Triggers that stand for something that is wrong."""


class Severity(IntEnum):
    """MAV_SEVERITY."""

    EMERGENCY = 0
    CRITICAL = 2
    WARNING = 4
    INFO = 6


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


class LandedState(IntEnum):
    """MAV_LANDED_STATE."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


_ENDING = (Mode.RETURN, Mode.LAND, Mode.DESCEND, Mode.TERMINATION)
"""Modes that end the flight: a low battery changes none of them for one that takes longer."""

TRANSITIONS: dict[tuple[Mode, Trigger], tuple[Mode, Severity, str]] = {
    (Mode.OFFBOARD, Trigger.STREAM_LOST): (Mode.HOLD, Severity.CRITICAL, "Failsafe: offboard stream lost, holding"),
    (Mode.HOLD, Trigger.STILL_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: offboard stream lost, landing"),
    (Mode.HOLD, Trigger.STILL_LOST_RETURN): (
        Mode.RETURN,
        Severity.CRITICAL,
        "Failsafe: offboard stream lost, returning",
    ),
    (Mode.HOLD, Trigger.LINK_LOST): (Mode.LAND, Severity.CRITICAL, "Failsafe: no heartbeat, landing"),
    (Mode.HOLD, Trigger.LINK_LOST_RETURN): (Mode.RETURN, Severity.CRITICAL, "Failsafe: no heartbeat, returning"),
    (Mode.TAKEOFF, Trigger.CLIMBED): (Mode.HOLD, Severity.INFO, "Takeoff height reached, holding"),
    (Mode.RETURN, Trigger.ABOVE_HOME): (Mode.LAND, Severity.INFO, "Home reached, landing"),
    (Mode.TAKEOFF, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.RETURN, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.LAND, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    (Mode.MISSION, Trigger.MISSION_FINISHED): (Mode.HOLD, Severity.INFO, "Mission finished, holding"),
    (Mode.MISSION, Trigger.MISSION_RETURNS): (Mode.RETURN, Severity.INFO, "Mission: returning"),
    (Mode.ORBIT, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    **{
        (mode, Trigger.STICKS_LOST): (Mode.RETURN, Severity.CRITICAL, "Failsafe: manual control lost, returning")
        for mode in Mode
        if mode.flies is Flies.STICKS
    },
    **{
        (mode, trigger): (following, Severity.CRITICAL, f"Failsafe: geofence breached, {what}")
        for trigger, (following, what) in _BEYOND_FENCE.items()
        for mode in Mode
        if mode not in _ENDING
    },
    (Mode.DESCEND, Trigger.DISARMED): (Mode.HOLD, Severity.INFO, "Disarmed, mode hold"),
    **{
        (mode, Trigger.POSITION_LOST): (Mode.DESCEND, Severity.CRITICAL, "Failsafe: no position, descending")
        for mode in Mode
        if mode is not Mode.DESCEND
    },
    **{
        (mode, trigger): (to, Severity.CRITICAL, f"Failsafe: low battery, {text}")
        for trigger, to, text in (
            (Trigger.BATTERY_HOLDS, Mode.HOLD, "holding"),
            (Trigger.BATTERY_RETURNS, Mode.RETURN, "returning"),
            (Trigger.BATTERY_LANDS, Mode.LAND, "landing"),
        )
        for mode in Mode
        if mode not in _ENDING or (mode, to) == (Mode.RETURN, Mode.LAND)
    },
    **{
        (mode, Trigger.ATTITUDE_FAILED): (Mode.TERMINATION, Severity.EMERGENCY, "Failsafe: attitude, terminating")
        for mode in Mode
        if mode is not Mode.TERMINATION
    },
}
"""All changes of mode without a command: the next mode and what is said. None of them enters OFFBOARD."""
